//! Commands that lack a piece, and the question for it: "change the colour", "thirty percent", "rename that one".

use super::word_pattern::{after, core, matched, words};
use super::{Reader, scope};
use crate::color;
use crate::commands::command::Command;
use crate::commands::table::TABLE;
use crate::syntax::token::{self, Kind, Token, text_of};
use crate::text::{capital, join_with};

/// What a command sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Value {
    Color,
    Opacity,
    Name,
}

impl Value {
    /// The question where structure and value are missing.
    fn both(self) -> &'static str {
        match self {
            Self::Color => "Which structure, and which colour?",
            Self::Opacity => "Which structure, and how opaque, in percent?",
            Self::Name => "Which unit, and what should it be called?",
        }
    }

    /// The question where the value for a structure is missing.
    fn of(self, structure: &str) -> String {
        match self {
            Self::Color => format!("Which colour should {structure} be?"),
            Self::Opacity => format!("How opaque should {structure} be, in percent?"),
            Self::Name => format!("What should {structure} be called?"),
        }
    }

    /// The command with both.
    fn command(self, structure: &str, value: &str) -> String {
        match self {
            Self::Color => format!("make {structure} {value}"),
            Self::Opacity => format!("set the opacity of {structure} to {value}"),
            Self::Name => format!("rename {structure} to {value}"),
        }
    }
}

/// Sentences that name what is to be set, without its value. `X` is the structure.
const SETTINGS: [(&str, Value); 22] = [
    ("change/set/adjust/alter/edit the/its/their colour/color/colours/colors", Value::Color),
    ("change/set/adjust/alter/edit colour/color/colours/colors", Value::Color),
    ("change/set/adjust/alter/edit the colour/color/colours/colors of X", Value::Color),
    ("change/set/adjust/alter/edit X 's colour/color", Value::Color),
    ("another/different/new colour/color", Value::Color),
    ("a/some different/new/other/nicer/better colour/color", Value::Color),
    ("another/different/new colour/color for X", Value::Color),
    ("a/some different/new/other/nicer/better colour/color for X", Value::Color),
    ("give X another/different/new colour/color", Value::Color),
    ("give X a/some different/new/other/nicer/better colour/color", Value::Color),
    ("make X another/different colour/color", Value::Color),
    ("make X a different/new colour/color", Value::Color),
    ("change/set/adjust/alter/edit the/its/their opacity/transparency", Value::Opacity),
    ("change/set/adjust/alter/edit opacity/transparency", Value::Opacity),
    ("change/set/adjust/alter/edit the opacity/transparency of X", Value::Opacity),
    ("change/set/adjust/alter/edit X 's opacity/transparency", Value::Opacity),
    ("give X another/different opacity/transparency", Value::Opacity),
    ("give X a different/new/better name", Value::Name),
    ("give X another/different name", Value::Name),
    ("change the name", Value::Name),
    ("change the name of X", Value::Name),
    ("another/different/new name for X", Value::Name),
];

/// The same for verbs alone: only a structure that is known, or none, may follow.
const VERBS: [(&str, Value); 4] = [
    ("colour/color/recolour/recolor/paint X", Value::Color),
    ("colour/color/recolour/recolor/paint", Value::Color),
    ("rename/relabel X", Value::Name),
    ("rename/relabel", Value::Name),
];

/// Words that point at a structure without naming it, the longest first.
pub(super) const POINTING: [&str; 17] = [
    "one of them",
    "one of those",
    "one of these",
    "some of them",
    "one of the units",
    "one of the structures",
    "that one",
    "this one",
    "the one",
    "that thing",
    "this thing",
    "something",
    "it",
    "that",
    "this",
    "them",
    "those",
];

/// Words of which a name has none.
const NOT_IN_NAMES: [&str; 10] = ["to", "by", "and", "in", "with", "then", "as", "but", "so", "if"];

/// Most words of a structure.
const MOST_WORDS: usize = 5;

/// Most structures that a question names.
const MOST_NAMED: usize = 6;

/// Politeness around a command.
const LEADS: [&str; 26] = [
    "please",
    "could you",
    "can you",
    "would you",
    "could we",
    "can we",
    "can i",
    "could i",
    "i would like to",
    "i'd like to",
    "i want to",
    "i need to",
    "i would like to have",
    "i'd like to have",
    "i would like",
    "i'd like",
    "i want",
    "i need",
    "we need",
    "let 's",
    "ok",
    "okay",
    "now",
    "so",
    "and",
    "just",
];
const TAILS: [&str; 7] = ["please", "now", "then", "thanks", "thank you", "for me", "instead"];

/// A command that lacks a piece.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Gap {
    /// A structure and a value.
    Both(Value),
    /// The value for a structure.
    Value(Value, String),
    /// The structure for an opacity.
    Share(String),
    /// The structure for a verb, with its names.
    Structure(String),
}

/// Whether words point at something without naming it.
fn is_vague(words: &[Token]) -> bool {
    POINTING.iter().chain(&["one", "some"]).any(|vague| matched(words, vague).is_some())
}

/// Whether words may be a name.
fn may_be_name(words: &[Token]) -> bool {
    let is_no_name = |t: &Token| {
        NOT_IN_NAMES.contains(&t.text.as_str())
            || color::is_word(&t.text)
            || !matches!(t.kind, Kind::Word | Kind::Quoted)
    };
    words.len() <= MOST_WORDS && !words.iter().any(is_no_name)
}

fn is_known(reader: &Reader<'_>, source: &str, words: &[Token]) -> bool {
    let lemmas = token::normalized_name(text_of(source, words));
    reader.normalized.iter().any(|(_, known)| *known == lemmas)
}

/// What an utterance lacks.
fn gap(reader: &Reader<'_>, source: &str, tokens: &[Token]) -> Option<Gap> {
    let all = words(tokens);
    let said = core(&all, &LEADS, &TAILS);
    let of = |object: &[Token], value: Value| match object {
        [] => Gap::Both(value),
        vague if is_vague(vague) => Gap::Both(value),
        object => Gap::Value(value, text_of(source, object).to_owned()),
    };
    let named = |(pattern, value): &(&str, Value)| {
        // "Bone" is a colour as well.
        let is_name = |object: &&[Token]| may_be_name(object) || is_known(reader, source, object);
        matched(said, pattern).filter(is_name).map(|object| of(object, *value))
    };
    let alone = |(pattern, value): &(&str, Value)| {
        let is_structure =
            |object: &&[Token]| object.is_empty() || is_vague(object) || is_known(reader, source, object);
        matched(said, pattern).filter(is_structure).map(|object| of(object, *value))
    };
    let found = SETTINGS.iter().find_map(named).or_else(|| VERBS.iter().find_map(alone));
    found.or_else(|| share(reader, source, said)).or_else(|| verb(said).map(Gap::Structure))
}

/// "Thirty percent" alone.
fn share(reader: &Reader<'_>, source: &str, said: &[Token]) -> Option<Gap> {
    let is_share = said.len() <= MOST_WORDS && said.last().is_some_and(|t| t.is_mark('%') || t.is("percent"));
    let amount = text_of(source, said);
    let is_amount = || reader.read(&Value::Opacity.command("it", amount)).is_certain();
    (is_share && is_amount()).then(|| Gap::Share(amount.to_owned()))
}

/// The verb of a command that is said with nothing that names a structure: "hide that one", "select".
fn verb(said: &[Token]) -> Option<String> {
    let needs_target = |row: &Command| row.fields.iter().any(|field| field.name == "target" && !field.is_optional());
    let is_said = |row: &&Command| {
        let object = after(said, row.title).filter(|rest| rest.is_empty() || is_vague(rest));
        object.is_some() && needs_target(row) && scope::has_verb_title(row)
    };
    TABLE.iter().find(is_said).map(|row| row.title.to_owned())
}

/// The question for what an utterance lacks.
pub(super) fn question(reader: &Reader<'_>, source: &str, tokens: &[Token]) -> Option<String> {
    Some(match gap(reader, source, tokens)? {
        Gap::Both(value) => value.both().to_owned(),
        Gap::Value(value, structure) => value.of(&structure),
        Gap::Share(amount) => format!("{} of what?", capital(&amount)),
        Gap::Structure(verb) => {
            let names: Vec<String> = reader.names.iter().take(MOST_NAMED).map(|name| (*name).to_owned()).collect();
            match names.as_slice() {
                [] => format!("Nothing has a name yet. Which structure should I {verb}?"),
                names => format!("Which structure should I {verb}: {}?", join_with(names, "or")),
            }
        }
    })
}

/// Commands that an utterance makes with the answer to its question.
pub(super) fn completed(reader: &Reader<'_>, before: &str, answer: &str) -> Vec<String> {
    match gap(reader, before, &token::tokens(before)) {
        Some(Gap::Both(_)) | None => Vec::new(),
        Some(Gap::Value(value, structure)) => vec![value.command(&structure, answer)],
        Some(Gap::Share(amount)) => vec![Value::Opacity.command(answer, &amount)],
        Some(Gap::Structure(verb)) => vec![format!("{verb} {answer}")],
    }
}
