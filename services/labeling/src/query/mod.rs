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
//! assert_eq!(items[0].explanation(), "usual name: cranium ~ skull");
//! assert!(matches!(scene.find("the kidney"), Outcome::Ambiguous { candidates } if candidates.len() == 2));
//! assert!(matches!(scene.find("liver"), Outcome::NothingMatches { .. }));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod outcome;
mod parse;
mod picture;
mod rank;

pub use outcome::{LEAD, Outcome, Ranked, SPREAD, THRESHOLD, Why};
pub use picture::like_picture;

use crate::attributes::Attributes;
use crate::attributes::judge::Looks;
use crate::frame::Frame;
use crate::lexical::Index;
use crate::meaning::LabelCosines;
use crate::pictures::UnitPictures;
use crate::query::rank::Known;
use crate::wordnet::WordNetError;

/// Something that a text can mean: a labelled unit, a base unit, or a cluster without a label.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// Its label or name, if it has one.
    pub label: Option<String>,
    /// Its look, if it is known.
    pub attributes: Option<Attributes>,
}

/// What a query can use beside labels and looks of the items.
#[derive(Clone, Copy, Default)]
pub struct QueryContext<'c> {
    /// A sentence encoder.
    pub meaning: Option<&'c dyn LabelCosines>,
    /// An image-text model that has seen the items. Where words find nothing, it leads to a question, never to a match.
    pub pictures: Option<&'c dyn UnitPictures>,
    /// Measures the selection, for "things like this"; called for such texts alone. It has no look if nothing is selected.
    pub selection: Option<&'c dyn Fn() -> Option<Attributes>>,
}

/// Items to query, with an index of their labels.
pub struct Scene {
    index: Index,
    looks: Looks,
    /// For each item, whether others have all of its Gaussians.
    covered: Vec<bool>,
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
        Ok(Self { index, looks, covered: Vec::new() })
    }

    /// With a word for each item whether others have all of its Gaussians, such as a base unit whose parts are saved units. A look
    /// alone means such an item only where no other item has it.
    #[must_use]
    pub fn with_covered(self, covered: Vec<bool>) -> Self {
        Self { covered, ..self }
    }

    /// The looks of the items, in their order.
    #[must_use]
    pub fn looks(&self) -> &Looks {
        &self.looks
    }

    /// The items that a text means.
    #[must_use]
    pub fn find(&self, text: &str) -> Outcome {
        self.find_by(text, QueryContext::default())
    }

    /// The items that a text means, by words, looks, and what else is known. Words that are sure decide alone, so an item's own
    /// label always finds it.
    #[must_use]
    pub fn find_by(&self, text: &str, context: QueryContext<'_>) -> Outcome {
        let QueryContext { meaning, pictures, selection } = context;
        let Self { index, looks, covered } = self;
        rank::find(Known { index, looks, covered, meaning, pictures, selection }, text)
    }
}

#[cfg(test)]
mod meaning_tests;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::meaning::Cosines;
    use crate::pictures::PictureShares;

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

    /// An encoder by which every text is as near to the labels as these cosines say.
    struct Fixed(Vec<f64>);

    impl LabelCosines for Fixed {
        fn cosines(&self, _: &str) -> Option<Cosines> {
            Some(Cosines { labels: self.0.iter().copied().map(Some).collect(), background: 0.1 })
        }
    }

    fn by(meaning: &Fixed) -> QueryContext<'_> {
        QueryContext { meaning: Some(meaning), ..QueryContext::default() }
    }

    #[test]
    fn guesses_are_questions_alone_in_lists_and_in_plurals() {
        let scene = scene(&["aneurysm sac", "vein", "skull"]);
        let kind = |text: &str, cosines: [f64; 3]| match scene.find_by(text, by(&Fixed(cosines.to_vec()))) {
            Outcome::Match { items } => ('=', items.len()),
            Outcome::Ambiguous { candidates } => ('?', candidates.len()),
            Outcome::NothingMatches { .. } => ('-', 0),
        };
        // Nothing has the utility 1.3 + 24.4 · 0.1 = 3.74, and cosines count 15 times.
        let (sure, guess, far) = ([0.36, 0.0, 0.0], [0.27, 0.0, 0.0], [0.1, 0.0, 0.0]);
        for text in ["the swollen part", "the swollen parts", "the swollen part and the growth"] {
            assert_eq!([sure, guess, far].map(|cosines| kind(text, cosines)), [('=', 1), ('?', 1), ('-', 0)], "{text}");
        }
        assert_eq!(kind("the swollen part", [0.26, 0.25, 0.0]), ('?', 2));
        // An exact label needs no encoder, and what stands beside it is still a guess.
        assert_eq!(kind("the skull", guess), ('=', 1));
        assert_eq!(kind("the skull and the swollen part", guess).0, '?');
    }

    /// A ball of a colour, as long as it is large.
    fn ball(label: &str, size: f64, color: [f32; 3]) -> Item {
        let covariance = glam::DMat3::from_diagonal(glam::DVec3::splat(size * size));
        let (deviations, center) = ([size; 3], glam::DVec3::splat(size));
        let attributes = Some(Attributes { count: 9, center, covariance, deviations, color, opacity: 0.8 });
        Item { label: Some(label.into()), attributes }
    }

    #[test]
    fn a_look_means_the_part_before_what_its_parts_cover() {
        let blue = [0.1, 0.2, 0.9];
        let items = [ball("residue", 2.0, blue), ball("sac", 1.0, blue), ball("bone", 2.0, [0.9, 0.9, 0.8])];
        let scene = |covered| Scene::new(items.clone(), Frame::XYZ).unwrap().with_covered(covered);
        assert_eq!(found(&scene(Vec::new()), "the blue one"), ('?', vec![0, 1]));
        let scene = scene(vec![true, false, false]);
        assert_eq!(found(&scene, "the blue one"), ('=', vec![1]));
        assert_eq!(found(&scene, "the residue"), ('=', vec![0]), "its name means it all the same");
    }

    #[test]
    fn things_are_like_one_another_by_look_or_by_name() {
        const RED: [f32; 3] = [0.8, 0.1, 0.1];
        const BLUE: [f32; 3] = [0.1, 0.1, 0.8];
        let items = [
            ball("sac", 3.0, RED),
            ball("bud", 3.2, RED),
            ball("vein", 9.0, BLUE),
            ball("left kidney", 5.0, BLUE),
            ball("right kidney", 1.0, RED),
        ];
        let selected = items[1].attributes;
        let scene = Scene::new(items, Frame::XYZ).unwrap();
        for (text, expected) in [
            ("things like the sac", ('=', vec![1])),
            ("what looks like the sac", ('=', vec![1])),
            ("the other one like the sac", ('=', vec![1])),
            // A kidney of another size and colour is a kidney.
            ("parts similar to the left kidney", ('=', vec![4])),
            ("things like the sac and the left kidney", ('=', vec![1, 4])),
            ("things like the kidney", ('?', vec![3, 4])),
            ("things like the vein", ('-', vec![])),
            ("things like the carburettor", ('-', vec![])),
            ("things like this", ('-', vec![])),
        ] {
            assert_eq!(found(&scene, text), expected, "{text}");
        }
        let context = QueryContext { selection: Some(&|| selected), ..QueryContext::default() };
        let Outcome::Match { items } = scene.find_by("things like this", context) else { panic!("no match") };
        assert_eq!(items.iter().map(|r| r.item).collect::<Vec<_>>(), [0], "the selection itself is left out");
        assert_eq!(items[0].explanation(), "like the selection in colour, size, shape, opacity");
        assert!(items[0].is_inferred());
        let why = |text: &str| match scene.find(text) {
            Outcome::NothingMatches { why, .. } => why.to_string(),
            other => panic!("{other:?}"),
        };
        assert_eq!(why("things like this"), "nothing is selected");
        assert_eq!(why("things like the vein"), "nothing else is like the vein");
    }

    /// A model to which each text is as likely for the pictures of the items as these numbers say.
    struct FixedShares(Vec<Option<f64>>);

    impl UnitPictures for FixedShares {
        fn shares(&self, _: &str) -> Option<PictureShares> {
            Some(PictureShares { model: "a model".into(), units: self.0.clone() })
        }
    }

    #[test]
    fn pictures_ask_where_words_find_nothing() {
        let scene = scene(&["part a", "part b", "handle bar"]);
        let by = |text: &str, shares: [Option<f64>; 3]| {
            let pictures = FixedShares(shares.to_vec());
            scene.find_by(text, QueryContext { pictures: Some(&pictures), ..QueryContext::default() })
        };
        let Outcome::Ambiguous { candidates } = by("the saddle", [Some(0.9), Some(0.6), Some(0.2)]) else {
            panic!("no question")
        };
        assert_eq!(candidates.iter().map(|r| (r.item, r.score)).collect::<Vec<_>>(), [(0, 0.9), (1, 0.6)]);
        assert_eq!(candidates[0].explanation(), "pictures: saddle by a model");
        // A label decides, looks are measured, and unlikely pictures say nothing.
        let sure = [Some(0.9), None, None];
        assert!(matches!(by("the handle bar", sure), Outcome::Match { items } if items[0].item == 2));
        for (text, shares) in [("the red one", sure), ("the saddle", [Some(0.4), None, None]), ("no saddle", sure)] {
            let outcome = by(text, shares);
            assert!(
                !matches!(&outcome, Outcome::Ambiguous { candidates } if candidates[0].pictures.is_some()),
                "{text}"
            );
        }
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
