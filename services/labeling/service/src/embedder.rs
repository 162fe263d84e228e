//! Embeds the units of a scene by their pictures, in the background. A label is usable at once; its embedding follows.

use std::sync::Arc;
use std::time::Duration;

use sg_edit::{EditError, EditState, PlacedScene, Replica, UnitRef};
use sg_proto::keys::{self, role};
use sg_proto::labeling::{self, EmbeddingStatus};
use sg_runtime::bus::{Bus, LivelinessChange};
use sg_runtime::context::Context;
use sg_runtime::scene_replica::SceneReplica;
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use supergaussian_labeling::embedding_cache::EmbeddingCache;
use tokio::sync::{mpsc, watch};

use crate::measured_units::{labelled, looks_alike};
use crate::picture_encoder::{PictureEncoder, PictureError, RegionEmbedding};
use crate::region_proposals::{RegionProposals, Regions};
use crate::region_views::RegionViewsError;
use crate::unit_embeddings::{Fused, UnitEmbeddings};

/// Most units that are embedded. Words alone speak for the others.
pub(crate) const MAX_UNITS: usize = 256;
/// Most Gaussians of a unit that is embedded: drawing more would take a minute.
const MAX_GAUSSIANS: usize = 1_000_000;
/// Time without a change of the scene after which units are embedded: a dragged slider changes a colour many times.
const SETTLED: Duration = Duration::from_millis(250);
/// The same time where a unit is new: nobody saves one in passing.
const SAVED: Duration = Duration::from_millis(20);
/// Time before each further try of a unit that could not be embedded.
const RETRIES: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(5)];
/// Most regions that are embedded.
const MAX_REGIONS: usize = 24;
/// Time that the regions may take to come.
const REGIONS_TIME: Duration = Duration::from_secs(10);

/// Which units have an embedding.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct EmbeddingProgress {
    /// Their names, in the order of the scene.
    pub(crate) embedded: Vec<String>,
    /// Number of units and regions whose embedding is still to come.
    pub(crate) pending: u32,
    /// Number of regions whose embedding is there.
    pub(crate) embedded_regions: u32,
}

/// What became of a unit.
#[derive(Debug, PartialEq, Eq)]
enum Embedded {
    /// Its embedding is there.
    Ready,
    /// It is not, and will not be before the unit changes.
    Failed,
    /// Some unit has changed.
    Superseded,
}

/// Why an embedding was not made.
#[derive(Debug, thiserror::Error)]
pub(crate) enum EmbeddingProblem {
    #[error(transparent)]
    Edit(#[from] EditError),
    #[error(transparent)]
    Picture(#[from] PictureError),
    #[error("it has {found} Gaussians; at most {MAX_GAUSSIANS} are drawn for an embedding")]
    TooLarge { found: usize },
    #[error("the work broke off")]
    BrokeOff,
}

impl EmbeddingProblem {
    fn is_change(&self) -> bool {
        matches!(self, Self::Picture(PictureError::Views(RegionViewsError::Superseded)))
    }

    /// Whether another try may help.
    fn is_transient(&self) -> bool {
        !matches!(self, Self::TooLarge { .. } | Self::Picture(PictureError::Views(RegionViewsError::Region(_))))
    }
}

/// The region of a unit, and the name of its embedding.
pub(crate) struct Prepared {
    pub(crate) alone: Scene,
    /// The longest edge of the scene.
    pub(crate) edge: f64,
    pub(crate) key: blake3::Hash,
}

/// Embeds units one after another.
pub(crate) struct Embedder {
    pub(crate) scene: SceneReplica<Replica>,
    pub(crate) placed: PlacedScene,
    pub(crate) embeddings: Arc<UnitEmbeddings>,
    /// Regions that nobody has named, which are embedded after the units.
    pub(crate) regions: Arc<RegionProposals>,
    /// Services that start and end.
    pub(crate) services: mpsc::Receiver<LivelinessChange>,
    pub(crate) cache: EmbeddingCache,
    pub(crate) progress: watch::Sender<EmbeddingProgress>,
    pub(crate) bus: Bus,
}

impl Embedder {
    /// Embeds the units of each revision once the scene has settled, until the scene's feed ends.
    pub(crate) async fn run(mut self) {
        loop {
            let state = Arc::clone(self.scene.newest().replica.state());
            let is_done = self.embed_units(&state).await;
            let is_done = is_done && self.embed_regions(&state).await;
            // Names, selection, light and viewpoint may change without an effect on the pictures.
            while is_done && has_same_units(&state, self.scene.newest().replica.state()) {
                tokio::select! {
                    changed = self.scene.changed() => {
                        if changed.is_none() {
                            return;
                        }
                    }
                    // A selection service that was away has regions now.
                    Some(change) = self.services.recv() => {
                        if change.alive && change.role == role::SELECTION {
                            break;
                        }
                    }
                }
            }
            loop {
                let is_new = has_new_unit(&state, self.scene.newest().replica.state());
                let pause = if is_new { SAVED } else { SETTLED };
                match tokio::time::timeout(pause, self.scene.changed()).await {
                    Ok(Some(_)) => {}
                    Ok(None) => return,
                    Err(_) => break,
                }
            }
        }
    }

    /// Embeds all units of a state. Returns false if one has changed meanwhile.
    async fn embed_units(&self, state: &Arc<EditState>) -> bool {
        let units: Vec<(String, UnitRef)> =
            labelled(state).take(MAX_UNITS).map(|(name, unit)| (name.to_owned(), unit)).collect();
        let names: Vec<String> = units.iter().map(|(name, _)| name.clone()).collect();
        self.embeddings.retain(&names);
        let mut pending = units.len() as u32;
        let publish = |pending| {
            let embedded = self.embeddings.embedded(&names);
            self.publish(|known| EmbeddingProgress { embedded, pending, ..known.clone() });
        };
        publish(pending);
        // Units that somebody saved come before those of the file, the newest first: they are asked for first.
        let (saved, base): (Vec<_>, Vec<_>) = units.iter().partition(|(_, u)| matches!(u, UnitRef::Editable(_)));
        for (name, unit) in saved.into_iter().rev().chain(base) {
            if self.embed(state, name, *unit).await == Embedded::Superseded {
                return false;
            }
            pending -= 1;
            publish(pending);
        }
        true
    }

    /// Publishes the progress, if it is other than before.
    fn publish(&self, of: impl FnOnce(&EmbeddingProgress) -> EmbeddingProgress) {
        self.progress.send_if_modified(|known| {
            let progress = of(known);
            let is_new = *known != progress;
            *known = progress;
            is_new
        });
    }

    /// Embeds the most prominent regions of a state. Returns false if a unit has changed meanwhile.
    async fn embed_regions(&self, state: &Arc<EditState>) -> bool {
        let context = Context::root().deadline_in(REGIONS_TIME);
        let Some(regions) = self.regions.of(state, &context).await else {
            self.publish(|known| EmbeddingProgress { embedded_regions: 0, ..known.clone() });
            return true;
        };
        let count = regions.masks().len().min(MAX_REGIONS);
        for at in 0..count {
            let pending = (count - at) as u32;
            let embedded_regions = regions.embedded() as u32;
            self.publish(|known| EmbeddingProgress { pending, embedded_regions, ..known.clone() });
            if regions.has_pictures(at) {
                continue;
            }
            match self.embed_region(state, &regions, at).await {
                Ok(()) => {}
                Err(problem) if problem.is_change() => return false,
                // Its look speaks for it still.
                Err(problem) => tracing::warn!(%problem, "a region could not be embedded"),
            }
        }
        let embedded_regions = regions.embedded() as u32;
        self.publish(|known| EmbeddingProgress { pending: 0, embedded_regions, ..known.clone() });
        true
    }

    async fn embed_region(
        &self,
        state: &Arc<EditState>,
        regions: &Arc<Regions>,
        at: usize,
    ) -> Result<(), EmbeddingProblem> {
        let Some(members) = regions.masks().get(at).cloned() else { return Ok(()) };
        let (placed, of, embeddings) = (self.placed.clone(), Arc::clone(state), Arc::clone(&self.embeddings));
        let prepared = blocking(move || prepare(&placed, &of, &members, embeddings.encoder())).await??;
        let (made, _) = self.pictures(state, prepared).await?;
        let (regions, embeddings) = (Arc::clone(regions), Arc::clone(&self.embeddings));
        blocking(move || regions.embed(at, &embeddings, made.embedding)).await
    }

    /// Embeds a unit, with further tries after a fault that may pass.
    async fn embed(&self, state: &Arc<EditState>, name: &str, unit: UnitRef) -> Embedded {
        let mut retries = RETRIES.iter();
        loop {
            let problem = match self.try_embed(state, name, unit).await {
                Ok(()) => return Embedded::Ready,
                Err(problem) => problem,
            };
            if problem.is_change() {
                self.report(state, name, EmbeddingStatus::Superseded, labeling::Embedding::default()).await;
                return Embedded::Superseded;
            }
            let Some(pause) = retries.next().filter(|_| problem.is_transient()) else {
                let reason = labeling::Embedding { problem: problem.to_string(), ..labeling::Embedding::default() };
                self.report(state, name, EmbeddingStatus::Failed, reason).await;
                return Embedded::Failed;
            };
            tokio::time::sleep(*pause).await;
        }
    }

    async fn try_embed(&self, state: &Arc<EditState>, name: &str, unit: UnitRef) -> Result<(), EmbeddingProblem> {
        let (placed, of, embeddings) = (self.placed.clone(), Arc::clone(state), Arc::clone(&self.embeddings));
        let prepared = blocking(move || prepare(&placed, &of, &of.members(unit), embeddings.encoder())).await??;
        if self.embeddings.has(name, &prepared.key) {
            return Ok(());
        }
        // What it looked like before says nothing of it now.
        self.embeddings.forget(name);
        self.report(state, name, EmbeddingStatus::Started, labeling::Embedding::default()).await;
        let key = prepared.key;
        let (made, stored) = self.pictures(state, prepared).await?;
        let (embeddings, unit_name, embedding) = (Arc::clone(&self.embeddings), name.to_owned(), made.embedding);
        let Fused { encode_ms, fuse_ms } = blocking(move || embeddings.add(&unit_name, key, &embedding)).await??;
        let reply = labeling::Embedding {
            views: made.views as u32,
            stored,
            render_ms: made.render_ms,
            encode_ms: made.encode_ms + encode_ms,
            fuse_ms,
            ..labeling::Embedding::default()
        };
        self.report(state, name, EmbeddingStatus::Ready, reply).await;
        Ok(())
    }

    /// The embedding of a region's pictures, and whether it was stored.
    async fn pictures(
        &self,
        state: &Arc<EditState>,
        prepared: Prepared,
    ) -> Result<(RegionEmbedding, bool), EmbeddingProblem> {
        let (cache, key, embeddings) = (self.cache.clone(), prepared.key, Arc::clone(&self.embeddings));
        let (newest, of) = (self.scene.receiver(), Arc::clone(state));
        let made = blocking(move || {
            if let Some((embedding, views)) = cache.load(&key) {
                return Ok::<_, PictureError>((
                    RegionEmbedding { embedding, views, render_ms: 0.0, encode_ms: 0.0 },
                    true,
                ));
            }
            let between = || {
                let is_same = has_same_units(&of, newest.borrow().replica.state());
                if is_same { Ok(()) } else { Err(RegionViewsError::Superseded) }
            };
            let made = embeddings.encoder().encode_region(prepared.alone, prepared.edge, &between)?;
            if let Err(error) = cache.store(&key, &(made.embedding.clone(), made.views)) {
                tracing::warn!(%error, "an embedding could not be stored; a restart makes it again");
            }
            Ok((made, false))
        });
        Ok(made.await??)
    }

    async fn report(&self, state: &EditState, unit: &str, status: EmbeddingStatus, rest: labeling::Embedding) {
        let event =
            labeling::Embedding { unit: unit.to_owned(), status: status.into(), revision: state.revision(), ..rest };
        if let Err(fault) = self.bus.publish(&keys::LABELING_EMBEDDING, &event, &Context::root()).await {
            tracing::warn!(%fault, "the progress of an embedding could not be published");
        }
    }
}

/// Runs work on a thread that may block.
async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, EmbeddingProblem> {
    tokio::task::spawn_blocking(work).await.map_err(|_| EmbeddingProblem::BrokeOff)
}

/// The region of a unit as a state has it.
///
/// # Errors
/// [`EmbeddingProblem`] for a unit that is too large, or whose Gaussians could not be collected.
pub(crate) fn prepare(
    placed: &PlacedScene,
    state: &EditState,
    members: &Mask,
    encoder: &PictureEncoder,
) -> Result<Prepared, EmbeddingProblem> {
    let placed = placed.of(state);
    let found = members.count();
    if found > MAX_GAUSSIANS {
        return Err(EmbeddingProblem::TooLarge { found });
    }
    let alone = state.edited_placed(&placed, members)?;
    let key = encoder.key(&alone);
    Ok(Prepared { alone, edge: placed.bounds.longest_edge(), key })
}

/// Whether two states have the same units under the same names, and all look the same.
fn has_same_units(a: &EditState, b: &EditState) -> bool {
    a.revision() == b.revision() || (labelled(a).eq(labelled(b)) && looks_alike(a, b))
}

/// Whether a later state has a unit whose name the former one does not have.
fn has_new_unit(former: &EditState, later: &EditState) -> bool {
    labelled(later).any(|(name, _)| labelled(former).all(|(known, _)| known != name))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use sg_proto::scene::command::Action;
    use sg_proto::scene::{Color, SaveUnit, Select, SetColor, Target};
    use sg_scene::synthetic::test_scene;

    use super::*;

    #[test]
    fn a_saved_unit_is_new_and_a_changed_one_is_not() {
        let scene = Arc::new(test_scene(&[("bone", 30), ("skin", 40)]));
        let opened = EditState::of_scene(&scene, "", "");
        let named = |name: &str| Some(Target { units: vec![name.to_owned()], ..Target::default() });
        let select = Action::Select(Select { target: named("bone"), ..Select::default() });
        let selected = opened.after(&scene, select).unwrap();
        let saved = selected.after(&scene, Action::SaveUnit(SaveUnit { name: "skull".into(), ..SaveUnit::default() }));
        let saved = saved.unwrap();
        let color = Some(Color { red: 0.9, green: 0.1, blue: 0.1 });
        let painted = saved.after(&scene, Action::SetColor(SetColor { target: named("skull"), color })).unwrap();
        assert!(!has_new_unit(&opened, &selected) && has_new_unit(&selected, &saved));
        assert!(!has_new_unit(&saved, &painted) && !has_new_unit(&saved, &selected));
    }
}
