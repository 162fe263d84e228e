//! Words of a text: lower case, without marks, with the place of its head.

/// Most words of a text that are read; what follows is dropped.
pub(crate) const MAX_WORDS: usize = 48;
/// Most characters of one word that are read.
const MAX_LETTERS: usize = 40;

/// The words of a text in lower case. Hyphens, underscores and marks part words, a lower case letter before a capital does too
/// ("leftKidney"), apostrophes vanish ("isn't" becomes "isnt"). A comma stays as a word of its own.
pub(crate) fn words(text: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let mut word = String::new();
    let mut flush = |word: &mut String| {
        if !word.is_empty() && words.len() < MAX_WORDS {
            words.push(std::mem::take(word));
        }
        word.clear();
    };
    let mut before = ' ';
    for c in text.chars() {
        if c.is_alphanumeric() {
            let camel = before.is_lowercase() && c.is_uppercase();
            let digits = before.is_alphabetic() && c.is_ascii_digit();
            if camel || digits {
                flush(&mut word);
            }
            if word.chars().count() < MAX_LETTERS {
                word.extend(c.to_lowercase());
            }
        } else if !matches!(c, '\'' | '’') {
            flush(&mut word);
            if c == ',' {
                flush(&mut ",".to_owned());
            }
        }
        before = c;
    }
    flush(&mut word);
    words
}

/// Words that carry no meaning of their own in a label.
const FUNCTION_WORDS: [&str; 14] =
    ["the", "a", "an", "of", "in", "on", "at", "to", "and", "with", "for", "from", "my", "its"];
/// Words after which the head of a noun phrase has passed: "root of the tooth".
const AFTER_HEAD: [&str; 8] = ["of", "in", "on", "at", "with", "for", "from", "to"];

/// The content words of a noun phrase and the place of its head.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Phrase {
    /// Content words in lower case.
    pub(crate) words: Vec<String>,
    /// Index of the head among the words: the noun that the others describe.
    pub(crate) head: usize,
}

impl Phrase {
    /// The phrase of a text.
    #[must_use]
    pub fn of(text: &str) -> Self {
        Self::of_words(&words(text))
    }

    /// The phrase of words in lower case.
    pub(crate) fn of_words(words: &[String]) -> Self {
        let mut phrase = Self::default();
        let mut head = None;
        for word in words.iter().filter(|w| *w != ",") {
            if AFTER_HEAD.contains(&word.as_str()) && head.is_none() && !phrase.words.is_empty() {
                head = Some(phrase.words.len() - 1);
            }
            if !FUNCTION_WORDS.contains(&word.as_str()) {
                phrase.words.push(word.clone());
            }
        }
        // A number behind a name tells namesakes apart and is no head: "bolt 2".
        let is_number = |w: &String| w.bytes().all(|b| b.is_ascii_digit());
        let last = phrase.words.iter().rposition(|w| !is_number(w)).unwrap_or_default();
        phrase.head = head.unwrap_or(last);
        phrase
    }

    /// Whether there is no content word.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_texts() {
        for (text, expected) in [
            ("The Left-Kidney!", vec!["the", "left", "kidney"]),
            ("leftKidney_2", vec!["left", "kidney", "2"]),
            ("isn't red, or blue", vec!["isnt", "red", ",", "or", "blue"]),
            ("Bolt2", vec!["bolt", "2"]),
            ("Großhirn · Ohr", vec!["großhirn", "ohr"]),
            ("", vec![]),
            ("¿…?", vec![]),
        ] {
            assert_eq!(words(text), expected, "{text}");
        }
        assert_eq!(words(&"w ".repeat(1000)).len(), MAX_WORDS);
        assert_eq!(words(&"x".repeat(1000))[0].len(), MAX_LETTERS);
    }

    #[test]
    fn heads_of_phrases() {
        for (text, head) in [
            ("left kidney", "kidney"),
            ("the root of the tooth", "root"),
            ("bolt 2", "bolt"),
            ("valve in the engine", "valve"),
            ("cup", "cup"),
        ] {
            let phrase = Phrase::of(text);
            assert_eq!(phrase.words[phrase.head], head, "{text}");
        }
        assert!(Phrase::of("of the").is_empty());
    }
}
