//! Scores of sentences by the model's own likelihood: the decoder is given each sentence's tokens, and sentences with the same
//! beginning share its cost.

use std::collections::HashMap;
use std::sync::atomic::AtomicBool;

use crate::decoder::{Branch, Node};
use crate::error::WhisperError;
use crate::model::{Hearing, Whisper, check};
use crate::options::Options;
use crate::phrases::Phrases;
use crate::probability::{log_add, log_sum};
use crate::spelling::MOST_SPELLINGS;
use crate::start::Start;

/// Tokens that are decoded together.
const BATCH: usize = 64;

/// What each token of a text adds to its log-probability where texts of different lengths are compared. A decoder that hears badly
/// likes to end early, so without it short sentences win. Calibrated on sentences that no report speaks.
pub const TOKEN_BONUS: f32 = 1.5;

/// Which sentences are followed to their ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PhraseSearch {
    /// All of them: the exact twin of the other.
    Exact,
    /// Of the beginnings of each length, the `beams` likeliest that are at most `margin` (natural logarithm) less likely than the
    /// likeliest of them, and than the likeliest whole sentence so far.
    Beam {
        /// Most beginnings of a length.
        beams: usize,
        /// Most that a beginning may be less likely.
        margin: f32,
    },
}

impl Default for PhraseSearch {
    fn default() -> Self {
        Self::Beam { beams: 24, margin: 10.0 }
    }
}

/// A sentence and how likely it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhraseScore {
    /// Place of the sentence in the list.
    pub sentence: usize,
    /// Natural logarithm of the probability of all its spellings together.
    pub log_probability: f32,
}

/// How a search compares sentences with each other.
#[derive(Clone, Copy)]
pub(crate) struct Comparison {
    /// Added to a log-probability for each token.
    pub(crate) bonus: f32,
    /// Least log-probability with bonuses of a sentence that is accepted.
    pub(crate) least: f32,
}

/// A beginning of sentences.
#[derive(Clone, Copy)]
struct Beginning {
    /// Number of its tokens.
    tokens: usize,
    /// Its last token in the tree of sentences.
    phrase: usize,
    /// The token before it in the decoder's tree.
    parent: Node,
    sum: f32,
}

impl Whisper {
    /// The sentences that were followed to their ends, likeliest first.
    ///
    /// # Errors
    /// [`WhisperError::Option`], and [`WhisperError::Cancelled`] between two batches of tokens.
    pub fn score(
        &self,
        hearing: &Hearing,
        phrases: &Phrases,
        search: PhraseSearch,
        options: &Options,
        cancel: &AtomicBool,
    ) -> Result<Vec<PhraseScore>, WhisperError> {
        let options = Options { timestamps: false, ..options.clone() };
        let mut start = self.start(hearing, &options)?;
        let comparison = Comparison { bonus: TOKEN_BONUS, least: f32::NEG_INFINITY };
        self.score_phrases(hearing, &mut start, phrases, search, comparison, cancel)
    }

    /// As [`Self::score`], behind marks that are decoded. Beginnings that cannot be accepted are not followed.
    pub(crate) fn score_phrases(
        &self,
        hearing: &Hearing,
        start: &mut Start,
        phrases: &Phrases,
        search: PhraseSearch,
        comparison: Comparison,
        cancel: &AtomicBool,
    ) -> Result<Vec<PhraseScore>, WhisperError> {
        if let PhraseSearch::Beam { beams, margin } = search
            && (beams == 0 || margin.is_nan() || margin < 0.0)
        {
            let problem = format!("{beams} beams with a margin of {margin}; take 1 or more, and 0 or more");
            return Err(WhisperError::option("search", problem));
        }
        let mut scores: HashMap<usize, f32> = HashMap::new();
        let mut best = f32::NEG_INFINITY;
        let mut logits = start.logits.clone();
        start.rules.apply(&[], &mut logits);
        let mut frontier = Vec::new();
        let root = Beginning { tokens: 0, phrase: 0, parent: start.node, sum: 0.0 };
        self.follow(phrases, root, start.node, &logits, &mut frontier, &mut |_, _| {});
        let vocabulary = self.decoder.vocabulary();
        for _ in 0..start.room {
            prune(&mut frontier, phrases, search, best, comparison);
            if frontier.is_empty() {
                break;
            }
            let mut next = Vec::new();
            for batch in frontier.chunks(BATCH) {
                check(cancel)?;
                let branch = |of: &Beginning| Branch { parent: Some(of.parent), token: phrases.nodes[of.phrase].token };
                let branches: Vec<Branch> = batch.iter().map(branch).collect();
                let first = start.tree.len();
                let outputs = self.decoder.advance(&hearing.keys, &mut start.tree, &branches)?;
                let mut logits = self.decoder.logits(&outputs)?;
                for (at, (of, logits)) in batch.iter().zip(logits.chunks_exact_mut(vocabulary)).enumerate() {
                    start.rules.apply(&[phrases.nodes[of.phrase].token], logits);
                    self.follow(phrases, *of, first + at, logits, &mut next, &mut |sentence, sum| {
                        let score = scores.entry(sentence).or_insert(f32::NEG_INFINITY);
                        *score = log_add(*score, sum);
                        best = best.max(*score + comparison.bonus * phrases.lengths[sentence] as f32);
                    });
                }
            }
            frontier = next;
        }
        let mut scores: Vec<PhraseScore> =
            scores.into_iter().map(|(sentence, log_probability)| PhraseScore { sentence, log_probability }).collect();
        scores.sort_by(|a, b| b.log_probability.total_cmp(&a.log_probability).then(a.sentence.cmp(&b.sentence)));
        Ok(scores)
    }

    /// Adds what may follow a beginning, and reports the sentences that end with it.
    fn follow(
        &self,
        phrases: &Phrases,
        of: Beginning,
        node: Node,
        logits: &[f32],
        next: &mut Vec<Beginning>,
        end: &mut impl FnMut(usize, f32),
    ) {
        let all = log_sum(logits);
        let sum = |token: u32| of.sum + logits[token as usize] - all;
        let here = &phrases.nodes[of.phrase];
        here.ends.iter().for_each(|sentence| end(*sentence, sum(self.vocabulary.end)));
        next.extend(here.children.iter().map(|child| Beginning {
            tokens: of.tokens + 1,
            phrase: *child,
            parent: node,
            sum: sum(phrases.nodes[*child].token),
        }));
    }
}

/// Drops beginnings that a search doesn't follow. `best` is the sum with bonuses of the best whole sentence so far.
fn prune(frontier: &mut Vec<Beginning>, phrases: &Phrases, search: PhraseSearch, best: f32, comparison: Comparison) {
    let margin = if let PhraseSearch::Beam { margin, .. } = search { margin } else { f32::INFINITY };
    // Spellings of a sentence add up, so single ones may be less likely.
    let least = comparison.least - (MOST_SPELLINGS as f32).ln();
    frontier.retain(|of| {
        // No sentence with this beginning is better.
        let tokens = of.tokens + phrases.nodes[of.phrase].height;
        let most = of.sum + comparison.bonus * tokens as f32;
        most > f32::NEG_INFINITY && most >= least && most >= best - margin
    });
    if let PhraseSearch::Beam { beams, .. } = search {
        frontier.sort_by(|a, b| b.sum.total_cmp(&a.sum).then(a.phrase.cmp(&b.phrase)));
        frontier.truncate(beams);
        // All have the same length.
        let least = frontier.first().map_or(f32::NEG_INFINITY, |first| first.sum - margin);
        frontier.retain(|of| of.sum >= least);
    }
}
