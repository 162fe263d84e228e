//! Suggestions for parts that are not understood.

use std::collections::BTreeSet;
use std::sync::LazyLock;

use sg_proto::language::Act;

use crate::color;
use crate::commands::command::{Command, Construct};
use crate::commands::help::with_names;
use crate::commands::kept_views::GO_TO_TITLE;
use crate::commands::table::TABLE;
use crate::syntax::token::{self, Kind, Token};

/// Whether an example may be refused: one on saved units alone, on kept viewpoints, or on a file that has to be there.
fn may_be_refused(entry: &Command, example: &str) -> bool {
    match entry.act {
        Act::Rename | Act::Delete | Act::Open | Act::ForgetView => true,
        Act::SetView => entry.title == GO_TO_TITLE,
        // A new name is none of a unit that exists.
        Act::Label => example.contains("{unit}"),
        _ => false,
    }
}

/// Largest number of suggestions.
pub(super) const MAX_SUGGESTIONS: usize = 3;

/// The utterance with each misspelt word corrected. `None`: no word has a similar known word.
pub(super) fn corrected(source: &str, tokens: &[Token], names: &[&str]) -> Option<String> {
    let vocabulary = vocabulary(names);
    let mut text = String::new();
    let mut done = 0;
    let mut changed = false;
    for token in tokens {
        if token.kind != Kind::Word || vocabulary.contains(&token.text) || color::is_word(&token.text) {
            continue;
        }
        let Some(word) = nearest(&token.text, &vocabulary) else { continue };
        text.push_str(source.get(done..token.start)?);
        text.push_str(word);
        done = token.end;
        changed = true;
    }
    text.push_str(source.get(done..)?);
    changed.then_some(text)
}

/// All words of the table.
static TABLE_WORDS: LazyLock<BTreeSet<String>> = LazyLock::new(|| {
    let phrases = TABLE
        .iter()
        .flat_map(|entry| entry.constructs.iter().flat_map(Construct::phrases).chain(entry.examples.iter().copied()));
    phrases.flat_map(words).collect()
});

/// The words of a phrase.
fn words(phrase: &str) -> impl Iterator<Item = String> {
    token::tokens(phrase).into_iter().filter(|t| t.kind == Kind::Word).map(|t| t.text)
}

/// All words of the table and of some names.
pub(super) fn vocabulary(names: &[&str]) -> BTreeSet<String> {
    let mut vocabulary = TABLE_WORDS.clone();
    vocabulary.extend(names.iter().flat_map(|name| words(name)));
    vocabulary
}

/// The most similar word: one edit away, or two for a long word.
fn nearest<'v>(word: &str, vocabulary: &'v BTreeSet<String>) -> Option<&'v str> {
    let allowed = match word.chars().count() {
        0..=3 => return None,
        4..=6 => 1,
        _ => 2,
    };
    vocabulary
        .iter()
        .filter(|w| w.chars().count() > 2)
        .map(|w| (strsim::damerau_levenshtein(word, w), w.as_str()))
        .filter(|(distance, _)| *distance <= allowed)
        .min()
        .map(|(_, w)| w)
}

/// The examples with the most words in common with the utterance, or else one of each main command.
pub(super) fn examples(not_understood: &[String], names: &[&str]) -> Vec<String> {
    const COMMON: [&str; 14] =
        ["the", "a", "to", "of", "it", "and", "is", "from", "with", "me", "in", "my", "what", "i"];
    let lemmas: BTreeSet<String> = not_understood
        .iter()
        .flat_map(|part| token::tokens(part))
        .filter(|t| t.kind == Kind::Word && !COMMON.contains(&t.text.as_str()))
        .map(|t| t.lemma)
        .collect();
    let mut scored: Vec<(usize, &str)> = Vec::new();
    for entry in TABLE {
        for example in entry.examples.iter().filter(|example| !may_be_refused(entry, example)) {
            let shared = token::tokens(example).iter().filter(|t| lemmas.contains(&t.lemma)).count();
            if shared > 0 {
                scored.push((shared, example));
            }
        }
    }
    // The sort is stable, so equal examples keep the order of the table.
    scored.sort_by_key(|(shared, _)| std::cmp::Reverse(*shared));
    let mut chosen: Vec<String> =
        scored.into_iter().map(|(_, e)| with_names(e, names)).take(2 * MAX_SUGGESTIONS).collect();
    let general = TABLE.iter().filter_map(|e| e.examples.first());
    if chosen.is_empty() {
        chosen.extend(general.take(2).map(|e| with_names(e, names)));
        chosen.push("help".to_owned());
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelt_words_are_corrected_and_unknown_words_kept() {
        let correct = |text: &str| corrected(text, &token::tokens(text), &["aneurysm"]);
        assert_eq!(correct("hied the aneurism").as_deref(), Some("hide the aneurysm"));
        assert_eq!(correct("quantum chromodynamics"), None);
    }

    #[test]
    fn nothing_is_suggested_that_a_unit_of_the_file_refuses() {
        for said in
            ["please rename the pot somehow", "forget about the name", "save it as the pot, would you", "open up"]
        {
            let found = examples(&[said.to_owned()], &["pot"]);
            let refused = |e: &String| {
                ["rename", "forget", "remove the name", "as pot", "update", "open"].iter().any(|w| e.contains(w))
            };
            assert!(!found.iter().any(refused), "{said}: {found:?}");
        }
    }

    #[test]
    fn examples_with_common_words_come_first() {
        let found = examples(&["make the background disappear slowly".to_owned()], &["pot"]);
        assert!(found.iter().any(|e| e.contains("background")), "{found:?}");
        assert_eq!(examples(&["xyzzy".to_owned()], &["pot"]).last().map(String::as_str), Some("help"));
    }
}
