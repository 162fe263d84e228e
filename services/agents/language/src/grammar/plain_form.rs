//! Plain forms of an utterance: without politeness and reasons, with a verb of the table of commands in place of a modal or of none.

mod phrases;

use self::phrases::{
    AMOUNT_WORDS, AMOUNTS, APART, BECOMES, HOMOPHONES, INTERESTS, LEADS, MODALS, OPINIONS, REMARKS, SOFTENERS, STATES,
    TAILS, TRANSPARENCIES, WISHES,
};
use super::word_pattern::after_any as after;
use crate::color;
use crate::syntax::token::{Kind, Token, begins_with, text_of};

fn words(phrase: &str) -> Vec<&str> {
    phrase.split(' ').collect()
}

/// The tokens without marks at both ends.
fn trimmed(tokens: &[Token]) -> &[Token] {
    let is_mark = |t: &Token| matches!(t.kind, Kind::Mark(',' | '.' | '!' | '?' | ';' | ':' | '-' | '\u{2026}'));
    let from = tokens.iter().position(|t| !is_mark(t)).unwrap_or(tokens.len());
    let to = tokens.iter().rposition(|t| !is_mark(t)).map_or(from, |last| last + 1);
    tokens.get(from..to).unwrap_or_default()
}

/// The part before the longest of some ends.
fn before<'t>(tokens: &'t [Token], ends: &[&str]) -> Option<&'t [Token]> {
    let ends_with = |words: &Vec<&str>| {
        let from = tokens.len().checked_sub(words.len());
        from.and_then(|from| tokens.get(from..)).is_some_and(|rest| begins_with(rest, words))
    };
    let length = ends.iter().map(|phrase| words(phrase)).filter(ends_with).map(|words| words.len()).max()?;
    tokens.get(..tokens.len() - length)
}

/// Without politeness at both ends.
pub(super) fn core(tokens: &[Token]) -> &[Token] {
    let mut rest = trimmed(tokens);
    loop {
        let shorter = after(rest, &LEADS).or_else(|| before(rest, &TAILS)).map(trimmed);
        match shorter.filter(|shorter| !shorter.is_empty()) {
            Some(shorter) => rest = shorter,
            None => return rest,
        }
    }
}

/// Plain forms of an utterance, the surest first. None of them has to be understood.
pub(super) fn of(source: &str, tokens: &[Token]) -> Vec<String> {
    let core = core(tokens);
    let mut forms = Vec::new();
    if core.len() < trimmed(tokens).len() {
        forms.push(text_of(source, core).to_owned());
    }
    let wish = after(core, &WISHES).map(trimmed).filter(|rest| !rest.is_empty());
    for part in std::iter::once(core).chain(wish) {
        forms.extend(modal(source, part));
        forms.extend(state(source, part));
        forms.extend(own_color(source, part));
        forms.extend(share_to(source, part));
        forms.extend(colored(source, part));
        forms.extend(transparent(source, part));
        forms.extend(given(source, part));
    }
    forms.extend(wish.map(|rest| text_of(source, rest).to_owned()));
    forms.extend(background(source, core));
    forms.extend(without_about(source, core));
    forms.extend(about_it(source, core));
    forms
}

/// The utterance with words in place of others that sound alike, if there are any.
pub(super) fn heard(source: &str, tokens: &[Token]) -> Option<String> {
    let said: Vec<&str> = trimmed(tokens).iter().map(|t| text_of(source, std::slice::from_ref(t))).collect();
    let mut text = said.join(" ");
    for (apart, one) in APART {
        text = text.replace(apart, one);
    }
    let alike =
        |word: &str| HOMOPHONES.iter().find(|(heard, _)| heard.eq_ignore_ascii_case(word)).map(|(_, meant)| *meant);
    let better: Vec<&str> = text.split(' ').map(|word| alike(word).unwrap_or(word)).collect();
    let better = better.join(" ");
    (better != said.join(" ")).then_some(better)
}

/// "The sac should be red" as "make the sac red", "could the sac be hidden" as "hide the sac".
fn modal(source: &str, tokens: &[Token]) -> Option<String> {
    let is = |t: &Token, words: &[&str]| words.contains(&t.text.as_str());
    let leads = tokens.first().is_some_and(|t| is(t, &MODALS));
    let clause = if leads { tokens.get(1..)? } else { tokens };
    // The subject ends at the modal, or at "be" where the modal leads.
    let verbs: &[&str] = if leads { &BECOMES } else { &MODALS };
    let at = clause.iter().position(|t| is(t, verbs))?;
    let end = clause.get(..at)?.iter().rposition(|t| !is(t, &SOFTENERS))? + 1;
    let rest = clause.get(at..)?;
    let is_verb = |t: &Token| is(t, &MODALS) || is(t, &BECOMES) || is(t, &SOFTENERS);
    let value = rest.get(rest.iter().position(|t| !is_verb(t))?..)?;
    command_for(source, clause.get(..end)?, value)
}

/// The command for a thing that becomes something.
fn command_for(source: &str, subject: &[Token], value: &[Token]) -> Option<String> {
    let value = after(value, &["shown in", "drawn in", "displayed in", "in"]).unwrap_or(value);
    let subject = text_of(source, subject);
    if value.is_empty() || subject.is_empty() {
        return None;
    }
    let said = value.iter().map(|t| t.text.as_str()).collect::<Vec<_>>().join(" ");
    if let Some((_, command)) = STATES.iter().find(|(state, _)| *state == said) {
        return Some(command.replace('X', subject));
    }
    if let Some(name) = after(value, &["called", "named", "labelled", "labeled"]) {
        return Some(format!("rename {subject} to {}", text_of(source, name)));
    }
    Some(format!("make {subject} {}", text_of(source, value)))
}

/// "Soft tissue off" as "hide soft tissue", "the sac shown on its own" as "show only the sac".
fn state(source: &str, tokens: &[Token]) -> Option<String> {
    let (rest, state, command) = STATES
        .iter()
        .filter_map(|(state, command)| Some((before(tokens, &[state])?, *state, *command)))
        .min_by_key(|(rest, ..)| rest.len())?;
    // "Put the kettle on" is no talk about a scene, "turn the bone on" and "take the bone away" are.
    const SWITCHES: [&str; 2] = ["turn", "switch"];
    const MOVES: [&str; 6] = ["take", "put", "get", "bring", "move", "leave"];
    const PLACES: [&str; 3] = ["away", "out of the way", "out of sight"];
    let is = |t: &Token, words: &[&str]| words.contains(&t.text.as_str());
    let object = match rest.split_first() {
        Some((first, object)) if is(first, &SWITCHES) => object,
        Some((first, object)) if is(first, &MOVES) && PLACES.contains(&state) => object,
        Some((first, _)) if is(first, &MOVES) => return None,
        _ => rest,
    };
    let object = match text_of(source, object) {
        "it all" | "all of it" | "the lot" | "the whole lot" => "everything",
        other => other,
    };
    (!object.is_empty()).then(|| command.replace('X', object))
}

/// "Give the sac back the colour it has in the file" as "restore the colour of the sac".
fn own_color(source: &str, tokens: &[Token]) -> Option<String> {
    const FILE: [&str; 8] = [
        "back",
        "again",
        "it has in the file",
        "it had in the file",
        "in the file",
        "of the file",
        "from the file",
        "it had before",
    ];
    const OWN: [&str; 8] = ["file", "original", "own", "default", "initial", "normal", "usual", "old"];
    let color = tokens.iter().position(|t| matches!(t.text.as_str(), "colour" | "color" | "colours" | "colors"))?;
    let is_own = tokens.iter().any(|t| OWN.contains(&t.text.as_str()));
    let object = after(tokens, &["give", "put", "bring", "set", "reset", "return", "restore", "turn"])?;
    let object = object.get(..color.checked_sub(tokens.len() - object.len())?)?;
    const BACK: [&str; 6] = ["back", "the", "its", "to", "their", "into"];
    let end = object.iter().rposition(|t| !BACK.contains(&t.text.as_str()) && !OWN.contains(&t.text.as_str()))? + 1;
    let rest = tokens.get(color + 1..)?;
    let is_whole = rest.is_empty()
        || FILE.iter().any(|phrase| words(phrase).len() == rest.len() && begins_with(rest, &words(phrase)));
    (is_own && is_whole)
        .then(|| format!("restore the colour of {}", text_of(source, object.get(..end).unwrap_or_default())))
}

/// "Drop the bone to 20 percent" as "set the opacity of the bone to 20 percent". Alpha is opacity.
fn share_to(source: &str, tokens: &[Token]) -> Option<String> {
    let (verb, rest) = tokens.split_first()?;
    if !AMOUNTS.contains(&verb.text.as_str()) {
        return None;
    }
    let number = rest.iter().position(|t| matches!(t.kind, Kind::Number(_)))?;
    let to = rest.get(..number)?.iter().rposition(|t| matches!(t.text.as_str(), "to" | "at"))?;
    let value = rest.get(number..)?;
    let is_share = value.get(1).is_none_or(|t| t.is_mark('%') || t.is("percent") || t.is("opacity"));
    let object = rest.get(..to)?;
    let end = object.iter().rposition(|t| !AMOUNT_WORDS.contains(&t.text.as_str()))? + 1;
    let object = object.get(..end)?;
    let object = after(object, &["the alpha of", "alpha of", "the opacity of", "opacity of"]).unwrap_or(object);
    let (Kind::Number(amount), true) = (&value.first()?.kind, is_share && !object.is_empty() && value.len() <= 3)
    else {
        return None;
    };
    let (object, digits) = (text_of(source, object), text_of(source, value));
    // A number above 1 is a percentage.
    let percent = if value.len() == 1 && *amount > 1.0 { " percent" } else { "" };
    Some(format!("set the opacity of {object} to {digits}{percent}"))
}

/// "Purple for the vessels", "the bone in brown", "put the bone in color brown" and "colour of the bone: beige" as "make … …".
fn colored(source: &str, tokens: &[Token]) -> Option<String> {
    let make = |object: &[Token], color: std::ops::Range<usize>| {
        let color = text_of(source, tokens.get(color)?);
        (!object.is_empty()).then(|| format!("make {} {color}", text_of(source, object)))
    };
    if let Some(color) = color_at(tokens, 0)
        && let Some(object) =
            tokens.get(color.end..).and_then(|rest| after(rest, &["for", "on", "as the colour of", "as color of"]))
    {
        return make(object, color);
    }
    // The colour is what the sentence ends with.
    let from = (1..tokens.len()).find(|from| color_at(tokens, *from).is_some_and(|color| color.end == tokens.len()))?;
    let color = color_at(tokens, from)?;
    let object = tokens.get(..from)?;
    let object = before(object, &["in color", "in colour", "in the color", "in the colour", "in", ":", "="])?;
    let object = after(object, &["put", "set", "show", "have", "paint", "draw", "display"]).unwrap_or(object);
    let object = after(object, &["the colour of", "the color of", "colour of", "color of"]).unwrap_or(object);
    make(object, color)
}

/// "Half-transparent vessels" as "make vessels half transparent".
fn transparent(source: &str, tokens: &[Token]) -> Option<String> {
    let object = after(tokens, &TRANSPARENCIES).filter(|object| !object.is_empty())?;
    let degree = text_of(source, tokens.get(..tokens.len() - object.len())?);
    Some(format!("make {} {degree}", text_of(source, object)))
}

/// "Give the bone a warmer tone" as "make the bone warmer".
fn given(source: &str, tokens: &[Token]) -> Option<String> {
    const LOOKS: [&str; 7] = ["tone", "look", "colour", "color", "shade", "tint", "touch"];
    let rest = after(tokens, &["give"])?;
    let (last, rest) = rest.split_last()?;
    let article = rest.iter().rposition(|t| t.text == "a" || t.text == "an").filter(|at| *at > 0)?;
    let (object, value) = (rest.get(..article)?, rest.get(article + 1..)?);
    let is_look = LOOKS.contains(&last.text.as_str()) && !value.is_empty();
    is_look.then(|| format!("make {} {}", text_of(source, object), text_of(source, value)))
}

/// "I need it on a white background" and "change the bg to white" as "make the background white".
fn background(source: &str, tokens: &[Token]) -> Option<String> {
    const NAMES: [&str; 4] = ["background", "backdrop", "bg", "backround"];
    const NEGATIONS: [&str; 5] = ["not", "don't", "dont", "never", "no"];
    let is = |t: &Token, words: &[&str]| words.contains(&t.text.as_str());
    // Other commands beside it would be lost.
    let is_alone =
        !tokens.iter().any(|t| is(t, &NEGATIONS) || is(t, &["and", "then"]) || t.is_mark(',') || t.is_mark(';'));
    let at = tokens.iter().position(|t| is(t, &NAMES)).filter(|_| is_alone)?;
    // Next to it, or at the end of the sentence.
    let place = (0..tokens.len()).find_map(|from| {
        let color = color_at(tokens, from)?;
        (color.end == at || (from > at && color.end == tokens.len())).then_some(color)
    })?;
    Some(format!("make the background {}", text_of(source, tokens.get(place)?)))
}

/// "Turn it by about 20 degrees" without "about".
fn without_about(source: &str, tokens: &[Token]) -> Option<String> {
    const ABOUT: [&str; 6] = ["about", "around", "roughly", "approximately", "some", "maybe"];
    let is_about = |pair: &[Token]| match pair {
        [word, number] => ABOUT.contains(&word.text.as_str()) && matches!(number.kind, Kind::Number(_)),
        _ => false,
    };
    let at = tokens.windows(2).position(is_about)?;
    let (lead, rest) = (text_of(source, tokens.get(..at)?), text_of(source, tokens.get(at + 1..)?));
    Some(format!("{lead} {rest}").trim().to_owned())
}

/// The colour that begins at a token.
fn color_at(tokens: &[Token], from: usize) -> Option<std::ops::Range<usize>> {
    let said: Vec<&str> =
        tokens.get(from..)?.iter().take_while(|t| t.kind == Kind::Word).map(|t| t.text.as_str()).collect();
    let (_, length) = color::from_words(said.get(..said.len().min(color::MAX_WORDS))?)?;
    Some(from..from + length)
}

/// The parts of an utterance of several commands: what commas and conjunctions separate.
pub(super) fn parts(source: &str, tokens: &[Token]) -> Vec<String> {
    const BETWEEN: [&str; 4] = ["and", "then", "afterwards", "also"];
    let is_break = |t: &Token| {
        matches!(t.kind, Kind::Mark(',' | ';' | '.' | '!'))
            || (t.kind == Kind::Word && BETWEEN.contains(&t.text.as_str()))
    };
    let parts = core(tokens).split(is_break).map(core).filter(|part| !part.is_empty());
    parts.map(|part| text_of(source, part).to_owned()).collect()
}

/// Whether a part of an utterance only says what somebody thinks: "interesting", "much better".
pub(super) fn is_remark(part: &str) -> bool {
    let mut words = part.split_whitespace().map(str::to_lowercase).peekable();
    words.peek().is_some() && words.all(|word| OPINIONS.contains(&word.as_str()))
}

/// "The metal thing is in my way, hide it" as "hide the metal thing".
fn about_it(source: &str, tokens: &[Token]) -> Option<String> {
    let comma = tokens.iter().position(|t| t.is_mark(',') || t.is_mark(';') || t.is_mark('.') || t.is_mark(':'))?;
    let (remark, command) = (tokens.get(..comma)?, trimmed(tokens.get(comma + 1..)?));
    let object = match after(remark, &INTERESTS) {
        Some(object) => object,
        None => remark.get(..remark.iter().position(|t| REMARKS.contains(&t.text.as_str()))?)?,
    };
    let it = command.iter().position(|t| matches!(t.text.as_str(), "it" | "them" | "that" | "this"))?;
    if object.is_empty() || it == 0 {
        return None;
    }
    let (lead, rest) = (text_of(source, command.get(..it)?), text_of(source, command.get(it + 1..)?));
    Some(format!("{lead} {} {rest}", text_of(source, object)).trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::syntax::token::tokens;

    #[test]
    fn utterances_have_plain_forms() {
        for (said, form) in [
            (
                "Sorry to bother you, but could the vessels perhaps be a little less opaque? Thanks a lot!",
                "make the vessels a little less opaque",
            ),
            ("I was wondering whether we could look at this from the back.", "look at this from the back"),
            ("Dear assistant, may I ask you to colour the clip in red? Many thanks.", "colour the clip in red"),
            ("If it's not too much trouble, I'd love a white background", "a white background"),
            ("Would it be possible to have the sac shown on its own, please?", "show only the sac"),
            ("The pink stuff should be fully opaque", "make The pink stuff fully opaque"),
            ("Can the blue one be green instead?", "make the blue one green"),
            ("The biggest structure should appear in dark red.", "make The biggest structure dark red"),
            ("The clip shall be called Yasargil from now on", "rename The clip to Yasargil"),
            ("soft tissue off", "hide soft tissue"),
            ("drop the bone to 20 percent", "set the opacity of the bone to 20 percent"),
            ("dial the alpha of the aneurysm down to .3", "set the opacity of the aneurysm to .3"),
            ("set the bone to 30", "set the opacity of the bone to 30 percent"),
            ("half-transparent vessels", "make vessels half-transparent"),
            ("let's try purple for the blood vessels", "make the blood vessels purple"),
            ("please to put the bone in color brown", "make the bone brown"),
            ("Give the aneurysm back the colour it has in the file", "restore the colour of the aneurysm"),
            ("The metal thing is in my way, remove it from view", "remove The metal thing from view"),
            ("I want to work on the skull, select it", "select the skull"),
            ("I need it on a white background for a figure", "make the background white"),
            ("change the bg to light green", "make the background light green"),
            ("orbit up by about 20°", "orbit up by 20°"),
            ("give the bone a warmer tone", "make the bone warmer"),
        ] {
            let forms = of(said, &tokens(said));
            assert!(forms.iter().any(|f| f == form), "“{said}”: {forms:?}");
        }
        for (said, form) in [
            ("zoom inn", "zoom in"),
            ("light from the write", "light from the right"),
            ("back ground white", "background white"),
        ] {
            assert_eq!(heard(said, &tokens(said)).as_deref(), Some(form));
        }
        let said = "bone at 15%, tissue off and then white background";
        assert_eq!(parts(said, &tokens(said)), ["bone at 15%", "tissue off", "white background"]);
        assert_eq!(heard("hide the bone", &tokens("hide the bone")), None);
    }
}
