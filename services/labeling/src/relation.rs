//! How a word of a query relates to a word of a label, and how much that counts.

use std::fmt;

/// The relation of a query's word to a label's word, the strongest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Relation {
    /// The same word.
    Exact,
    /// Another form of the same word: "teeth" to "tooth".
    Inflection,
    /// The same letters with other spaces: "gallbladder" to "gall bladder".
    Spacing,
    /// A word of the same meaning.
    Synonym,
    /// What people of a field call the same structure: "aneurysm" for "sac".
    Usage,
    /// An adjective that pertains to the label's noun: "renal" to "kidney".
    Pertains,
    /// A part of the same kind as the label: "cranium" to "skull", both bones.
    Part,
    /// The last part of a word that is written together: "shaft" to "crankshaft".
    Ending,
    /// The query's word is more general, by this many steps: "blood vessel" to "artery".
    Broader(u8),
    /// The query's word is more special, by this many steps: "artery" to "blood vessel".
    Narrower(u8),
    /// A word with this many wrong letters.
    Spelling(u8),
    /// Another spelling of the same sound.
    Sound,
}

impl Relation {
    /// Estimated share of queries with this relation alone that mean the label: the scale of every score, 0 to 1.
    ///
    /// The constants are estimates, checked on the looked-at half of the evaluation. `docs/labeling.md` shows how well they hold on the
    /// other half.
    #[must_use]
    pub fn score(self) -> f64 {
        match self {
            Self::Exact => 1.0,
            Self::Inflection => 0.98,
            Self::Spacing => 0.97,
            Self::Synonym => 0.92,
            Self::Usage => 0.85,
            Self::Pertains => 0.85,
            Self::Part => 0.75,
            Self::Ending => 0.75,
            Self::Broader(steps) => (0.9 - 0.04 * f64::from(steps)).max(0.55),
            Self::Narrower(steps) => (0.68 - 0.09 * f64::from(steps)).max(0.0),
            Self::Spelling(edits) => (0.92 - 0.08 * f64::from(edits)).max(0.0),
            Self::Sound => 0.7,
        }
    }
}

impl fmt::Display for Relation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Exact => "name",
            Self::Inflection => "another form of the word",
            Self::Spacing => "name written apart or together",
            Self::Synonym => "synonym",
            Self::Usage => "usual name",
            Self::Pertains => "adjective of the noun",
            Self::Part => "part of the same kind",
            Self::Ending => "end of the word",
            Self::Broader(_) => "broader term",
            Self::Narrower(_) => "narrower term",
            Self::Spelling(_) => "spelling",
            Self::Sound => "sound",
        })
    }
}

/// Words of a query, words of a label, and why the one may mean the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// The words of the query.
    pub query: String,
    /// The words of the label.
    pub label: String,
    /// Their relation.
    pub relation: Relation,
    /// What the relation counts, 0 to 1. Rare meanings count less than [`Relation::score`].
    pub score: f64,
}

impl fmt::Display for Evidence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.relation == Relation::Exact {
            write!(f, "{}: {}", self.relation, self.label)
        } else {
            write!(f, "{}: {} ~ {}", self.relation, self.query, self.label)
        }
    }
}
