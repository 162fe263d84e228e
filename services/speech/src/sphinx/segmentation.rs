//! The output of `pocketsphinx`: one line with words, their frames and their acoustic scores (`-hypseg`).
//!
//! `u S 0 T −2520 A −1846 L −674 0 −394 −337 <sil> 28 −768 0 hide 68 … 141`: name of the utterance, scale, total, acoustic and
//! language score, then for each word its first frame, acoustic score, language score and name, and at last the number of frames.
//! Scores are logarithms to the base 1.0001, shifted by 10 bits; a frame's best state has 0.

/// Frames a second.
pub(super) const FRAME_RATE: f32 = 100.0;

/// A word or phone of the line.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Segment {
    /// Without the number of its pronunciation.
    pub(super) word: String,
    pub(super) start: usize,
    pub(super) end: usize,
    pub(super) acoustic: f32,
}

impl Segment {
    /// Whether it is silence or noise.
    pub(super) fn is_filler(&self) -> bool {
        self.word.starts_with('<') || self.word.starts_with('[') || self.word.starts_with('+') || self.word == "SIL"
    }
}

/// Parses a line; `None` if it is not of this form. An utterance without a result has no segments.
pub(super) fn parse(line: &str) -> Option<Vec<Segment>> {
    let fields: Vec<&str> = line.split_whitespace().collect();
    let [_, "S", _, "T", _, "A", _, "L", _, segments @ ..] = &fields[..] else { return None };
    let mut out: Vec<Segment> = Vec::new();
    let (groups, rest) = segments.as_chunks::<4>();
    let [last] = rest else { return None };
    let last: usize = last.parse().ok()?;
    for [start, acoustic, language, word] in groups {
        let (start, acoustic): (usize, f32) = (start.parse().ok()?, acoustic.parse().ok()?);
        let _: f32 = language.parse().ok()?;
        if let Some(before) = out.last_mut() {
            before.end = start;
        }
        let word = word.split_once('(').filter(|(word, _)| !word.is_empty()).map_or(*word, |(word, _)| word);
        out.push(Segment { word: word.to_owned(), start, end: last, acoustic });
    }
    let in_order = out.iter().all(|segment| segment.start <= segment.end && segment.end <= last);
    out.retain(|segment| segment.word != "(NULL)");
    in_order.then_some(out)
}

/// Acoustic score of a stretch of frames, with each segment's score spread evenly over its frames.
pub(super) fn score_between(segments: &[Segment], start: usize, end: usize) -> f32 {
    let share = |segment: &Segment| {
        let length = segment.end.saturating_sub(segment.start).max(1);
        let common = segment.end.min(end).saturating_sub(segment.start.max(start));
        segment.acoustic * common as f32 / length as f32
    };
    segments.iter().map(share).sum()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LINE: &str = "u1 S 0 T -2520 A -1846 L -674 0 -394 -337 <sil> 28 -768 0 hide(2) 68 -134 0 the 77 -354 0 sac 114 -196 -337 <sil> 141";

    #[test]
    fn a_line_is_parsed() {
        let segments = parse(LINE).unwrap();
        let words: Vec<(&str, usize, usize)> = segments.iter().map(|s| (s.word.as_str(), s.start, s.end)).collect();
        assert_eq!(words, [("<sil>", 0, 28), ("hide", 28, 68), ("the", 68, 77), ("sac", 77, 114), ("<sil>", 114, 141)]);
        assert!((score_between(&segments, 0, 141) + 1846.0).abs() < 1e-3);
        assert!((score_between(&segments, 28, 48) + 384.0).abs() < 1e-3);
        assert_eq!(parse("u9 S 0 T 0 A 0 L 0 213").unwrap(), []);
        for bad in ["", "u9", "u9 S 0 T 0 A 0 L 0", "u9 S 0 T 0 A 0 L 0 1 2 3", "u9 S 0 T 0 A 0 L 0 9 0 0 a 4"] {
            assert_eq!(parse(bad), None, "{bad}");
        }
    }

    proptest! {
        #[test]
        fn any_line_is_taken_or_refused(cut in 0_usize..130, noise in "[0-9 a-z()<-]{0,20}") {
            let line = format!("{}{noise}", &LINE[..cut.min(LINE.len())]);
            if let Some(segments) = parse(&line) {
                prop_assert!(segments.iter().all(|s| s.start <= s.end));
            }
        }
    }
}
