//! Parser of targets: names, the selection, everything, everything else, "it".
//!
//! The end of a target depends on the words after it ("make the dark vessel red", "hide the soil and zoom in"). So the
//! parser returns all readings, the most likely first. [`target_then`] takes the first whose continuation matches.

use std::collections::BTreeSet;
use std::sync::LazyLock;

use sg_proto::language::Reference;
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::phrase::{
    EXCEPTING, Input, Outcome, advance, article, end, exactly, items as listed, mark, one_of, peek_at, phrase,
    remaining, slice, word,
};
use super::token::{Kind, Token, normalized_name};
use crate::color;

/// A parsed target.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Target {
    /// The reference.
    pub(crate) reference: Reference,
    /// Number of unknown names.
    pub(crate) unknown: usize,
}

/// Largest number of readings.
const MAX_READINGS: usize = 48;

/// Largest number of words of an unknown name.
const MAX_UNKNOWN_WORDS: usize = 5;

/// Largest number of names in a list.
const MAX_LIST: usize = 32;

/// Nouns for a unit.
const UNIT: &str = "unit | structure | label | object | segment | component | material | part | region | layer | \
     group";

/// Nouns for several units.
const UNITS: &str = "units | structures | labels | objects | segments | components | materials | parts | things | \
     layers";

/// Phrases for the selection, after an article.
const SELECTION: &str = "selection | current selection | present selection | selected | selected part | selected region | \
 selected structure | selected thing | selected area | selected one | selected piece | \
 selected gaussian | selected point | selected stuff | marked region | marked part | \
 marked structure | marked area | brushed region | brushed part | brushed structure | \
 highlighted part | highlighted region | highlighted structure";

/// Phrases for the selection, without an article.
const SELECTED: &str = "what is selected | what 's selected | what i selected | what i have selected | what i've selected | \
 what i brushed | what i marked | what i painted | what i picked";

/// Phrases for the whole scene.
const EVERYTHING: &str = "everything | all | all of it | all of them | the whole scene | the entire scene | the scene | this scene | this volume | this model | \
 the whole thing | the whole volume | the volume | the whole data set | the whole dataset | \
 the data | the model | the whole model | the picture | the image";

/// Phrases for everything but the last target.
const REST: &str = "everything else | all else | the rest | all the rest | rest of the scene | the rest of the scene | \
 the rest of it | the others | all others | all the others | all the other | all other | the other | \
 others | the remaining | what remains | the remainder | anything else | the surroundings | \
 its surroundings";

/// Phrases for everything but the names after them.
const EXCEPT: &str = "everything except | everything except for | everything but | everything apart from | \
 everything other than | everything besides | everything save | everything that is not | \
 everything that 's not | everything outside | everything around | all except | all except for | \
 all but | all apart from | all other than | anything but | anything except | all units except | \
 all units but | all structures except | all structures but | the rest except";

/// Things of any kind, before "like".
const THINGS: &str = "things | thing | others | one | ones | units | unit | structures | structure | parts | part | regions | \
 region | objects | object | everything | anything | something | all | more | what | whatever";

/// Phrases between things and what they are like.
const ALIKE: &str = "like | just like | similar to | resembling | looking like | look like | that look like | \
 which look like | that are like | that is like | which are like | are like | is like | that are similar to | \
 that is similar to | which are similar to | are similar to | is similar to | resemble | that resemble";

/// Words that are never part of an unknown name.
const NOT_IN_NAMES: &str = "the | a | an | this | that | these | those | my | your | our | his | her | its | their | it | \
 them | they | me | you | i | we | us | he | she | to | by | from | with | without | at | on | \
 onto | off | into | in | as | of | for | than | and | or | but | not | no | nor | never | don't | \
 doesn't | if | unless | while | until | when | because | so | is | are | was | were | be | been | \
 am | do | does | did | should | would | could | can | will | must | have | has | had | what | \
 which | who | where | why | how | whatever | everything | all | nothing | anything | something | \
 some | any | every | each | both | either | neither | only | just | alone | else | other | others | \
 rest | more | less | most | much | very | too | please | now | then | percent | selection | \
 selected | 's | once | twice | again | about | except | like";

static SENTENCE_WORDS: LazyLock<BTreeSet<&str>> = LazyLock::new(|| listed(NOT_IN_NAMES).collect());

/// Whether a word is never part of an unknown name.
pub(crate) fn is_sentence_word(word: &str) -> bool {
    SENTENCE_WORDS.contains(word)
}

/// All readings of the target that begins here, the most likely first, each with the rest of the input.
pub(crate) fn readings<'t>(input: &Input<'t>) -> Vec<(Target, Input<'t>)> {
    let mut all = Vec::new();
    if input.state.readings_left.get() == 0 {
        return all;
    }
    let mut start = *input;
    let both: Outcome<Option<_>> = opt(exactly("both")).parse_next(&mut start);
    if both.is_ok() {
        whole(&start, &mut all);
        list(&start, &Target::default(), 0, &mut all);
    }
    let left = &input.state.readings_left;
    all.truncate(MAX_READINGS.min(left.get()));
    left.set(left.get() - all.len());
    all
}

/// Parses the first reading of a target whose continuation matches.
///
/// An exception may follow the continuation: "make everything transparent except the sac".
pub(crate) fn target_then<'t, O>(
    input: &mut Input<'t>,
    mut tail: impl FnMut(&mut Input<'t>, &Target) -> Outcome<O>,
) -> Outcome<(Target, O)> {
    for (target, rest) in readings(input) {
        let mut at = rest;
        if let Ok(found) = tail(&mut at, &target) {
            let target = if target.reference.everything { with_exceptions(target, &mut at) } else { target };
            *input = at;
            return Ok((target, found));
        }
    }
    Err(EmptyError)
}

/// Parses exceptions from everything, if there are any.
fn with_exceptions<'t>(everything: Target, input: &mut Input<'t>) -> Target {
    let mut at = *input;
    let excepting: Outcome<_> = alt((one_of(EXCEPTING), one_of("but"))).parse_next(&mut at);
    let mut exceptions = Vec::new();
    if excepting.is_ok() {
        list(&at, &Target::default(), 1, &mut exceptions);
    }
    for (mut target, mut rest) in exceptions {
        if end(&mut rest).is_ok() {
            target.reference.complement = true;
            *input = rest;
            return target;
        }
    }
    everything
}

/// Parses a target at the end of a clause.
pub(crate) fn target_alone(input: &mut Input<'_>) -> Outcome<Target> {
    target_then(input, |rest, _| end(rest)).map(|(target, ())| target)
}

/// The target of the last command.
pub(crate) fn focus() -> Target {
    Target { reference: Reference { focus: true, ..Reference::default() }, unknown: 0 }
}

/// References that are not part of a list.
fn whole<'t>(input: &Input<'t>, all: &mut Vec<(Target, Input<'t>)>) {
    let mut at = *input;
    if one_of(EXCEPT).parse_next(&mut at).is_ok() {
        let mut exceptions = Vec::new();
        list(&at, &Target::default(), 0, &mut exceptions);
        for (mut target, rest) in exceptions {
            target.reference.complement = true;
            all.push((target, rest));
        }
    }
    let mut at = *input;
    if one_of(REST).parse_next(&mut at).is_ok() {
        let _: Outcome<_> = opt(exactly(UNITS)).parse_next(&mut at);
        let reference = Reference { complement: true, ..Reference::default() };
        all.push((Target { reference, unknown: 0 }, at));
    }
    let mut at = *input;
    let everything: Outcome<()> = alt((
        (exactly("all | every"), opt(exactly("of")), opt(exactly("the")), alt((exactly(UNITS), exactly(UNIT)))).void(),
        (exactly("the"), exactly(UNITS)).void(),
        one_of(EVERYTHING).void(),
    ))
    .parse_next(&mut at);
    if everything.is_ok() {
        let reference = Reference { everything: true, ..Reference::default() };
        all.push((Target { reference, unknown: 0 }, at));
    }
}

/// Lists of names and pronouns, the longest first: "the soil and the pot" may be one target.
fn list<'t>(input: &Input<'t>, so_far: &Target, length: usize, all: &mut Vec<(Target, Input<'t>)>) {
    if length >= MAX_LIST || all.len() >= MAX_READINGS {
        return;
    }
    for (item, rest) in items(input, length > 0) {
        let mut target = so_far.clone();
        target.reference.names.extend(item.reference.names);
        target.reference.selection |= item.reference.selection;
        target.reference.focus |= item.reference.focus;
        target.unknown += item.unknown;
        let mut next = rest;
        let conjunction: Outcome<()> = alt((
            (exactly("as"), exactly("well"), exactly("as")).void(),
            (opt(separator(',')), exactly("and | plus"), opt(exactly("also"))).void(),
            separator(','),
            separator('&'),
        ))
        .parse_next(&mut next);
        if conjunction.is_ok() {
            list(&next, &target, length + 1, all);
        }
        all.push((target, rest));
    }
}

fn separator<'t>(c: char) -> impl Parser<Input<'t>, (), EmptyError> {
    mark(c).void()
}

/// Readings of one item of a list.
fn items<'t>(input: &Input<'t>, continued: bool) -> Vec<(Target, Input<'t>)> {
    let mut found = Vec::new();
    known(input, &mut found);
    alike(input, &mut found);
    let mut at = *input;
    let pronoun: Outcome<Reference> = alt((
        one_of(SELECTED).map(|_| Reference { selection: true, ..Reference::default() }),
        (article, one_of(SELECTION)).map(|_| Reference { selection: true, ..Reference::default() }),
        exactly("it | them | itself").map(|_| Reference { focus: true, ..Reference::default() }),
        (exactly("this | that | these | those"), opt(alt((exactly(UNIT), exactly(UNITS), exactly("one | thing")))))
            .map(|_| Reference::default()),
    ))
    .parse_next(&mut at);
    if let Ok(mut reference) = pronoun {
        if !reference.selection && !reference.focus {
            // "this" is the selection if there is one, else the last target.
            reference.selection = input.state.has_selection;
            reference.focus = !input.state.has_selection;
        }
        found.push((Target { reference, unknown: 0 }, at));
    }
    let mut at = *input;
    let lead: Outcome<_> = (
        article,
        opt((
            alt((word(UNIT), exactly("one | thing"))),
            opt(alt((exactly("called | named | labelled | labeled").void(), phrase("with the name")))),
        )),
    )
        .parse_next(&mut at);
    if let Ok(((), prefix)) = lead {
        let explicit = prefix.is_some();
        if explicit {
            known(&at, &mut found);
        }
        if let Some(token) = peek_at(&at, 0).filter(|t| t.kind == Kind::Quoted) {
            let mut rest = at;
            advance(&mut rest, 1);
            let name = token.text.clone();
            let unknown = usize::from(!has_name(input.state.names, &name));
            found.push((named(name, unknown), rest));
        }
        let definite = peek_at(input, 0).is_some_and(|t| matches!(t.text.as_str(), "the" | "a" | "an"));
        unknown(&at, continued && !definite && !explicit, &mut found);
    }
    found
}

/// Things that are like another one: "things like the sac", "others like this". The labeling service finds them, so the words
/// stay as they are.
fn alike<'t>(input: &Input<'t>, found: &mut Vec<(Target, Input<'t>)>) {
    let mut at = *input;
    let lead: Outcome<_> = (
        opt(exactly("all | any")),
        article,
        opt(exactly("other | another | more")),
        one_of(THINGS),
        opt(exactly("else")),
        one_of(ALIKE),
    )
        .parse_next(&mut at);
    if lead.is_err() {
        return;
    }
    for (model, rest) in items(&at, false) {
        // What the model is, is known; which units are like it, is not.
        found.push((named(words_before(&rest, input), model.unknown.max(1)), rest));
    }
}

/// The words from one place to a later one, as they were said.
fn words_before(end: &Input<'_>, start: &Input<'_>) -> String {
    let tokens = remaining(start);
    let length = tokens.len() - remaining(end).len();
    slice(start.state.source, tokens.get(..length).unwrap_or_default())
}

/// Parses what things are like at the end of a question: "units are like the sac", "looks like this".
pub(crate) fn alike_alone(input: &mut Input<'_>) -> Outcome<Target> {
    let mut at = *input;
    (opt(exactly("other | else")), opt(one_of(THINGS)), opt(exactly("else")), one_of(ALIKE)).parse_next(&mut at)?;
    for (model, rest) in items(&at, false) {
        let mut after = rest;
        if end(&mut after).is_ok() {
            *input = after;
            return Ok(named(format!("things like {}", words_before(&rest, &at)), model.unknown.max(1)));
        }
    }
    Err(EmptyError)
}

fn named(name: String, unknown: usize) -> Target {
    Target { reference: Reference { names: vec![name], ..Reference::default() }, unknown }
}

/// Whether one of some names, each with its normalized words, is this one.
pub(crate) fn has_name(names: &[(String, Vec<String>)], name: &str) -> bool {
    let key = normalized_name(name);
    names.iter().any(|(n, folded)| n == name || *folded == key)
}

/// Numbers of tokens of the names that begin here, the longest first.
pub(crate) fn known_lengths(names: &[(String, Vec<String>)], tokens: &[&Token]) -> Vec<usize> {
    let mut lengths: Vec<usize> = names
        .iter()
        .filter_map(|(_, folded)| {
            let here = tokens.get(..folded.len())?;
            let fits =
                !folded.is_empty() && here.iter().zip(folded).all(|(t, w)| t.lemma == *w && t.kind != Kind::Quoted);
            fits.then_some(folded.len())
        })
        .collect();
    lengths.sort_unstable_by(|a, b| b.cmp(a));
    lengths.dedup();
    lengths
}

/// Known names that begin here, the longest first.
fn known<'t>(input: &Input<'t>, found: &mut Vec<(Target, Input<'t>)>) {
    const LEADS: &str =
        "all | of | the | a | an | my | our | this | that | these | those | whole | entire | both | each";
    let tokens = remaining(input);
    // A name may begin with one of these words, so names are tried before the words are skipped.
    for skipped in 0..=3 {
        let lead = tokens.get(..skipped).unwrap_or_default();
        if lead.len() < skipped || !lead.iter().all(|t| t.kind == Kind::Word && listed(LEADS).any(|w| t.text == w)) {
            break;
        }
        let rest = tokens.get(skipped..).unwrap_or_default();
        for length in known_lengths(input.state.names, rest) {
            let mut at = *input;
            advance(&mut at, skipped + length);
            let name = slice(input.state.source, rest.get(..length).unwrap_or_default());
            let target = named(name, 0);
            let mut after = at;
            let noun: Outcome<_> = alt((exactly(UNIT), exactly(UNITS))).parse_next(&mut after);
            if noun.is_ok() {
                found.push((target.clone(), after));
            }
            found.push((target, at));
        }
    }
}

/// Unknown names: a few words that are not part of the sentence, the shortest first.
fn unknown<'t>(input: &Input<'t>, not_an_opening: bool, found: &mut Vec<(Target, Input<'t>)>) {
    let tokens = remaining(input);
    let is_opening = tokens.first().is_some_and(|t| input.state.opening_lemmas.contains(&t.lemma));
    if not_an_opening && is_opening {
        return;
    }
    for length in 1..=MAX_UNKNOWN_WORDS {
        let Some(name) = tokens.get(..length) else { return };
        let Some(last) = name.last() else { return };
        let fits = match last.kind {
            Kind::Word => !is_sentence_word(&last.text),
            Kind::Number(_) => length > 1,
            Kind::Quoted | Kind::Color(_) | Kind::File | Kind::Mark(_) => false,
        };
        if !fits {
            return;
        }
        // A name of colour words only is a colour without its unit.
        if name.iter().all(|t| color::is_word(&t.text)) {
            continue;
        }
        let mut rest = *input;
        advance(&mut rest, length);
        found.push((named(slice(input.state.source, name), 1), rest));
    }
}
