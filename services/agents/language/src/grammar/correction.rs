//! Corrections of the utterance before: "no, the sac", "I meant the clip", "not the bone, the sac", "never mind".
//!
//! What the utterance before did is taken back, and the corrected one follows in the same plan. [`self_correction`] finds what the
//! correction takes the place of.

use sg_proto::language::{Act, Clause, IntentRequest, Reference, Turn, movement};
use sg_proto::scene::{SetView, State, set_view};

use super::forms::{self, is_safe};
use super::sentence::Sentence;
use super::{Reader, self_correction, spelling};
use crate::syntax::token::{self, Kind, Token, begins_with, text_of};

/// Longest correction, and longest utterance that one is about, tokens.
const MOST_TOKENS: [usize; 2] = [20, 40];

/// Most utterances that correct each other, one after another.
const MOST_TURNS: usize = 4;

/// Most tokens of a name that no unit has. The labeling service may know it.
const MOST_OF_NAME: usize = 3;

/// Most words of "black was better".
const MOST_OF_COMPARISON: usize = 6;

/// Beginnings that reject the utterance before, beside the markers of a correction within an utterance. The longest stand first.
const REJECTIONS: [&[&str]; 16] = [
    &["that", "was", "supposed", "to", "be"],
    &["it", "was", "supposed", "to", "be"],
    &["that", "was", "meant", "to", "be"],
    &["that", "should", "have", "been"],
    &["it", "should", "have", "been"],
    &["i", "wanted"],
    &["that", "was", "wrong"],
    &["that", "is", "wrong"],
    &["not", "that", "one"],
    &["not", "this", "one"],
    &["that", "'s", "wrong"],
    &["my", "mistake"],
    &["wrong", "one"],
    &["not", "this"],
    &["i", "said"],
    &["wrong"],
];

/// Markers that reject nothing by themselves. A whole command behind one is a new command.
const WEAK: [&[&str]; 5] = [&["or", "rather"], &["make", "that"], &["actually"], &["oops"], &["wait"]];

/// Words without a meaning around a rejection.
const HESITATIONS: [&str; 15] =
    ["hmm", "hm", "mm", "uh", "uhm", "um", "er", "erm", "oh", "ah", "ugh", "whoops", "well", "but", "please"];

/// Words behind "no" that make it no rejection: "no thanks", "no more".
const NO_IDIOMS: [&str; 10] =
    ["thanks", "thank", "more", "longer", "need", "problem", "idea", "way", "further", "matter"];

/// Ways to ask that the last change be taken back.
const TAKING_BACK: [&str; 38] = [
    "never mind",
    "nevermind",
    "forget it",
    "forget that",
    "cancel that",
    "scratch that",
    "not that",
    "not this",
    "wrong",
    "that was wrong",
    "that's wrong",
    "that is wrong",
    "that was a mistake",
    "my mistake",
    "oops",
    "put it back",
    "put that back",
    "put them back",
    "put it back as it was",
    "change it back",
    "change that back",
    "change them back",
    "turn it back",
    "take that back",
    "take it back",
    "go back",
    "go back to that",
    "undo",
    "undo that",
    "undo it",
    "as it was",
    "leave it as it was",
    "not what i wanted",
    "that's not what i wanted",
    "that is not what i wanted",
    "that's not what i meant",
    "that is not what i meant",
    "i didn't mean that",
];

/// Ends of a sentence that prefers what was before: "black was better".
const PREFERENCES: [&str; 6] =
    [" was better", " were better", " looked better", " was nicer", " better before", " nicer before"];

/// Words around such a sentence: "no, put it back, please".
const AROUND: [&str; 9] = ["no", "nope", "sorry", "oops", "wait", "actually", "then", "again", "thanks"];

/// Acts that only ask. Nothing is taken back for a question.
const ASKING: [Act; 5] = [Act::List, Act::ListViews, Act::Describe, Act::QuerySelection, Act::Help];

/// The clauses of an utterance that takes the one before back, with those of the corrected one. `None`: it corrects nothing.
///
/// Nothing is taken back if the turn before changed nothing. `literal` is the utterance as it was said: one with a meaning keeps it,
/// except "put it back" where nothing was moved.
pub(super) fn of(
    reader: &Reader<'_>,
    request: &IntentRequest,
    tokens: &[Token],
    literal: &Sentence,
) -> Option<Sentence> {
    let turns = &request.conversation;
    let turns = turns.get(turns.len().saturating_sub(MOST_TURNS)..)?;
    let last = turns.last()?;
    let scene = request.observation.as_ref()?.scene.as_ref()?;
    if tokens.len() > MOST_TOKENS[0] {
        return None;
    }
    let undone = || taken_back(reader, turns, scene, &request.text);
    if last.undo_steps > 0 && is_taking_back(tokens) {
        let is_free = !literal.is_certain() || (is_put_back(literal) && !has_act(reader, turns, &[Act::Transform]));
        return is_free.then(|| Sentence { clauses: undone(), ..Sentence::default() });
    }
    if literal.is_certain() {
        return None;
    }
    let (_, sentence) = corrected(reader, turns, &request.text, tokens)?;
    let is_own = |clause: &Clause| ASKING.contains(&clause.act()) || matches!(clause.act(), Act::Undo | Act::Redo);
    if last.undo_steps == 0 || sentence.clauses.iter().all(is_own) {
        return Some(sentence);
    }
    let meant = sentence.clauses.into_iter().map(|clause| with_names(clause, &scene.focus));
    let clauses = undone().into_iter().map(Some).chain(meant).collect::<Option<Vec<Clause>>>()?;
    Some(Sentence { clauses, unknown: sentence.unknown, ..Sentence::default() })
}

/// The clauses that take the last turn back. The viewpoint stays where a person has moved it since, unless the turn was about it.
fn taken_back(reader: &Reader<'_>, turns: &[Turn], scene: &State, source: &str) -> Vec<Clause> {
    const VIEWS: [Act; 2] = [Act::SetView, Act::BestView];
    let Some(last) = turns.last() else { return Vec::new() };
    let undo = Clause {
        act: Act::Undo.into(),
        amount: Some(f64::from(last.undo_steps)),
        words: source.trim().to_owned(),
        ..Clause::default()
    };
    let view = scene.view.filter(|_| last.later_views > 0 && !has_act(reader, turns, &VIEWS));
    let stay = view.map(|view| Clause {
        act: Act::SetView.into(),
        view: Some(SetView { change: Some(set_view::Change::View(view)) }),
        ..Clause::default()
    });
    std::iter::once(undo).chain(stay).collect()
}

/// Whether the last turn has a clause of one of these acts.
fn has_act(reader: &Reader<'_>, turns: &[Turn], acts: &[Act]) -> bool {
    let text = amounts_to(reader, turns);
    text.is_some_and(|text| reader.read(&text).clauses.iter().any(|clause| acts.contains(&clause.act())))
}

/// Whether this is "put it back" alone.
fn is_put_back(sentence: &Sentence) -> bool {
    let [clause] = sentence.clauses.as_slice() else { return false };
    let kind = clause.movement.as_ref().and_then(|movement| movement.kind.as_ref());
    matches!(kind, Some(movement::Kind::PutBack(_))) && clause.target.as_ref().is_some_and(|target| target.focus)
}

/// The clause with names in place of "it" and "the rest": an undo takes the last target back too. `None`: there is none.
fn with_names(clause: Clause, focus: &[String]) -> Option<Clause> {
    let Some(target) = &clause.target else { return Some(clause) };
    let is_rest = target.complement && target.names.is_empty() && !target.selection;
    if !target.focus && !is_rest {
        return Some(clause);
    }
    if focus.is_empty() {
        return None;
    }
    let mut names = target.names.clone();
    names.extend(focus.iter().filter(|name| !target.names.contains(name)).cloned());
    let target = Reference { names, focus: false, ..target.clone() };
    Some(Clause { target: Some(target), ..clause })
}

/// What a correction says.
struct Meant<'t> {
    /// What is meant.
    tokens: &'t [Token],
    /// What is not meant, if it is named.
    rejected: Option<&'t [Token]>,
    /// Whether something is rejected in so many words.
    is_explicit: bool,
}

/// The text of the last of some turns as the utterance behind them corrects it, and its reading.
fn corrected(reader: &Reader<'_>, turns: &[Turn], source: &str, tokens: &[Token]) -> Option<(String, Sentence)> {
    let meant = meant(tokens)?;
    let said = text_of(source, meant.tokens);
    let alone = reader.read(said);
    // "Thanks" is no correction.
    let is_courtesy = alone.clauses.is_empty() && alone.not_understood.is_empty();
    if is_courtesy || (alone.is_certain() && !meant.is_explicit) {
        return None;
    }
    let before = amounts_to(reader, turns)?;
    let found = match meant.rejected.map(|rejected| exchanged(reader, &before, rejected, said)) {
        Some(Some(found)) => Some(found),
        Some(None) if !meant.rejected.is_some_and(|rejected| is_target(reader, source, rejected)) => return None,
        _ => {
            let joined = format!("{before}, no, {said}");
            self_correction::corrected(reader, &joined, &token::tokens(&joined))
        }
    };
    let found = found.or_else(|| alone.is_certain().then(|| (said.to_owned(), alone)));
    found.filter(|(_, sentence)| is_clear(sentence, meant.tokens))
}

/// Whether every name is known, or the one that is not stands for a thing that a command takes which can be taken back.
fn is_clear(sentence: &Sentence, meant: &[Token]) -> bool {
    let is_name = meant.len() <= MOST_OF_NAME && meant.first().is_some_and(is_article);
    sentence.unknown == 0 || (sentence.unknown == 1 && is_name && is_safe(sentence))
}

fn is_article(token: &Token) -> bool {
    matches!(token.text.as_str(), "the" | "my")
}

/// The text that the last turn amounts to: in a form that is understood, and with what it corrected.
fn amounts_to(reader: &Reader<'_>, turns: &[Turn]) -> Option<String> {
    let (last, earlier) = turns.split_last()?;
    let text = last.utterance.trim().trim_end_matches(['.', '!', '?', ',', ';', ' ']);
    let tokens = token::tokens(text);
    if tokens.len() > MOST_TOKENS[1] {
        return None;
    }
    if reader.read_tokens(text, &tokens).is_certain() {
        return Some(text.to_owned());
    }
    let before = || corrected(reader, earlier, text, &tokens).map(|(text, _)| text);
    let within = || self_correction::corrected(reader, text, &tokens).map(|(text, _)| text);
    let plain = || forms::of(reader, text, &tokens).into_iter().find(|form| reader.read(form).is_certain());
    let spelled = || spelling::repaired(reader, text).map(|(text, _)| text);
    Some(before().or_else(within).or_else(plain).or_else(spelled).unwrap_or_else(|| text.to_owned()))
}

/// The text with what is meant in the place of what is rejected, and its reading.
fn exchanged(reader: &Reader<'_>, before: &str, rejected: &[Token], said: &str) -> Option<(String, Sentence)> {
    let name = match rejected.split_first() {
        Some((first, rest)) if is_article(first) && !rest.is_empty() => rest,
        _ => rejected,
    };
    let tokens = token::tokens(before);
    let is_here = |here: &[Token]| here.iter().zip(name).all(|(a, b)| a.lemma == b.lemma);
    let at = tokens.windows(name.len().max(1)).position(is_here)?;
    let from = at.checked_sub(1).filter(|from| tokens.get(*from).is_some_and(is_article)).unwrap_or(at);
    let (first, last) = (tokens.get(from)?, tokens.get(at + name.len().max(1) - 1)?);
    let text = format!("{}{said}{}", before.get(..first.start)?, before.get(last.end..)?);
    let sentence = reader.read(&text);
    let is_whole = sentence.not_understood.is_empty();
    (is_whole && self_correction::differs_once(&reader.read(before), &sentence)).then_some((text, sentence))
}

/// Whether some words name what a command can be about.
fn is_target(reader: &Reader<'_>, source: &str, words: &[Token]) -> bool {
    reader.read(&format!("hide {}", text_of(source, words))).is_certain()
}

/// What a correction says. `None`: it does not begin as one.
fn meant(tokens: &[Token]) -> Option<Meant<'_>> {
    let (rest, is_marked, is_explicit) = behind_rejection(tokens)?;
    let is_break = |t: &Token| matches!(t.kind, Kind::Mark(',' | ';' | '.' | '!' | ':')) || t.text == "but";
    if let Some((_, negated)) = rest.split_first().filter(|(first, _)| first.text == "not") {
        // "Not the bone, the sac."
        let at = negated.iter().position(is_break)?;
        let (rejected, meant) = negated.split_at(at);
        let (meant, ..) = behind_rejection(meant)?;
        let is_said = !rejected.is_empty() && !meant.is_empty();
        return is_said.then_some(Meant { tokens: meant, rejected: Some(rejected), is_explicit: true });
    }
    // "Everything, not the bone" is an exception.
    let is_all = rest.iter().any(|t| matches!(t.text.as_str(), "all" | "everything"));
    let negation = rest.windows(2).position(|pair| matches!(pair, [mark, not] if is_break(mark) && not.text == "not"));
    if let Some(at) = negation.filter(|_| !is_all) {
        // "The sac, not the bone."
        let (meant, rejected) = (rest.get(..at)?, rest.get(at + 2..)?);
        let is_said = !rejected.is_empty() && !meant.is_empty();
        return is_said.then_some(Meant { tokens: meant, rejected: Some(rejected), is_explicit });
    }
    // "The sac instead."
    let instead =
        rest.split_last().filter(|(last, _)| last.text == "instead").map(|(_, shorter)| without_marks(shorter));
    let is_correction = is_marked || instead.is_some();
    let tokens = instead.unwrap_or(rest);
    (is_correction && !tokens.is_empty()).then_some(Meant { tokens, rejected: None, is_explicit })
}

/// The tokens behind rejections and hesitations, whether there are rejections, and whether one of them is more than a hesitation.
/// `None`: a "no" that rejects nothing.
fn behind_rejection(tokens: &[Token]) -> Option<(&[Token], bool, bool)> {
    let (mut is_marked, mut is_explicit) = (false, false);
    let mut rest = without_marks(tokens);
    loop {
        let is_idiom = matches!(rest, [no, next, ..] if no.text == "no" && NO_IDIOMS.contains(&next.text.as_str()));
        if is_idiom {
            return None;
        }
        let words = REJECTIONS.iter().chain(&self_correction::MARKERS).find(|words| begins_with(rest, words));
        let length = match words {
            Some(words) => {
                is_marked = true;
                is_explicit |= !WEAK.contains(words);
                words.len()
            }
            None if rest.first().is_some_and(|first| HESITATIONS.contains(&first.text.as_str())) => 1,
            None => return Some((rest, is_marked, is_explicit)),
        };
        rest = without_marks(rest.get(length..).unwrap_or_default());
    }
}

/// The tokens without marks at both ends. A percent sign belongs to its number.
fn without_marks(tokens: &[Token]) -> &[Token] {
    let is_mark = |t: &Token| matches!(t.kind, Kind::Mark(c) if c != '%');
    let from = tokens.iter().position(|t| !is_mark(t)).unwrap_or(tokens.len());
    let to = tokens.iter().rposition(|t| !is_mark(t)).map_or(from, |last| last + 1);
    tokens.get(from..to).unwrap_or_default()
}

/// Whether an utterance asks for nothing but that the last change be taken back.
fn is_taking_back(tokens: &[Token]) -> bool {
    let mut is_asked = false;
    for part in tokens.split(|t| matches!(t.kind, Kind::Mark(_))) {
        let words: Vec<String> = part.iter().map(|t| t.text.replace('\u{2019}', "'")).collect();
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        match takes_back(&words) {
            Some(asked) => is_asked |= asked,
            None => return false,
        }
    }
    is_asked
}

/// Whether some words ask for it. `None`: they say something else. "No" alone says nothing.
fn takes_back(words: &[&str]) -> Option<bool> {
    let is_around = |word: &str| AROUND.contains(&word) || HESITATIONS.contains(&word);
    let leads = words.iter().take_while(|word| is_around(word)).count();
    let end = words.iter().rposition(|word| !is_around(word)).map_or(0, |last| last + 1);
    let mut shorter = (0..end).filter_map(|from| words.get(from..end)).take(leads + 1);
    if is_way_back(words) || shorter.any(is_way_back) {
        return Some(true);
    }
    (leads == words.len()).then_some(false)
}

fn is_way_back(words: &[&str]) -> bool {
    let said = words.join(" ").replace(" '", "'");
    let is_about_before = match words.first() {
        // "That was better" may be praise.
        Some(&("that" | "this")) => said.ends_with(" before"),
        Some(&("what" | "which" | "who")) | None => false,
        Some(_) => true,
    };
    let is_preference = PREFERENCES.iter().any(|end| said.ends_with(end)) && words.len() <= MOST_OF_COMPARISON;
    TAKING_BACK.contains(&said.as_str()) || (is_preference && is_about_before)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_is_taken_back_in_many_words() {
        for said in [
            "never mind",
            "Put it back.",
            "no, not that",
            "no not that!",
            "that was wrong",
            "That\u{2019}s wrong, put it back please",
            "oops",
            "black was better, put it back",
            "the old one was better",
            "I liked it better before",
            "sorry, put it back again",
        ] {
            assert!(is_taking_back(&token::tokens(said)), "{said}");
        }
        for said in [
            "no",
            "no thanks",
            "no, sorry",
            "thanks",
            "that was better",
            "put the sac back",
            "never",
            "what was better?",
        ] {
            assert!(!is_taking_back(&token::tokens(said)), "{said}");
        }
    }

    #[test]
    fn a_correction_is_told_from_what_it_rejects() {
        let said = |text: &str| {
            let tokens = token::tokens(text);
            let meant = meant(&tokens)?;
            let rejected = meant.rejected.map(|rejected| text_of(text, rejected).to_owned());
            Some((text_of(text, meant.tokens).to_owned(), rejected, meant.is_explicit))
        };
        for (text, meant, rejected, is_explicit) in [
            ("no, the sac", "the sac", None, true),
            ("hmm no, make that light blue", "light blue", None, true),
            ("oops I meant white", "white", None, true),
            ("sorry, 30 %", "30 %", None, true),
            ("not that one, the clip", "the clip", None, true),
            ("oops, not the bone, the vessels", "the vessels", Some("the bone"), true),
            ("not the vessels! the skull", "the skull", Some("the vessels"), true),
            ("the sac, not the bone", "the sac", Some("the bone"), false),
            ("wait, the clip", "the clip", None, false),
            ("the clip instead", "the clip", None, false),
        ] {
            assert_eq!(said(text), Some((meant.to_owned(), rejected.map(str::to_owned), is_explicit)), "{text}");
        }
        for text in ["no", "no thanks", "no more", "make the sac blue", "the sac", "sorry", "not now"] {
            assert_eq!(said(text), None, "{text}");
        }
    }
}
