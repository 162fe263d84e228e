//! Utterances that correct themselves: "make the sac red, no, blue", "hide the sac, I mean the vessel".

use sg_proto::language::Clause;

use super::Reader;
use super::sentence::Sentence;
use crate::syntax::token::{Kind, Token, begins_with, text_of};

/// Words between what was said first and its correction, the longest first.
pub(super) const MARKERS: [&[&str]; 26] = [
    &["or", "rather"],
    &["no", "hang", "on"],
    &["no", "hold", "on"],
    &["hang", "on"],
    &["hold", "on"],
    &["scrap", "that"],
    &["or", "no"],
    &["no", "wait"],
    &["wait", "no"],
    &["i", "mean"],
    &["i", "meant"],
    &["make", "that"],
    &["scratch", "that"],
    &["not", "that"],
    &["no"],
    &["nope"],
    &["sorry"],
    &["actually"],
    &["correction"],
    &["oops"],
    &["wait"],
    &["uh"],
    &["um"],
    &["er"],
    &["erm"],
    &["uhm"],
];

/// Beginnings of a correction that repeat the command: "no, make it black".
const REPEATED: [&[&str]; 7] = [
    &["make", "it"],
    &["make", "them"],
    &["make", "that"],
    &["make", "this"],
    &["turn", "it"],
    &["paint", "it"],
    &["set", "it", "to"],
];

/// Most tokens that a correction takes the place of.
const MAX_REPLACED: usize = 5;

/// The reading of the corrected utterance, where it has one clear meaning.
pub(super) fn of(reader: &Reader<'_>, source: &str, tokens: &[Token]) -> Option<Sentence> {
    corrected(reader, source, tokens).map(|(_, sentence)| sentence)
}

/// The text of the corrected utterance and its reading.
///
/// The part behind the last marker counts alone if it is a command. Otherwise it takes the place of some words before the marker:
/// of the last ones for which the utterance has the same acts and one clause is another.
pub(super) fn corrected(reader: &Reader<'_>, source: &str, tokens: &[Token]) -> Option<(String, Sentence)> {
    let (head, tail) = parts(tokens)?;
    let alone = reader.read(text_of(source, tail));
    let refers_back = alone.clauses.iter().filter_map(|c| c.target.as_ref()).any(|t| t.focus);
    if alone.is_certain() && !refers_back {
        return Some((text_of(source, tail).to_owned(), alone));
    }
    let repeated = REPEATED.iter().find(|words| tail.len() > words.len() && begins_with(tail, words));
    let tail = repeated.and_then(|words| tail.get(words.len()..)).unwrap_or(tail);
    replaced(reader, source, (head, tail), "").or_else(|| {
        // "Make the sac, no, the vessel, blue": the utterance goes on behind the correction.
        let comma = tail.iter().position(|t| t.is_mark(','))?;
        let (correction, rest) = (tail.get(..comma)?, tail.get(comma + 1..)?);
        replaced(reader, source, (head, correction), text_of(source, rest))
    })
}

/// The head with the correction in the place of some of its last words that fit, and the rest of the utterance behind it.
fn replaced(
    reader: &Reader<'_>,
    source: &str,
    (head, tail): (&[Token], &[Token]),
    rest: &str,
) -> Option<(String, Sentence)> {
    let first = reader.read(&format!("{} {rest}", text_of(source, head)));
    if !first.not_understood.is_empty() || first.clauses.is_empty() {
        return None;
    }
    let mut named = None;
    let mut lengths: Vec<usize> = (1..=MAX_REPLACED.min(head.len())).collect();
    lengths.sort_by_key(|length| length.abs_diff(tail.len()));
    for length in lengths {
        for from in (0..=head.len() - length).rev() {
            let before = text_of(source, head.get(..from).unwrap_or_default());
            let after = text_of(source, head.get(from + length..).unwrap_or_default());
            let text = format!("{before} {} {after} {rest}", text_of(source, tail)).trim().to_owned();
            let corrected = reader.read(&text);
            if corrected.is_certain() && differs_once(&first, &corrected) {
                return Some((text, corrected));
            }
            // The labeling service may know the name. It takes the place of a known one.
            let has_article = tail.first().is_some_and(|t| matches!(t.text.as_str(), "the" | "my" | "this" | "that"));
            let is_whole = corrected.not_understood.is_empty() && corrected.unknown == 1 && first.unknown == 0;
            let is_name = has_article && is_whole;
            if is_name && named.is_none() && differs_once(&first, &corrected) {
                named = Some((text, corrected));
            }
        }
    }
    named
}

/// What stands before and behind the last marker. Marks and further markers between them belong to neither.
fn parts(tokens: &[Token]) -> Option<(&[Token], &[Token])> {
    let at = |from: usize| MARKERS.iter().find(|words| begins_with(tokens.get(from..).unwrap_or_default(), words));
    let last = (1..tokens.len()).rev().find(|from| at(*from).is_some())?;
    let is_filler = |t: &Token| matches!(t.kind, Kind::Mark(_));
    let mut tail = last;
    while let Some(token) = tokens.get(tail) {
        match at(tail) {
            Some(words) => tail += words.len(),
            None if is_filler(token) => tail += 1,
            None => break,
        }
    }
    let mut head = last;
    loop {
        let marker = MARKERS.iter().find(|words| {
            head > words.len() && begins_with(tokens.get(head - words.len()..).unwrap_or_default(), words)
        });
        match marker {
            Some(words) => head -= words.len(),
            None if head > 1 && tokens.get(head - 1).is_some_and(is_filler) => head -= 1,
            None => break,
        }
    }
    let mut end = tokens.len();
    // "No, the vessel instead."
    while end > tail && tokens.get(end - 1).is_some_and(|t| is_filler(t) || t.text == "instead") {
        end -= 1;
    }
    let (head, tail) = (tokens.get(..head)?, tokens.get(tail..end)?);
    (!head.is_empty() && !tail.is_empty()).then_some((head, tail))
}

/// Whether both have the same acts in the same order, and one clause has another meaning.
pub(super) fn differs_once(first: &Sentence, corrected: &Sentence) -> bool {
    let acts = |s: &Sentence| s.clauses.iter().map(Clause::act).collect::<Vec<_>>();
    let meaning = |c: &Clause| Clause { words: String::new(), ..c.clone() };
    acts(first) == acts(corrected)
        && first.clauses.iter().zip(&corrected.clauses).filter(|(a, b)| meaning(a) != meaning(b)).count() == 1
}
