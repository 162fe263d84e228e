//! Replies sentence by sentence, so that speaking starts before the reply is complete.

/// Longest sentence in characters. A longer one is cut at a comma or space.
pub const MAX_SENTENCE: usize = 300;

/// Characters after a sentence that are looked at: closing quotes, a space, the first letter of the next one.
const LOOKAHEAD: usize = 8;

/// Words with a full stop that ends no sentence.
const ABBREVIATIONS: [&str; 24] = [
    "approx", "ca", "cf", "dr", "e.g", "ed", "eq", "eqs", "etc", "fig", "figs", "i.e", "incl", "max", "min", "mr",
    "mrs", "ms", "no", "nos", "prof", "resp", "st", "vs",
];

/// Splits text that arrives in pieces. How it is cut into pieces does not matter.
#[derive(Debug, Clone, Default)]
pub struct SentenceSplitter {
    /// Text whose sentence is not complete, without runs of white space.
    waiting: Vec<char>,
}

impl SentenceSplitter {
    /// Takes the next piece, and returns the sentences that are complete.
    pub fn push(&mut self, piece: &str) -> Vec<String> {
        let mut sentences = Vec::new();
        for c in piece.chars() {
            match (c, self.waiting.last()) {
                // A line's end is an end in any case.
                ('\n', _) => self.take(self.waiting.len(), &mut sentences),
                (c, Some(' ') | None) if c.is_whitespace() => {}
                (c, _) if c.is_whitespace() => self.waiting.push(' '),
                (c, _) if c.is_control() => {}
                (c, _) => {
                    self.waiting.push(c);
                    if let Some(end) = boundary(&self.waiting) {
                        self.take(end, &mut sentences);
                    }
                }
            }
            if self.waiting.len() > MAX_SENTENCE + LOOKAHEAD {
                self.take(cut(&self.waiting), &mut sentences);
            }
        }
        sentences
    }

    /// Ends the text: the rest is a sentence.
    pub fn finish(&mut self) -> Option<String> {
        let mut sentences = Vec::new();
        self.take(self.waiting.len(), &mut sentences);
        sentences.pop()
    }

    fn take(&mut self, end: usize, sentences: &mut Vec<String>) {
        let sentence: String = self.waiting.drain(..end).collect();
        if self.waiting.first() == Some(&' ') {
            self.waiting.remove(0);
        }
        let sentence = sentence.trim();
        if sentence.chars().any(char::is_alphanumeric) {
            sentences.push(sentence.to_owned());
        }
    }
}

/// All sentences of a text.
#[must_use]
pub fn sentences(text: &str) -> Vec<String> {
    let mut splitter = SentenceSplitter::default();
    let mut sentences = splitter.push(text);
    sentences.extend(splitter.finish());
    sentences
}

/// End of the first sentence, if the last character begins another one: "… 3.5 mm. It", not "approx. 3", not "3.5".
fn boundary(text: &[char]) -> Option<usize> {
    let (last, before) = text.split_last()?;
    let before = before.strip_suffix(&[' '])?;
    let closes = |c: &char| matches!(c, '"' | '”' | '’' | '\'' | ')' | ']');
    let closing = before.iter().rev().take_while(|c| closes(c)).count();
    let inside = &before[..before.len() - closing];
    let ends = match inside.last()? {
        '!' | '?' | '…' | ':' | ';' => true,
        '.' => !is_abbreviation(inside) && !(last.is_lowercase()),
        _ => false,
    };
    // A colon or semicolon is an end only where a person takes breath: after a few words.
    let short = matches!(inside.last(), Some(':' | ';')) && before.iter().filter(|c| **c == ' ').count() < 4;
    (ends && !short).then_some(before.len())
}

/// Whether the full stop at the end belongs to the word before it: an abbreviation, an initial, the number of a list.
fn is_abbreviation(text: &[char]) -> bool {
    let Some((_, text)) = text.split_last() else { return false };
    let begin = text.iter().rposition(|c| c.is_whitespace() || matches!(c, '(' | '"' | '“')).map_or(0, |k| k + 1);
    let word: String = text[begin..].iter().collect::<String>().to_lowercase();
    let initial = word.chars().count() == 1 && word.chars().all(char::is_alphabetic);
    let item = begin == 0 && !word.is_empty() && word.chars().all(|c| c.is_ascii_digit());
    initial || item || ABBREVIATIONS.contains(&word.as_str())
}

/// Where a long sentence is cut: after its last comma, or at its last space, or anywhere.
fn cut(text: &[char]) -> usize {
    let text = &text[..MAX_SENTENCE.min(text.len())];
    let comma = text.windows(2).rposition(|pair| matches!(pair, [',' | ';' | ':', ' '])).map(|k| k + 1);
    comma.or_else(|| text.iter().rposition(|c| *c == ' ')).filter(|k| *k > 0).unwrap_or(text.len())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn numbers_units_and_abbreviations_stay_whole() {
        let text = "The sac is red. It is 3.5 mm wide, approx. 20 % of the vessel (see Fig. 2). Done! “Really?” Yes… E.g. this. \
                    Dr. A. Smith agrees.\n1. One thing\n2. Another\n\n...";
        let expected = [
            "The sac is red.",
            "It is 3.5 mm wide, approx. 20 % of the vessel (see Fig. 2).",
            "Done!",
            "“Really?”",
            "Yes…",
            "E.g. this.",
            "Dr. A. Smith agrees.",
            "1. One thing",
            "2. Another",
        ];
        assert_eq!(sentences(text), expected);
        assert_eq!(sentences(" \n . "), Vec::<String>::new());
    }

    #[test]
    fn a_sentence_is_there_as_soon_as_the_next_one_begins() {
        let mut splitter = SentenceSplitter::default();
        assert_eq!(splitter.push("The sac is red."), Vec::<String>::new());
        assert_eq!(splitter.push(" T"), ["The sac is red."]);
        assert_eq!(splitter.push("he rest"), Vec::<String>::new());
        assert_eq!((splitter.finish().as_deref(), splitter.finish()), (Some("The rest"), None));
    }

    proptest! {
        #[test]
        fn pieces_of_any_length_give_the_same_sentences_and_no_word_is_lost(
            text in "([a-zA-Z0-9]{1,9}[.,:;!?]{0,1}[ \n]{1,2}){0,120}",
            cuts in proptest::collection::vec(1_usize..40, 1..9),
        ) {
            let whole = sentences(&text);
            let (mut splitter, mut parts, mut cuts) = (SentenceSplitter::default(), Vec::new(), cuts.iter().cycle());
            let mut rest = &text[..];
            while !rest.is_empty() {
                let (piece, after) = rest.split_at((*cuts.next().unwrap()).min(rest.len()));
                parts.extend(splitter.push(piece));
                rest = after;
            }
            parts.extend(splitter.finish());
            prop_assert_eq!(&whole, &parts);
            prop_assert!(whole.iter().all(|s| s.chars().count() <= MAX_SENTENCE + LOOKAHEAD));
            let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
            prop_assert_eq!(words(&whole.join(" ")), words(&text));
        }

        #[test]
        fn any_text_is_split(text in "\\PC{0,900}") {
            prop_assert!(sentences(&text).iter().all(|s| s.chars().count() <= MAX_SENTENCE + LOOKAHEAD));
        }
    }
}
