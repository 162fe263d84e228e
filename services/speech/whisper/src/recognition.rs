//! Recognition that knows the commands: the likeliest sentence of a list, where it is nearly as likely as free text.

use std::sync::atomic::AtomicBool;

use crate::error::WhisperError;
use crate::free_decoding::Transcript;
use crate::model::{Hearing, Whisper};
use crate::options::Options;
use crate::phrase_scoring::{Comparison, PhraseScore, PhraseSearch, TOKEN_BONUS};
use crate::phrases::Phrases;

/// Most tokens of a second of speech. People say 3 to 5.
const TOKENS_OF_SECOND: f32 = 8.0;
/// Further tokens that any sound may have.
const FIRST_TOKENS: usize = 8;

/// When a sentence of the list is taken for what was said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acceptance {
    /// Least log-likelihood ratio to free text (natural logarithm), bonuses included.
    pub least_ratio: f32,
    /// Ratio from which a sentence is taken at once. Below it, the free text is looked for again with the beams of the options.
    pub clear_ratio: f32,
    /// What each token adds to a log-probability: [`TOKEN_BONUS`].
    pub token_bonus: f32,
}

impl Default for Acceptance {
    fn default() -> Self {
        Self { least_ratio: -11.0, clear_ratio: -5.0, token_bonus: TOKEN_BONUS }
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
    /// Log-likelihood ratio to free text (natural logarithm), bonuses included. 0 where it is as likely.
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
    /// How much less likely the second sentence is (natural logarithm, bonuses included), if one was followed to its end.
    pub lead: Option<f32>,
    /// Free text.
    pub free: Transcript,
}

impl Whisper {
    /// Recognizes the likeliest sentence of a list if it is nearly as likely as free text, else free text.
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
        // Nobody speaks faster. A text that repeats itself ends here at the latest.
        let most = FIRST_TOKENS + (TOKENS_OF_SECOND * hearing.seconds) as usize;
        let options = Options { most_tokens: options.most_tokens.min(most), ..options };
        let greedy = Options { beams: 1, ..options.clone() };
        let mut free = self.decode_freely(hearing, &mut start, &greedy, cancel)?;
        let Acceptance { least_ratio, clear_ratio, token_bonus: bonus } = acceptance;
        let with_bonus = |sum: f32, tokens: usize| sum + bonus * tokens as f32;
        let sum_of = |free: &Transcript| with_bonus(free.log_probability, free.tokens.len() + 1);
        let free_sum = sum_of(&free);
        let comparison = Comparison { bonus, least: free_sum + least_ratio };
        let scores = self.score_phrases(hearing, &mut start, phrases, search, comparison, cancel)?;
        let mut sums: Vec<(f32, PhraseScore)> = scores
            .into_iter()
            .map(|score| (with_bonus(score.log_probability, phrases.lengths[score.sentence]), score))
            .collect();
        sums.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        // What fits clearly needs no other text to compare with, and most commands do.
        let is_clear = free.complete && sums.first().is_some_and(|(sum, _)| sum - free_sum >= clear_ratio);
        if options.beams > 1 && !is_clear {
            free = self.decode_freely(hearing, &mut start, &options, cancel)?;
        }
        // Beams choose by the mean of a token, so their text may have a lower sum than the greedy one.
        let free_sum = free_sum.max(sum_of(&free));
        let best = sums.first().map(|(sum, score)| Candidate {
            sentence: score.sentence,
            log_probability: score.log_probability,
            ratio: sum - free_sum,
        });
        let lead = sums.get(1).map(|(second, _)| sums[0].0 - second);
        let accepted = best.filter(|best| best.ratio >= acceptance.least_ratio);
        let (text, source) = match accepted {
            Some(best) => (phrases.sentences()[best.sentence].clone(), Source::Command(best.sentence)),
            None => (free.text.clone(), Source::Free),
        };
        Ok(Recognition { text, source, best, lead, free })
    }
}
