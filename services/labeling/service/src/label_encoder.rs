//! A sentence encoder beside the words: embeddings of labels, each made once, and cosines of texts with them.

use std::cell::Cell;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lru::LruCache;
use serde::Deserialize;
use sg_encoders::{Embedding, EncoderError, OnnxRuntime, OnnxSentenceEncoder, Precision, SentenceEncoder, TextEncoder};
use sg_labeling::meaning::{BACKGROUND, Cosines, LabelCosines, described};

/// Model that is used without a parameter, in the user's cache.
const USUAL_MODEL: &str = "models/all-MiniLM-L6-v2";
/// Most labels whose embeddings are kept: 13 MB for the usual model.
const MAX_LABELS: NonZeroUsize = NonZeroUsize::new(4096).unwrap();
/// Most labels that are kept of units that have gone: undo may bring them back. A long session makes thousands of others.
const MAX_FORMER: usize = 256;
/// Most labels that are encoded while somebody waits. Others count by their words alone until they are encoded.
const MAX_AT_ONCE: usize = 4;
/// Most parts of a query that are encoded, such as those that "and" joins. Words alone speak for the others.
const MAX_PARTS: usize = 4;
/// Labels in one pass of the encoder in advance. Between passes a text gets its turn.
const BATCH: usize = 16;
/// Longest label that is encoded, bytes. Longer ones are no names.
const MAX_LABEL_BYTES: usize = 512;

/// Which sentence encoder is used.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(from = "String")]
pub(crate) enum EncoderChoice {
    /// The usual model, if it is there.
    #[default]
    Auto,
    /// None.
    None,
    /// A model in a folder.
    Folder(PathBuf),
}

impl From<String> for EncoderChoice {
    fn from(text: String) -> Self {
        match text.as_str() {
            "auto" => Self::Auto,
            "none" => Self::None,
            _ => Self::Folder(PathBuf::from(text)),
        }
    }
}

impl From<&str> for EncoderChoice {
    fn from(text: &str) -> Self {
        Self::from(text.to_owned())
    }
}

/// An encoder with the labels that it has encoded.
pub(crate) struct LabelEncoder {
    encoder: Box<dyn TextEncoder>,
    background: Vec<Embedding>,
    /// Embeddings of each label: of itself, and of its description.
    known: Mutex<LruCache<String, Vec<Embedding>>>,
}

/// Threads of a graph: as many as there are cores.
pub(crate) fn threads() -> NonZeroUsize {
    std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN)
}

/// The folder of the usual model, if it is there.
fn usual_model() -> Option<PathBuf> {
    let folder = directories::ProjectDirs::from("", "", "supergaussian")?.cache_dir().join(USUAL_MODEL);
    folder.is_dir().then_some(folder)
}

/// The labels whose embeddings are kept. Words alone speak for the others.
fn kept(labels: &[String]) -> &[String] {
    labels.get(..MAX_LABELS.get()).unwrap_or(labels)
}

impl LabelEncoder {
    /// The encoder that a parameter chooses. `None` without one.
    ///
    /// # Errors
    /// [`EncoderError`] for a folder that has no readable model.
    pub(crate) fn of(choice: &EncoderChoice) -> Result<Option<Arc<Self>>, EncoderError> {
        Self::run_by(choice, None)
    }

    /// As [`LabelEncoder::of`]. With a library of ONNX Runtime, a folder that has a graph is run by it.
    pub(crate) fn run_by(choice: &EncoderChoice, library: Option<&Path>) -> Result<Option<Arc<Self>>, EncoderError> {
        let folder = match choice {
            EncoderChoice::None => None,
            EncoderChoice::Auto => usual_model(),
            EncoderChoice::Folder(folder) => Some(folder.clone()),
        };
        folder.map(|folder| Self::open(&folder, library).map(Arc::new)).transpose()
    }

    fn open(folder: &Path, library: Option<&Path>) -> Result<Self, EncoderError> {
        let encoder: Box<dyn TextEncoder> = match library.filter(|_| OnnxSentenceEncoder::is_in(folder)) {
            Some(library) => Box::new(OnnxSentenceEncoder::open(folder, &OnnxRuntime::load(library)?, threads())?),
            None => Box::new(SentenceEncoder::open(folder, Precision::F32)?),
        };
        let background = encoder.encode_texts(&BACKGROUND)?;
        Ok(Self { encoder, background, known: Mutex::new(LruCache::new(MAX_LABELS)) })
    }

    /// Ignores poisoning: each change of the cache is complete, even if its thread panics.
    fn known(&self) -> MutexGuard<'_, LruCache<String, Vec<Embedding>>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The first `most` labels that have no embedding yet, each once, in their order.
    fn unknown<'l>(&self, labels: &'l [String], most: usize) -> Vec<&'l str> {
        let known = self.known();
        let mut unknown: Vec<&str> = Vec::new();
        for label in labels.iter().filter(|label| !label.trim().is_empty() && label.len() <= MAX_LABEL_BYTES) {
            if unknown.len() == most {
                break;
            }
            if !known.contains(label) && !unknown.contains(&label.as_str()) {
                unknown.push(label);
            }
        }
        unknown
    }

    fn encode(&self, labels: &[&str]) -> Result<(), EncoderError> {
        // Without a dictionary a label has no description.
        let descriptions: Vec<Option<String>> = labels.iter().map(|label| described(label).ok().flatten()).collect();
        let texts: Vec<&str> =
            labels.iter().copied().chain(descriptions.iter().flatten().map(String::as_str)).collect();
        let mut encoded = self.encoder.encode_texts(&texts)?.into_iter();
        let mut own: Vec<Vec<Embedding>> = encoded.by_ref().take(labels.len()).map(|own| vec![own]).collect();
        for (embeddings, description) in own.iter_mut().zip(&descriptions) {
            if description.is_some() {
                embeddings.extend(encoded.next());
            }
        }
        let mut known = self.known();
        for (label, embeddings) in labels.iter().zip(own) {
            known.put((*label).to_owned(), embeddings);
        }
        Ok(())
    }

    /// Encodes the next labels that have no embedding yet. Returns whether any were left to encode.
    ///
    /// # Errors
    /// [`EncoderError`] for a label that the model cannot encode.
    pub(crate) fn encode_next(&self, labels: &[String]) -> Result<bool, EncoderError> {
        let next = self.unknown(kept(labels), BATCH);
        if next.is_empty() {
            self.forget_former(kept(labels));
            return Ok(false);
        }
        self.encode(&next).map(|()| true)
    }

    /// Forgets the oldest labels that are not of the scene, beyond [`MAX_FORMER`].
    fn forget_former(&self, labels: &[String]) {
        let mut known = self.known();
        for label in labels {
            known.promote(label);
        }
        while known.len() > labels.len() + MAX_FORMER {
            known.pop_lru();
        }
    }

    /// The encoder for the labels of a scene, for one query.
    pub(crate) fn labelled<'e>(&'e self, labels: &'e [String]) -> SceneLabels<'e> {
        SceneLabels { encoder: self, labels, parts: Cell::new(0) }
    }
}

/// An encoder for some labels, for one query.
pub(crate) struct SceneLabels<'e> {
    encoder: &'e LabelEncoder,
    labels: &'e [String],
    /// Parts of the query that were encoded.
    parts: Cell<usize>,
}

impl SceneLabels<'_> {
    fn of_text(&self, text: &str) -> Result<Option<Cosines>, EncoderError> {
        let next = self.encoder.unknown(kept(self.labels), MAX_AT_ONCE);
        if !next.is_empty() {
            self.encoder.encode(&next)?;
        }
        let Some(text) = self.encoder.encoder.encode_texts(&[text])?.pop() else { return Ok(None) };
        // Embeddings of one model always compare.
        let cosine = |other: &Embedding| other.cosine(&text).ok().map(f64::from);
        let background: Vec<f64> = self.encoder.background.iter().filter_map(cosine).collect();
        let mut known = self.encoder.known();
        let own = |label| known.get(label).map_or_else(Vec::new, |own| own.iter().filter_map(cosine).collect());
        Ok(Some(Cosines::of(self.labels.iter().map(own), &background)))
    }
}

impl LabelCosines for SceneLabels<'_> {
    fn cosines(&self, text: &str) -> Option<Cosines> {
        if self.parts.get() == MAX_PARTS {
            return None;
        }
        self.parts.set(self.parts.get() + 1);
        let cosines = self.of_text(text);
        cosines.inspect_err(|error| tracing::warn!(%error, "words alone decide")).ok().flatten()
    }
}

#[cfg(test)]
mod tests {
    #![allow(
        clippy::unwrap_used,
        clippy::print_stdout,
        reason = "a test fails by panicking and tells what it measured"
    )]

    use std::time::{Duration, Instant};

    use sg_labeling::frame::Frame;
    use sg_labeling::query::{Item, Outcome, QueryContext, Ranked, Scene};

    use super::*;

    /// all-MiniLM-L6-v2, if it is there. With `SUPERGAUSSIAN_REQUIRE_TOOLS=1` it must be.
    fn usual() -> Option<Arc<LabelEncoder>> {
        let found = LabelEncoder::of(&EncoderChoice::Auto).unwrap();
        let required = std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1");
        assert!(found.is_some() || !required, "SUPERGAUSSIAN_REQUIRE_TOOLS=1; run ops/models.sh");
        if found.is_none() {
            println!("SKIPPED: no all-MiniLM-L6-v2, run ops/models.sh");
        }
        found
    }

    fn scene(labels: &[String]) -> Scene {
        let items = labels.iter().map(|label| Item { label: Some(label.clone()), attributes: None });
        Scene::new(items, Frame::XYZ).unwrap()
    }

    fn by<'c>(meaning: &'c SceneLabels<'_>) -> QueryContext<'c> {
        QueryContext { meaning: Some(meaning), ..QueryContext::default() }
    }

    fn only(outcome: Outcome) -> Ranked {
        let Outcome::Match { items } = outcome else { panic!("{outcome:?}") };
        let [item] = items.as_slice() else { panic!("{items:?}") };
        item.clone()
    }

    #[test]
    fn parameters_name_a_model_or_none() {
        let of = |text: &str| serde_json::from_value::<EncoderChoice>(serde_json::json!(text)).unwrap();
        assert_eq!([of("auto"), of("none")], [EncoderChoice::Auto, EncoderChoice::None]);
        assert_eq!(of("/models/m"), EncoderChoice::Folder("/models/m".into()));
        assert!(LabelEncoder::of(&EncoderChoice::None).unwrap().is_none());
        let error = LabelEncoder::of(&"/nowhere".into()).err().unwrap().to_string();
        assert!(error.contains("/nowhere/config.json"), "{error}");
    }

    #[test]
    fn meanings_find_what_words_do_not() {
        let Some(encoder) = usual() else { return };
        for (labels, query, expected) in [
            (["grey matter", "skull", "eyeball", "scalp"], "brain tissue", 0),
            (["heart", "lungs", "diaphragm", "ribs"], "what one breathes with", 1),
        ] {
            let labels = labels.map(str::to_owned);
            let scene = scene(&labels);
            let words = scene.find(query);
            assert!(!matches!(&words, Outcome::Match { items } if items[0].item == expected), "{words:?}");
            let found = only(scene.find_by(query, by(&encoder.labelled(&labels))));
            assert!(found.item == expected && found.is_inferred(), "{query}: {found:?}");
            assert!(found.explanation().contains("meaning: "), "{}", found.explanation());
        }
    }

    #[test]
    fn long_lists_do_not_wait_for_each_part() {
        let Some(encoder) = usual() else { return };
        let labels = ["heart".to_owned()];
        let labelled = encoder.labelled(&labels);
        let answered = (0..6).filter(|i| labelled.cosines(&format!("part {i}")).is_some()).count();
        assert_eq!(answered, MAX_PARTS);
    }

    #[test]
    fn an_own_label_always_wins() {
        let Some(encoder) = usual() else { return };
        let labels = ["heart", "cardiac muscle", "pump", "lung", "heart valve"].map(str::to_owned);
        let scene = scene(&labels);
        for (at, label) in labels.iter().enumerate() {
            let found = only(scene.find_by(label, by(&encoder.labelled(&labels))));
            assert_eq!((found.item, found.score, found.meaning), (at, 1.0, None));
        }
    }

    /// A soak of 200,000 commands found this: each unit that was ever saved kept its embedding.
    #[test]
    fn labels_of_units_that_have_gone_are_forgotten() {
        let Some(encoder) = usual() else { return };
        let lasting = "skull".to_owned();
        for round in 0..8 {
            let passing = (0..64).map(|i| format!("unit {}", 64 * round + i));
            let labels: Vec<String> = std::iter::once(lasting.clone()).chain(passing).collect();
            while encoder.encode_next(&labels).unwrap() {}
            assert!(encoder.known().len() <= labels.len() + MAX_FORMER);
            assert!(labels.iter().all(|label| encoder.known().contains(label)), "those of the scene stay");
        }
        let few = [lasting];
        assert!(!encoder.encode_next(&few).unwrap());
        assert_eq!(encoder.known().len(), 1 + MAX_FORMER);
        assert!(encoder.known().contains(&few[0]));
    }

    #[test]
    fn labels_are_encoded_in_parts_and_a_query_does_not_wait_for_all() {
        let Some(encoder) = usual() else { return };
        let labels: Vec<String> = (0..50).map(|i| format!("{} part {i}", ["bolt", "vein", "leaf"][i % 3])).collect();
        let scene = scene(&labels);
        let _ = scene.find_by("the thing that fastens", by(&encoder.labelled(&labels)));
        assert_eq!(encoder.known().len(), MAX_AT_ONCE);
        while encoder.encode_next(&labels).unwrap() {}
        assert_eq!(encoder.known().len(), labels.len());
        let mut times: Vec<Duration> = (0..20)
            .map(|_| {
                let start = Instant::now();
                let _ = scene.find_by("the thing that fastens", by(&encoder.labelled(&labels)));
                start.elapsed()
            })
            .collect();
        times.sort_unstable();
        println!("a query with an encoder over 50 labels: {:?} at the median, {:?} at most", times[10], times[19]);
        assert!(times[0] < Duration::from_millis(60), "{times:?}");
    }
}
