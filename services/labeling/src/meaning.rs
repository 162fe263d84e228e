//! What a sentence encoder says of labels, joined with what their words say.
//!
//! The encoder is the caller's: this library reads no model. Cosines alone tell little: what counts is how far an item's cosine lies
//! above those of the other items, and above what texts of absent things reach. A conditional logit with an outside option
//! (McFadden 1974) states both. Item *i* has the utility `u_i = cosine · c_i + words · w_i`, of its cosine `c_i` and its score
//! by words `w_i`. "Nothing" has the utility `nothing + background · b`, where `b` is the mean cosine of the text with [`BACKGROUND`]:
//! some texts are near to everything, and others to nothing (Conneau et al. 2018). The share of queries that mean the item is
//! `exp u_i / Σ exp u`.

use crate::text::Phrase;
use crate::wordnet::{self, WordNet, WordNetError};

/// Words of a label whose broader terms are named.
const MAX_TERMS: usize = 3;

/// A label with what it is a kind of, as an encoder of general texts may not know: "grey matter: nervous tissue". The broader
/// terms are WordNet's, of the usual meaning of the label, or of its words where it has no meaning as a whole. `None` if no
/// word has one.
///
/// # Errors
/// [`WordNetError`] if the embedded synonyms are damaged.
pub fn described(label: &str) -> Result<Option<String>, WordNetError> {
    let net = wordnet::embedded()?;
    let words = Phrase::of(label).words;
    let terms: Vec<&str> = match broader_term(net, &words.join(" ")) {
        Some(term) => vec![term],
        None => words.iter().filter_map(|word| broader_term(net, word)).take(MAX_TERMS).collect(),
    };
    Ok((!terms.is_empty()).then(|| format!("{label}: {}", terms.join(", "))))
}

/// The broader term of the usual meaning of a noun.
fn broader_term<'n>(net: &'n WordNet, noun: &str) -> Option<&'n str> {
    if noun.bytes().any(|c| c.is_ascii_digit()) {
        return None;
    }
    let senses = net.dictionary_forms(noun).into_iter().flat_map(|form| net.senses(&form));
    let usual = senses.filter(|sense| net.is_noun(sense.synset)).min_by_key(|sense| sense.rank)?;
    let broader = net.broader(usual.synset).next()?;
    net.words_of(broader).next()
}

/// Words of all kinds, whose mean cosine with a text tells how near the text is to anything at all.
pub const BACKGROUND: [&str; 40] = [
    "thing",
    "person",
    "animal",
    "plant",
    "machine",
    "tool",
    "building",
    "food",
    "water",
    "stone",
    "metal",
    "wood",
    "light",
    "sound",
    "color",
    "number",
    "time",
    "idea",
    "place",
    "body",
    "organ",
    "bone",
    "vehicle",
    "furniture",
    "clothing",
    "weather",
    "star",
    "planet",
    "liquid",
    "gas",
    "particle",
    "wave",
    "energy",
    "electricity",
    "fire",
    "ice",
    "music",
    "book",
    "money",
    "game",
];

/// Cosines of one text, −1 to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Cosines {
    /// With the label of each item, in their order: the greater one of the label and of what [`described`] makes of it. `None` for
    /// an item without a label.
    pub labels: Vec<Option<f64>>,
    /// The mean with [`BACKGROUND`].
    pub background: f64,
}

impl Cosines {
    /// Of the cosines with each label and with what [`described`] makes of it, and of those with [`BACKGROUND`].
    #[must_use]
    pub fn of(labels: impl Iterator<Item = Vec<f64>>, background: &[f64]) -> Self {
        let labels = labels.map(|own| own.into_iter().max_by(f64::total_cmp)).collect();
        Self { labels, background: background.iter().sum::<f64>() / background.len().max(1) as f64 }
    }
}

/// Cosines of texts with the labels of items.
pub trait LabelCosines {
    /// The cosines of a text. `None` if it can't be encoded: words then decide alone.
    fn cosines(&self, text: &str) -> Option<Cosines>;
}

/// Coefficients of the utilities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// Of a cosine.
    pub cosine: f64,
    /// Of a score by words.
    pub words: f64,
    /// Utility of "nothing" for a text without background.
    pub nothing: f64,
    /// What the mean cosine with the background adds to it.
    pub background: f64,
}

/// The coefficients for all-MiniLM-L6-v2, of greatest likelihood on the odd scenes of `tests/meaning`. A test fits them again.
pub const CALIBRATION: Calibration = Calibration { cosine: 15.0, words: 7.9, nothing: 1.3, background: 24.4 };

impl Calibration {
    /// For each item, the share of queries with this evidence that mean it. Their sum is below 1: the rest means nothing. An item
    /// without a cosine has none.
    #[must_use]
    pub fn shares(&self, cosines: &Cosines, words: &[f64]) -> Vec<f64> {
        let utilities: Vec<Option<f64>> = cosines
            .labels
            .iter()
            .zip(words)
            .map(|(cosine, words)| Some(self.cosine * (*cosine)? + self.words * words))
            .collect();
        let nothing = self.nothing + self.background * cosines.background;
        let most = utilities.iter().flatten().copied().fold(nothing, f64::max);
        let weights: Vec<f64> = utilities.iter().map(|u| u.map_or(0.0, |u| (u - most).exp())).collect();
        let sum = (nothing - most).exp() + weights.iter().sum::<f64>();
        weights.iter().map(|weight| weight / sum).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn shares_are_those_of_the_formula() {
        let calibration = Calibration { cosine: 2.0, words: 1.0, nothing: 0.25, background: 0.5 };
        let cosines = Cosines { labels: vec![Some(0.5), None, Some(0.0)], background: 0.5 };
        let shares = calibration.shares(&cosines, &[0.0, 1.0, 1.0]);
        let e = std::f64::consts::E;
        let sum = 2.0 * e + 0.5_f64.exp();
        assert!((shares[0] - e / sum).abs() < 1e-12 && shares[1] == 0.0 && (shares[2] - e / sum).abs() < 1e-12);
        assert_eq!(CALIBRATION.shares(&Cosines { labels: vec![], background: 0.0 }, &[]), Vec::<f64>::new());
    }

    #[test]
    fn labels_say_what_they_are_a_kind_of() {
        let of = |label: &str| described(label).unwrap();
        assert_eq!(of("grey matter").as_deref(), Some("grey matter: nervous tissue"));
        assert_eq!(of("femurs").as_deref(), Some("femurs: leg bone"));
        assert!(of("oil pan").is_some_and(|text| text.starts_with("oil pan: ")));
        assert_eq!([of("xyzzy 3"), of("")], [None, None]);
    }

    proptest! {
        #[test]
        fn evidence_helps_its_item_and_shares_stay_below_one(
            cosines in prop::collection::vec(-1.0_f64..1.0, 1..20), at in 0_usize..20, more in 0.01_f64..0.5,
        ) {
            let at = at % cosines.len();
            let words = vec![0.1; cosines.len()];
            let of = |cosines: &[f64], words: &[f64]| {
                let labels = cosines.iter().copied().map(Some).collect();
                CALIBRATION.shares(&Cosines { labels, background: 0.2 }, words)
            };
            let before = of(&cosines, &words);
            prop_assert!(before.iter().sum::<f64>() < 1.0 + 1e-12 && before.iter().all(|s| (0.0..=1.0).contains(s)));
            let (mut nearer, mut said) = (cosines.clone(), words.clone());
            nearer[at] += more;
            said[at] += more;
            prop_assert!(of(&nearer, &words)[at] >= before[at] && of(&cosines, &said)[at] >= before[at]);
        }
    }
}
