//! Which tokens may follow: none of those that a model's files suppress, and times in order.

use std::ops::Range;

use crate::config::Suppressed;
use crate::probability::log_sum;
use crate::vocabulary::Vocabulary;

/// A time at the start of a text is at most 1 s: 50 steps of 20 ms.
const LATEST_START: u32 = 50;

/// Tokens that may follow.
pub(crate) struct Rules {
    always: Vec<u32>,
    at_start: Vec<u32>,
    end: u32,
    size: u32,
    /// Tokens of times within the sound, where times are wanted.
    times: Option<Range<u32>>,
}

impl Rules {
    /// Rules for a sound of so many frames of 20 ms.
    pub(crate) fn new(vocabulary: &Vocabulary, suppressed: &Suppressed, times: bool, frames: usize) -> Self {
        let first = vocabulary.first_time();
        let size = vocabulary.size as u32;
        Self {
            // A text may always end.
            always: suppressed.always.iter().copied().filter(|id| *id < size && *id != vocabulary.end).collect(),
            at_start: suppressed.at_start.iter().copied().filter(|id| *id < size).collect(),
            end: vocabulary.end,
            size,
            times: times.then(|| first..size.min(first.saturating_add(frames as u32 + 1))),
        }
    }

    /// Takes every chance from tokens that may not follow `text`, the tokens behind the marks.
    pub(crate) fn apply(&self, text: &[u32], logits: &mut [f32]) {
        let mut bar = |ids: Range<u32>| {
            if let Some(logits) = logits.get_mut(ids.start as usize..ids.end as usize) {
                logits.fill(f32::NEG_INFINITY);
            }
        };
        self.always.iter().for_each(|id| bar(*id..*id + 1));
        if text.is_empty() {
            self.at_start.iter().for_each(|id| bar(*id..*id + 1));
        }
        let Some(times) = &self.times else {
            bar(self.end + 1..self.size);
            return;
        };
        bar(self.end + 1..times.start);
        bar(times.end..self.size);
        let is_time = |id: &u32| times.contains(id);
        let last_is = text.last().is_some_and(is_time);
        let before_is = text.len() < 2 || is_time(&text[text.len() - 2]);
        if text.is_empty() {
            bar(0..times.start);
            bar(times.end.min(times.start + LATEST_START + 1)..times.end);
        } else if last_is && before_is {
            // Times come in pairs: an end and a start.
            bar(times.clone());
        } else if last_is {
            bar(0..self.end);
        }
        if let Some(last) = text.iter().rfind(|id| is_time(id)) {
            // Only the start of the next part may be the end of the one before.
            bar(times.start..if last_is && !before_is { *last } else { (last + 1).min(times.end) });
        }
        let (of_times, of_text) = (times.start as usize..times.end as usize, 0..times.start as usize);
        let most_text = logits[of_text.clone()].iter().copied().fold(f32::NEG_INFINITY, f32::max);
        if log_sum(&logits[of_times]) > most_text {
            logits[of_text].fill(f32::NEG_INFINITY);
        }
    }
}
