//! Programs that serve `supergaussian.backend.v1.SpeechBackendService`.

use std::time::Instant;

use sg_endpoint::{CallError, Endpoint, GrpcClient};
use sg_proto::backend::{SynthesizeRequest, SynthesizeResponse, TranscribeRequest, TranscribeResponse};
use sg_speech::audio::pcm::{PcmDecoder, PcmLayout};
use sg_speech::audio::{Recording, SPEECH_RATE, duration_of};
use sg_speech::child_process::Limits;
use sg_speech::error::SpeechError;
use sg_speech::phrases::PhraseGrammar;
use sg_speech::recognizer::{Recognition, Recognizer, Synthesizer, has_voice};
use tokio::runtime::Handle;

use super::{
    LONGEST, MAX_SOUND_BYTES, MAX_TEXT_BYTES, Server, ServerError, ServerParams, check_name, names, recognition,
    silence_of,
};

/// Paths of the methods.
const TRANSCRIBE: &str = "/supergaussian.backend.v1.SpeechBackendService/Transcribe";
const SYNTHESIZE: &str = "/supergaussian.backend.v1.SpeechBackendService/Synthesize";
/// Samples a second that a synthesizer may give.
const RATES: std::ops::RangeInclusive<u32> = 8_000..=48_000;
/// Most expected sentences that are sent.
const MAX_EXPECTED: usize = 2_000;

/// A program that serves over gRPC.
pub(crate) struct Grpc {
    server: Server,
    client: GrpcClient,
    language: String,
    voice: String,
}

impl Grpc {
    /// A recognizer. `language`: its code, such as `en`, or empty.
    ///
    /// # Errors
    /// [`ServerError`].
    pub(crate) fn recognizer(params: &ServerParams, language: &str, runtime: &Handle) -> Result<Self, ServerError> {
        check_name("language", language)?;
        Self::new(params, language, "", runtime)
    }

    /// A synthesizer with a voice as the program names it; empty for its default.
    ///
    /// # Errors
    /// [`ServerError`].
    pub(crate) fn synthesizer(params: &ServerParams, voice: &str, runtime: &Handle) -> Result<Self, ServerError> {
        check_name("voice", voice)?;
        Self::new(params, "", voice, runtime)
    }

    /// Where it is.
    pub(crate) fn endpoint(&self) -> Endpoint {
        self.server.endpoint.clone()
    }

    fn new(params: &ServerParams, language: &str, voice: &str, runtime: &Handle) -> Result<Self, ServerError> {
        let (server, key) = params.grpc(runtime)?;
        let _inside = runtime.enter();
        let client = GrpcClient::new(&server.endpoint, key)?;
        Ok(Self { server, client, language: language.to_owned(), voice: voice.to_owned() })
    }
}

fn milliseconds(time: std::time::Duration) -> u32 {
    u32::try_from(time.as_millis()).unwrap_or(u32::MAX)
}

impl Recognizer for Grpc {
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
        let time = self.server.time(limits);
        let request = TranscribeRequest {
            model: self.server.model.clone(),
            rate: SPEECH_RATE,
            samples: PcmLayout::mono(SPEECH_RATE).encode(samples),
            language: self.language.clone(),
            names: names(phrases).map(str::to_owned).collect(),
            expected: phrases.balanced_sentences(MAX_EXPECTED).into_iter().map(|s| s.written).collect(),
            deadline_ms: milliseconds(time),
        };
        let TranscribeResponse { text, confidence, model: _ } =
            self.server.wait(limits, || self.client.call(TRANSCRIBE, request.clone(), time, MAX_TEXT_BYTES))?;
        // Without a probability the program is taken at its word.
        let confidence = confidence.map_or(1.0, |p| if p.is_finite() { p } else { 0.0 });
        Ok(recognition(&text, confidence, phrases, began))
    }
}

impl Synthesizer for Grpc {
    fn name(&self) -> &'static str {
        self.server.name
    }

    fn synthesize(&self, sentence: &str, limits: &Limits) -> Result<Recording, SpeechError> {
        if let Some(silence) = silence_of(sentence) {
            return Ok(silence);
        }
        let time = self.server.time(limits);
        let request = SynthesizeRequest {
            model: self.server.model.clone(),
            voice: self.voice.clone(),
            text: sentence.to_owned(),
            deadline_ms: milliseconds(time),
        };
        let SynthesizeResponse { rate, samples: bytes } =
            self.server.wait(limits, || self.client.call(SYNTHESIZE, request.clone(), time, MAX_SOUND_BYTES))?;
        if !RATES.contains(&rate) {
            let (least, most) = (RATES.start(), RATES.end());
            let problem = format!("sound of {rate} samples a second; take {least} to {most}");
            return Err(self.server.error(CallError::Invalid(problem)));
        }
        if duration_of(bytes.len() / 2, rate) > LONGEST {
            let problem = format!("a sentence of more than {} s", LONGEST.as_secs());
            return Err(self.server.error(CallError::Invalid(problem)));
        }
        let mut samples = Vec::with_capacity(bytes.len() / 2);
        PcmDecoder::new(PcmLayout::mono(rate)).push(&bytes, &mut samples);
        Ok(Recording { rate, samples })
    }
}
