//! Free decoding: the text that a model finds likeliest, greedily or with beams.

use std::sync::atomic::AtomicBool;

use crate::decoder::{Branch, Node};
use crate::error::WhisperError;
use crate::model::{Hearing, Whisper, check};
use crate::options::Options;
use crate::probability::log_sum;
use crate::start::Start;

/// Seconds for a step of the tokens of times.
const TIME_STEP: f32 = 0.02;

/// What a model heard.
#[derive(Clone, Debug, PartialEq)]
pub struct Transcript {
    /// The text.
    pub text: String,
    /// Tokens of the text, and of times if there are any, without marks.
    pub tokens: Vec<u32>,
    /// Parts between times, where times were wanted.
    pub segments: Vec<Segment>,
    /// Natural logarithm of the text's probability, its end included.
    pub log_probability: f32,
    /// The same divided by the number of tokens, its end included.
    pub average_log_probability: f32,
    /// Probability that nobody speaks, from 0 to 1.
    pub no_speech: f32,
    /// Code of the language, where the model knows several.
    pub language: Option<String>,
    /// Whether the text ended by itself, within the most tokens.
    pub complete: bool,
    /// Other texts that a search with beams has followed to their ends, by falling mean log-probability of a token.
    pub others: Vec<OtherText>,
}

/// A text beside the transcript.
#[derive(Clone, Debug, PartialEq)]
pub struct OtherText {
    /// The text.
    pub text: String,
    /// Natural logarithm of its probability, its end included.
    pub log_probability: f32,
}

/// A part of a transcript.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Start in seconds.
    pub from: f32,
    /// End in seconds; none where the text ended without a time.
    pub to: Option<f32>,
    /// The part's text.
    pub text: String,
}

/// A text on the way.
#[derive(Clone)]
struct Hypothesis {
    node: Node,
    tokens: Vec<u32>,
    /// Logarithm of the probability up to each token.
    sums: Vec<f32>,
    sum: f32,
    ended: bool,
}

impl Hypothesis {
    /// The text up to the first copy of what it repeats at its end, if it does: it would never end.
    fn without_repetition(&self) -> Option<Self> {
        let until = self.tokens.len() - repeated(&self.tokens)?;
        let (tokens, sums) = (self.tokens[..until].to_vec(), self.sums[..until].to_vec());
        Some(Self { node: self.node, sum: sums.last().copied().unwrap_or_default(), tokens, sums, ended: false })
    }

    /// Mean for each token, its end included. Long texts are not disadvantaged.
    fn average(&self) -> f32 {
        self.sum / (self.tokens.len() + usize::from(self.ended)).max(1) as f32
    }
}

impl Whisper {
    /// The text of a sound.
    ///
    /// # Errors
    /// [`WhisperError::Option`], and [`WhisperError::Cancelled`] within one token of the flag.
    pub fn transcribe(
        &self,
        hearing: &Hearing,
        options: &Options,
        cancel: &AtomicBool,
    ) -> Result<Transcript, WhisperError> {
        let mut start = self.start(hearing, options)?;
        self.decode_freely(hearing, &mut start, options, cancel)
    }

    pub(crate) fn decode_freely(
        &self,
        hearing: &Hearing,
        start: &mut Start,
        options: &Options,
        cancel: &AtomicBool,
    ) -> Result<Transcript, WhisperError> {
        let most = options.most_tokens.min(start.room);
        let vocabulary = self.decoder.vocabulary();
        let mut live =
            vec![Hypothesis { node: start.node, tokens: Vec::new(), sums: Vec::new(), sum: 0.0, ended: false }];
        let mut ended: Vec<Hypothesis> = Vec::new();
        let mut logits = start.logits.clone();
        loop {
            check(cancel)?;
            let mut next: Vec<(usize, u32, f32)> = Vec::new();
            for (at, (hypothesis, logits)) in live.iter().zip(logits.chunks_exact_mut(vocabulary)).enumerate() {
                start.rules.apply(&hypothesis.tokens, logits);
                let all = log_sum(logits);
                let best = highest(logits, options.beams + 1);
                next.extend(best.into_iter().map(|token| (at, token, hypothesis.sum + logits[token as usize] - all)));
            }
            next.sort_by(|a, b| b.2.total_cmp(&a.2));
            let mut kept = Vec::with_capacity(options.beams);
            for (at, token, sum) in next {
                let of = &live[at];
                if token == self.vocabulary.end {
                    ended.push(Hypothesis { sum, ended: true, ..of.clone() });
                } else {
                    let tokens = of.tokens.iter().copied().chain([token]).collect();
                    let sums = of.sums.iter().copied().chain([sum]).collect();
                    let longer = Hypothesis { node: of.node, tokens, sums, sum, ended: false };
                    match longer.without_repetition() {
                        Some(cut) => ended.push(cut),
                        None => kept.push(longer),
                    }
                }
                // As many texts as beams are looked at, ended ones among them.
                if kept.len() == options.beams || ended.len() >= options.beams {
                    break;
                }
            }
            if ended.len() >= options.beams || kept.is_empty() {
                break;
            }
            if kept[0].tokens.len() >= most {
                if ended.is_empty() {
                    ended = kept;
                }
                break;
            }
            let branch = |of: &Hypothesis| Branch { parent: Some(of.node), token: of.tokens[of.tokens.len() - 1] };
            let branches: Vec<Branch> = kept.iter().map(branch).collect();
            let first = start.tree.len();
            let outputs = self.decoder.advance(&hearing.keys, &mut start.tree, &branches)?;
            logits = self.decoder.logits(&outputs)?;
            live = kept;
            live.iter_mut().enumerate().for_each(|(at, of)| of.node = first + at);
        }
        ended.sort_by(|a, b| b.average().total_cmp(&a.average()));
        let mut ended = ended.into_iter();
        let best = ended.next().unwrap_or(Hypothesis {
            node: start.node,
            tokens: Vec::new(),
            sums: Vec::new(),
            sum: 0.0,
            ended: false,
        });
        let text = |of: &Hypothesis| Ok::<_, WhisperError>(self.vocabulary.text(&of.tokens)?.trim().to_owned());
        let others = ended.filter(|other| other.ended);
        let others = others.map(|other| Ok(OtherText { text: text(&other)?, log_probability: other.sum }));
        Ok(Transcript {
            text: text(&best)?,
            others: others.collect::<Result<_, WhisperError>>()?,
            segments: if options.timestamps { self.segments(&best.tokens)? } else { Vec::new() },
            log_probability: best.sum,
            average_log_probability: best.average(),
            no_speech: start.no_speech,
            language: start.language.clone(),
            complete: best.ended,
            tokens: best.tokens,
        })
    }

    /// The parts of a text between its times.
    fn segments(&self, tokens: &[u32]) -> Result<Vec<Segment>, WhisperError> {
        let first = self.vocabulary.first_time();
        let (mut segments, mut from, mut part) = (Vec::new(), 0.0, Vec::new());
        for token in tokens {
            if *token < first {
                part.push(*token);
                continue;
            }
            let time = (token - first) as f32 * TIME_STEP;
            if !part.is_empty() {
                let text = self.vocabulary.text(&part)?.trim().to_owned();
                segments.push(Segment { from, to: Some(time), text });
                part.clear();
            }
            from = time;
        }
        if !part.is_empty() {
            segments.push(Segment { from, to: None, text: self.vocabulary.text(&part)?.trim().to_owned() });
        }
        Ok(segments)
    }
}

/// Copies of a part that make a repetition.
const COPIES: usize = 3;
/// Most tokens of a repeated part.
const LONGEST_PART: usize = 32;
/// Fewest tokens of all copies, so that "no, no, no" is a text.
const FEWEST_REPEATED: usize = 8;

/// The tokens at the end of a text that only repeat those before them, if there are such.
fn repeated(tokens: &[u32]) -> Option<usize> {
    let is_repeated = |part: &usize| {
        let all = (COPIES * part).max(FEWEST_REPEATED.next_multiple_of(*part));
        let tail = tokens.len().checked_sub(all).map(|from| &tokens[from..]);
        tail.filter(|tail| tail[*part..] == tail[..all - part]).map(|_| all - part)
    };
    (1..=LONGEST_PART).find_map(|part| is_repeated(&part))
}

/// The places of the `count` highest finite values, highest first; of equal ones the first.
fn highest(values: &[f32], count: usize) -> Vec<u32> {
    let mut best: Vec<u32> = Vec::with_capacity(count + 1);
    for (at, value) in values.iter().enumerate() {
        let full = best.len() == count;
        if *value == f32::NEG_INFINITY || value.is_nan() || full && *value <= values[best[count - 1] as usize] {
            continue;
        }
        let place = best.partition_point(|other| values[*other as usize] >= *value);
        best.insert(place, at as u32);
        best.truncate(count);
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_at_the_end_are_a_repetition() {
        assert_eq!(repeated(&[1, 2, 3, 1, 2, 3]), None);
        assert_eq!(repeated(&[9, 1, 2, 3, 1, 2, 3, 1, 2, 3]), Some(6));
        assert_eq!(repeated(&[9, 1, 2, 3, 1, 2, 3, 1, 2, 4]), None);
        assert_eq!(repeated(&[5, 5, 5]), None);
        assert_eq!(repeated(&[5; 8]), Some(7));
        assert_eq!(repeated(&[1, 2, 1, 2, 1, 2, 1, 2]), Some(6));
        assert_eq!(repeated(&[]), None);
    }

    #[test]
    fn the_highest_are_found_in_order() {
        let values = [0.5, f32::NEG_INFINITY, 2.0, f32::NAN, 1.0, 2.0];
        assert_eq!(highest(&values, 3), [2, 5, 4]);
        assert_eq!(highest(&values, 9), [2, 5, 4, 0]);
    }
}
