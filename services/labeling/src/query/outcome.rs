//! What a query means, and why.

use std::fmt;

use crate::relation::{Evidence, Relation};

/// Least score of a match. Below it a query matches nothing.
pub const THRESHOLD: f64 = 0.5;
/// Least score of a single match that a meaning speaks for. Below it the text may mean the item, which is a question.
pub(super) const SURE_MEANING: f64 = 0.7;
/// Least lead of a single match over the next one. With less the query is ambiguous.
pub const LEAD: f64 = 0.07;
/// Most that a score may lie below the best one where a text means several units.
pub const SPREAD: f64 = 0.2;

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
    /// What a sentence encoder compared, where one had a say: "brain tissue ~ grey matter".
    pub meaning: Option<String>,
    /// What an image-text model sees in its pictures: "handle by clip-vit-base-patch32".
    pub pictures: Option<String>,
    /// What it is like, and in what: "the sac in colour, size".
    pub alike: Option<String>,
    /// Whether it is meant because other items are named as left out.
    pub by_exclusion: bool,
}

impl Ranked {
    /// Why the item is meant, as part of a sentence: "synonym: windscreen ~ windshield; looks transparent".
    #[must_use]
    pub fn explanation(&self) -> String {
        let mut parts: Vec<String> = self.evidence.iter().map(ToString::to_string).collect();
        if let Some(meaning) = &self.meaning {
            parts.push(format!("meaning: {meaning}"));
        }
        if let Some(pictures) = &self.pictures {
            parts.push(format!("pictures: {pictures}"));
        }
        if let Some(alike) = &self.alike {
            parts.push(format!("like {alike}"));
        }
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

    /// Whether a meaning, pictures, a likeness, or a label's word of another kind than the same word, speaks for the item: a reply should
    /// then say so.
    #[must_use]
    pub fn is_inferred(&self) -> bool {
        let is_same = |r| matches!(r, Relation::Exact | Relation::Inflection | Relation::Spacing);
        self.meaning.is_some()
            || self.pictures.is_some()
            || self.alike.is_some()
            || self.evidence.iter().any(|e| !is_same(e.relation))
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
    /// One of these items; the text or the picture does not say which. A single one is likely by its meaning, and not sure.
    Ambiguous {
        /// At least one item, the best first.
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
    /// Things like the selection are asked for, and nothing is selected.
    NothingSelected,
    /// No other thing is like this one.
    NothingAlike(String),
    /// A picture is to be compared with those of the items, and no item has any yet.
    NoPictures,
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
            Self::NothingSelected => write!(f, "nothing is selected"),
            Self::NothingAlike(name) => write!(f, "nothing else is like {name}"),
            Self::NoPictures => write!(f, "the pictures of the units are not embedded yet"),
        }
    }
}
