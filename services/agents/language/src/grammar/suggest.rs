//! Suggestions for parts that are not understood.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;

use sg_proto::language::Act;

use super::sentence::Sentence;
use super::{Reader, rewording, scope};
use crate::color;
use crate::commands::command::{Command, Construct};
use crate::commands::help::with_names;
use crate::commands::kept_views::GO_TO_TITLE;
use crate::commands::table::TABLE;
use crate::syntax::token::{self, Kind, Token, text_of};

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
    phrases.flat_map(words).chain(COLORS.into_iter().chain(["please"]).map(str::to_owned)).collect()
});

/// Colours whose misspelling is repaired.
const COLORS: [&str; 16] = [
    "red",
    "orange",
    "yellow",
    "green",
    "blue",
    "purple",
    "violet",
    "pink",
    "brown",
    "white",
    "black",
    "grey",
    "turquoise",
    "magenta",
    "cyan",
    "beige",
];

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

/// Most commands that one verb of its own belongs to. "Make" begins many and tells none.
const MOST_SHARING: usize = 3;

/// How much the verb of a command counts, in words that an example shares.
const VERB_WEIGHT: usize = 2;

/// Places of the commands in the table that a verb begins, by its lemma.
static VERBS: LazyLock<BTreeMap<String, BTreeSet<usize>>> = LazyLock::new(|| {
    let mut verbs: BTreeMap<String, BTreeSet<usize>> = BTreeMap::new();
    for (place, entry) in TABLE.iter().enumerate() {
        for phrase in entry.constructs.iter().flat_map(Construct::phrases) {
            if let Some(first) = token::tokens(phrase).into_iter().next().filter(scope::is_content) {
                verbs.entry(first.lemma).or_default().insert(place);
            }
        }
    }
    verbs.retain(|_, places| places.len() <= MOST_SHARING);
    verbs
});

/// Whether some words have a name.
fn is_mentioned(name: &str, said: &[Token]) -> bool {
    let lemmas = token::normalized_name(name);
    !lemmas.is_empty() && said.windows(lemmas.len()).any(|here| here.iter().zip(&lemmas).all(|(t, l)| t.lemma == *l))
}

/// The names, those that some words mention first.
fn mentioned_first<'n>(names: &[&'n str], said: &[Token]) -> Vec<&'n str> {
    let (mut first, rest): (Vec<&str>, Vec<&str>) = names.iter().copied().partition(|name| is_mentioned(name, said));
    first.extend(rest);
    first
}

/// The examples with the verb of the utterance and the most words in common, or else one of each main command. They name the
/// units that the utterance names.
pub(super) fn examples(not_understood: &[String], names: &[&str]) -> Vec<String> {
    let said: Vec<Token> = not_understood.iter().flat_map(|part| token::tokens(part)).collect();
    let names = mentioned_first(names, &said);
    let mut chosen = scored(&said, &names, |_| false);
    chosen.truncate(2 * MAX_SUGGESTIONS);
    let general = TABLE.iter().filter_map(|e| e.examples.first());
    if chosen.is_empty() {
        chosen.extend(general.take(2).map(|e| with_names(e, &names)));
        chosen.push("help".to_owned());
    }
    chosen
}

/// The examples that share a word with some others, or belong to one of their verbs or to a wanted command, the best first.
fn scored(said: &[Token], names: &[&str], is_wanted: impl Fn(&Command) -> bool) -> Vec<String> {
    let lemmas: BTreeSet<&str> = said.iter().filter(|t| scope::is_content(t)).map(|t| t.lemma.as_str()).collect();
    let mut scored: Vec<(usize, &str)> = Vec::new();
    let has_name = names.iter().any(|name| is_mentioned(name, said));
    for (place, entry) in TABLE.iter().enumerate() {
        let has_verb = lemmas.iter().any(|lemma| VERBS.get(*lemma).is_some_and(|places| places.contains(&place)));
        let of_entry = VERB_WEIGHT * usize::from(has_verb) + usize::from(is_wanted(entry));
        for example in entry.examples.iter().filter(|example| !may_be_refused(entry, example)) {
            let shared = token::tokens(example).iter().filter(|t| lemmas.contains(t.lemma.as_str())).count();
            // A sentence about a structure is answered by one about a structure.
            let of_name = usize::from(has_name && example.contains("{unit}"));
            if of_entry + shared > 0 {
                scored.push((of_entry + shared + of_name, example));
            }
        }
    }
    // The sort is stable, so equal examples keep the order of the table.
    scored.sort_by_key(|(score, _)| std::cmp::Reverse(*score));
    scored.into_iter().map(|(_, example)| with_names(example, names)).collect()
}

/// Words for a thing of any kind.
const ANYTHING: [&str; 6] = ["something", "anything", "things", "stuff", "someone", "somebody"];

/// Nouns for a thing of any kind, behind an article.
const A_THING: [&str; 7] = ["structure", "unit", "object", "part", "thing", "region", "segment"];

/// A wish with the name of a unit in place of "something".
fn concrete(source: &str, wish: &[Token], unit: &str) -> Option<String> {
    let is_article = |t: &Token| matches!(t.text.as_str(), "a" | "an" | "one" | "some");
    let place = wish.iter().enumerate().find_map(|(at, t)| {
        let is_thing = is_article(t) && wish.get(at + 1).is_some_and(|noun| A_THING.contains(&noun.text.as_str()));
        if is_thing { Some((at, at + 2)) } else { ANYTHING.contains(&t.text.as_str()).then_some((at, at + 1)) }
    });
    let (from, to) = place?;
    let (lead, rest) = (text_of(source, wish.get(..from)?), text_of(source, wish.get(to..)?));
    Some(format!("{lead} the {unit} {rest}").trim().to_owned())
}

/// Sentences that do what somebody wants: the wish itself where it is a command, and examples of that command.
pub(super) fn ways(reader: &Reader<'_>, source: &str, wish: &[Token]) -> Vec<String> {
    let names = mentioned_first(&reader.names, wish);
    let unit = names.first().copied().unwrap_or("structure");
    let plain = concrete(source, wish, unit).unwrap_or_else(|| text_of(source, wish).to_owned());
    let literal = Some(reader.read(&plain)).filter(Sentence::is_certain);
    let reworded = || {
        let forms = rewording::of(&plain, &token::tokens(&plain));
        forms.iter().map(|form| reader.read(form)).find(Sentence::is_certain)
    };
    let sentence = literal.or_else(reworded).unwrap_or_default();
    let is_meant = |entry: &Command| sentence.clauses.iter().any(|clause| clause.act() == entry.act);
    let mut ways: Vec<String> = sentence.is_certain().then_some(plain).into_iter().collect();
    let is_read = |example: &String| reader.read(example).not_understood.is_empty();
    // A command that the wish means goes before others that share its words.
    let meant: BTreeSet<String> = TABLE
        .iter()
        .filter(|entry| is_meant(entry))
        .flat_map(|entry| entry.examples.iter().map(|example| with_names(example, &names)))
        .collect();
    let others = scored(wish, &names, is_meant).into_iter();
    for example in others.filter(|example| meant.is_empty() || meant.contains(example)).filter(is_read) {
        if ways.len() >= MAX_SUGGESTIONS {
            break;
        }
        if !ways.contains(&example) {
            ways.push(example);
        }
    }
    ways
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
    fn examples_belong_to_the_verb_and_name_the_units_of_the_utterance() {
        let found = examples(&["conceal bone behind the moon".to_owned()], &["pot", "bone"]);
        assert!(found.first().is_some_and(|e| e.contains("hide the bone")), "{found:?}");
        let found = examples(&["zoom towards infinity".to_owned()], &["pot"]);
        assert!(found.iter().take(MAX_SUGGESTIONS).all(|e| e.contains("zoom")), "{found:?}");
    }

    #[test]
    fn examples_with_common_words_come_first() {
        let found = examples(&["make the background disappear slowly".to_owned()], &["pot"]);
        assert!(found.iter().any(|e| e.contains("background")), "{found:?}");
        assert_eq!(examples(&["xyzzy".to_owned()], &["pot"]).last().map(String::as_str), Some("help"));
    }
}
