//! The embeddings of a scene's units: which are there, and how near a text is to each.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use sg_encoders::{Embedding, EmbeddingError, Fusion, RIDGE, adapted, fuse};
use sg_labeling::meaning::BACKGROUND;
use sg_labeling::pictures::{PictureShares, UnitPictures};

use crate::picture_encoder::{PictureEncoder, PictureError};

/// Most parts of a query that are encoded, such as those that "and" joins.
const MAX_PARTS: usize = 4;

/// How the embeddings of pictures and of names become one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum FusionChoice {
    /// The bisector of both.
    #[default]
    Normalized,
    /// The mean of the model's outputs, as the paper prints it.
    Unnormalized,
    /// The pictures alone.
    Pictures,
    /// The name alone.
    Name,
}

/// An embedding that texts are compared with.
#[derive(Debug, Clone)]
pub(crate) struct Compared {
    embedding: Embedding,
    /// Cosines of the background with it.
    background: Vec<f32>,
}

/// The embedding of one unit.
#[derive(Debug, Clone)]
struct UnitEmbedding {
    /// What its pictures were made of.
    key: blake3::Hash,
    pictures: Embedding,
    name: Embedding,
    fused: Compared,
}

/// Embeddings of the units of a scene, by their names.
pub(crate) struct UnitEmbeddings {
    encoder: Arc<PictureEncoder>,
    fusion: FusionChoice,
    /// Whether an adapter is fitted on the units.
    adapts: bool,
    /// Embeddings of words of all kinds.
    background: Vec<Embedding>,
    known: Mutex<HashMap<String, UnitEmbedding>>,
}

/// How near a text is to a unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Nearness {
    /// Cosine of the text's embedding with the unit's, −1 to 1.
    pub(crate) cosine: f32,
    /// Probability of the text among texts of all kinds, 0 to 1.
    pub(crate) share: f64,
}

/// The embedding of a unit was fused.
pub(crate) struct Fused {
    pub(crate) encode_ms: f64,
    pub(crate) fuse_ms: f64,
}

impl UnitEmbeddings {
    /// Embeddings by a model, none yet.
    ///
    /// # Errors
    /// [`PictureError`] if the model cannot encode texts.
    pub(crate) fn new(encoder: PictureEncoder, fusion: FusionChoice, adapts: bool) -> Result<Self, PictureError> {
        let background = encoder.encode_texts(&BACKGROUND)?;
        Ok(Self { encoder: Arc::new(encoder), fusion, adapts, background, known: Mutex::default() })
    }

    /// The same units by the same model, fused in another way. Later changes of either are not seen by the other.
    ///
    /// # Errors
    /// [`EmbeddingError`] for pictures and a name that are opposite to each other.
    pub(crate) fn variant(&self, fusion: FusionChoice, adapts: bool) -> Result<Self, EmbeddingError> {
        let (encoder, background) = (Arc::clone(&self.encoder), self.background.clone());
        let variant = Self { encoder, fusion, adapts, background, known: Mutex::default() };
        let mut units = self.known().clone();
        for unit in units.values_mut() {
            unit.fused = variant.fused(&unit.pictures, &unit.name)?;
        }
        if adapts {
            variant.adapt(&mut units)?;
        }
        *variant.known() = units;
        Ok(variant)
    }

    /// The model.
    pub(crate) fn encoder(&self) -> &PictureEncoder {
        &self.encoder
    }

    /// Ignores poisoning: each change of the map is complete, even if its thread panics.
    fn known(&self) -> MutexGuard<'_, HashMap<String, UnitEmbedding>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether a unit of this name has an embedding of these pictures.
    pub(crate) fn has(&self, unit: &str, key: &blake3::Hash) -> bool {
        self.known().get(unit).is_some_and(|known| known.key == *key)
    }

    /// The units whose embedding is there, of some names, in their order.
    pub(crate) fn embedded(&self, units: &[String]) -> Vec<String> {
        let known = self.known();
        units.iter().filter(|unit| known.contains_key(*unit)).cloned().collect()
    }

    /// Forgets all units but these.
    pub(crate) fn retain(&self, units: &[String]) {
        let kept: std::collections::HashSet<&String> = units.iter().collect();
        self.known().retain(|unit, _| kept.contains(unit));
    }

    /// Forgets a unit whose pictures have changed.
    pub(crate) fn forget(&self, unit: &str) {
        self.known().remove(unit);
    }

    /// Fuses the embedding of a unit's pictures with that of its name.
    ///
    /// # Errors
    /// [`PictureError`] for a name that the model cannot encode.
    pub(crate) fn add(&self, unit: &str, key: blake3::Hash, pictures: &Embedding) -> Result<Fused, PictureError> {
        let start = std::time::Instant::now();
        let name = self.encoder.encode_texts(&[unit])?;
        let encoded = start.elapsed();
        let name = name.into_iter().next().ok_or(EmbeddingError::Empty)?;
        let mut known = self.known();
        let fused = self.fused(pictures, &name)?;
        let own = UnitEmbedding { key, pictures: pictures.clone(), name, fused };
        known.insert(unit.to_owned(), own);
        if self.adapts {
            self.adapt(&mut known)?;
        }
        drop(known);
        Ok(Fused { encode_ms: encoded.as_secs_f64() * 1e3, fuse_ms: (start.elapsed() - encoded).as_secs_f64() * 1e3 })
    }

    /// An embedding with the cosines of the background.
    pub(crate) fn compared(&self, embedding: Embedding) -> Compared {
        // Embeddings of one model always compare.
        let background = self.background.iter().filter_map(|word| word.cosine(&embedding).ok()).collect();
        Compared { embedding, background }
    }

    /// The embedding of a text. `None` if it can't be encoded: then pictures have no say.
    pub(crate) fn text(&self, text: &str) -> Option<Embedding> {
        let encoded = self.encoder.encode_texts(&[text]);
        encoded.inspect_err(|error| tracing::warn!(%error, "pictures have no say")).ok()?.pop()
    }

    /// How near a text is to an embedding.
    pub(crate) fn near(&self, compared: &Compared, text: &Embedding) -> Option<Nearness> {
        // Embeddings of one model always compare.
        let cosine = compared.embedding.cosine(text).ok()?;
        Some(Nearness { cosine, share: self.encoder.share(cosine, &compared.background) })
    }

    /// The shares of a text, for a query.
    pub(crate) fn shares(&self, near: impl IntoIterator<Item = Option<Nearness>>) -> PictureShares {
        let units = near.into_iter().map(|near| near.map(|near| near.share)).collect();
        PictureShares { model: self.encoder.name().to_owned(), units }
    }

    /// The embedding of pictures and a name.
    fn fused(&self, pictures: &Embedding, name: &Embedding) -> Result<Compared, EmbeddingError> {
        let fused = match self.fusion {
            FusionChoice::Normalized => fuse(pictures, name, Fusion::Normalised)?,
            FusionChoice::Unnormalized => fuse(pictures, name, Fusion::Unnormalised)?,
            FusionChoice::Pictures => pictures.clone(),
            FusionChoice::Name => name.clone(),
        };
        Ok(self.compared(fused))
    }

    /// Fuses all units anew, with pictures that an adapter has moved. Each is moved by what the other units teach.
    fn adapt(&self, known: &mut HashMap<String, UnitEmbedding>) -> Result<(), EmbeddingError> {
        // A fixed order makes the same sums.
        let mut units: Vec<&mut UnitEmbedding> = known.values_mut().collect();
        units.sort_by(|a, b| a.key.as_bytes().cmp(b.key.as_bytes()));
        let moved = {
            let pictures: Vec<&Embedding> = units.iter().map(|unit| &unit.pictures).collect();
            let names: Vec<&Embedding> = units.iter().map(|unit| &unit.name).collect();
            adapted(&pictures, &names, RIDGE)?
        };
        for (unit, pictures) in units.into_iter().zip(&moved) {
            unit.fused = self.fused(pictures, &unit.name)?;
        }
        Ok(())
    }

    /// How near a text is to each of some units, in their order. `None` for a unit without an embedding.
    pub(crate) fn nearness(&self, units: &[String], text: &Embedding) -> Vec<Option<Nearness>> {
        let known = self.known();
        let near = |unit: &String| self.near(&known.get(unit)?.fused, text);
        units.iter().map(near).collect()
    }

    /// The cosines of a picture with the pictures of some units, in their order, whatever their names say. `None` for a unit
    /// without an embedding.
    pub(crate) fn picture_cosines(&self, units: &[String], picture: &Embedding) -> Vec<Option<f64>> {
        let known = self.known();
        let cosine = |unit: &String| known.get(unit)?.pictures.cosine(picture).ok().map(f64::from);
        units.iter().map(cosine).collect()
    }

    /// The embeddings for the units of a scene, for one query.
    pub(crate) fn of<'e>(&'e self, units: &'e [String]) -> SceneEmbeddings<'e> {
        SceneEmbeddings { embeddings: self, units, parts: std::cell::Cell::new(0) }
    }
}

/// Embeddings of some units, for one query.
pub(crate) struct SceneEmbeddings<'e> {
    embeddings: &'e UnitEmbeddings,
    units: &'e [String],
    parts: std::cell::Cell<usize>,
}

impl UnitPictures for SceneEmbeddings<'_> {
    fn shares(&self, text: &str) -> Option<PictureShares> {
        if self.embeddings.known().is_empty() || self.parts.get() == MAX_PARTS {
            return None;
        }
        self.parts.set(self.parts.get() + 1);
        let text = self.embeddings.text(text)?;
        Some(self.embeddings.shares(self.embeddings.nearness(self.units, &text)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn embeddings(fusion: FusionChoice) -> UnitEmbeddings {
        embeddings_that(fusion, false)
    }

    fn embeddings_that(fusion: FusionChoice, adapts: bool) -> UnitEmbeddings {
        UnitEmbeddings::new(PictureEncoder::tiny(1), fusion, adapts).unwrap()
    }

    #[test]
    fn pictures_and_names_become_one_embedding() {
        let units = ["sac".to_owned(), "body".to_owned()];
        let key = blake3::hash(b"a region");
        for (fusion, expected) in [
            (FusionChoice::Normalized, Some(Fusion::Normalised)),
            (FusionChoice::Unnormalized, Some(Fusion::Unnormalised)),
            (FusionChoice::Pictures, None),
            (FusionChoice::Name, None),
        ] {
            let embeddings = embeddings(fusion);
            let name = embeddings.encoder.encode_texts(&["sac"]).unwrap().remove(0);
            let pictures = embeddings.encoder.encode_texts(&["something else"]).unwrap().remove(0);
            assert!(embeddings.of(&units).shares("sac").is_none(), "no unit has an embedding");
            embeddings.add("sac", key, &pictures).unwrap();
            let known = embeddings.known().get("sac").unwrap().fused.embedding.clone();
            let fused = match (fusion, expected) {
                (_, Some(fusion)) => fuse(&pictures, &name, fusion).unwrap(),
                (FusionChoice::Pictures, None) => pictures,
                _ => name,
            };
            assert_eq!(known, fused, "{fusion:?}");
            let shares = embeddings.of(&units).shares("sac").unwrap();
            assert_eq!((shares.model.as_str(), shares.units.len(), shares.units[1]), ("clip-gelu", 2, None));
            assert!(shares.units[0].is_some_and(|share| (0.0..=1.0).contains(&share)));
        }
    }

    #[test]
    fn an_adapter_moves_pictures_by_the_other_units() {
        let embeddings = embeddings_that(FusionChoice::Pictures, true);
        let texts = ["a", "b", "c", "d"].map(|text| embeddings.encoder.encode_texts(&[text]).unwrap().remove(0));
        let fused = |unit: &str| embeddings.known().get(unit).unwrap().fused.embedding.clone();
        embeddings.add("sac", blake3::hash(b"1"), &texts[0]).unwrap();
        assert!(fused("sac").cosine(&texts[0]).unwrap() > 1.0 - 1e-6, "nothing to learn from");
        embeddings.add("body", blake3::hash(b"2"), &texts[1]).unwrap();
        let names = ["sac", "body"].map(|name| embeddings.encoder.encode_texts(&[name]).unwrap().remove(0));
        let expected = adapted(&[&texts[0], &texts[1]], &[&names[0], &names[1]], RIDGE).unwrap();
        for (unit, expected) in ["sac", "body"].into_iter().zip(&expected) {
            assert!(fused(unit).cosine(expected).unwrap() > 1.0 - 1e-6, "{unit}");
        }
    }

    #[test]
    fn a_variant_has_what_the_same_units_would_have() {
        let texts = ["a", "b", "c"].map(|text| PictureEncoder::tiny(1).encode_texts(&[text]).unwrap().remove(0));
        let units = ["sac", "body", "vein"].map(str::to_owned);
        let filled = |fusion, adapts| {
            let embeddings = embeddings_that(fusion, adapts);
            for (unit, pictures) in units.iter().zip(&texts) {
                embeddings.add(unit, blake3::hash(unit.as_bytes()), pictures).unwrap();
            }
            embeddings
        };
        let first = filled(FusionChoice::Pictures, false);
        let text = first.encoder().encode_texts(&["the swollen part"]).unwrap().remove(0);
        for fusion in [FusionChoice::Normalized, FusionChoice::Unnormalized, FusionChoice::Pictures, FusionChoice::Name]
        {
            for adapts in [false, true] {
                let (found, expected) = (first.variant(fusion, adapts).unwrap(), filled(fusion, adapts));
                let (found, expected) = (found.nearness(&units, &text), expected.nearness(&units, &text));
                assert_eq!(found, expected, "{fusion:?} {adapts}");
                assert!(found.iter().all(Option::is_some));
            }
        }
        let cosines = first.picture_cosines(&["vein".to_owned(), "skull".to_owned()], &texts[2]);
        assert!(cosines[0].is_some_and(|cosine| cosine > 1.0 - 1e-6) && cosines[1].is_none(), "{cosines:?}");
        // What is added later to one is not seen by the other.
        let later = first.variant(FusionChoice::Name, false).unwrap();
        later.forget("sac");
        assert!(first.embedded(&units).len() == 3 && later.embedded(&units).len() == 2);
    }

    #[test]
    fn units_come_and_go() {
        let embeddings = embeddings(FusionChoice::Name);
        let pictures = embeddings.encoder.encode_texts(&["a thing"]).unwrap().remove(0);
        let (key, other) = (blake3::hash(b"a region"), blake3::hash(b"another one"));
        let units = ["b", "a", "c"].map(str::to_owned);
        for unit in &units {
            embeddings.add(unit, key, &pictures).unwrap();
        }
        assert!(embeddings.has("a", &key) && !embeddings.has("a", &other) && !embeddings.has("d", &key));
        assert_eq!(embeddings.embedded(&units), units);
        embeddings.forget("b");
        embeddings.retain(&units[..2]);
        assert_eq!(embeddings.embedded(&units), ["a"]);
        let parts = embeddings.of(&units);
        let answered = (0..6).filter(|i| parts.shares(&format!("part {i}")).is_some()).count();
        assert_eq!(answered, MAX_PARTS);
    }
}
