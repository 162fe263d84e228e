//! `labeling retrieval`: how well texts find the units of scenes, by each method beside the others, with a real model.

mod queries;
mod report;

use std::path::PathBuf;

use clap::Args;
use sg_encoders::{Embedding, Precision};
use sg_input::print;
use sg_labeling::entropy::EntropyForm;
use sg_labeling::meaning::LabelCosines;
use sg_labeling::query::{Outcome, QueryContext, THRESHOLD};
use sg_labeling::retrieval::{Ranking, Tally};

use crate::label_encoder::{EncoderChoice, LabelEncoder};
use crate::offline_scene::OfflineScene;
use crate::params::{precision_of, views_of};
use crate::picture_encoder::PictureEncoder;
use crate::region_views::ViewOrder;
use crate::unit_embeddings::{FusionChoice, UnitEmbeddings};

use queries::Query;
use report::Subject;

/// The order of the views in a session.
const USUAL: ViewOrder = ViewOrder::Entropy(EntropyForm::Normalized);
/// The orders of the views that are compared, the usual one first.
const ORDERS: [ViewOrder; 3] = [USUAL, ViewOrder::Entropy(EntropyForm::Literal), ViewOrder::VisibleArea];

#[derive(Debug, Args)]
pub(crate) struct Retrieval {
    /// Scenes: scene.toml or Gaussian files. A text is asked for in each scene that has its unit
    #[arg(value_name = "SCENE", required = true)]
    pub(crate) scenes: Vec<PathBuf>,
    /// Model of pictures and texts: its folder
    #[arg(long, value_name = "FOLDER")]
    pub(crate) image_encoder: PathBuf,
    /// Precision of its weights
    #[arg(long, value_name = "f32|f16|int8", default_value = "f32", value_parser = precision_of)]
    pub(crate) image_precision: Precision,
    /// Pictures of a unit, 1 to 12
    #[arg(long, value_name = "N", default_value = "5", value_parser = views_of)]
    pub(crate) views: usize,
    /// Texts instead of the units' own names: lines of a text, a tab, and the name of the unit, or `-` for nothing
    #[arg(long, value_name = "FILE.tsv")]
    pub(crate) queries: Option<PathBuf>,
    /// Sentence encoder to compare with: a model's folder, `auto` for the one of ops/models.sh if it is there, or `none`
    #[arg(long, value_name = "auto|none|FOLDER", default_value = "auto")]
    pub(crate) text_encoder: EncoderChoice,
    /// Writes JSON instead of a table
    #[arg(long)]
    pub(crate) json: bool,
}

/// Embeddings of the units, and how they are made.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Variant {
    order: ViewOrder,
    fusion: FusionChoice,
    /// Whether an adapter moves the pictures, each by what the other units teach.
    adapts: bool,
}

/// A way to find the unit that a text means.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Method {
    /// Labels and looks.
    Words,
    /// Labels and looks with a sentence encoder.
    Meaning,
    /// Cosines with embeddings of the units.
    Embeddings(Variant),
}

impl Method {
    /// The method, for a person.
    fn title(self) -> String {
        let Variant { order, fusion, adapts } = match self {
            Self::Words => return "words".to_owned(),
            Self::Meaning => return "words and meaning".to_owned(),
            Self::Embeddings(variant) => variant,
        };
        let fusion = match fusion {
            FusionChoice::Pictures => "pictures",
            FusionChoice::Name => "name",
            FusionChoice::Normalized => "normalized",
            FusionChoice::Unnormalized => "unnormalized",
        };
        let order = match order {
            ViewOrder::Entropy(EntropyForm::Normalized) => "",
            ViewOrder::Entropy(EntropyForm::Literal) => ", views by literal entropy",
            ViewOrder::VisibleArea => ", views by visible area",
        };
        format!("{fusion}{order}{}", if adapts { ", adapter" } else { "" })
    }

    /// Whether the unit's own name has a part in it.
    fn has_name(self) -> bool {
        match self {
            Self::Words | Self::Meaning => true,
            Self::Embeddings(variant) => variant.fusion != FusionChoice::Pictures,
        }
    }
}

/// The methods that are compared. An adapter moves pictures alone, so it changes nothing of names alone. These are left out where
/// names are asked for: each finds itself.
fn methods(asks_names: bool, has_meaning: bool) -> Vec<Method> {
    use FusionChoice::{Name, Normalized, Pictures, Unnormalized};
    let [_, literal, area] = ORDERS;
    let mut methods = vec![Method::Words];
    methods.extend(has_meaning.then_some(Method::Meaning));
    let variants = [
        (USUAL, Pictures, false),
        (literal, Pictures, false),
        (area, Pictures, false),
        (USUAL, Pictures, true),
        (USUAL, Name, false),
        (USUAL, Normalized, false),
        (USUAL, Normalized, true),
        (USUAL, Unnormalized, false),
        (USUAL, Unnormalized, true),
    ];
    let kept = variants.into_iter().filter(|(_, fusion, _)| !(asks_names && *fusion == Name));
    methods.extend(kept.map(|(order, fusion, adapts)| Method::Embeddings(Variant { order, fusion, adapts })));
    methods
}

/// A text that is asked for in a scene.
struct Question<'q> {
    text: &'q str,
    /// The unit that it means. `None` if it means nothing.
    unit: Option<usize>,
}

/// What a method says to a question.
struct Answer {
    ranking: Ranking,
    /// Whether it leads to a question or a match, whichever unit that is.
    is_given: bool,
}

/// What was measured.
struct Measurement {
    rows: Vec<(Method, Tally)>,
    units: usize,
    /// Units that have an embedding.
    embedded: usize,
    /// Sums over the units with an embedding, for the views of the usual order.
    render_ms: f64,
    encode_ms: f64,
}

impl Measurement {
    fn mean_render_ms(&self) -> f64 {
        self.render_ms / self.embedded.max(1) as f64
    }

    fn mean_encode_ms(&self) -> f64 {
        self.encode_ms / self.embedded.max(1) as f64
    }
}

/// Measures, and writes the report to standard output.
///
/// # Errors
/// One line for a scene, a model or queries that are of no use.
pub(crate) fn run(arguments: &Retrieval) -> Result<(), String> {
    let Retrieval { scenes, image_encoder, image_precision, views, queries, text_encoder, json } = arguments;
    let asked = queries.as_deref().map(queries::read).transpose().map_err(|e| e.to_string())?;
    let scenes = scenes.iter().map(|path| OfflineScene::open(path)).collect::<Result<Vec<_>, String>>()?;
    if let Some((path, asked)) = queries.as_deref().zip(asked.as_deref()) {
        let names: Vec<&str> = scenes.iter().flat_map(|scene| &scene.units.names).map(String::as_str).collect();
        queries::check(path, asked, &names).map_err(|e| e.to_string())?;
    }
    let meaning = LabelEncoder::of(text_encoder).map_err(|e| e.to_string())?;
    let encoder = PictureEncoder::open(image_encoder, *image_precision, *views).map_err(|e| e.to_string())?;
    let none = UnitEmbeddings::new(encoder, FusionChoice::Pictures, false).map_err(|e| e.to_string())?;
    let measured = measure(&scenes, asked.as_deref(), &none, meaning.as_deref())?;
    let precision = format!("{image_precision:?}").to_lowercase();
    let file = queries.as_deref().map(|path| path.display().to_string());
    let subject = Subject {
        model: none.encoder().name(),
        precision: &precision,
        views: *views,
        scenes: scenes.iter().map(|scene| scene.name.as_str()).collect(),
        queries: file.as_deref(),
    };
    let text = if *json {
        report::json(&subject, &measured).map_err(|e| e.to_string())?
    } else {
        report::table(&subject, &measured).join("\n")
    };
    print::result(&text).map_err(|e| format!("standard output: {e}"))
}

/// Asks for units by all methods: by `queries`, or by the units' own names. `none` has the model, and no unit.
///
/// # Errors
/// One line if nothing can be asked for, no unit has an embedding, or a model fails.
fn measure(
    scenes: &[OfflineScene],
    queries: Option<&[Query]>,
    none: &UnitEmbeddings,
    meaning: Option<&LabelEncoder>,
) -> Result<Measurement, String> {
    let rows = methods(queries.is_none(), meaning.is_some()).into_iter().map(|method| (method, Tally::default()));
    let mut measured = Measurement { rows: rows.collect(), units: 0, embedded: 0, render_ms: 0.0, encode_ms: 0.0 };
    for scene in scenes {
        let questions = questions(queries, &scene.units.names);
        measured.units += scene.units.names.len();
        // Such a scene would only take time.
        if questions.is_empty() || scene.units.names.is_empty() {
            continue;
        }
        let by_order = embedded(scene, none, &mut measured)?;
        let texts: Vec<&str> = questions.iter().map(|question| question.text).collect();
        let texts = none.encoder().encode_texts(&texts).map_err(|e| e.to_string())?;
        for (method, tally) in &mut measured.rows {
            let answers = match method {
                Method::Words => by_words(scene, &questions, None)?,
                Method::Meaning => by_words(scene, &questions, meaning)?,
                Method::Embeddings(variant) => by_embeddings(scene, &texts, &by_order, *variant)?,
            };
            for (question, answer) in questions.iter().zip(&answers) {
                match question.unit {
                    Some(unit) => tally.add_meant(&answer.ranking, unit),
                    None => tally.add_absent(answer.is_given),
                }
            }
        }
    }
    if measured.embedded == 0 {
        return Err("no unit has an embedding, so nothing was measured; name scenes with visible units".to_owned());
    }
    Ok(measured)
}

/// The questions for a scene: the texts whose unit it has, and those that mean nothing. Without texts, the names of its units.
fn questions<'q>(queries: Option<&'q [Query]>, names: &'q [String]) -> Vec<Question<'q>> {
    let Some(queries) = queries else {
        let own = |(unit, name): (usize, &'q String)| Question { text: name, unit: Some(unit) };
        return names.iter().enumerate().map(own).collect();
    };
    let asked = queries.iter().filter_map(|query| {
        let unit = match &query.unit {
            Some(meant) => Some(names.iter().position(|name| name == meant)?),
            None => None,
        };
        Some(Question { text: &query.text, unit })
    });
    asked.collect()
}

/// The embeddings of a scene's units by their pictures, for each order of the views.
fn embedded(
    scene: &OfflineScene,
    none: &UnitEmbeddings,
    measured: &mut Measurement,
) -> Result<Vec<(ViewOrder, UnitEmbeddings)>, String> {
    let units = scene.embed(none.encoder(), &ORDERS);
    measured.embedded += units.len();
    let mut by_order = Vec::with_capacity(ORDERS.len());
    for (at, order) in ORDERS.into_iter().enumerate() {
        let embeddings = none.variant(FusionChoice::Pictures, false).map_err(|e| e.to_string())?;
        for unit in &units {
            let Some(made) = unit.by_order.get(at) else { continue };
            let fused = embeddings.add(&unit.name, unit.key, &made.embedding).map_err(|e| e.to_string())?;
            if order == USUAL {
                measured.render_ms += made.render_ms;
                measured.encode_ms += made.encode_ms + fused.encode_ms;
            }
        }
        by_order.push((order, embeddings));
    }
    Ok(by_order)
}

/// What labels and looks say, with a sentence encoder if there is one.
fn by_words(
    scene: &OfflineScene,
    questions: &[Question<'_>],
    meaning: Option<&LabelEncoder>,
) -> Result<Vec<Answer>, String> {
    let names = &scene.units.names;
    if let Some(encoder) = meaning {
        while encoder.encode_next(names).map_err(|e| e.to_string())? {}
    }
    let answer = |question: &Question<'_>| {
        let labels = meaning.map(|encoder| encoder.labelled(names));
        let meaning = labels.as_ref().map(|labels| labels as &dyn LabelCosines);
        let context = QueryContext { meaning, ..QueryContext::default() };
        let listed = match scene.units.queryable.find_by(question.text, context) {
            Outcome::Match { items } => items,
            Outcome::Ambiguous { candidates } => candidates,
            Outcome::NothingMatches { .. } => Vec::new(),
        };
        let mut scores = vec![None; names.len()];
        for ranked in &listed {
            if let Some(score) = scores.get_mut(ranked.item) {
                *score = Some(ranked.score);
            }
        }
        Answer { ranking: Ranking::new(scores), is_given: !listed.is_empty() }
    };
    Ok(questions.iter().map(answer).collect())
}

/// What embeddings of the units say to the embeddings of texts: cosines rank the units, and the greatest share decides whether
/// there is a question at all, as in a session.
fn by_embeddings(
    scene: &OfflineScene,
    texts: &[Embedding],
    by_order: &[(ViewOrder, UnitEmbeddings)],
    variant: Variant,
) -> Result<Vec<Answer>, String> {
    let of_order = by_order.iter().find(|(order, _)| *order == variant.order);
    let (_, embeddings) = of_order.ok_or("the views were not drawn in this order")?;
    let embeddings = embeddings.variant(variant.fusion, variant.adapts).map_err(|e| e.to_string())?;
    let answer = |text: &Embedding| {
        let near = embeddings.nearness(&scene.units.names, text);
        let is_given = near.iter().flatten().any(|near| near.share >= THRESHOLD);
        let cosines = near.into_iter().map(|near| near.map(|near| f64::from(near.cosine)));
        Answer { ranking: Ranking::new(cosines.collect()), is_given }
    };
    Ok(texts.iter().map(answer).collect())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::Vec3;
    use sg_encoders::{Fusion, RIDGE, adapted, fuse};
    use sg_labeling::meaning::BACKGROUND;
    use sg_scene::synthetic::test_scene;

    use super::*;

    fn scene() -> OfflineScene {
        let mut file = test_scene(&[("bone", 90), ("skin", 120), ("vein", 60)]);
        for (unit, color) in file.units.iter_mut().zip([Vec3::new(0.9, 0.1, 0.1), Vec3::new(0.1, 0.8, 0.1), Vec3::Z]) {
            unit.palette = color;
        }
        OfflineScene::new("a scene".to_owned(), file).unwrap()
    }

    fn none() -> UnitEmbeddings {
        UnitEmbeddings::new(PictureEncoder::tiny(2), FusionChoice::Pictures, false).unwrap()
    }

    fn queries(text: &str) -> Vec<Query> {
        queries::parse(Path::new("texts.tsv"), text).unwrap()
    }

    fn tally(measured: &Measurement, title: &str) -> Tally {
        let row = measured.rows.iter().find(|(method, _)| method.title() == title);
        row.map_or_else(|| panic!("no row {title}"), |(_, tally)| tally.clone())
    }

    #[test]
    fn ranks_are_those_of_the_embeddings_themselves() {
        const TEXTS: [(&str, Option<usize>); 4] =
            [("the hard part", Some(0)), ("a tube of blood", Some(2)), ("what covers it", Some(1)), ("the moon", None)];
        let (scene, none) = (scene(), none());
        let text = "the hard part\tbone\na tube of blood\tvein\nwhat covers it\tskin\nthe moon\t-\n";
        let measured = measure(std::slice::from_ref(&scene), Some(&queries(text)), &none, None).unwrap();
        assert_eq!((measured.units, measured.embedded), (3, 3));
        assert!(measured.render_ms > 0.0 && measured.encode_ms > 0.0);

        let encoder = none.encoder();
        let texts = encoder.encode_texts(&TEXTS.map(|(text, _)| text)).unwrap();
        let names = ["bone", "skin", "vein"].map(|name| encoder.encode_texts(&[name]).unwrap().remove(0));
        let background = encoder.encode_texts(&BACKGROUND).unwrap();
        let made = scene.embed(encoder, &ORDERS);
        let by_order = |at: usize| made.iter().map(|unit| unit.by_order[at].embedding.clone()).collect::<Vec<_>>();
        let pictures = by_order(0);
        let fused = |fusion: Fusion| -> Vec<Embedding> {
            pictures.iter().zip(&names).map(|(picture, name)| fuse(picture, name, fusion).unwrap()).collect()
        };
        let (own, theirs): (Vec<&Embedding>, Vec<&Embedding>) = pictures.iter().zip(&names).unzip();
        for (title, units) in [
            ("pictures", pictures.clone()),
            ("pictures, views by literal entropy", by_order(1)),
            ("pictures, views by visible area", by_order(2)),
            ("pictures, adapter", adapted(&own, &theirs, RIDGE).unwrap()),
            ("name", names.to_vec()),
            ("normalized", fused(Fusion::Normalised)),
            ("unnormalized", fused(Fusion::Unnormalised)),
        ] {
            let mut expected = (0, 0.0, 0);
            for (text, (_, meant)) in texts.iter().zip(TEXTS) {
                let cosines: Vec<f32> = units.iter().map(|unit| unit.cosine(text).unwrap()).collect();
                if let Some(unit) = meant {
                    let rank = cosines.iter().filter(|cosine| **cosine >= cosines[unit]).count();
                    expected.0 += usize::from(rank == 1);
                    expected.1 += 1.0 / rank as f64;
                } else {
                    let asks = units.iter().zip(&cosines).any(|(unit, cosine)| {
                        let others: Vec<f32> = background.iter().map(|word| word.cosine(unit).unwrap()).collect();
                        encoder.share(*cosine, &others) >= 0.5
                    });
                    expected.2 += usize::from(asks);
                }
            }
            let found = tally(&measured, title);
            assert_eq!((found.recall_at_1().count, found.false_answers().count), (expected.0, expected.2), "{title}");
            let mean = found.mean_reciprocal_rank().unwrap();
            assert!((mean - expected.1 / 3.0).abs() < 1e-12, "{title}: {mean}");
            assert_eq!((found.recall_at_5().count, found.false_answers().of), (3, 1), "{title}");
        }
        assert!((tally(&measured, "pictures").chance().unwrap() - 1.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn words_answer_or_say_that_nothing_matches() {
        let text = "bone\tbone\nthe bones\tbone\nepidermis\tvein\nthe carburettor\t-\nthe skin\t-\n";
        let measured = measure(&[scene()], Some(&queries(text)), &none(), None).unwrap();
        let words = tally(&measured, "words");
        assert_eq!((words.recall_at_1().count, words.meant()), (2, 3), "{words:?}");
        assert_eq!((words.false_answers().count, words.false_answers().of), (1, 2));
    }

    #[test]
    fn names_ask_for_their_own_units() {
        let scenes = [scene(), scene()];
        let measured = measure(&scenes, None, &none(), None).unwrap();
        assert_eq!((measured.units, measured.embedded), (6, 6));
        assert!(measured.rows.iter().all(|(_, tally)| tally.meant() == 6 && tally.false_answers().of == 0));
        let titles: Vec<String> = measured.rows.iter().map(|(method, _)| method.title()).collect();
        let expected = [
            "words",
            "pictures",
            "pictures, views by literal entropy",
            "pictures, views by visible area",
            "pictures, adapter",
            "normalized",
            "normalized, adapter",
            "unnormalized",
            "unnormalized, adapter",
        ];
        assert_eq!(titles, expected);
        assert_eq!(tally(&measured, "words").recall_at_1().count, 6, "an own name always wins");
        let unmarked = measured.rows.iter().filter(|(method, _)| !method.has_name()).count();
        assert_eq!(unmarked, 4, "pictures alone do not have the name");
        assert!(methods(false, true).len() == 11 && methods(true, false).len() == 9);
    }

    #[test]
    fn what_cannot_be_measured_is_an_error() {
        let mut file = test_scene(&[("ghost", 30)]);
        file.units[0].opacity = 0.0;
        let ghost = OfflineScene::new("a scene".to_owned(), file).unwrap();
        let error = measure(&[ghost], None, &none(), None).err().unwrap();
        assert!(error.starts_with("no unit has an embedding"), "{error}");
    }
}
