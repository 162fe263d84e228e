//! Other forms of an utterance with the same meaning, in words that the table of commands has.

use super::plain_form;
use crate::color;
use crate::syntax::token::{self, Kind, Token, begins_with, text_of};

/// Words that ask for something to be so: "can the sac be red".
const MODALS: [&str; 7] = ["can", "could", "may", "might", "should", "shall", "would"];

/// First words of a purpose or a reason, which no command has.
const PURPOSES: [&[&str]; 43] = [
    &["but", "keep"],
    &["but", "leave"],
    &["and", "leave"],
    &["instead", "of"],
    &["rather", "than"],
    &["but", "don't"],
    &["it", "looks", "like"],
    &["it", "disappears"],
    &["like", "in"],
    &["of", "all"],
    &["without", "changing"],
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
    &["so", "it"],
    &["so", "its"],
    &["so", "the"],
    &["for", "a", "figure"],
    &["for", "my"],
    &["for", "our"],
    &["for", "the", "paper"],
    &["for", "the", "figure"],
    &["i'm", "too"],
    &["i", "am", "too"],
    &["i", "don't", "need"],
];

/// Beginnings and ends of an utterance about X, and the command in their place.
const FRAMES: [(&[&str], &[&str], &str); 44] = [
    (&["i", "don't", "want", "to", "see"], &[], "hide X"),
    (&["i", "dont", "want", "to", "see"], &[], "hide X"),
    (&["i", "do", "not", "want", "to", "see"], &[], "hide X"),
    (&["i", "don't", "need", "to", "see"], &[], "hide X"),
    (&["i", "no", "longer", "want", "to", "see"], &[], "hide X"),
    (&["i'd", "rather", "not", "see"], &[], "hide X"),
    (&["i'd", "love", "to", "see"], &["disappear"], "hide X"),
    (&["i'd", "like", "to", "see"], &["disappear"], "hide X"),
    (&["get"], &["out", "of", "the", "way"], "hide X"),
    (&["get"], &["out", "of", "my", "way"], "hide X"),
    (&["kill"], &[], "hide X"),
    (&["lose"], &[], "hide X"),
    (&["drop"], &[], "hide X"),
    (&["ditch"], &[], "hide X"),
    (&["let", "me", "see", "through"], &[], "make X transparent"),
    (&["let", "us", "see", "through"], &[], "make X transparent"),
    (&["i", "want", "to", "see", "through"], &[], "make X transparent"),
    (&["could", "we", "see"], &[], "make X"),
    (&["could", "i", "see"], &[], "make X"),
    (&["can", "we", "see"], &[], "make X"),
    (&["can", "i", "see"], &[], "make X"),
    (&["i'd", "love", "to", "see"], &[], "make X"),
    (&["i", "want", "to", "see"], &[], "make X"),
    (&["just"], &[], "show only X"),
    (&["nothing", "but"], &[], "show only X"),
    (&[], &["only"], "show only X"),
    (&[], &["alone"], "show only X"),
    (&["what", "is", "the", "volume", "of"], &[], "how big is X"),
    (&["what", "'s", "the", "volume", "of"], &[], "how big is X"),
    (&["measure"], &[], "how big is X"),
    (&["where", "is"], &[], "frame X"),
    (&["where", "are"], &[], "frame X"),
    (&["spin"], &[], "rotate X"),
    (&["which", "one", "is"], &[], "what is X"),
    (&["what", "is", "that"], &[], "what is the X"),
    (&["what", "'s", "that"], &[], "what is the X"),
    (&["what", "is", "this"], &[], "what is the X"),
    (&["which", "is"], &[], "what is X"),
    (&["add"], &[], "add X to the selection"),
    (&["now", "without"], &[], "remove X from the selection"),
    (&["replace", "the", "selection", "by"], &[], "select X"),
    (&["replace", "the", "selection", "with"], &[], "select X"),
    (&["protect"], &["against", "changes"], "lock X"),
    (&["protect"], &["from", "changes"], "lock X"),
];

/// Words of politeness that may stand before a frame.
const MOST_BEFORE: usize = 3;

/// Whole utterances, and the command in their place.
const WHOLE: [(&str, &str); 29] = [
    ("too dark", "make it brighter"),
    ("it's too dark", "make it brighter"),
    ("it is too dark", "make it brighter"),
    ("too bright", "make it darker"),
    ("it's too bright", "make it darker"),
    ("it is too bright", "make it darker"),
    ("oops", "undo"),
    ("wrong", "undo"),
    ("that was wrong", "undo"),
    ("that's wrong", "undo"),
    ("that is wrong", "undo"),
    ("that's not what i wanted", "undo"),
    ("that is not what i wanted", "undo"),
    ("not what i wanted", "undo"),
    ("cancel that", "undo"),
    ("select what is not selected", "invert the selection"),
    ("drop my selection", "clear the selection"),
    ("drop the selection", "clear the selection"),
    ("lose the selection", "clear the selection"),
    ("kill the selection", "clear the selection"),
    ("forget the selection", "clear the selection"),
    ("hold it there", "pause the tour"),
    ("wait hold it there", "pause the tour"),
    ("stay here", "pause the tour"),
    ("wait here", "pause the tour"),
    ("stop here", "pause the tour"),
    ("restore the deleted stuff", "restore everything deleted"),
    ("restore the deleted parts", "restore everything deleted"),
    ("bring back what i deleted", "restore everything deleted"),
];

/// Forms of the utterance, the surest first. None of them has to be understood.
pub(super) fn of(source: &str, tokens: &[Token]) -> Vec<String> {
    let mut all = simple(source, tokens);
    // A purpose may follow any other form.
    let short = without_purpose(source, tokens);
    if let Some(short) = &short {
        all.extend(simple(short, &token::tokens(short)));
        all.push(short.clone());
    }
    for text in std::iter::once(source).chain(short.as_deref()) {
        for plain in plain_form::of(text, &token::tokens(text)) {
            let tokens = token::tokens(&plain);
            all.extend(simple(&plain, &tokens));
            all.extend(without_purpose(&plain, &tokens));
            all.push(plain);
        }
    }
    all
}

/// Forms that one step makes.
fn simple(source: &str, tokens: &[Token]) -> Vec<String> {
    let forms = [
        whole(tokens),
        named_as(source, tokens),
        asked(source, tokens),
        assigned(source, tokens),
        share_last(source, tokens),
        signed(source, tokens),
        share_alone(source, tokens),
        comparison(source, tokens),
        color_first(source, tokens),
    ];
    forms.into_iter().flatten().chain(framed(source, tokens)).collect()
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
    // "Orange, not blue" is orange. "Everything, not the bone" is an exception.
    let is_all = tokens.iter().any(|t| matches!(t.text.as_str(), "all" | "everything" | "every" | "each"));
    let is_contrast = |at: &usize| {
        let here = tokens.get(at.saturating_sub(1)..).unwrap_or_default();
        !is_all
            && here.first().is_some_and(|t| t.is_mark(','))
            && begins_with(here.get(1..).unwrap_or_default(), &["not"])
    };
    let at = (2..tokens.len()).find(|at| is_purpose(at) || is_contrast(at))?;
    Some(text_of(source, tokens.get(..at)?).trim_end_matches([',', ' ']).to_owned())
}

/// The texts of the words, with one form of the apostrophe.
fn spoken(tokens: &[Token]) -> Vec<String> {
    let tokens = tokens.iter().filter(|t| !matches!(t.kind, Kind::Mark('.' | '!' | '?')));
    tokens.map(|t| t.text.replace('\u{2019}', "'")).collect()
}

/// The command in the place of a whole utterance.
fn whole(tokens: &[Token]) -> Option<String> {
    let said = spoken(tokens).join(" ").replace(" '", "'");
    WHOLE.iter().find(|(whole, _)| *whole == said).map(|(_, command)| (*command).to_owned())
}

/// "Store the selected part under the name loop" as "save the selection as loop", "the clip, it shall be called staple" as "rename the clip
/// to staple".
fn named_as(source: &str, tokens: &[Token]) -> Option<String> {
    const NAMING: [&[&str]; 21] = [
        &["under", "the", "name"],
        &["give", "that", "the", "name"],
        &["give", "it", "the", "name"],
        &["give", "this", "the", "name"],
        &["shall", "be", "known", "as"],
        &["should", "be", "known", "as"],
        &["be", "known", "as"],
        &["be", "called"],
        &["under", "name"],
        &["with", "the", "name"],
        &["by", "the", "name", "of"],
        &["and", "call", "it"],
        &["and", "name", "it"],
        &["and", "label", "it"],
        &["it", "shall", "be", "called"],
        &["it", "should", "be", "called"],
        &["let", "'s", "call", "it"],
        &["please", "label", "it"],
        &["name", ":"],
        &["label", ":"],
        &["call", "it"],
    ];
    const BECOMING: [&str; 7] = ["should", "shall", "must", "will", "is", "ought", "to"];
    const VIEWS: [&str; 6] = ["view", "viewpoint", "angle", "camera", "perspective", "position"];
    const SELECTED: [&str; 9] =
        ["selection", "selected", "brushed", "marked", "painted", "highlighted", "picked", "piece", "region"];
    let place = |words: &&[&str]| {
        let from = (0..tokens.len()).find(|from| tokens.get(*from..).is_some_and(|rest| begins_with(rest, words)))?;
        Some((from, from + words.len()))
    };
    let (from, to) = NAMING.iter().filter_map(place).min_by_key(|(from, to)| (*from, std::cmp::Reverse(*to)))?;
    let (head, name) = (tokens.get(..from)?, text_of(source, plain_form::core(tokens.get(to..)?)));
    let has = |words: &[&str]| head.iter().any(|t| words.contains(&t.text.as_str()));
    if name.is_empty() {
        None
    } else if has(&VIEWS) {
        Some(format!("save this view as {name}"))
    } else if head.is_empty() || has(&SELECTED) {
        Some(format!("save the selection as {name}"))
    } else {
        // "The clip should from now on be called staple."
        let subject = head.get(..head.iter().position(|t| BECOMING.contains(&t.text.as_str()))?)?;
        (!subject.is_empty()).then(|| format!("rename {} to {name}", text_of(source, subject)))
    }
}

/// "I don't want to see the skin" as "hide the skin".
fn framed(source: &str, tokens: &[Token]) -> Vec<String> {
    let end = tokens.iter().rposition(|t| !matches!(t.kind, Kind::Mark(_))).map_or(0, |last| last + 1);
    let tokens = tokens.get(..end).unwrap_or_default();
    let said = spoken(tokens);
    if said.len() != tokens.len() {
        return Vec::new();
    }
    let fits = |at: usize, words: &[&str]| {
        said.get(at..at + words.len()).is_some_and(|here| here.iter().zip(words).all(|(a, b)| a == b))
    };
    let mut forms = Vec::new();
    for (before, after, command) in FRAMES {
        let latest = if before.is_empty() { 0 } else { MOST_BEFORE };
        let Some(last) = said.len().checked_sub(after.len()).filter(|last| fits(*last, after)) else { continue };
        let Some(first) = (0..=latest).find(|at| fits(*at, before)) else { continue };
        let object = tokens.get(first + before.len()..last).unwrap_or_default();
        if !object.is_empty() {
            let lead = text_of(source, tokens.get(..first).unwrap_or_default());
            forms.push(format!("{lead} {}", command.replace('X', text_of(source, object))).trim().to_owned());
        }
    }
    forms
}

/// "Skin at 40 percent" as "set the opacity of skin to 40 percent".
fn share_alone(source: &str, tokens: &[Token]) -> Option<String> {
    let end = tokens.iter().rposition(|t| t.is_mark('%') || t.is("percent"))?;
    let number = end.checked_sub(1).filter(|n| matches!(tokens.get(*n).map(|t| &t.kind), Some(Kind::Number(_))))?;
    let name = tokens.get(..number)?;
    let name = match name.split_last() {
        Some((last, rest)) if matches!(last.text.as_str(), "at" | "to") => rest,
        _ => name,
    };
    let alone = tokens.get(end + 1..)?.iter().all(|t| matches!(t.kind, Kind::Mark(_)) || t.is("please"));
    let share = text_of(source, tokens.get(number..=end)?);
    (alone && !name.is_empty()).then(|| format!("set the opacity of {} to {share}", text_of(source, name)))
}

/// "More transparent" as "make it more transparent".
fn comparison(source: &str, tokens: &[Token]) -> Option<String> {
    let compares = tokens.iter().take(4).any(|t| matches!(t.text.as_str(), "more" | "less"));
    compares.then(|| format!("make it {source}"))
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
        for (said, form) in [
            ("just the bone", "show only the bone"),
            ("bone only.", "show only bone"),
            ("can you get the skin out of my way?", "can you hide the skin"),
            ("could we see the bone in yellow", "make the bone in yellow"),
            ("skin at 40 percent", "set the opacity of skin to 40 percent"),
            ("skin 40%", "set the opacity of skin to 40%"),
            ("more transparent", "make it more transparent"),
            ("store the selected part under name loop", "save the selection as loop"),
            ("Store current viewpoint, name: pterional", "save this view as pterional"),
            ("What I brushed there is the carotid. Please label it carotid.", "save the selection as carotid"),
            ("label: branch1", "save the selection as branch1"),
            ("which one is the sac?", "what is the sac"),
            ("the clip shall be called Yasargil from now on", "rename the clip to Yasargil"),
            ("It\u{2019}s too dark!", "make it brighter"),
            ("make the sac red but keep the vessel as it is", "make the sac red"),
        ] {
            let forms = of(said, &tokens(said));
            assert!(forms.iter().any(|f| f == form), "“{said}”: {forms:?}");
        }
        assert_eq!(of("make the sac red", &tokens("make the sac red")), Vec::<String>::new());
    }
}
