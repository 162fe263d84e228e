//! The embedded backend: a deterministic grammar from text to an [`Intent`].
//!
//! A recursive-descent parser reads tokens with lemmas. The table of [`commands`](crate::commands) lists all phrases.
//! The longest name of a unit is matched first, so that a unit may be called "red vessel". Unknown names stay in the
//! intent as they were spoken; the function agent refuses them with the existing names.
//!
//! | phrase | result |
//! | --- | --- |
//! | "it", "them" | [`Reference::focus`](sg_proto::language::Reference) |
//! | "this", "that" | the selection if there is one, else the focus |
//! | "everything else", "the rest" | a complement without names |
//! | "make it brighter" (scene), "brighter" | ambient and diffuse multiplied |
//! | "transparent" · "half/semi-transparent" · "80 % transparent" | opacity 0.3 · 0.5 · 0.2 |
//! | "rotate left", "turn the camera left" | the camera moves to its left |
//! | "turn it left" | the scene turns left, so the camera moves to its right |
//! | "turn the sac left by 30 degrees", "turn it by 30 degrees" after a command on the sac | the sac turns |
//! | "light from the left" | light from the left of the current picture |
//! | "save this view as entry", "save the view as entry.png" | a kept viewpoint, a picture |
//! | "go to the front view", "go to the entry view" | the front, a kept viewpoint |
//! | "go to entry" | the unit "entry", else the kept viewpoint |
//! | "update the sac" | a label clause with [`SetOperation::Replace`](sg_proto::scene::SetOperation) |

mod conversation;
mod correction;
mod follow_up;
mod forms;
mod interpretation;
mod missing;
mod plain_form;
mod question;
mod rewording;
mod scope;
mod self_correction;
mod sentence;
mod sentence_model;
mod slots;
mod spelling;
mod suggest;
mod word_pattern;

use std::cell::{Cell, OnceCell, RefCell};
use std::collections::{BTreeSet, HashMap};
use std::sync::LazyLock;

use sg_proto::language::{Intent, Observation};
use sg_proto::limits::MAX_UTTERANCE_BYTES;
use sg_proto::scene::{BaseUnit, Selection, State};
use winnow::stream::TokenSlice;

use crate::syntax::phrase::{Input, ParseContext};
use crate::syntax::token::{self, Token};
use crate::unit_names;
use sentence::{OpeningIndex, Sentence};

pub use interpretation::interpret;

static OPENINGS: LazyLock<OpeningIndex> = LazyLock::new(OpeningIndex::of_table);

/// Largest number of readings of targets in one utterance. A sentence takes some hundreds.
const MAX_READINGS: usize = 20_000;

/// Most readings and similar words that are kept while an utterance is read.
const MOST_KEPT: usize = 512;

/// Name of this backend.
pub const NAME: &str = "grammar";

/// An utterance that is not parsed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum UtteranceError {
    /// The utterance is longer than the contract allows.
    #[error("the utterance has {0} bytes; the limit is {MAX_UTTERANCE_BYTES}")]
    TooLong(usize),
    /// The utterance is empty.
    #[error("the utterance is empty; try “help”")]
    Empty,
}

/// Parses an utterance for a scene, as it was said. [`interpret`] repairs what this does not understand.
///
/// The result is deterministic. Parts that are not understood stand word for word in `not_understood`, with up to three
/// suggestions. A clause that refers back to such a part ("it", "the rest") is not understood either.
///
/// # Errors
/// [`UtteranceError`]: the utterance is empty or longer than [`MAX_UTTERANCE_BYTES`].
pub fn parse(text: &str, observation: &Observation) -> Result<Intent, UtteranceError> {
    let tokens = tokens_of(text)?;
    let reader = Reader::new(observation);
    let sentence = reader.read_tokens(text, &tokens);
    Ok(reader.intent(text, &tokens, sentence))
}

/// The tokens of an utterance of a length that the contract allows.
fn tokens_of(text: &str) -> Result<Vec<Token>, UtteranceError> {
    if text.len() > MAX_UTTERANCE_BYTES {
        return Err(UtteranceError::TooLong(text.len()));
    }
    let tokens = token::tokens(text);
    if tokens.is_empty() { Err(UtteranceError::Empty) } else { Ok(tokens) }
}

/// Reads texts for one scene.
#[derive(Debug)]
struct Reader<'o> {
    /// Names of units that people may address.
    names: Vec<&'o str>,
    /// The same, each with its normalized words.
    normalized: Vec<(String, Vec<String>)>,
    /// Names of kept viewpoints.
    kept_views: Vec<&'o str>,
    /// The same, each with its normalized words.
    normalized_views: Vec<(String, Vec<String>)>,
    has_selection: bool,
    has_focus: bool,
    scene: Option<&'o State>,
    /// Whether the conversation was about a tour, so that "hold on" may mean it.
    speaks_of_tour: bool,
    /// Readings of the texts so far: the forms of an utterance are looked at for one meaning after another.
    readings: RefCell<HashMap<String, Sentence>>,
    /// Words of the commands and of the names.
    vocabulary: OnceCell<BTreeSet<String>>,
    /// Words of the vocabulary that are like a misspelt one.
    similar_words: RefCell<HashMap<String, Vec<String>>>,
}

impl<'o> Reader<'o> {
    fn new(observation: &'o Observation) -> Self {
        let scene = observation.scene.as_ref();
        let names = scene.map(unit_names::addressable).unwrap_or_default();
        let kept_views = scene.map(unit_names::kept_views).unwrap_or_default();
        let normalized =
            |names: &[&str]| names.iter().map(|n| ((*n).to_owned(), token::normalized_name(n))).collect::<Vec<_>>();
        Self {
            normalized: normalized(&names),
            names,
            normalized_views: normalized(&kept_views),
            kept_views,
            has_selection: scene.and_then(|s| s.selection.as_ref()).is_some_and(|s| s.count > 0),
            has_focus: scene.is_some_and(|s| !s.focus.is_empty()),
            scene,
            speaks_of_tour: false,
            readings: RefCell::default(),
            vocabulary: OnceCell::new(),
            similar_words: RefCell::default(),
        }
    }

    /// All names that people may say.
    fn known_names(&self) -> Vec<&'o str> {
        self.names.iter().chain(&self.kept_views).copied().collect()
    }

    /// Words of the commands and of the names.
    fn vocabulary(&self) -> &BTreeSet<String> {
        self.vocabulary.get_or_init(|| suggest::vocabulary(&self.known_names()))
    }

    fn read(&self, text: &str) -> Sentence {
        if let Some(known) = self.readings.borrow().get(text) {
            return known.clone();
        }
        let sentence = self.read_tokens(text, &token::tokens(text));
        let mut readings = self.readings.borrow_mut();
        if readings.len() < MOST_KEPT {
            readings.insert(text.to_owned(), sentence.clone());
        }
        sentence
    }

    fn context<'c>(&'c self, source: &'c str) -> ParseContext<'c> {
        ParseContext {
            source,
            names: &self.normalized,
            kept_views: &self.normalized_views,
            opening_lemmas: &OPENINGS.first_lemmas,
            has_selection: self.has_selection,
            has_focus: self.has_focus,
            view: self.scene.and_then(|scene| scene.view.as_ref()),
            readings_left: Cell::new(MAX_READINGS),
        }
    }

    fn read_tokens(&self, source: &str, tokens: &[Token]) -> Sentence {
        let context = self.context(source);
        let tokens: Vec<&Token> = tokens.iter().collect();
        sentence::parse(&OPENINGS, Input { input: TokenSlice::new(&tokens), state: &context })
    }

    /// The sentence as an intent, with suggestions for what is not understood.
    fn intent(&self, text: &str, tokens: &[Token], sentence: Sentence) -> Intent {
        let mut suggestions = Vec::new();
        if !sentence.not_understood.is_empty() {
            let corrected =
                suggest::corrected(text, tokens, &self.known_names()).filter(|better| self.read(better).is_certain());
            suggestions.extend(corrected);
            // Some examples need units.
            let is_understood = |example: &String| self.read(example).not_understood.is_empty();
            for example in suggest::examples(&sentence.not_understood, &self.names).into_iter().filter(is_understood) {
                if suggestions.len() < suggest::MAX_SUGGESTIONS && !suggestions.contains(&example) {
                    suggestions.push(example);
                }
            }
        }
        Intent {
            clauses: sentence.clauses,
            not_understood: sentence.not_understood,
            suggestions,
            backend: NAME.to_owned(),
            ..Intent::default()
        }
    }
}

/// An observation of a scene with these units and a selection, for examples.
#[must_use]
pub fn sample_observation(names: &[&str]) -> Observation {
    let unit = |name: &&str| BaseUnit { name: (*name).to_owned(), ..BaseUnit::default() };
    let selection = Some(Selection { count: 1, ..Selection::default() });
    let scene = State { base_units: names.iter().map(unit).collect(), selection, ..State::default() };
    Observation { scene: Some(scene), ..Observation::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::help::with_names;
    use crate::commands::table::TABLE;
    use sg_proto::language::Act;

    fn observation(names: &[&str]) -> Observation {
        let unit = |name: &&str| BaseUnit { name: (*name).to_owned(), ..BaseUnit::default() };
        let scene = State { base_units: names.iter().map(unit).collect(), ..State::default() };
        Observation { scene: Some(scene), ..Observation::default() }
    }

    #[test]
    fn every_example_is_parsed_as_its_act() {
        for names in [&["sac", "vessel"][..], &["leaves", "flower pot"], &[]] {
            // Without known names the old name cannot be told from the new one.
            for entry in TABLE.iter().filter(|e| !names.is_empty() || e.act != Act::Rename) {
                assert!(!entry.examples.is_empty(), "{} has no example", entry.title);
                for example in entry.examples {
                    let utterance = with_names(example, names);
                    let intent = parse(&utterance, &observation(names)).unwrap();
                    assert!(intent.not_understood.is_empty(), "“{utterance}” misses {:?}", intent.not_understood);
                    assert!(!intent.clauses.is_empty(), "“{utterance}” means nothing");
                    for clause in &intent.clauses {
                        assert_eq!(clause.act(), entry.act, "“{utterance}”");
                    }
                }
            }
        }
    }

    #[test]
    fn every_act_of_the_contract_has_a_command() {
        for act in (1..).map_while(|act| Act::try_from(act).ok()) {
            assert!(TABLE.iter().any(|e| e.act == act), "{act:?}");
        }
    }

    #[test]
    fn no_phrase_occurs_twice_in_one_construct() {
        for entry in TABLE {
            for construct in entry.constructs {
                let mut seen = BTreeSet::new();
                for opening in construct.phrases() {
                    assert!(!opening.starts_with('(') && !opening.contains("  "), "“{opening}”");
                    assert!(seen.insert(opening), "“{opening}” occurs twice under {}", entry.title);
                }
            }
        }
    }
}
