//! Utterances that continue the one before: "the same for the vessel", "and the bone too", "again".

use sg_proto::language::{Act, Clause, Turn};

use super::forms::{self, understood};
use super::sentence::Sentence;
use super::word_pattern::after;
use super::{Reader, missing};
use crate::syntax::token::{self, Kind, Token};

/// Most tokens of an utterance that completes the one before.
const MOST_COMPLETING: usize = 5;

/// Ways to say yes.
const YES: [&str; 14] =
    ["yes", "yeah", "yep", "yup", "sure", "ok", "okay", "right", "exactly", "correct", "please", "do", "it", "that"];

/// Ways to ask for the same once more.
const AGAIN: [&str; 10] = [
    "again",
    "once more",
    "one more time",
    "do it again",
    "do that again",
    "repeat",
    "repeat that",
    "repeat it",
    "the same again",
    "same again",
];

/// Beginnings of the same for another target. The longest stand first.
const SAME_FOR: [&str; 28] = [
    "and do the same for",
    "and do the same to",
    "and do the same with",
    "do the same thing to",
    "do the same thing for",
    "do the same for",
    "do the same to",
    "do the same with",
    "and do that to",
    "do that to",
    "do that for",
    "do that with",
    "do it to",
    "and the same for",
    "the same for",
    "the same with",
    "the same to",
    "same for",
    "same with",
    "and now",
    "and let me have",
    "and show me",
    "let me have",
    "ok now",
    "okay now",
    "now",
    "and",
    "also",
];

/// Ends of such an utterance, without a meaning of their own.
const ENDS: [&str; 4] = ["as well", "too", "also", "please"];

/// Whether an utterance says yes alone.
pub(super) fn is_yes(tokens: &[Token]) -> bool {
    let mut words = tokens.iter().filter(|t| t.kind == Kind::Word).peekable();
    words.peek().is_some_and(|first| !matches!(first.text.as_str(), "it" | "that" | "please"))
        && words.all(|t| YES.contains(&t.text.as_str()))
}

/// The meaning of an utterance after `before`. `None`: it does not continue that one.
pub(super) fn of(reader: &Reader<'_>, source: &str, tokens: &[Token], before: &str) -> Option<Sentence> {
    let before = before.trim().trim_end_matches(['.', '!', '?', ',', ';']);
    if let Some(completed) = completed(reader, source, tokens, before) {
        return Some(completed);
    }
    // The one before may have been understood in another form.
    let (before, last) = read_before(reader, before)?;
    let words: Vec<&str> = tokens.iter().filter(|t| t.kind != Kind::Mark('.')).map(|t| t.text.as_str()).collect();
    let said = words.join(" ");
    if AGAIN.contains(&said.trim_end_matches(" please")) {
        return Some(last);
    }
    let trimmed = source.trim().trim_end_matches(['.', '!', '?']);
    let lower = trimmed.to_lowercase();
    let ending = ENDS.iter().find(|end| lower.strip_suffix(**end).is_some_and(|rest| rest.ends_with([' ', ','])));
    let object = ending.map_or(trimmed, |end| trimmed.get(..trimmed.len() - end.len()).unwrap_or(trimmed));
    let object = object.trim_end_matches([' ', ',']);
    let opening =
        SAME_FOR.iter().find(|opening| lower.strip_prefix(**opening).is_some_and(|rest| rest.starts_with(' ')));
    let object = opening.map_or(object, |opening| object.get(opening.len()..).unwrap_or(object)).trim();
    let texts = [format!("{before} and the same for {object}"), format!("{before} and {object}")];
    let [named, also] = texts.map(|text| continued(reader, &text, &last));
    let also = also.filter(Sentence::is_certain);
    let same = named.clone().filter(Sentence::is_certain);
    if opening.is_some() || ending.is_some() {
        return same.or(also).or(named);
    }
    // A name alone could mean anything; a value alone belongs to the last target.
    also.filter(|_| same.is_none())
}

/// Ways to ask for more of the last change.
const MORE: [&str; 12] = [
    "more",
    "a bit more",
    "a little more",
    "a little bit more",
    "even more",
    "some more",
    "still more",
    "much more",
    "further",
    "a bit further",
    "more please",
    "a bit more please",
];

/// The last change once more, for "a bit more" where nothing is selected. Otherwise the strokes of the selection get more.
pub(super) fn once_more(reader: &Reader<'_>, tokens: &[Token], last: &Turn) -> Option<Sentence> {
    let words: Vec<&str> = tokens.iter().filter(|t| t.kind == Kind::Word).map(|t| t.text.as_str()).collect();
    if reader.has_selection || last.undo_steps == 0 || !MORE.contains(&words.join(" ").as_str()) {
        return None;
    }
    let is_relative = |clause: &Clause| match clause.act() {
        Act::SetOpacity => clause.relative,
        Act::SetLight => clause.light.is_some_and(|light| light.relative),
        Act::SetTone => clause.tone.as_ref().is_some_and(|tone| tone.relative),
        _ => false,
    };
    let sentence = read_before(reader, &last.utterance)?.1;
    sentence.clauses.iter().all(is_relative).then_some(sentence)
}

/// The utterance with a name in place of "it", where the one before was a question about a thing: "how big is the sac?", "make it red".
pub(super) fn with_described(reader: &Reader<'_>, source: &str, tokens: &[Token], last: &Turn) -> Option<String> {
    let is_it = |t: &Token| matches!(t.text.as_str(), "it" | "them");
    if last.undo_steps > 0 || !tokens.iter().any(is_it) {
        return None;
    }
    let (_, described) = read_before(reader, &last.utterance)?;
    let [clause] = described.clauses.as_slice() else { return None };
    let target = clause.target.as_ref().filter(|target| clause.act() == Act::Describe && !target.complement)?;
    let [name] = target.names.as_slice() else { return None };
    let name = if name.starts_with("the ") { name.clone() } else { format!("the {name}") };
    let (mut text, mut done) = (String::new(), 0);
    for token in tokens.iter().filter(|t| is_it(t)) {
        text.push_str(source.get(done..token.start)?);
        text.push_str(&name);
        done = token.end;
    }
    text.push_str(source.get(done..)?);
    Some(text)
}

/// The form in which an earlier utterance is understood, and its reading. The labeling service may have known its names.
fn read_before(reader: &Reader<'_>, before: &str) -> Option<(String, Sentence)> {
    let before = before.trim().trim_end_matches(['.', '!', '?', ',', ';']);
    let mut forms = vec![before.to_owned()];
    forms.extend(forms::of(reader, before, &token::tokens(before)));
    let certain = forms.iter().find_map(|form| Some((form.clone(), forms::certain(reader, form)?)));
    certain.or_else(|| forms.iter().find_map(|form| Some((form.clone(), understood(reader, form)?))))
}

/// An utterance that the one before lacked: "make it red", "the clip"; "change the colour of the clip", "yellow".
fn completed(reader: &Reader<'_>, source: &str, tokens: &[Token], before: &str) -> Option<Sentence> {
    let said = source.trim().trim_end_matches(['.', '!', '?']);
    if said.is_empty() || tokens.len() > MOST_COMPLETING || reader.read(said).is_certain() {
        return None;
    }
    let earlier = token::tokens(before);
    let has_antecedent = reader.has_focus || reader.has_selection;
    let named = pronoun(&earlier).filter(|_| !has_antecedent).map(|(start, end)| {
        let (lead, rest) = (before.get(..start), before.get(end..));
        format!("{}{said}{}", lead.unwrap_or_default(), rest.unwrap_or_default())
    });
    let is_open = !reader.read(before).is_certain();
    let longer = [format!("{before} to {said}"), format!("{before} {said}")].into_iter().filter(|_| is_open);
    let answered = missing::completed(reader, before, said);
    named
        .into_iter()
        .chain(answered)
        .chain(longer)
        .find_map(|text| Some(reader.read(&text)).filter(Sentence::is_certain))
}

/// Where the first words stand that point at a structure without naming it.
fn pronoun(tokens: &[Token]) -> Option<(usize, usize)> {
    (0..tokens.len()).find_map(|from| {
        let here = tokens.get(from..)?;
        let rest = missing::POINTING.iter().find_map(|words| after(here, words))?;
        let last = here.get(here.len().checked_sub(rest.len() + 1)?)?;
        Some((here.first()?.start, last.end))
    })
}

/// The clauses of a text behind those of its beginning, which may have names that the labeling service has to know.
fn continued(reader: &Reader<'_>, text: &str, last: &Sentence) -> Option<Sentence> {
    let whole = understood(reader, text)?;
    let rest = whole.clauses.strip_prefix(last.clauses.as_slice()).filter(|rest| !rest.is_empty())?;
    let unknown = whole.unknown.saturating_sub(last.unknown);
    // "Only the bone", "and the vessels too": both are to be seen.
    let beside = |clause: &Clause| match clause.act() {
        Act::ShowOnly => Clause { act: Act::Show.into(), ..clause.clone() },
        _ => clause.clone(),
    };
    Some(Sentence { clauses: rest.iter().map(beside).collect(), unknown, ..Sentence::default() })
}
