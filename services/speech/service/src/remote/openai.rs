//! OpenAI's protocol for speech: `audio/transcriptions` and `audio/speech`. Many servers speak it.

use std::time::Instant;

use sg_endpoint::{CallError, Endpoint, HttpClient, Part};
use sg_speech::audio::wav::{decode_streamed_wav, encode_wav};
use sg_speech::audio::{Recording, SPEECH_RATE};
use sg_speech::child_process::Limits;
use sg_speech::error::SpeechError;
use sg_speech::phrases::PhraseGrammar;
use sg_speech::recognizer::{Recognition, Recognizer, Synthesizer, has_voice};
use supergaussian_speech::transcription::Transcription;
use tokio::runtime::Handle;

use super::{
    LONGEST, MAX_SOUND_BYTES, MAX_TEXT_BYTES, Server, ServerError, ServerParams, check_name, names, recognition,
    silence_of,
};

/// A server that speaks OpenAI's protocol.
pub(crate) struct OpenAi {
    server: Server,
    client: HttpClient,
    language: String,
    voice: String,
}

impl OpenAi {
    /// A recognizer. `language`: its code, such as `en`, or empty.
    ///
    /// # Errors
    /// [`ServerError`].
    pub(crate) fn recognizer(params: &ServerParams, language: &str, runtime: &Handle) -> Result<Self, ServerError> {
        check_name("language", language)?;
        let (server, key) = params.openai("whisper-1", runtime)?;
        let client = HttpClient::new(&server.endpoint, key)?;
        Ok(Self { server, client, language: language.to_owned(), voice: String::new() })
    }

    /// A synthesizer with a voice as the server names it; `alloy` without one.
    ///
    /// # Errors
    /// [`ServerError`].
    pub(crate) fn synthesizer(params: &ServerParams, voice: &str, runtime: &Handle) -> Result<Self, ServerError> {
        check_name("voice", voice)?;
        let (server, key) = params.openai("tts-1", runtime)?;
        let client = HttpClient::new(&server.endpoint, key)?;
        let voice = if voice.is_empty() { "alloy" } else { voice };
        Ok(Self { server, client, language: String::new(), voice: voice.to_owned() })
    }

    /// Where it is.
    pub(crate) fn endpoint(&self) -> Endpoint {
        self.server.endpoint.clone()
    }

    /// The form of an utterance.
    fn form(&self, sound: &[u8], phrases: &PhraseGrammar) -> Vec<Part> {
        let mut parts = vec![
            Part::File { name: "file", file_name: "utterance.wav", media_type: "audio/wav", bytes: sound.to_vec() },
            Part::Text { name: "model", value: self.server.model.clone() },
            Part::Text { name: "temperature", value: "0".to_owned() },
        ];
        // Only Whisper states probabilities of segments. Other models of OpenAI state those of tokens, and know no other format.
        if self.server.model.contains("whisper") {
            parts.push(Part::Text { name: "response_format", value: "verbose_json".to_owned() });
        } else {
            parts.push(Part::Text { name: "response_format", value: "json".to_owned() });
            parts.push(Part::Text { name: "include[]", value: "logprobs".to_owned() });
        }
        let names: Vec<&str> = names(phrases).collect();
        if !names.is_empty() {
            parts.push(Part::Text { name: "prompt", value: format!("{}.", names.join(", ")) });
        }
        if !self.language.is_empty() {
            parts.push(Part::Text { name: "language", value: self.language.clone() });
        }
        parts
    }
}

impl Recognizer for OpenAi {
    fn name(&self) -> &'static str {
        self.server.name
    }

    fn recognize(
        &mut self,
        samples: &[f32],
        phrases: &PhraseGrammar,
        limits: &Limits,
    ) -> Result<Recognition, SpeechError> {
        let began = Instant::now();
        if !has_voice(samples) {
            return Ok(Recognition::default());
        }
        let sound = encode_wav(&Recording { rate: SPEECH_RATE, samples: samples.to_vec() });
        let sound = sound.map_err(SpeechError::Limit)?;
        let heard = self.server.wait(limits, || async {
            let form = self.form(&sound, phrases);
            Transcription::parse(&self.client.post_form("audio/transcriptions", form, MAX_TEXT_BYTES).await?)
        })?;
        Ok(recognition(heard.text(), heard.confidence(), phrases, began))
    }
}

impl Synthesizer for OpenAi {
    fn name(&self) -> &'static str {
        self.server.name
    }

    fn synthesize(&self, sentence: &str, limits: &Limits) -> Result<Recording, SpeechError> {
        if let Some(silence) = silence_of(sentence) {
            return Ok(silence);
        }
        let request = serde_json::json!({
            "model": self.server.model, "voice": self.voice, "input": sentence, "response_format": "wav",
        });
        let request = request.to_string();
        self.server.wait(limits, || async {
            let sound = self.client.post_json("audio/speech", request.clone(), MAX_SOUND_BYTES).await?;
            decode_streamed_wav(sound, LONGEST).map_err(CallError::Invalid)
        })
    }
}
