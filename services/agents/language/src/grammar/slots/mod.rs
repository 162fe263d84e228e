//! Commands by what an utterance names, in any order of its words.
//!
//! A command about a thing takes few slots: the thing, a colour or an amount, and words that tell what is meant. Where every word of an
//! utterance is one of these or means nothing of its own, and one command of [`commands`] has just these slots, that command is
//! the meaning. It is written as a sentence that the grammar reads again. A word that fits no slot, a negation or a question ends the
//! attempt, so that talk about other matters is never a command.

mod commands;
mod cues;

use std::collections::HashMap;
use std::sync::LazyLock;

use self::cues::{CUES, Cue, DETERMINERS, EVERYTHING, HEADS, LOOKS, PRONOUNS, REST};
use super::Reader;
use crate::color;
use crate::syntax::number::quantity;
use crate::syntax::phrase::{self, Input, remaining};
use crate::syntax::target::known_lengths;
use crate::syntax::token::{Kind, Token};

/// Most tokens of an utterance that is read in this way.
const MOST_TOKENS: usize = 24;

/// Most words of a description.
const MOST_DESCRIBING: usize = 5;

/// Most things of one utterance.
const MOST_THINGS: usize = 6;

/// An amount as it was said.
#[derive(Debug, Clone, PartialEq)]
struct Amount {
    text: String,
    value: f64,
    /// Whether it is a percentage or a fraction.
    is_share: bool,
}

/// A part of an utterance that is not a cue.
#[derive(Debug, Clone, PartialEq)]
enum Part {
    Thing(String),
    Color(String),
}

/// The slots of an utterance.
#[derive(Debug, Default, Clone, PartialEq)]
struct Slots {
    /// What the words tell, without fillers.
    cues: Vec<Cue>,
    /// Names and descriptions of things, and colours, in their order.
    parts: Vec<Part>,
    /// Things behind an exception.
    exceptions: Vec<String>,
    amounts: Vec<Amount>,
    everything: bool,
    rest: bool,
    pronoun: bool,
    /// Whether two things stand apart without a conjunction.
    is_scattered: bool,
}

/// The utterance as a sentence of the grammar. `None`: its words do not tell one command.
pub(super) fn of(reader: &Reader<'_>, source: &str, tokens: &[Token]) -> Option<String> {
    if tokens.len() > MOST_TOKENS {
        return None;
    }
    let context = reader.context(source);
    let tokens: Vec<&Token> = tokens.iter().collect();
    let slots = Slots::of(Input { input: winnow::stream::TokenSlice::new(&tokens), state: &context })?;
    commands::of(&slots)
}

/// A cue with the words of one of its phrases.
type Phrase = (Cue, Vec<&'static str>);

/// Phrases of the cues by their first words, in the order of the table.
static PHRASES: LazyLock<HashMap<&'static str, Vec<Phrase>>> = LazyLock::new(|| {
    let mut phrases: HashMap<&'static str, Vec<Phrase>> = HashMap::new();
    for (cue, list) in CUES {
        for words in phrase::items(list).map(words) {
            let words: Vec<&'static str> = words.collect();
            phrases.entry(words.first().copied().unwrap_or_default()).or_default().push((*cue, words));
        }
    }
    phrases
});

/// The words of a phrase, as tokens have them.
fn words(phrase: &'static str) -> impl Iterator<Item = &'static str> {
    phrase.split(['-', ' '])
}

/// Number of tokens of the longest of some phrases that begins here.
fn longest(tokens: &[&Token], list: &'static str) -> usize {
    let length = |phrase| {
        let fits = words(phrase).enumerate().all(|(k, word)| tokens.get(k).is_some_and(|token| token.is(word)));
        fits.then(|| words(phrase).count())
    };
    phrase::items(list).filter_map(length).max().unwrap_or(0)
}

/// The longest cue that begins here, and its number of tokens. The first in the table wins.
fn cue_at(tokens: &[&Token]) -> Option<(Cue, usize)> {
    let first = tokens.first()?;
    let begins =
        |words: &[&str]| tokens.len() >= words.len() && words.iter().zip(tokens).all(|(word, token)| token.is(word));
    let mut best: Option<(Cue, usize)> = None;
    for key in [first.text.as_str(), first.lemma.as_str()] {
        for (cue, words) in PHRASES.get(key).into_iter().flatten() {
            if best.is_none_or(|(_, length)| words.len() > length) && begins(words) {
                best = Some((*cue, words.len()));
            }
        }
    }
    best
}

/// Number of tokens of the colour that begins here.
fn color_length(tokens: &[&Token]) -> usize {
    if tokens.first().is_some_and(|t| matches!(t.kind, Kind::Color(_))) {
        return 1;
    }
    let said: Vec<&str> =
        tokens.iter().take(color::MAX_WORDS).take_while(|t| t.kind == Kind::Word).map(|t| t.text.as_str()).collect();
    color::from_words(&said).map_or(0, |(_, length)| length)
}

impl Slots {
    fn of(mut input: Input<'_>) -> Option<Self> {
        let mut slots = Self::default();
        // Whether a conjunction or a comma stands before the next thing.
        let mut is_joined = true;
        let mut is_exception = false;
        // What was told before the last thing.
        let mut told = 0;
        while let Some(first) = remaining(&input).first() {
            let tokens = remaining(&input);
            let length = match first.kind {
                Kind::Quoted | Kind::File | Kind::Mark('"' | '{' | '}' | '(' | ')' | '/' | '?') => return None,
                Kind::Mark(mark) => {
                    is_joined |= matches!(mark, ',' | '&' | '+');
                    1
                }
                Kind::Color(_) | Kind::Number(_) | Kind::Word => {
                    let (length, thing) = slots.take(&input, tokens, is_exception)?;
                    if thing {
                        // "The sac red and …": what follows a value is no more of its things.
                        let things = slots.parts.iter().filter(|part| matches!(part, Part::Thing(_))).count();
                        let is_first = things + slots.exceptions.len() == 1;
                        let is_apart = !is_first && !is_exception && slots.told() > told;
                        slots.is_scattered |= !std::mem::replace(&mut is_joined, false) || is_apart;
                        told = slots.told();
                    } else {
                        let taken = tokens.get(..length).unwrap_or_default();
                        let joins = matches!(cue_at(taken), Some((Cue::And | Cue::Except, _)));
                        is_exception |= matches!(cue_at(taken), Some((Cue::Except, _)));
                        is_joined |= joins;
                    }
                    length
                }
            };
            phrase::advance(&mut input, length.max(1));
        }
        (slots.parts.len() + slots.exceptions.len() <= 2 * MOST_THINGS).then_some(slots)
    }

    /// Number of cues, colours and amounts so far, without conjunctions.
    fn told(&self) -> usize {
        let colors = self.parts.iter().filter(|part| matches!(part, Part::Color(_))).count();
        colors + self.amounts.len() + self.cues.iter().filter(|cue| !matches!(cue, Cue::And | Cue::Except)).count()
    }

    /// Takes what begins here; returns its number of tokens, and whether it is a thing.
    fn take(&mut self, input: &Input<'_>, tokens: &[&Token], is_exception: bool) -> Option<(usize, bool)> {
        let source = input.state.source;
        let text = |length: usize| phrase::slice(source, tokens.get(..length).unwrap_or_default());
        let cue = cue_at(tokens);
        let cue_length = cue.map_or(0, |(_, length)| length);
        let rest = longest(tokens, REST);
        if rest > cue_length {
            self.rest = true;
            return Some((rest, false));
        }
        let all = longest(tokens, EVERYTHING);
        let thing = thing_length(input, tokens);
        if all >= cue_length && all >= thing && all > 0 {
            self.everything = true;
            return Some((all, false));
        }
        if thing > cue_length || (thing > 0 && thing == cue_length && is_known(input, tokens)) {
            let name = text(thing);
            if is_exception {
                self.exceptions.push(name);
            } else {
                self.parts.push(Part::Thing(name));
            }
            return Some((thing, true));
        }
        let color = color_length(tokens);
        if color > 0 && color >= cue_length {
            self.parts.push(Part::Color(text(color)));
            return Some((color, false));
        }
        if let Some((value, length)) = amount(input)
            && length >= cue_length
            && cue != Some((Cue::Half, length))
        {
            self.amounts.push(Amount { text: text(length), value: value.value, is_share: value.share });
            return Some((length, false));
        }
        let (cue, length) = cue?;
        if PRONOUNS.split(" | ").any(|pronoun| tokens.first().is_some_and(|t| t.text == pronoun)) && length == 1 {
            self.pronoun = true;
        }
        if cue == Cue::Block {
            return None;
        }
        if cue != Cue::Filler {
            self.cues.push(cue);
        }
        Some((length, false))
    }
}

/// The amount that begins here, and its number of tokens.
fn amount(input: &Input<'_>) -> Option<(crate::syntax::number::Quantity, usize)> {
    let mut at = *input;
    let value = quantity(&mut at).ok()?;
    Some((value, remaining(input).len() - remaining(&at).len()))
}

fn is_known(input: &Input<'_>, tokens: &[&Token]) -> bool {
    !known_lengths(input.state.names, tokens).is_empty()
}

/// Number of tokens of the thing that begins here: a known name, or a description that the labeling service may know.
fn thing_length(input: &Input<'_>, tokens: &[&Token]) -> usize {
    let lead = longest(tokens, DETERMINERS);
    let rest = tokens.get(lead..).unwrap_or_default();
    let known = |at: usize| {
        let here = rest.get(at..).unwrap_or_default();
        known_lengths(input.state.names, here).first().copied().unwrap_or(0)
    };
    let in_list = |token: &Token, list: &'static str| phrase::items(list).any(|word| token.text == word);
    let mut length = 0;
    // Where the description ends that is found so far.
    let mut end = 0;
    while let Some(token) = rest.get(length).filter(|_| length < MOST_DESCRIBING) {
        let here = rest.get(length..).unwrap_or_default();
        let name = known(length);
        if name > 0 {
            length += name;
            end = length;
            continue;
        }
        let color = color_length(here);
        let is_head = in_list(token, HEADS);
        if color > 0 {
            // A colour belongs to a description only if a noun follows. Behind a noun it says what the thing becomes.
            let has_noun = here.get(color).is_some_and(|next| in_list(next, HEADS));
            if end > 0 && !has_noun {
                break;
            }
            length += color;
        } else if in_list(token, LOOKS) || is_head {
            length += 1;
            if is_head && length > 1 {
                end = length;
            }
        } else if token.kind == Kind::Word && cue_at(here).is_none() && !is_number(input, lead + length) {
            length += 1;
            end = length;
        } else {
            break;
        }
    }
    // "The red sac" says how the sac looks, or shall look. Other forms read that.
    let begins_with_color = color_length(rest) > 0 && known(color_length(rest)) > 0;
    if end == 0 || (begins_with_color && lead == 0) { 0 } else { lead + end }
}

fn is_number(input: &Input<'_>, ahead: usize) -> bool {
    let mut at = *input;
    phrase::advance(&mut at, ahead);
    quantity(&mut at).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grammar::{parse, sample_observation};
    use crate::syntax::token::tokens;

    const NAMES: [&str; 5] = ["vessels", "bone", "tissue", "sac", "clip"];

    fn form(said: &str) -> Option<String> {
        let observation = sample_observation(&NAMES);
        of(&Reader::new(&observation), said, &tokens(said))
    }

    #[test]
    fn words_in_any_order_tell_a_command() {
        let mut wrong = Vec::new();
        for (said, command) in [
            ("I'd like to see the bone in yellow", "make the bone yellow"),
            ("bone turquoise", "make bone turquoise"),
            ("all grey except the sac", "make everything but the sac grey"),
            ("swap the pink of the tissue for brown", "make the tissue brown"),
            ("vessels green bone blue clip yellow", "make vessels green and make bone blue and make clip yellow"),
            ("what's behind everything is too black, make it dark blue", "make the background dark blue"),
            ("opacity clip 0.6", "set the opacity of clip to 0.6"),
            ("put the sac and the clip at 70 per cent", "set the opacity of the sac and the clip to 70 per cent"),
            ("tissue is too strong for me, tone its opacity down to ten", "set the opacity of tissue to 10 percent"),
            ("the bone should be like a ghost, barely visible", "ghost the bone"),
            ("I can't really see the tissue, make it more solid", "make the tissue more opaque"),
            ("I need to look through the bone, make it like glass", "make the bone transparent"),
            ("Please make invisible the clip", "hide the clip"),
            ("the clip: hide", "hide the clip"),
            ("Other than the vessels, I want nothing on screen", "show only the vessels"),
            ("turn the lot off, only leave the bone and the sac", "show only the bone and the sac"),
        ] {
            wrong.extend((form(said).as_deref() != Some(command)).then(|| (said, form(said))));
        }
        for (said, command) in [
            ("I would like that the light comes from upper right", "light from the upper right"),
            ("put the light source above the head", "light from above"),
            ("the lamp shines from behind", "light from behind"),
            ("kill the specular highlights", "no specular"),
            ("I'd like the surface less shiny", "less specular"),
            ("go a bit away, I am too near", "zoom out a bit"),
            ("fill the screen with the sac", "frame the sac"),
            ("move the camera where nothing is in the way of the clip", "show me the best view of the clip"),
            ("turn the head so I look from the left", "view from the left"),
            ("back to the view we started with", "reset the view"),
            ("select all without the bone", "select everything but the bone"),
            ("I want the selection to be the tissue instead", "select the tissue"),
            ("drop my selection", "clear the selection"),
            ("lock all units, just not the clip", "lock everything but the clip"),
            ("a warmer tint for the bone", "make the bone warmer"),
            ("make the vessels' colours more vivid", "make the vessels more saturated"),
            ("render with diffuse only", "show only the diffuse term"),
            ("reset everything to how it was when I started", "reset"),
            ("then turn round to the back", "view from behind"),
            ("bring it back but at 40 percent", "show it and set the opacity of it to 40 percent"),
            ("other way round: everything that's not selected", "invert the selection"),
            ("add the clip to what I've brushed", "add the clip to the selection"),
        ] {
            wrong.extend((form(said).as_deref() != Some(command)).then(|| (said, form(said))));
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
    }

    #[test]
    fn each_command_is_a_sentence_of_the_grammar() {
        let observation = sample_observation(&NAMES);
        for said in [
            "bone turquoise",
            "all grey except the sac",
            "opacity clip 0.6",
            "bone 40 percent see-through",
            "the bone should be like a ghost",
            "the clip: hide",
            "turn the lot off, only leave the bone and the sac",
            "the light comes from upper right",
            "kill the specular highlights",
            "less shiny",
            "the lamp is too dim, brighter light",
            "go a bit away",
            "fill the screen with the sac",
            "the best perspective on the clip",
            "back to the view we started with",
            "select all without the bone",
            "drop my selection",
            "a warmer tint for the bone",
            "the tissue is too pale, more vivid",
            "render with diffuse only",
            "surface normals",
            "tilt it upwards by 20 degrees to the left",
        ] {
            let Some(command) = form(said) else { continue };
            let intent = parse(&command, &observation).unwrap();
            assert!(
                intent.not_understood.is_empty() && !intent.clauses.is_empty(),
                "“{said}” as “{command}”: {intent:?}"
            );
        }
    }

    #[test]
    fn other_talk_is_no_command() {
        for said in [
            "don't hide the bone",
            "is the bone hidden?",
            "what would happen if the bone were hidden",
            "book me a flight to Lisbon on Friday",
            "play some relaxing music",
            "set a timer for ten minutes",
            "which treatment would you recommend for this patient",
            "denoise the scan and resample it to one millimetre",
            "delete the bone",
            "hide the bone and make the sac red",
            "make the sac red and dance",
            "hide the sac and the moon at 40 percent and dance",
            "the bone",
            "thirty percent",
            "red",
            "I never asked you to turn the tissue green",
        ] {
            assert_eq!(form(said), None, "“{said}”");
        }
    }
}
