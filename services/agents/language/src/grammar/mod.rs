//! The embedded backend: a deterministic grammar from text and what is seen to an [`Intent`].
//!
//! A tokenizer with lemmas feeds a recursive-descent parser; [`table`](self::help) is the one list of what can be said.
//! Names of the scene's units are matched first and longest, so that a unit may be called "red vessel"; a name that the
//! scene does not have is kept as it was spoken, for whoever carries the clause out to refuse it with the names there are.
//!
//! | said | becomes |
//! | --- | --- |
//! | "it", "them" | [`Reference::focus`](sg_proto::language::Reference) |
//! | "this", "that" | the selection where something is selected, else the focus |
//! | "everything else", "the rest" | a complement of nothing named |
//! | "make it brighter" (scene), "brighter" | ambient and diffuse multiplied |
//! | "transparent" · "half/semi-transparent" · "80 % transparent" | opacity 0.3 · 0.5 · 0.2 |
//! | "rotate left", "turn the camera left" | the eye moves to its left |
//! | "turn it left" | the thing turns left, so the eye moves to its right |
//! | "light from the left" | from the left of the picture as it is seen now |
//! | "update the sac" | a label clause with [`SetOperation::Replace`](sg_proto::scene::SetOperation) |

mod sentence;
mod suggest;

use std::sync::LazyLock;

use sg_proto::language::{Intent, Observation};
use sg_proto::limits::MAX_UTTERANCE_BYTES;
use sg_proto::scene::{BaseUnit, Selection, State};
use winnow::stream::TokenSlice;

use crate::syntax::phrase::{Input, Known};
use crate::syntax::token;
use crate::unit_names;
use sentence::{OpeningIndex, Sentence};

static OPENINGS: LazyLock<OpeningIndex> = LazyLock::new(OpeningIndex::of_table);

/// Name of this backend.
pub const NAME: &str = "grammar";

/// An utterance that is not even looked at.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum UtteranceError {
    /// Longer than the contract allows.
    #[error("the utterance has {0} bytes; say it in at most {MAX_UTTERANCE_BYTES}")]
    TooLong(usize),
    /// Nothing in it.
    #[error("nothing was said; try “help”")]
    Empty,
}

/// Understands an utterance in front of a scene.
///
/// Deterministic. What cannot be understood stands in `not_understood`, word for word, with up to three suggestions;
/// a clause that refers back to such a part ("it", "the rest") is not understood either.
///
/// # Errors
/// [`UtteranceError`]: an utterance that is empty or over [`MAX_UTTERANCE_BYTES`].
pub fn parse(text: &str, observation: &Observation) -> Result<Intent, UtteranceError> {
    if text.len() > MAX_UTTERANCE_BYTES {
        return Err(UtteranceError::TooLong(text.len()));
    }
    let tokens = token::tokens(text);
    if tokens.is_empty() {
        return Err(UtteranceError::Empty);
    }
    let scene = observation.scene.as_ref();
    let names = scene.map(unit_names::addressable).unwrap_or_default();
    let folded: Vec<(String, Vec<String>)> =
        names.iter().map(|n| ((*n).to_owned(), unit_names::normalized(n))).collect();
    let read = |source: &str, tokens: &[token::Token]| -> Sentence {
        let known = Known {
            source,
            names: &folded,
            beginnings: &OPENINGS.first,
            has_selection: scene.and_then(|s| s.selection.as_ref()).is_some_and(|s| s.count > 0),
            view: scene.and_then(|s| s.view.as_ref()),
        };
        let tokens: Vec<&token::Token> = tokens.iter().collect();
        sentence::read(&OPENINGS, Input { input: TokenSlice::new(&tokens), state: &known })
    };
    let sentence = read(text, &tokens);
    let mut suggestions = Vec::new();
    if !sentence.not_understood.is_empty() {
        let corrected = suggest::corrected(text, &tokens, &names).filter(|better| {
            let again = read(better, &token::tokens(better));
            again.not_understood.is_empty() && again.unknown == 0
        });
        suggestions.extend(corrected);
        // Some examples make sense only where there are units.
        let sensible = |example: &String| read(example, &token::tokens(example)).not_understood.is_empty();
        for example in suggest::examples(&sentence.not_understood, &names).into_iter().filter(sensible) {
            if suggestions.len() < suggest::MAX_SUGGESTIONS && !suggestions.contains(&example) {
                suggestions.push(example);
            }
        }
    }
    Ok(Intent {
        clauses: sentence.clauses,
        not_understood: sentence.not_understood,
        suggestions,
        backend: NAME.to_owned(),
        ..Intent::default()
    })
}

/// A scene with units of these names and a selection, for examples.
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

    fn observation(names: &[&str]) -> Observation {
        let unit = |name: &&str| BaseUnit { name: (*name).to_owned(), ..BaseUnit::default() };
        let scene = State { base_units: names.iter().map(unit).collect(), ..State::default() };
        Observation { scene: Some(scene), ..Observation::default() }
    }

    #[test]
    fn every_example_of_the_table_is_read_as_its_act() {
        for names in [&["sac", "vessel"][..], &["leaves", "flower pot"], &[]] {
            // Where nothing has a name nothing can be told apart from its new one.
            for entry in TABLE.iter().filter(|e| !names.is_empty() || e.act != sg_proto::language::Act::Rename) {
                assert!(!entry.examples.is_empty(), "{} has no example", entry.title);
                for example in entry.examples {
                    let said = with_names(example, names);
                    let intent = parse(&said, &observation(names)).unwrap();
                    assert!(intent.not_understood.is_empty(), "“{said}” misses {:?}", intent.not_understood);
                    assert!(!intent.clauses.is_empty(), "“{said}” means nothing");
                    for clause in &intent.clauses {
                        assert_eq!(clause.act(), entry.act, "“{said}”");
                    }
                }
            }
        }
    }

    #[test]
    fn every_act_of_the_contract_can_be_said() {
        for act in 1..=21 {
            let act = sg_proto::language::Act::try_from(act).unwrap();
            assert!(TABLE.iter().any(|e| e.act == act), "{act:?}");
        }
        assert!(sg_proto::language::Act::try_from(22).is_err(), "an act was added to the contract");
    }

    #[test]
    fn no_beginning_stands_twice_in_one_construction() {
        for entry in TABLE {
            for construct in entry.constructs {
                let mut seen = std::collections::BTreeSet::new();
                for opening in construct.phrases() {
                    assert!(!opening.starts_with('(') && !opening.contains("  "), "“{opening}”");
                    assert!(seen.insert(opening), "“{opening}” stands twice under {}", entry.title);
                }
            }
        }
    }
}
