//! Forms of an utterance, their readings, and the intents that these make.

use std::collections::HashSet;

use sg_proto::language::{Act, Intent};

use super::sentence::Sentence;
use super::{Reader, rewording, slots};
use crate::syntax::token::{self, Token};

/// Most names of a reworded utterance that no unit has.
pub(super) const MOST_UNKNOWN: usize = 2;

/// Acts that a repaired spelling may mean at once: a look tells their effect, and one undo takes it back.
const SAFE: [Act; 25] = [
    Act::SetColor,
    Act::SetOpacity,
    Act::Show,
    Act::Hide,
    Act::ShowOnly,
    Act::SetLight,
    Act::SetBackground,
    Act::SetView,
    Act::BestView,
    Act::Tour,
    Act::SetTerm,
    Act::Select,
    Act::ClearSelection,
    Act::TakeAnswer,
    Act::Transform,
    Act::SetTone,
    Act::AdjustTransferFunction,
    Act::ResetTransferFunction,
    Act::Lock,
    Act::List,
    Act::ListViews,
    Act::QuerySelection,
    Act::Describe,
    Act::Help,
    Act::Unlock,
];

/// Forms of an utterance in words of the table of commands, the surest first.
pub(super) fn of(reader: &Reader<'_>, text: &str, tokens: &[Token]) -> Vec<String> {
    let mut forms = rewording::of(text, tokens);
    let by_slots = |form: &str| slots::of(reader, form, &token::tokens(form));
    let commands: Vec<String> =
        std::iter::once(text).chain(forms.iter().map(String::as_str)).filter_map(by_slots).collect();
    forms.extend(commands);
    let mut seen = HashSet::new();
    forms.retain(|form| seen.insert(form.clone()));
    forms
}

/// The reading of a text that has a meaning but for names, and can be taken back.
pub(super) fn understood(reader: &Reader<'_>, text: &str) -> Option<Sentence> {
    whole(reader, text).filter(is_safe)
}

/// The reading of a text that has a meaning but for names.
pub(super) fn whole(reader: &Reader<'_>, text: &str) -> Option<Sentence> {
    let is_whole = |sentence: &Sentence| {
        sentence.not_understood.is_empty() && !sentence.clauses.is_empty() && sentence.unknown <= MOST_UNKNOWN
    };
    Some(reader.read(text)).filter(is_whole)
}

/// The reading of a text that is understood with known names alone.
pub(super) fn certain(reader: &Reader<'_>, text: &str) -> Option<Sentence> {
    Some(reader.read(text)).filter(Sentence::is_certain)
}

/// Whether a look tells the effect of every clause, and one undo takes it back.
pub(super) fn is_safe(sentence: &Sentence) -> bool {
    sentence.clauses.iter().all(|clause| SAFE.contains(&clause.act()))
}

/// The intent of a repaired sentence. A clause alone has the words that the person said.
pub(super) fn repaired(sentence: Sentence, text: &str, read_as: String) -> Intent {
    let mut clauses = sentence.clauses;
    if let [clause] = clauses.as_mut_slice() {
        clause.words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    }
    Intent { clauses, read_as, backend: super::NAME.to_owned(), ..Intent::default() }
}
