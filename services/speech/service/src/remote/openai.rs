//! OpenAI's protocol for speech: `audio/transcriptions` and `audio/speech`. Many servers speak it.

use std::time::Instant;

use serde::Deserialize;
use sg_endpoint::{CallError, Endpoint, HttpClient, Part};
use sg_speech::audio::wav::{decode_streamed_wav, encode_wav};
use sg_speech::audio::{Recording, SPEECH_RATE};
use sg_speech::child_process::Limits;
use sg_speech::error::SpeechError;
use sg_speech::phrases::PhraseGrammar;
use sg_speech::recognizer::{Recognition, Recognizer, Synthesizer, has_voice};
use tokio::runtime::Handle;

use super::{
    LONGEST, MAX_SOUND_BYTES, MAX_TEXT_BYTES, Server, ServerError, ServerParams, check_name, names, recognition,
    silence_of,
};

/// Whisper's own rule for silence: this probability of no speech with less than this mean log-probability.
const NO_SPEECH: (f32, f32) = (0.6, -1.0);

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

/// An answer of `audio/transcriptions`. Servers state probabilities in one of two ways, or not at all.
#[derive(Debug, Deserialize)]
struct Transcription {
    text: String,
    #[serde(default)]
    segments: Vec<Segment>,
    #[serde(default)]
    logprobs: Option<Vec<Token>>,
}

#[derive(Debug, Deserialize)]
struct Segment {
    #[serde(default)]
    avg_logprob: Option<f32>,
    #[serde(default)]
    no_speech_prob: Option<f32>,
}

#[derive(Debug, Deserialize)]
struct Token {
    logprob: f32,
}

impl Transcription {
    fn parse(body: &[u8]) -> Result<Self, CallError> {
        // The parser's own message may repeat the answer.
        serde_json::from_slice(body).map_err(|error| {
            let (line, column) = (error.line(), error.column());
            CallError::Invalid(format!("no transcription; the answer is wrong at line {line}, column {column}"))
        })
    }

    /// Whether the server heard no speech.
    fn is_silence(&self) -> bool {
        let (least, most) = NO_SPEECH;
        let silent =
            |s: &Segment| s.no_speech_prob.is_some_and(|p| p > least) && s.avg_logprob.is_some_and(|p| p < most);
        !self.segments.is_empty() && self.segments.iter().all(silent)
    }

    /// Geometric mean of the probabilities; 1 where the server states none.
    fn confidence(&self) -> f32 {
        let tokens = self.logprobs.iter().flatten().map(|token| token.logprob);
        let logs: Vec<f32> = tokens.chain(self.segments.iter().filter_map(|segment| segment.avg_logprob)).collect();
        let mean = logs.iter().sum::<f32>() / logs.len().max(1) as f32;
        if mean.is_finite() { mean.exp() } else { 0.0 }
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
        let text = if heard.is_silence() { "" } else { &heard.text };
        Ok(recognition(text, heard.confidence(), phrases, began))
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
