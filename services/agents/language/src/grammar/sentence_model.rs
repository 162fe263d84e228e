//! Commands in people's own words, read by a model that learned from examples.
//!
//! The sentences of `sentences/*.tsv` are the examples. The model tells the likeliest command and the words of its slots. With these the
//! command is a sentence that the grammar reads. It counts as any other form, if it is likely enough.

use std::ops::Range;
use std::sync::LazyLock;

use sg_proto::scene::Color;
use sg_sentence_model::{Model, Reading, Slot};

use super::Reader;
use super::forms::{certain, is_safe, understood, whole};
use super::sentence::Sentence;
use crate::syntax::token::{self, Kind, Token};
use crate::{color, state_answer};

/// Least probability of a command with slots whose effect a look tells.
const LIKELY: f32 = 0.35;

/// The same for a command without slots: nothing but its words tells it.
const LIKELY_ALONE: f32 = 0.5;

/// Least probability of a command that deletes, names, takes back or steers a tour, of a sentence that asks for nothing, and of one with a
/// number, a colour or a name that its command does not take.
const SURE: f32 = 0.7;

/// Least probability of a command that deletes or names what no unit is called, and of one beside a colour that it does not take.
const CERTAIN: f32 = 0.8;

/// Commands of the examples that the grammar has in other words.
const WORDS: [(&str, &str); 3] =
    [("brighter light", "brighter"), ("darker light", "turn down the light"), ("next stop of the tour", "next stop")];

/// Commands about one colour of the scene that is given by another.
const SAME_COLOR: &str = "make {thing} the colour of {other}";
const DARKER_BACKGROUND: &str = "make the background darker";
const LIGHTER_BACKGROUND: &str = "make the background lighter";

/// Share of the way to black or white by which the background changes.
const BACKGROUND_STEP: f32 = 0.35;

/// Words for the sides of the scene, and the words that the grammar has for them.
const SIDES: [(&str, &[&str]); 6] = [
    ("left", &["left", "west", "port", "sinistral"]),
    ("right", &["right", "east", "starboard", "dextral"]),
    (
        "above",
        &[
            "above", "top", "over", "overhead", "up", "upper", "upward", "upwards", "north", "ceiling", "sky", "bird",
            "superior",
        ],
    ),
    (
        "below",
        &[
            "below",
            "bottom",
            "under",
            "underneath",
            "beneath",
            "down",
            "lower",
            "downward",
            "downwards",
            "south",
            "floor",
            "frog",
            "inferior",
        ],
    ),
    ("front", &["front", "frontal", "forward", "face", "fore", "ahead", "anterior"]),
    ("behind", &["behind", "back", "rear", "reverse", "hind", "posterior"]),
];

/// Words that stand for a thing that was named before.
const PRONOUNS: [&str; 7] = ["it", "them", "this", "that", "these", "those", "its"];

/// Words of an exception.
const EXCEPTIONS: [&str; 16] = [
    "except",
    "excepted",
    "excluding",
    "without",
    "apart from",
    "save the",
    "save for",
    "besides",
    "bar the",
    "minus",
    "that isn't",
    "that aren't",
    "that is not",
    "not though",
    "though not",
    "just not",
];

/// Words before what describes a thing by a clause: "whatever is made of metal".
const RELATIVE: [&str; 8] = [
    "whatever is",
    "whatever's",
    "whatever looks",
    "anything that is",
    "anything that's",
    "everything that is",
    "the ones that are",
    "the one that is",
];

/// Words between these and the description.
const MADE_OF: [&str; 4] = ["made of", "made from", "coloured", "colored"];

/// Words before a noun that names a thing.
const DETERMINERS: [&str; 8] = ["the", "this", "that", "these", "those", "my", "our", "both"];

/// Words around an amount that change little.
const ABOUT: [&str; 14] = [
    "about",
    "around",
    "roughly",
    "exactly",
    "just",
    "only",
    "approximately",
    "like",
    "maybe",
    "say",
    "some",
    "a",
    "to",
    "at",
];

static MODEL: LazyLock<Option<Model>> =
    LazyLock::new(|| Model::decode(include_bytes!(concat!(env!("OUT_DIR"), "/sentences.bin"))).ok());

/// Whether a word in lower case is one of those that people use in commands.
pub(super) fn knows(word: &str) -> bool {
    MODEL.as_ref().is_some_and(|model| model.knows(word))
}

/// What the model makes of a sentence.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Meaning {
    /// A command, as a sentence of the grammar with its reading.
    Command(String, Sentence),
    /// It says what shall not be done, or what was.
    Nothing,
    /// It asks for what this program does not do.
    OutOfScope,
}

/// The meaning of a sentence, if it is likely enough.
pub(super) fn of(reader: &Reader<'_>, text: &str) -> Option<Meaning> {
    at_least(reader, text, 0.0)
}

/// The meaning of a sentence, if it is clearer than that of any repair.
pub(super) fn clear(reader: &Reader<'_>, text: &str) -> Option<Meaning> {
    at_least(reader, text, CERTAIN)
}

fn at_least(reader: &Reader<'_>, text: &str, least: f32) -> Option<Meaning> {
    let reading = MODEL.as_ref()?.read(text, reader.known_names())?;
    if reading.probability < least {
        return None;
    }
    match reading.command {
        "DON'T" => (reading.probability >= SURE).then_some(Meaning::Nothing),
        "OUT" => (reading.probability >= SURE).then_some(Meaning::OutOfScope),
        "ASK" | "CHAT" => None,
        _ => {
            let form = form(reader, text, &reading)?;
            let steers = reading.command.ends_with("the tour") && reading.command != "start the tour";
            if excludes_otherwise(text, &form) || (steers && !reader.speaks_of_tour) {
                return None;
            }
            let least = match &reading {
                Reading { colors_left: 1.., .. } => CERTAIN,
                Reading { numbers_left: 1.., .. } | Reading { names_left: 1.., .. } => SURE,
                _ if steers => SURE,
                Reading { slots, .. } if slots.is_empty() => LIKELY_ALONE,
                _ => LIKELY,
            };
            // "The stock market fell by two percent" is about no part of a scene.
            let thing = said(reader, text, &reading, Slot::Thing);
            if thing.is_some_and(|thing| !names_in(reader, &thing) && !refers_to_scene(reader, &thing)) {
                return None;
            }
            let p = reading.probability;
            let safe = (p >= least).then(|| understood(reader, &form)).flatten();
            let sure = || (p >= least.max(SURE)).then(|| certain(reader, &form)).flatten();
            let named = || (p >= CERTAIN).then(|| whole(reader, &form)).flatten();
            safe.or_else(sure).or_else(named).map(|sentence| Meaning::Command(form, sentence))
        }
    }
}

/// The command that a sentence means, for a look alone.
pub(super) fn command(reader: &Reader<'_>, text: &str) -> Option<(String, Sentence)> {
    match of(reader, text)? {
        Meaning::Command(form, sentence) if is_safe(&sentence) => Some((form, sentence)),
        _ => None,
    }
}

/// Whether words may mean a part of the scene: by a word that the examples have for parts, by a pronoun, or as all of them.
fn refers_to_scene(reader: &Reader<'_>, thing: &str) -> bool {
    let is_read = || certain(reader, &format!("hide {thing}")).is_some();
    MODEL.as_ref().is_some_and(|model| model.may_be_thing(thing)) || is_read()
}

/// Whether a sentence has an exception that its command lost.
fn excludes_otherwise(text: &str, form: &str) -> bool {
    let words =
        |text: &str| format!(" {} ", token::tokens(text).iter().map(|t| t.text.as_str()).collect::<Vec<_>>().join(" "));
    let has = |said: &str| EXCEPTIONS.iter().any(|exception| said.contains(&format!(" {exception} ")));
    let form = words(form);
    has(&words(text)) && !has(&form) && !form.contains(" but ") && !form.starts_with(" show only ")
}

/// The command as a sentence of the grammar, with the words of its slots.
fn form(reader: &Reader<'_>, text: &str, reading: &Reading<'_>) -> Option<String> {
    let slot = |slot: Slot| said(reader, text, reading, slot);
    // "That" is no pronoun where a name stands in another slot.
    let refers = reading.names_left == 0 && !reading.slots.iter().any(|(slot, _)| *slot == Slot::Other);
    let referred = || pronoun(text).filter(|_| refers).map(str::to_owned);
    let thing = || slot(Slot::Thing).map(|said| described(&said)).or_else(|| unknown_noun(text)).or_else(referred);
    let background =
        |toward: f32| reader.scene.and_then(|scene| scene.background).map(|color| background(color, toward));
    match reading.command {
        SAME_COLOR => {
            let color = color_of(reader, &slot(Slot::Other)?)?;
            return Some(format!("make {} {}", thing()?, hex(color)));
        }
        DARKER_BACKGROUND => return background(0.0),
        LIGHTER_BACKGROUND => return background(1.0),
        _ => {}
    }
    let known = WORDS.iter().find(|(command, _)| *command == reading.command);
    let mut form = known.map_or(reading.command, |(_, words)| words).to_owned();
    for kind in Slot::ALL.into_iter().filter(|kind| reading.command.contains(&kind.marked())) {
        let value = match kind {
            Slot::Thing => thing()?,
            Slot::Other => slot(kind)?,
            Slot::Color => color_in(&slot(kind)?)?,
            Slot::Amount | Slot::Angle | Slot::Count => amount(&slot(kind)?),
            Slot::Side => side(&slot(kind)?)?.to_owned(),
            Slot::Name => format!("“{}”", slot(kind)?.trim_matches(['"', '\'', '“', '”'])),
            Slot::Kept => kept(reader, &slot(kind)?),
        };
        form = form.replace(&kind.marked(), &value);
    }
    Some(form)
}

/// The words of a slot. Of two that stand apart, the one with a name or a colour counts; the other belongs to a reason.
fn said(reader: &Reader<'_>, text: &str, reading: &Reading<'_>, slot: Slot) -> Option<String> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for (_, place) in reading.slots.iter().filter(|(other, _)| *other == slot) {
        let between = runs.last().and_then(|last| text.get(last.end..place.start)).unwrap_or("apart");
        let is_joined = matches!(between.trim_matches([' ', ',']), "" | "and" | "&" | "and also" | "as well as");
        match runs.last_mut().filter(|_| is_joined) {
            Some(last) => last.end = place.end,
            None => runs.push(place.clone()),
        }
    }
    let words = |run: &Range<usize>| text.get(run.clone()).unwrap_or_default().trim_matches([' ', ',', '.']).to_owned();
    let said: Vec<String> = runs.iter().map(words).filter(|said| !said.is_empty()).collect();
    let is_known = |said: &&String| match slot {
        Slot::Color => color_in(said).is_some(),
        _ => names_in(reader, said),
    };
    match slot {
        // "Thirty, no, forty percent".
        Slot::Amount | Slot::Angle | Slot::Count => said.last(),
        _ => said.iter().find(is_known).or(said.first()),
    }
    .cloned()
}

/// Whether a name of the scene is among some words.
fn names_in(reader: &Reader<'_>, said: &str) -> bool {
    let lemmas = token::normalized_name(said);
    reader
        .normalized
        .iter()
        .any(|(_, known)| !known.is_empty() && lemmas.windows(known.len()).any(|run| run == known.as_slice()))
}

/// A thing that a clause describes, in words that the grammar takes for a description: "whatever is made of metal" is "the metal thing".
fn described(said: &str) -> String {
    let lower = said.to_lowercase();
    let Some(rest) = RELATIVE.iter().find_map(|lead| lower.strip_prefix(lead)) else { return said.to_owned() };
    let rest = rest.trim();
    let look = MADE_OF.iter().find_map(|lead| rest.strip_prefix(lead)).unwrap_or(rest);
    format!("the {} thing", look.trim())
}

/// A noun behind an article that no command has, so that it names a thing.
fn unknown_noun(text: &str) -> Option<String> {
    let tokens = token::tokens(text);
    let is_name = |token: &Token| token.kind == Kind::Word && !knows(&token.text) && !color::is_word(&token.text);
    let found = tokens.windows(2).find_map(|two| match two {
        [article, noun] if DETERMINERS.contains(&article.text.as_str()) && is_name(noun) => Some(noun),
        _ => None,
    })?;
    Some(format!("the {}", found.text)).filter(|thing| MODEL.as_ref().is_some_and(|model| model.may_be_thing(thing)))
}

/// The pronoun of a sentence.
fn pronoun(text: &str) -> Option<&'static str> {
    let tokens = token::tokens(text);
    let said = tokens.iter().find_map(|token| PRONOUNS.iter().find(|pronoun| token.text == **pronoun))?;
    Some(if *said == "its" { "it" } else { said })
}

/// The colour among some words: "a sort of dark red".
fn color_in(said: &str) -> Option<String> {
    if color::from_phrase(said).is_some() {
        return Some(said.to_owned());
    }
    let words: Vec<&str> = said.split([' ', '-']).filter(|word| !word.is_empty()).collect();
    let lengths = (1..=words.len().min(color::MAX_WORDS)).rev();
    let mut runs = lengths.flat_map(|length| words.windows(length)).map(|run| run.join(" "));
    runs.find(|run| color::from_phrase(run).is_some())
}

/// An amount without words that change little: "about half".
fn amount(said: &str) -> String {
    let words: Vec<&str> = said.split_whitespace().skip_while(|word| ABOUT.contains(word)).collect();
    if words.is_empty() || words == ["quarter"] { said.to_owned() } else { words.join(" ") }
}

/// The word of the grammar for a side.
fn side(said: &str) -> Option<&'static str> {
    let tokens = token::tokens(said);
    let is_said = |words: &[&str]| tokens.iter().any(|token| words.contains(&token.text.as_str()));
    SIDES.iter().find(|(_, words)| is_said(words)).map(|(side, _)| *side)
}

/// The kept viewpoint that some words name.
fn kept(reader: &Reader<'_>, said: &str) -> String {
    let lemmas = token::normalized_name(said);
    let is_named = |(_, known): &&(String, Vec<String>)| {
        !known.is_empty() && lemmas.windows(known.len()).any(|run| run == known.as_slice())
    };
    reader.normalized_views.iter().find(is_named).map_or_else(|| said.to_owned(), |(name, _)| name.clone())
}

/// The colour of a unit by its name.
fn color_of(reader: &Reader<'_>, said: &str) -> Option<Color> {
    let lemmas = token::normalized_name(said);
    let (name, _) = reader.normalized.iter().find(|(_, known)| *known == lemmas)?;
    state_answer::own_color(name, reader.scene?)
}

fn hex(color: Color) -> String {
    let [red, green, blue] = [color.red, color.green, color.blue].map(|c| (c.clamp(0.0, 1.0) * 255.0).round());
    format!("#{red:02x}{green:02x}{blue:02x}", red = red as u8, green = green as u8, blue = blue as u8)
}

/// The command for a background that is nearer to black (0) or white (1).
fn background(color: Color, toward: f32) -> String {
    let mix = |channel: f32| channel + BACKGROUND_STEP * (toward - channel);
    let mixed = Color { red: mix(color.red), green: mix(color.green), blue: mix(color.blue) };
    format!("make the background {}", hex(mixed))
}

#[cfg(test)]
mod tests {
    use sg_proto::scene::{KeptView, Unit};

    use super::*;
    use crate::grammar::sample_observation;

    /// Values of slots that the grammar reads.
    const VALUES: [(Slot, &str); 9] = [
        (Slot::Thing, "the sac"),
        (Slot::Other, "the clip"),
        (Slot::Color, "red"),
        (Slot::Amount, "30 percent"),
        (Slot::Angle, "30 degrees"),
        (Slot::Count, "three"),
        (Slot::Side, "left"),
        (Slot::Name, "dome"),
        (Slot::Kept, "entry"),
    ];

    fn observation() -> sg_proto::language::Observation {
        let mut observation = sample_observation(&["sac", "clip"]);
        let scene = observation.scene.as_mut().unwrap();
        scene.kept_views.push(KeptView { name: "entry".to_owned(), ..KeptView::default() });
        scene.background = Some(Color { red: 0.0, green: 0.0, blue: 0.4 });
        let color = Some(Color { red: 0.0, green: 0.2, blue: 1.0 });
        scene.units.push(Unit { name: "dome".to_owned(), color, ..Unit::default() });
        observation
    }

    fn command_of(text: &str) -> Option<String> {
        let observation = observation();
        match of(&Reader::new(&observation), text)? {
            Meaning::Command(form, _) => Some(form),
            _ => None,
        }
    }

    #[test]
    fn every_command_of_the_examples_is_a_sentence_of_the_grammar() {
        let observation = observation();
        let reader = Reader::new(&observation);
        for command in MODEL.as_ref().unwrap().commands().iter().filter(|c| c.contains(char::is_lowercase)) {
            let mut text = command.clone();
            let mut slots = Vec::new();
            for (slot, value) in VALUES {
                let value = if slot == Slot::Other && command == SAME_COLOR { "the dome" } else { value };
                while let Some(at) = text.find(&slot.marked()) {
                    text.replace_range(at..at + slot.marked().len(), value);
                    slots.push((slot, value));
                }
            }
            let places = slots.iter().map(|(slot, value)| {
                let at = text.find(value).unwrap();
                (*slot, at..at + value.len())
            });
            let reading = Reading {
                command,
                probability: 1.0,
                slots: places.collect(),
                numbers_left: 0,
                colors_left: 0,
                names_left: 0,
            };
            let form = form(&reader, &text, &reading).unwrap_or_else(|| panic!("“{command}” has no form"));
            let sentence = certain(&reader, &form);
            assert!(sentence.is_some(), "“{command}” as “{form}” is not understood");
        }
    }

    #[test]
    fn other_peoples_words_are_read() {
        let mut wrong = Vec::new();
        for (said, form) in [
            ("dunk the sac in a bucket of red", "make the sac red"),
            ("opacity of thirty percent for the clip would do nicely", "set the opacity of the clip to thirty percent"),
            ("the clip blocks my view of the sac, get it out of the way", "hide the clip"),
            ("hang a teal curtain behind it all", "make the background teal"),
            ("the sac wants the same paint job as the dome", "make the sac #0033ff"),
        ] {
            wrong.extend((command_of(said).as_deref() != Some(form)).then(|| (said, command_of(said))));
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
    }

    #[test]
    fn talk_about_other_things_is_no_command() {
        for said in [
            "our budget was cut by a third",
            "put the kettle on please",
            "the stock market fell by two percent",
            "thanks a lot",
        ] {
            assert_eq!(command_of(said), None, "{said}");
        }
    }

    #[test]
    fn a_background_goes_toward_black_or_white() {
        let color = Color { red: 0.0, green: 0.0, blue: 0.4 };
        assert_eq!(background(color, 0.0), "make the background #000042");
        assert_eq!(background(color, 1.0), "make the background #59599c");
    }

    #[test]
    fn values_are_found_among_other_words() {
        assert_eq!(color_in("a sort of dark red").as_deref(), Some("dark red"));
        assert_eq!(color_in("no colour at all"), None);
        assert_eq!(amount("about half"), "half");
        assert_eq!(side("the rear"), Some("behind"));
        assert_eq!(side("moonlight"), None);
    }
}
