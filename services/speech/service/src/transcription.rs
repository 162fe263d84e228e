//! Answers of servers that transcribe by OpenAI's protocol.

use serde::Deserialize;
use sg_endpoint::CallError;

/// Whisper's own rule for silence: this probability of no speech with less than this mean log-probability.
const NO_SPEECH: (f32, f32) = (0.6, -1.0);

/// An answer of `audio/transcriptions`. Servers state probabilities in one of two ways, or not at all.
#[derive(Debug, Deserialize)]
pub struct Transcription {
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
    /// The answer in a body.
    ///
    /// # Errors
    /// [`CallError::Invalid`] with the place of the mistake.
    pub fn parse(body: &[u8]) -> Result<Self, CallError> {
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

    /// What the server heard; empty for silence.
    #[must_use]
    pub fn text(&self) -> &str {
        if self.is_silence() { "" } else { &self.text }
    }

    /// Geometric mean of the probabilities; 1 where the server states none.
    #[must_use]
    pub fn confidence(&self) -> f32 {
        let tokens = self.logprobs.iter().flatten().map(|token| token.logprob);
        let logs: Vec<f32> = tokens.chain(self.segments.iter().filter_map(|segment| segment.avg_logprob)).collect();
        let mean = logs.iter().sum::<f32>() / logs.len().max(1) as f32;
        if mean.is_finite() { mean.exp() } else { 0.0 }
    }
}
