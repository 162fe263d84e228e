//! Other forms of an utterance with the same meaning, in words that the table of commands has.

use crate::color;
use crate::syntax::token::{self, Kind, Token, begins_with, text_of};

/// Words that ask for something to be so: "can the sac be red".
const MODALS: [&str; 7] = ["can", "could", "may", "might", "should", "shall", "would"];

/// First words of a purpose or a reason, which no command has.
const PURPOSES: [&[&str]; 21] = [
    &["so", "that"],
    &["so", "i"],
    &["so", "we"],
    &["so", "you"],
    &["in", "order", "to"],
    &["because"],
    &["since"],
    &["as", "i"],
    &["as", "we"],
    &["to", "see"],
    &["to", "show"],
    &["to", "reveal"],
    &["to", "expose"],
    &["to", "highlight"],
    &["to", "emphasize"],
    &["to", "emphasise"],
    &["to", "look"],
    &["to", "get", "a"],
    &["for", "a", "better"],
    &["for", "better"],
    &["which", "is"],
];

/// Openings of a wish, and the command in their place.
const WISHES: [(&[&str], &str, &str); 11] = [
    (&["i", "don't", "want", "to", "see"], "hide", ""),
    (&["i", "dont", "want", "to", "see"], "hide", ""),
    (&["i", "do", "not", "want", "to", "see"], "hide", ""),
    (&["i", "don't", "need", "to", "see"], "hide", ""),
    (&["i", "no", "longer", "want", "to", "see"], "hide", ""),
    (&["i'd", "rather", "not", "see"], "hide", ""),
    (&["let", "me", "see", "through"], "make", "transparent"),
    (&["let", "us", "see", "through"], "make", "transparent"),
    (&["i", "want", "to", "see", "through"], "make", "transparent"),
    (&["what", "is", "the", "volume", "of"], "how big is", ""),
    (&["measure"], "how big is", ""),
];

/// Forms of the utterance, the surest first. None of them has to be understood.
pub(super) fn of(source: &str, tokens: &[Token]) -> Vec<String> {
    let forms = [asked(source, tokens), without_purpose(source, tokens), wished(source, tokens)];
    let more =
        [assigned(source, tokens), color_first(source, tokens), share_last(source, tokens), signed(source, tokens)];
    let mut all: Vec<String> = forms.into_iter().chain(more).flatten().collect();
    // A purpose may follow any other form.
    if let Some(short) = without_purpose(source, tokens) {
        let tokens = token::tokens(&short);
        all.extend([asked(&short, &tokens), wished(&short, &tokens)].into_iter().flatten());
    }
    all
}

/// "Can the sac be red" as "the sac should be red".
fn asked(source: &str, tokens: &[Token]) -> Option<String> {
    let (first, rest) = tokens.split_first()?;
    let at = rest.iter().position(|t| t.text == "be").filter(|at| *at > 0)?;
    let (subject, value) = (rest.get(..at)?, rest.get(at + 1..)?);
    let value: Vec<Token> = value.iter().take_while(|t| !t.is_mark('?')).cloned().collect();
    MODALS
        .contains(&first.text.as_str())
        .then(|| format!("{} should be {}", text_of(source, subject), text_of(source, &value)))
}

/// "Hide the skin so that I can see the bone" as "hide the skin".
fn without_purpose(source: &str, tokens: &[Token]) -> Option<String> {
    let is_purpose =
        |at: &usize| PURPOSES.iter().any(|words| tokens.get(*at..).is_some_and(|rest| begins_with(rest, words)));
    let at = (2..tokens.len()).find(is_purpose)?;
    Some(text_of(source, tokens.get(..at)?).trim_end_matches([',', ' ']).to_owned())
}

/// "I don't want to see the skin" as "hide the skin".
fn wished(source: &str, tokens: &[Token]) -> Option<String> {
    // A contraction is a word and its end.
    let spoken: Vec<String> = tokens.iter().map(|t| t.text.replace('\u{2019}', "'")).collect();
    let fits = |words: &[&str]| spoken.len() > words.len() && words.iter().zip(&spoken).all(|(a, b)| a == b);
    let (words, before, after) = WISHES.iter().find(|(words, _, _)| fits(words))?;
    let object: Vec<Token> =
        tokens.get(words.len()..)?.iter().take_while(|t| !t.is_mark('?') && !t.is_mark('.')).cloned().collect();
    Some(format!("{before} {} {after}", text_of(source, &object)).trim_end().to_owned())
}

/// "sac: red", "sac -> red" and "sac = red" as "sac red".
fn assigned(source: &str, tokens: &[Token]) -> Option<String> {
    let is_sign = |t: &Token| matches!(t.kind, Kind::Mark(':' | '=' | '>' | '-' | '\u{2192}'));
    let from = tokens.iter().position(is_sign).filter(|at| *at > 0)?;
    let length = tokens.get(from..)?.iter().take_while(|t| is_sign(t)).count();
    let (left, right) = (tokens.get(..from)?, tokens.get(from + length..)?);
    let once = !right.is_empty() && !right.iter().any(is_sign);
    // A sign before a number belongs to it.
    let signs = !matches!(right.first()?.kind, Kind::Number(_)) || !tokens.get(from)?.is_mark('-') || length > 1;
    (once && signs).then(|| format!("{} {}", text_of(source, left), text_of(source, right)))
}

/// "Red sac" as "make the sac red".
fn color_first(source: &str, tokens: &[Token]) -> Option<String> {
    let words: Vec<&str> = tokens.iter().take_while(|t| t.kind == Kind::Word).map(|t| t.text.as_str()).collect();
    let (_, length) = color::from_words(words.get(..words.len().min(color::MAX_WORDS))?)?;
    let (color, name) = (tokens.get(..length)?, tokens.get(length..)?);
    (!name.is_empty()).then(|| format!("make {} {}", text_of(source, name), text_of(source, color)))
}

/// "10 % more opaque" as "more opaque by 10 %".
fn share_last(source: &str, tokens: &[Token]) -> Option<String> {
    let at = tokens.iter().position(|t| matches!(t.text.as_str(), "more" | "less"))?;
    let percent = at.checked_sub(1).filter(|p| tokens.get(*p).is_some_and(|t| t.is_mark('%') || t.is("percent")))?;
    let number = percent.checked_sub(1).filter(|n| matches!(tokens.get(*n).map(|t| &t.kind), Some(Kind::Number(_))))?;
    let before = text_of(source, tokens.get(..number)?);
    let share = text_of(source, tokens.get(number..at)?);
    Some(format!("{before} {} by {share}", text_of(source, tokens.get(at..)?)))
}

/// "Bone opacity -20%" as "reduce the opacity of bone by 20 %".
fn signed(source: &str, tokens: &[Token]) -> Option<String> {
    let is_property = |t: &Token| matches!(t.text.as_str(), "opacity" | "transparency");
    let sign = tokens.windows(2).position(|pair| match pair {
        [sign, number] => (sign.is_mark('-') || sign.is_mark('+')) && matches!(number.kind, Kind::Number(_)),
        _ => false,
    })?;
    let (before, amount) = (tokens.get(..sign)?, tokens.get(sign + 1..)?);
    let property = before.iter().find(|t| is_property(t))?;
    let frame = ["set", "change", "adjust", "make", "of", "by", "to", "'s", "the", "its"];
    let target: Vec<&str> = before
        .iter()
        .filter(|t| !is_property(t) && !frame.contains(&t.text.as_str()))
        .map(|t| source.get(t.start..t.end).unwrap_or_default())
        .collect();
    let target = if target.is_empty() { "it".to_owned() } else { target.join(" ") };
    let verb = if tokens.get(sign)?.is_mark('-') { "reduce" } else { "increase" };
    Some(format!("{verb} the {} of {target} by {}", property.text, text_of(source, amount)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::syntax::token::tokens;

    #[test]
    fn an_utterance_has_its_forms() {
        for (said, form) in [
            ("Can the sac be red?", "the sac should be red"),
            ("hide the skin so that I can see the bone", "hide the skin"),
            ("hide the skin, because it is in the way", "hide the skin"),
            ("I don't want to see the skin.", "hide the skin"),
            ("let me see through the skin", "make the skin transparent"),
            ("sac: red", "sac red"),
            ("sac -> red", "sac red"),
            ("dark red sac", "make sac dark red"),
            ("make the vessel 10 % more opaque", "make the vessel more opaque by 10 %"),
            ("bone opacity -20%", "reduce the opacity of bone by 20%"),
            ("set the opacity of the bone to +20 %", "increase the opacity of bone by 20 %"),
        ] {
            let forms = of(said, &tokens(said));
            assert!(forms.iter().any(|f| f == form), "“{said}”: {forms:?}");
        }
        assert_eq!(of("make the sac red", &tokens("make the sac red")), Vec::<String>::new());
    }
}
