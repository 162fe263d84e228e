//! Repair of misspelt and misheard words: the one way of spelling that makes a sentence.

use std::collections::BTreeSet;

use sg_proto::language::Clause;

use super::sentence::Sentence;
use super::{Reader, sentence_model};
use crate::color;
use crate::syntax::token::{self, Kind, Token};

/// Most misspelt words of an utterance, and most similar words of each. Each choice is read once.
const MOST: [usize; 2] = [3, 4];

/// Most letters that a spelling has more or fewer than the word.
const MOST_LONGER: usize = 2;

/// Most ways of spelling that are read in all their forms.
const MOST_READ: usize = 8;

/// The utterance with its misspelt words repaired, and its reading. `None` if no way of spelling is understood, or if two are
/// that mean different things.
pub(super) fn repaired(reader: &Reader<'_>, text: &str) -> Option<(String, Sentence)> {
    one_meaning(spellings(reader, text, |_, _| true), |better| Some(reader.read(better)).filter(Sentence::is_certain))
}

/// As [`repaired`], for words that are understood in another form alone, or with a name that no unit has.
pub(super) fn respelled(
    reader: &Reader<'_>,
    text: &str,
    read: impl Fn(&str) -> Option<Sentence>,
) -> Option<(String, Sentence)> {
    let mut spellings = spellings(reader, text, is_slip);
    spellings.truncate(MOST_READ);
    one_meaning(spellings, read)
}

/// The one meaning that some spellings have, with the first of them that has it.
fn one_meaning(spellings: Vec<String>, read: impl Fn(&str) -> Option<Sentence>) -> Option<(String, Sentence)> {
    let mut found: Option<(String, Sentence)> = None;
    for better in spellings {
        let Some(sentence) = read(&better) else { continue };
        if found.as_ref().is_some_and(|(_, other)| meaning(other) != meaning(&sentence)) {
            return None;
        }
        found.get_or_insert((better, sentence));
    }
    found
}

/// Whether a word has the letters of another in another order, or one more or fewer. With another letter in one place it may as well be
/// a word of other talk: "five" is no slip for "give".
fn is_slip(word: &str, meant: &str) -> bool {
    is_swap(word, meant) || word.chars().count() != meant.chars().count()
}

/// The ways to spell the misspelt words of an utterance with words that may be meant. There are none if too many words are misspelt.
fn spellings(reader: &Reader<'_>, text: &str, may_be: impl Fn(&str, &str) -> bool) -> Vec<String> {
    let tokens = token::tokens(text);
    let vocabulary = reader.vocabulary();
    let mut misspelt: Vec<(&Token, Vec<String>)> = Vec::new();
    for token in tokens.iter().filter(|t| t.kind == Kind::Word) {
        let is_known =
            vocabulary.contains(&token.text) || color::is_word(&token.text) || sentence_model::knows(&token.text);
        if !is_known {
            let mut similar = similar_words(reader, &token.text);
            similar.retain(|meant| may_be(&token.text, meant));
            similar.truncate(MOST[1]);
            // A word with nothing similar may be a new name, so it stays.
            if !similar.is_empty() {
                misspelt.push((token, similar));
            }
        }
    }
    if misspelt.is_empty() || misspelt.len() > MOST[0] {
        return Vec::new();
    }
    let choices: usize = misspelt.iter().map(|(_, words)| words.len()).product();
    (0..choices).filter_map(|choice| spelled(text, &misspelt, choice)).collect()
}

/// The text with one choice of the words for the misspelt ones.
fn spelled(text: &str, misspelt: &[(&Token, Vec<String>)], choice: usize) -> Option<String> {
    let (mut better, mut done, mut left) = (String::new(), 0, choice);
    for (token, words) in misspelt {
        better.push_str(text.get(done..token.start)?);
        better.push_str(words.get(left % words.len())?);
        (done, left) = (token.end, left / words.len());
    }
    better.push_str(text.get(done..)?);
    Some(better)
}

/// The clauses without their words.
fn meaning(sentence: &Sentence) -> Vec<Clause> {
    sentence.clauses.iter().map(|c| Clause { words: String::new(), ..c.clone() }).collect()
}

/// As [`similar`], looked for once in an utterance.
fn similar_words(reader: &Reader<'_>, word: &str) -> Vec<String> {
    if let Some(known) = reader.similar_words.borrow().get(word) {
        return known.clone();
    }
    let found: Vec<String> = similar(word, reader.vocabulary()).into_iter().map(str::to_owned).collect();
    let mut kept = reader.similar_words.borrow_mut();
    if kept.len() < super::MOST_KEPT {
        kept.insert(word.to_owned(), found.clone());
    }
    found
}

/// Words that may be meant, the most similar first.
fn similar<'v>(word: &str, vocabulary: &'v BTreeSet<String>) -> Vec<&'v str> {
    let mut found: Vec<(usize, &str)> =
        vocabulary.iter().filter_map(|other| Some((unlikeness(word, other)?, other.as_str()))).collect();
    found.sort_unstable();
    let least = found.first().map_or(0, |(distance, _)| *distance);
    found.into_iter().filter(|(distance, _)| *distance == least).map(|(_, word)| word).collect()
}

/// How far a known word is from a spelling: edits, or 2 for one that sounds alike. `None`: too far.
fn unlikeness(word: &str, known: &str) -> Option<usize> {
    let (length, other) = (word.chars().count(), known.chars().count());
    if length < 3 || other < 3 || length.abs_diff(other) > MOST_LONGER {
        return None;
    }
    let distance = strsim::damerau_levenshtein(word, known);
    let allowed = match length {
        // A short word with another letter is another word; a slip of the hand leaves one out or swaps two.
        3 => usize::from(length != other || is_swap(word, known)),
        4..=6 => 1,
        _ => 2,
    };
    if (1..=allowed).contains(&distance) {
        Some(distance)
    } else {
        (length > 4 && other > 4 && sound(word) == sound(known)).then_some(2)
    }
}

/// Whether two words have the same letters.
fn is_swap(a: &str, b: &str) -> bool {
    let sorted = |word: &str| {
        let mut letters: Vec<char> = word.chars().collect();
        letters.sort_unstable();
        letters
    };
    sorted(a) == sorted(b)
}

/// The consonants that are heard, each once: "vessel" and "vassal" are vsl.
fn sound(word: &str) -> String {
    let letters = word.replace("ph", "f").replace("ck", "k");
    let mut heard = String::new();
    for letter in letters.chars() {
        let letter = match letter {
            'c' | 'q' => 'k',
            'z' => 's',
            'a' | 'e' | 'i' | 'o' | 'u' | 'y' | 'h' | 'w' => continue,
            other => other,
        };
        if !heard.ends_with(letter) {
            heard.push(letter);
        }
    }
    // A word that begins with a vowel begins with another sound.
    if word.starts_with(['a', 'e', 'i', 'o', 'u']) {
        heard.insert(0, '-');
    }
    heard
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_words_are_similar_and_others_are_not() {
        for (word, known) in
            [("sca", "sac"), ("vesel", "vessel"), ("vassal", "vessel"), ("teh", "the"), ("hdie", "hide")]
        {
            assert!(unlikeness(word, known).is_some(), "{word} {known}");
        }
        for (word, known) in [("bag", "sac"), ("sad", "sac"), ("bone", "skin"), ("hi", "hide"), ("sac", "sac")] {
            assert_eq!(unlikeness(word, known), None, "{word} {known}");
        }
    }
}
