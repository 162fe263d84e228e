//! A scene file with its units, without a session.

use std::cell::Cell;
use std::path::Path;
use std::sync::Arc;

use sg_edit::{EditState, PlacedScene, UnitRef};
use sg_formats::{LoadOptions, load};
use sg_input::print;
use sg_labeling::pictures::{PictureShares, UnitPictures};
use sg_scene::model::Scene;

use crate::embedder::{EmbeddingProblem, MAX_UNITS, Prepared, prepare};
use crate::measured_units::{MeasuredUnits, Units, labelled};
use crate::picture_encoder::{PictureEncoder, RegionEmbedding};
use crate::region_views::ViewOrder;
use crate::unit_embeddings::UnitEmbeddings;

/// A scene as its file has it.
pub(crate) struct OfflineScene {
    /// Its path, for a person.
    pub(crate) name: String,
    /// Its base units.
    pub(crate) units: Arc<Units>,
    placed: PlacedScene,
    state: EditState,
}

/// The embeddings of a unit's pictures.
pub(crate) struct EmbeddedUnit {
    pub(crate) name: String,
    pub(crate) key: blake3::Hash,
    /// One for each order of the views that was asked for.
    pub(crate) by_order: Vec<RegionEmbedding>,
}

impl OfflineScene {
    /// Opens a scene file, with its warnings on standard error.
    ///
    /// # Errors
    /// One line for a file that is no scene.
    pub(crate) fn open(path: &Path) -> Result<Self, String> {
        let loaded = load(path, &LoadOptions::default()).map_err(|e| e.to_string())?;
        for warning in &loaded.warnings {
            print::status(&format!("warning: {}: {warning}", path.display()));
        }
        Self::new(path.display().to_string(), loaded.scene)
    }

    /// A scene under a name for a person.
    ///
    /// # Errors
    /// One line if the embedded synonyms are damaged.
    pub(crate) fn new(name: String, scene: Scene) -> Result<Self, String> {
        let scene = Arc::new(scene);
        let state = EditState::of_scene(&scene, "", "");
        let placed = PlacedScene::new(scene);
        let units = MeasuredUnits::new(placed.clone()).of(&state).map_err(|e| e.to_string())?;
        Ok(Self { name, units, placed, state })
    }

    /// Embeds the pictures of each unit, by the views that are best in each of some orders. A unit that can't be embedded is left
    /// out, with a line on standard error. So are those beyond the limit of a session.
    pub(crate) fn embed(&self, encoder: &PictureEncoder, orders: &[ViewOrder]) -> Vec<EmbeddedUnit> {
        let units: Vec<(&str, UnitRef)> = labelled(&self.state).take(MAX_UNITS).collect();
        print::status(&format!("embedding {} units of {}", units.len(), self.name));
        let left_out = self.units.names.len().saturating_sub(units.len());
        if left_out > 0 {
            print::status(&format!("warning: {left_out} units are left out; at most {MAX_UNITS} are embedded"));
        }
        let embedded = units.into_iter().filter_map(|(name, unit)| {
            let made = self.embed_unit(name, unit, encoder, orders);
            made.inspect_err(|problem| self.warn_of(name, &problem.to_string())).ok()
        });
        embedded.collect()
    }

    fn embed_unit(
        &self,
        name: &str,
        unit: UnitRef,
        encoder: &PictureEncoder,
        orders: &[ViewOrder],
    ) -> Result<EmbeddedUnit, EmbeddingProblem> {
        let Prepared { alone, edge, key } = prepare(&self.placed, &self.state, &self.state.members(unit), encoder)?;
        let by_order = encoder.encode_region_by(orders, alone, edge)?;
        Ok(EmbeddedUnit { name: name.to_owned(), key, by_order })
    }

    /// Embeds each unit as a session does.
    pub(crate) fn embed_into(&self, embeddings: &UnitEmbeddings) {
        for unit in self.embed(embeddings.encoder(), &[ViewOrder::default()]) {
            let added = unit.by_order.first().map(|made| embeddings.add(&unit.name, unit.key, &made.embedding));
            if let Some(Err(problem)) = added {
                self.warn_of(&unit.name, &problem.to_string());
            }
        }
    }

    fn warn_of(&self, unit: &str, problem: &str) {
        print::status(&format!("warning: {}: {unit} has no embedding: {problem}", self.name));
    }
}

/// The embeddings of a scene's units, made when a text first asks for them: words often find a unit alone.
pub(crate) struct OfflinePictures<'s> {
    scene: &'s OfflineScene,
    embeddings: &'s UnitEmbeddings,
    is_embedded: Cell<bool>,
}

impl<'s> OfflinePictures<'s> {
    /// Of embeddings that have no unit yet.
    pub(crate) fn new(scene: &'s OfflineScene, embeddings: &'s UnitEmbeddings) -> Self {
        Self { scene, embeddings, is_embedded: Cell::new(false) }
    }
}

impl UnitPictures for OfflinePictures<'_> {
    fn shares(&self, text: &str) -> Option<PictureShares> {
        if !self.is_embedded.replace(true) {
            self.scene.embed_into(self.embeddings);
        }
        self.embeddings.of(&self.scene.units.names).shares(text)
    }
}

#[cfg(test)]
mod tests {
    use sg_scene::synthetic::test_scene;

    use super::*;
    use crate::picture_encoder::PictureError;
    use crate::region_views::RegionViewsError;
    use crate::unit_embeddings::FusionChoice;

    #[test]
    fn pictures_are_embedded_at_the_first_question() {
        let scene = OfflineScene::new("a scene".to_owned(), test_scene(&[("bone", 60), ("skin", 90)])).unwrap();
        let embeddings = UnitEmbeddings::new(PictureEncoder::tiny(1), FusionChoice::Normalized, false).unwrap();
        let pictures = OfflinePictures::new(&scene, &embeddings);
        assert!(embeddings.embedded(&scene.units.names).is_empty());
        let first = pictures.shares("the hard part").unwrap();
        assert!(first.units.len() == 2 && first.units.iter().all(Option::is_some), "{first:?}");
        assert_eq!(embeddings.embedded(&scene.units.names), ["bone", "skin"]);
        assert_eq!(pictures.shares("the hard part"), Some(first));
    }

    #[test]
    fn a_unit_without_a_visible_gaussian_is_left_out() {
        let mut file = test_scene(&[("bone", 60), ("ghost", 30)]);
        file.units[1].opacity = 0.0;
        let scene = OfflineScene::new("a scene".to_owned(), file).unwrap();
        let encoder = PictureEncoder::tiny(1);
        let orders = [ViewOrder::default(), ViewOrder::VisibleArea];
        let embedded = scene.embed(&encoder, &orders);
        let names: Vec<&str> = embedded.iter().map(|unit| unit.name.as_str()).collect();
        assert_eq!((names, embedded[0].by_order.len()), (vec!["bone"], 2));
        let ghost = scene.embed_unit("ghost", UnitRef::Base(1), &encoder, &orders);
        assert!(matches!(ghost, Err(EmbeddingProblem::Picture(PictureError::Views(RegionViewsError::Region(_))))));
    }
}
