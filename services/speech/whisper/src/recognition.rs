//! Recognition that knows the commands: the likeliest sentence of a list, where it is nearly as likely as free text.

use std::sync::atomic::AtomicBool;

use crate::error::WhisperError;
use crate::free_decoding::Transcript;
use crate::model::{Hearing, Whisper};
use crate::options::Options;
use crate::phrase_scoring::PhraseSearch;
use crate::phrases::Phrases;

/// When a sentence of the list is taken for what was said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acceptance {
    /// Least log-likelihood ratio to free text for each token of the sentence.
    pub least_ratio: f32,
}

impl Default for Acceptance {
    fn default() -> Self {
        Self { least_ratio: -1.0 }
    }
}

/// What a recognition is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A sentence of the list, by its place.
    Command(usize),
    /// Free text.
    Free,
}

/// A sentence of the list, whether it was accepted or not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Place of the sentence in the list.
    pub sentence: usize,
    /// Natural logarithm of its probability.
    pub log_probability: f32,
    /// Log-likelihood ratio to free text, for each of its tokens. 0 where it is as likely as free text.
    pub ratio: f32,
}

/// What was said.
#[derive(Clone, Debug, PartialEq)]
pub struct Recognition {
    /// The sentence of the list, or free text.
    pub text: String,
    /// Which of the two.
    pub source: Source,
    /// The likeliest sentence of the list, if any was followed to its end.
    pub best: Option<Candidate>,
    /// How much less likely the second sentence is (natural logarithm), if there is one.
    pub lead: Option<f32>,
    /// Free text.
    pub free: Transcript,
}

impl Whisper {
    /// What was said: the likeliest sentence of a list if it is nearly as likely as free text, else free text.
    ///
    /// # Errors
    /// As [`Whisper::transcribe`] and [`Whisper::score`].
    pub fn recognize(
        &self,
        hearing: &Hearing,
        phrases: &Phrases,
        search: PhraseSearch,
        acceptance: Acceptance,
        options: &Options,
        cancel: &AtomicBool,
    ) -> Result<Recognition, WhisperError> {
        let options = Options { timestamps: false, ..options.clone() };
        let mut start = self.start(hearing, &options)?;
        let free = self.decode_freely(hearing, &mut start, &options, cancel)?;
        let scores = self.score_phrases(hearing, &mut start, phrases, search, f32::NEG_INFINITY, cancel)?;
        let best = scores.first().map(|best| {
            let tokens = phrases.lengths[best.sentence];
            let ratio = (best.log_probability - free.log_probability) / tokens as f32;
            Candidate { sentence: best.sentence, log_probability: best.log_probability, ratio }
        });
        let lead = scores.get(1).map(|second| scores[0].log_probability - second.log_probability);
        let accepted = best.filter(|best| best.ratio >= acceptance.least_ratio);
        let (text, source) = match accepted {
            Some(best) => (phrases.sentences()[best.sentence].clone(), Source::Command(best.sentence)),
            None => (free.text.clone(), Source::Free),
        };
        Ok(Recognition { text, source, best, lead, free })
    }
}
