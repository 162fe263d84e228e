//! How sure a result of the grammar is.
//!
//! A grammar decoder finds a sentence in anything. So the same sound is decoded a second time as a free sequence of phones
//! (a background model; Young 1994, "Detecting misrecognitions and out-of-vocabulary words"). Where the grammar's words explain
//! the sound much worse than free phones do, something else was said.

use super::segmentation::{Segment, score_between};

/// What the two decodings say about a result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Features {
    /// Acoustic loss of the grammar against free phones, over all frames, for each frame of words.
    pub loss: f32,
    /// The same of the worst word.
    pub worst_word: f32,
}

/// Frames that a short word's loss is divided by at least: a word of five frames is easily bad by chance.
const LEAST_FRAMES: usize = 12;

/// Logistic regression over [`Features`]: intercept, then weights of loss and worst word. Fitted by
/// `examples/calibrate.rs` on sentences that no report uses.
pub(super) const WEIGHTS: [f32; 3] = [9.8, -0.098, -0.132];

impl Features {
    /// Of the grammar's segments and of the free phones' over the same frames; `None` without a word.
    pub(super) fn of(grammar: &[Segment], phones: &[Segment]) -> Option<Self> {
        let words: Vec<&Segment> = grammar.iter().filter(|segment| !segment.is_filler()).collect();
        let frames: usize = words.iter().map(|word| word.end - word.start).sum();
        let end = grammar.last()?.end;
        let loss_in = |start, end| score_between(phones, start, end) - score_between(grammar, start, end);
        let of_word =
            |word: &&Segment| loss_in(word.start, word.end) / (word.end - word.start).max(LEAST_FRAMES) as f32;
        let worst_word = words.iter().map(of_word).reduce(f32::max)?;
        let frames = frames.max(1) as f32;
        Some(Self { loss: loss_in(0, end) / frames, worst_word })
    }

    /// Probability that the result is what was said.
    #[must_use]
    pub fn confidence(&self) -> f32 {
        let [intercept, loss, worst_word] = WEIGHTS;
        let sum = intercept + loss * self.loss + worst_word * self.worst_word;
        1.0 / (1.0 + (-sum).exp())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(word: &str, start: usize, end: usize, acoustic: f32) -> Segment {
        Segment { word: word.into(), start, end, acoustic }
    }

    #[test]
    fn a_word_that_does_not_fit_the_sound_lowers_the_confidence() {
        let phones = [segment("SIL", 0, 20, -100.0), segment("AH", 20, 120, -400.0)];
        let grammar = |second| {
            [segment("<sil>", 0, 20, -100.0), segment("hide", 20, 70, -300.0), segment("sac", 70, 120, second)]
        };
        let good = Features::of(&grammar(-350.0), &phones).unwrap();
        assert!((good.loss - 2.5).abs() < 1e-4 && (good.worst_word - 3.0).abs() < 1e-4, "{good:?}");
        let bad = Features::of(&grammar(-5_000.0), &phones).unwrap();
        assert!((bad.worst_word - 96.0).abs() < 1e-4, "{bad:?}");
        assert!(good.confidence() > 0.8 && bad.confidence() < 0.2, "{} {}", good.confidence(), bad.confidence());
        assert_eq!(Features::of(&[], &phones), None);
        assert_eq!(Features::of(&[segment("<sil>", 0, 9, -1.0)], &phones), None);
    }
}
