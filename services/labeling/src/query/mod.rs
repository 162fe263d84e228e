//! Queries: which units a text means, by their labels and by their looks.
//!
//! ```
//! use sg_labeling::frame::Frame;
//! use sg_labeling::query::{Item, Outcome, Scene};
//!
//! let labels = ["skull", "left kidney", "right kidney"];
//! let items = labels.map(|label| Item { label: Some(label.into()), attributes: None });
//! let scene = Scene::new(items, Frame::XYZ)?;
//! let Outcome::Match { items } = scene.find("cranium") else { return Err("no match".into()) };
//! assert_eq!(items[0].item, 0);
//! assert_eq!(items[0].explanation(), "part of the same kind: cranium ~ skull");
//! assert!(matches!(scene.find("the kidney"), Outcome::Ambiguous { candidates } if candidates.len() == 2));
//! assert!(matches!(scene.find("liver"), Outcome::NothingMatches { .. }));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod parse;
mod rank;

pub use parse::Number;

use std::fmt;

use crate::attributes::Attributes;
use crate::attributes::judge::Looks;
use crate::frame::Frame;
use crate::lexical::Index;
use crate::relation::{Evidence, Relation};
use crate::wordnet::WordNetError;

/// Least score of a match. Below it a query matches nothing.
pub const THRESHOLD: f64 = 0.5;
/// Least lead of a single match over the next one. With less the query is ambiguous.
pub const LEAD: f64 = 0.07;
/// Most that a score may lie below the best one where a text means several units.
pub const SPREAD: f64 = 0.2;

/// Something that a text can mean: a labelled unit, a base unit, or a cluster without a label.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// Its label or name, if it has one.
    pub label: Option<String>,
    /// Its look, if it is known.
    pub attributes: Option<Attributes>,
}

/// An item with its score and what speaks for it.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranked {
    /// Index of the item.
    pub item: usize,
    /// Share of queries with this evidence that mean the item, 0 to 1.
    pub score: f64,
    /// What the words of its label say.
    pub evidence: Vec<Evidence>,
    /// The words of the query that its look fits: "largest", "red".
    pub looks: Vec<String>,
    /// The words of the query that its look does not fit.
    pub unfit: Vec<String>,
    /// Whether it is meant because other items are named as left out.
    pub by_exclusion: bool,
}

impl Ranked {
    /// Why the item is meant, as part of a sentence: "synonym: windscreen ~ windshield; looks transparent".
    #[must_use]
    pub fn explanation(&self) -> String {
        let mut parts: Vec<String> = self.evidence.iter().map(ToString::to_string).collect();
        if !self.looks.is_empty() {
            parts.push(format!("looks {}", self.looks.join(", ")));
        }
        if !self.unfit.is_empty() {
            parts.push(format!("not {}", self.unfit.join(", ")));
        }
        if self.by_exclusion {
            parts.push("not excluded".to_owned());
        }
        parts.join("; ")
    }

    /// Whether a label's word of another kind than the same word speaks for the item: a reply should then say so.
    #[must_use]
    pub fn is_inferred(&self) -> bool {
        self.evidence.iter().any(|e| !matches!(e.relation, Relation::Exact | Relation::Inflection | Relation::Spacing))
    }
}

/// What a query means.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// These items, the best first.
    Match {
        /// At least one item.
        items: Vec<Ranked>,
    },
    /// One of these items; the text does not say which.
    Ambiguous {
        /// At least two items, the best first.
        candidates: Vec<Ranked>,
    },
    /// No item is likely enough.
    NothingMatches {
        /// The likeliest item, below [`THRESHOLD`].
        best: Option<Ranked>,
        /// Why nothing matches, for a reply.
        why: Why,
    },
}

/// Why nothing matches.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Why {
    /// There are no items.
    NoItems,
    /// The text has no word that names or describes a thing.
    NoWords,
    /// No label is like these words.
    NoSuchLabel(String),
    /// There are things of that name, but none looks like this.
    NoSuchLook {
        /// The words that name the thing; empty where any thing is asked for.
        noun: String,
        /// The words that describe it.
        look: String,
    },
    /// All that matches is excluded.
    AllExcluded,
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoItems => write!(f, "there is nothing to find"),
            Self::NoWords => write!(f, "no word names or describes a thing"),
            Self::NoSuchLabel(noun) => write!(f, "no label is like \"{noun}\""),
            Self::NoSuchLook { noun, look } if noun.is_empty() => write!(f, "nothing looks \"{look}\""),
            Self::NoSuchLook { noun, look } => write!(f, "no \"{noun}\" looks \"{look}\""),
            Self::AllExcluded => write!(f, "all that matches is excluded"),
        }
    }
}

/// Items to query, with an index of their labels.
pub struct Scene {
    index: Index,
    looks: Looks,
}

impl Scene {
    /// Items in their order, and the frame of words such as "left".
    ///
    /// # Errors
    /// [`WordNetError`] if the embedded synonyms are damaged.
    pub fn new(items: impl IntoIterator<Item = Item>, frame: Frame) -> Result<Self, WordNetError> {
        let items: Vec<Item> = items.into_iter().collect();
        let index = Index::new(items.iter().map(|item| item.label.as_deref()))?;
        let looks = Looks::new(items.into_iter().map(|item| item.attributes).collect(), frame);
        Ok(Self { index, looks })
    }

    /// The items that a text means.
    #[must_use]
    pub fn find(&self, text: &str) -> Outcome {
        rank::find(&self.index, &self.looks, text)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn scene(labels: &[&str]) -> Scene {
        let item = |label: &&str| Item { label: Some((*label).into()), attributes: None };
        Scene::new(labels.iter().map(item), Frame::XYZ).unwrap()
    }

    fn found(scene: &Scene, text: &str) -> (char, Vec<usize>) {
        let numbers = |ranked: Vec<Ranked>| {
            let mut items: Vec<usize> = ranked.iter().map(|r| r.item).collect();
            items.sort_unstable();
            items
        };
        match scene.find(text) {
            Outcome::Match { items } => ('=', numbers(items)),
            Outcome::Ambiguous { candidates } => ('?', numbers(candidates)),
            Outcome::NothingMatches { .. } => ('-', Vec::new()),
        }
    }

    #[test]
    fn one_several_none() {
        let scene = scene(&["left kidney", "right kidney", "liver", "blood vessel"]);
        for (text, expected) in [
            ("the left kidney", ('=', vec![0])),
            ("kidney", ('?', vec![0, 1])),
            ("both kidneys", ('=', vec![0, 1])),
            ("all the kidneys", ('=', vec![0, 1])),
            ("the liver and the left kidney", ('=', vec![0, 2])),
            ("everything but the vessel", ('=', vec![0, 1, 2])),
            ("without the kidneys", ('=', vec![2, 3])),
            ("the kidney that is not left", ('=', vec![1])),
            ("everything", ('=', vec![0, 1, 2, 3])),
            ("heart", ('-', vec![])),
            ("", ('-', vec![])),
            ("???", ('-', vec![])),
            ("everything but everything", ('-', vec![])),
        ] {
            assert_eq!(found(&scene, text), expected, "{text}");
        }
        assert_eq!(found(&self::scene(&[]), "liver"), ('-', vec![]));
    }

    #[test]
    fn replies_say_why() {
        let scene = scene(&["windshield", "truck"]);
        let Outcome::Match { items } = scene.find("windscreen") else { panic!("no match") };
        assert_eq!(items[0].explanation(), "synonym: windscreen ~ windshield");
        assert!(items[0].is_inferred());
        let Outcome::NothingMatches { why, .. } = scene.find("the heart") else { panic!("a match") };
        assert_eq!(why.to_string(), "no label is like \"heart\"");
        let Outcome::NothingMatches { why, .. } = scene.find("the red truck") else { panic!("a match") };
        assert_eq!(why.to_string(), "no \"truck\" looks \"red\"");
    }

    proptest! {
        #[test]
        fn any_text_gets_an_answer(text in "\\PC{0,80}", labels in prop::collection::vec("\\PC{0,20}", 0..6)) {
            let items = labels.into_iter().map(|label| Item { label: Some(label), attributes: None });
            let scene = Scene::new(items, Frame::XYZ).unwrap();
            match scene.find(&text) {
                Outcome::Match { items } => {
                    prop_assert!(!items.is_empty());
                    prop_assert!(items.windows(2).all(|w| w[0].score >= w[1].score));
                    prop_assert!(items.iter().all(|r| (THRESHOLD..=1.0).contains(&r.score)));
                }
                Outcome::Ambiguous { candidates } => prop_assert!(candidates.len() > 1),
                Outcome::NothingMatches { best, .. } => prop_assert!(best.is_none_or(|b| b.score < THRESHOLD || b.by_exclusion)),
            }
        }
    }
}
