//! How well speech was recognised: word error rate, commands right, false commands.

use crate::spoken;

/// Least number of substitutions, deletions and insertions between two sequences (Levenshtein 1966).
#[must_use]
pub fn edit_distance<T: PartialEq>(a: &[T], b: &[T]) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut diagonal = row.first().copied().unwrap_or_default();
        if let Some(first) = row.first_mut() {
            *first = i + 1;
        }
        for (j, y) in b.iter().enumerate() {
            let best = (diagonal + usize::from(x != y)).min(row[j] + 1).min(row[j + 1] + 1);
            diagonal = std::mem::replace(&mut row[j + 1], best);
        }
    }
    row.last().copied().unwrap_or_default()
}

/// Counts over utterances.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Accuracy {
    /// Words of the references.
    pub words: usize,
    /// Edits from the references.
    pub word_errors: usize,
    /// Utterances that are commands.
    pub commands: usize,
    /// Commands that were accepted with the right words.
    pub commands_right: usize,
    /// Commands that were accepted with other words: what is worst.
    pub commands_wrong: usize,
    /// Utterances that are no commands.
    pub off_topic: usize,
    /// Those that were accepted as a command.
    pub false_commands: usize,
}

impl Accuracy {
    /// Counts a command: what was said, what was recognised and whether it was accepted. A text that was not accepted has its
    /// word errors too.
    pub fn count_command(&mut self, said: &str, recognized: &str, accepted: bool) {
        let (said, recognized) = (spoken::words(said), spoken::words(recognized));
        self.words += said.len();
        self.word_errors += edit_distance(&said, &recognized);
        self.commands += 1;
        self.commands_right += usize::from(accepted && said == recognized);
        self.commands_wrong += usize::from(accepted && said != recognized);
    }

    /// Counts an utterance that is no command.
    pub fn count_off_topic(&mut self, accepted: bool) {
        self.off_topic += 1;
        self.false_commands += usize::from(accepted);
    }

    /// Edits for each word of the references; 0 without words. It can exceed 1.
    #[must_use]
    pub fn word_error_rate(&self) -> f64 {
        share(self.word_errors, self.words)
    }

    /// Share of commands right; 0 without commands.
    #[must_use]
    pub fn command_accuracy(&self) -> f64 {
        share(self.commands_right, self.commands)
    }

    /// Share of off-topic utterances that became commands; 0 without any.
    #[must_use]
    pub fn false_command_rate(&self) -> f64 {
        share(self.false_commands, self.off_topic)
    }
}

fn share(part: usize, whole: usize) -> f64 {
    if whole == 0 { 0.0 } else { part as f64 / whole as f64 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn commands_and_words_are_counted() {
        let mut accuracy = Accuracy::default();
        accuracy.count_command("Fade the sac to 20 %.", "fade the sac to twenty percent", true);
        accuracy.count_command("hide the sac", "hide sack now", true);
        accuracy.count_command("undo", "", false);
        accuracy.count_off_topic(true);
        accuracy.count_off_topic(false);
        assert_eq!((accuracy.words, accuracy.word_errors), (10, 3));
        assert_eq!((accuracy.commands_right, accuracy.commands_wrong), (1, 1));
        assert!((accuracy.word_error_rate() - 0.3).abs() < 1e-9);
        assert!((accuracy.command_accuracy() - 1.0 / 3.0).abs() < 1e-9);
        assert!((accuracy.false_command_rate() - 0.5).abs() < 1e-9);
        assert_eq!(Accuracy::default().word_error_rate(), 0.0);
    }

    proptest! {
        #[test]
        fn the_distance_is_a_metric(a in "[ab]{0,7}", b in "[ab]{0,7}", c in "[ab]{0,7}") {
            let d = |x: &str, y: &str| edit_distance(x.as_bytes(), y.as_bytes());
            prop_assert_eq!(d(&a, &b), d(&b, &a));
            prop_assert_eq!(d(&a, &b) == 0, a == b);
            prop_assert!(d(&a, &c) <= d(&a, &b) + d(&b, &c));
            prop_assert!(d(&a, &b) >= a.len().abs_diff(b.len()) && d(&a, &b) <= a.len().max(b.len()));
        }
    }
}
