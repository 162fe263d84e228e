//! Regions of whole Super-Gaussians that nobody has named: what a text may mean where no unit suits it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use sg_edit::wire::encode_mask;
use sg_edit::{EditState, PlacedScene};
use sg_encoders::Embedding;
use sg_formats::npy;
use sg_labeling::attributes::Attributes;
use sg_labeling::frame::Frame;
use sg_labeling::pictures::{PictureShares, UnitPictures};
use sg_labeling::proposals::proposals;
use sg_labeling::query::{Item, Outcome, QueryContext, Scene as Queryable, Why};
use sg_labeling::wordnet::WordNetError;
use sg_proto::limits::MAX_MESSAGE_BYTES;
use sg_proto::selection::{ClusterRegion, RegionsRequest};
use sg_proto::{keys, labeling};
use sg_raster::structure::labels_of;
use sg_runtime::blobs::{Blobs, StoredFile};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_scene::mask::Mask;

use crate::measured_units::{looks_alike, measure};
use crate::unit_embeddings::{Compared, UnitEmbeddings};

/// Most regions that a text is compared with.
const MAX_REGIONS: u32 = 128;
/// Most regions of one reply.
const MAX_PROPOSED: usize = 4;
/// Most bytes of the masks of one reply. The first mask of any scene fits.
const MAX_MASK_BYTES: usize = MAX_MESSAGE_BYTES - (64 << 10);
/// Time that the selection service has to answer.
const ASKING: Duration = Duration::from_secs(2);

/// The regions of a state.
pub(crate) struct Regions {
    of: EditState,
    masks: Vec<Mask>,
    sizes: Vec<usize>,
    looks: Vec<Option<Attributes>>,
    /// The embeddings of their pictures, those that are there.
    pictures: Mutex<Vec<Option<Compared>>>,
}

impl Regions {
    fn new(placed: &PlacedScene, state: &EditState, labels: &[u32], regions: &[ClusterRegion]) -> Self {
        let mut members: Vec<Vec<usize>> = Vec::new();
        for (gaussian, label) in labels.iter().enumerate() {
            let cluster = *label as usize;
            // Clusters have fewer ids than there are Gaussians, and the label of none is greater.
            if cluster >= labels.len() || state.deleted().get(gaussian) {
                continue;
            }
            if members.len() <= cluster {
                members.resize(cluster + 1, Vec::new());
            }
            members[cluster].push(gaussian);
        }
        let mask = |region: &ClusterRegion| {
            let mut mask = Mask::empty(labels.len());
            for gaussian in region.clusters.iter().filter_map(|c| members.get(*c as usize)).flatten() {
                mask.set(*gaussian, true);
            }
            mask
        };
        let masks: Vec<Mask> = regions.iter().take(MAX_REGIONS as usize).map(mask).filter(|m| !m.is_none()).collect();
        let scene = placed.of(state);
        Self {
            of: state.clone(),
            sizes: masks.iter().map(Mask::count).collect(),
            looks: masks.iter().map(|mask| measure(&scene, state, mask)).collect(),
            pictures: Mutex::new(vec![None; masks.len()]),
            masks,
        }
    }

    /// The members of each, the most prominent first.
    pub(crate) fn masks(&self) -> &[Mask] {
        &self.masks
    }

    /// Ignores poisoning: each change of the list is complete, even if its thread panics.
    fn pictures(&self) -> MutexGuard<'_, Vec<Option<Compared>>> {
        self.pictures.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the pictures of a region are embedded.
    pub(crate) fn has_pictures(&self, region: usize) -> bool {
        self.pictures().get(region).is_some_and(Option::is_some)
    }

    /// Number of regions whose pictures are embedded.
    pub(crate) fn embedded(&self) -> usize {
        self.pictures().iter().flatten().count()
    }

    /// Keeps the embedding of a region's pictures.
    pub(crate) fn embed(&self, region: usize, embeddings: &UnitEmbeddings, pictures: Embedding) {
        let compared = embeddings.compared(pictures);
        if let Some(own) = self.pictures().get_mut(region) {
            *own = Some(compared);
        }
    }

    /// The regions that a text may mean, the likeliest first.
    ///
    /// # Errors
    /// [`WordNetError`] if the embedded synonyms are damaged.
    pub(crate) fn find(
        &self,
        text: &str,
        frame: Frame,
        embeddings: Option<&UnitEmbeddings>,
    ) -> Result<Vec<labeling::ProposedRegion>, WordNetError> {
        let items = self.looks.iter().map(|look| Item { label: None, attributes: *look });
        let queryable = Queryable::new(items, frame)?;
        let pictures = embeddings.map(|embeddings| RegionPictures { regions: self, embeddings });
        let pictures = pictures.as_ref().map(|pictures| pictures as &dyn UnitPictures);
        let outcome = queryable.find_by(text, QueryContext { pictures, ..QueryContext::default() });
        let overlap = |a: usize, b: usize| match (self.masks.get(a), self.masks.get(b)) {
            (Some(a), Some(b)) => a.intersects(b),
            _ => false,
        };
        let found = proposals(outcome, &self.sizes, overlap, MAX_PROPOSED);
        let mut bytes = 0;
        let proposed = found.into_iter().map_while(|ranked| {
            let members = encode_mask(self.masks.get(ranked.item)?);
            bytes += members.bits.len();
            (bytes <= MAX_MASK_BYTES).then(|| labeling::ProposedRegion {
                gaussians: self.sizes.get(ranked.item).copied().unwrap_or_default() as u64,
                members: Some(members),
                score: ranked.score,
                explanation: ranked.explanation(),
            })
        });
        Ok(proposed.collect())
    }
}

/// The pictures of regions, for one query.
struct RegionPictures<'r> {
    regions: &'r Regions,
    embeddings: &'r UnitEmbeddings,
}

impl UnitPictures for RegionPictures<'_> {
    fn shares(&self, text: &str) -> Option<PictureShares> {
        if self.regions.embedded() == 0 {
            return None;
        }
        let text = self.embeddings.text(text)?;
        let pictures = self.regions.pictures();
        let near = pictures.iter().map(|compared| self.embeddings.near(compared.as_ref()?, &text));
        Some(self.embeddings.shares(near))
    }
}

/// Whether a region may be meant where a text means no unit for this reason. A name that nothing has is found by pictures alone.
pub(crate) fn may_be_region(outcome: &Outcome, has_pictures: bool) -> bool {
    let Outcome::NothingMatches { why, .. } = outcome else { return false };
    match why {
        Why::NoSuchLook { noun, .. } => noun.is_empty() || has_pictures,
        Why::NoSuchLabel(_) | Why::NoItems => has_pictures,
        Why::NoWords | Why::NoPictures | Why::AllExcluded | Why::NothingSelected | Why::NothingAlike(_) => false,
    }
}

/// The newest regions, as the selection service merges its Super-Gaussians.
pub(crate) struct RegionProposals {
    bus: Bus,
    blobs: Blobs,
    placed: PlacedScene,
    newest: tokio::sync::Mutex<Option<Arc<Regions>>>,
}

impl RegionProposals {
    pub(crate) fn new(bus: Bus, blobs: Blobs, placed: PlacedScene) -> Self {
        Self { bus, blobs, placed, newest: tokio::sync::Mutex::default() }
    }

    /// The regions of a state. Those of a state that looks the same are those of this one. `None` without an answer of the
    /// selection service: a session may have none.
    pub(crate) async fn of(&self, state: &Arc<EditState>, context: &Context) -> Option<Arc<Regions>> {
        let mut newest = self.newest.lock().await;
        if let Some(known) = newest.as_ref().filter(|known| looks_alike(&known.of, state)) {
            return Some(Arc::clone(known));
        }
        match self.read(state, context).await {
            Ok(regions) => {
                let regions = Arc::new(regions);
                *newest = Some(Arc::clone(&regions));
                Some(regions)
            }
            Err(fault) => {
                tracing::debug!(%fault, "no regions");
                None
            }
        }
    }

    async fn read(&self, state: &Arc<EditState>, context: &Context) -> Result<Regions, Fault> {
        let asking = context.next().within(ASKING.min(context.remaining()));
        let request = RegionsRequest { count: MAX_REGIONS };
        let (reply, sender) = self.bus.ask_identified(&keys::SELECTION_REGIONS, &request, &asking).await?;
        let stored = StoredFile { path: &reply.labels_path, hash: &reply.labels_hash, sender: sender.as_ref() };
        let path = self.blobs.fetch(&self.bus, &keys::SELECTION_CONTENT, stored, &context.next()).await?;
        tokio::task::block_in_place(|| {
            let labels = npy::read_labels(&path).map_err(|e| Fault::internal(e.to_string()))?;
            // The selection service may follow the scene a little later.
            let labels = labels_of(labels, state.count()).map_err(|e| Fault::unavailable(e.to_string()))?;
            Ok(Regions::new(&self.placed, state, &labels, &reply.regions))
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sg_edit::UnitRef;
    use sg_scene::synthetic::test_scene;

    use super::*;
    use crate::picture_encoder::PictureEncoder;
    use crate::unit_embeddings::FusionChoice;

    fn region(clusters: &[u32]) -> ClusterRegion {
        ClusterRegion { clusters: clusters.to_vec(), ..ClusterRegion::default() }
    }

    /// A unit of four clusters of 100 Gaussians. The second and third are red, the others grey.
    fn striped() -> (PlacedScene, Arc<EditState>, Vec<u32>) {
        let mut scene = test_scene(&[("vase", 400)]);
        let unit = &mut scene.units[0];
        unit.palette = Vec3::splat(0.5);
        let shading = unit.gaussians.shading.as_mut().unwrap();
        for (i, offset) in shading.offset_color.iter_mut().enumerate() {
            *offset = if (100..300).contains(&i) { Vec3::new(0.4, -0.45, -0.45) } else { Vec3::ZERO };
        }
        let scene = Arc::new(scene);
        let state = Arc::new(EditState::of_scene(&scene, "", ""));
        (PlacedScene::new(scene), state, (0..400).map(|i| i / 100).collect())
    }

    #[test]
    fn a_region_is_proposed_by_its_look() {
        let (placed, state, labels) = striped();
        let all = [region(&[1, 2]), region(&[1]), region(&[0, 3]), region(&[7])];
        let regions = Regions::new(&placed, &state, &labels, &all);
        assert_eq!(regions.sizes, [200, 100, 200], "the cluster of nobody is no region");
        let found = regions.find("the red part", Frame::XYZ, None).unwrap();
        assert_eq!(found.iter().map(|region| region.gaussians).collect::<Vec<_>>(), [200]);
        assert!(found[0].explanation.contains("red") && found[0].score > 0.5, "{found:?}");
        let members = sg_edit::wire::decode_mask(found[0].members.as_ref().unwrap(), 400, "members").unwrap();
        assert_eq!(members.ones().collect::<Vec<_>>(), (100..300).collect::<Vec<_>>());
        for absent in ["the blue part", "the handle"] {
            assert!(regions.find(absent, Frame::XYZ, None).unwrap().is_empty(), "{absent}");
        }
    }

    #[test]
    fn deleted_gaussians_belong_to_no_region() {
        let (placed, state, labels) = striped();
        let mut selected = Mask::empty(400);
        selected.select_range(100..150);
        let select = sg_proto::scene::CommitSelection { mask: Some(encode_mask(&selected)), ..Default::default() };
        let delete = sg_proto::scene::DeleteGaussians {
            target: Some(sg_proto::scene::Target { selection: true, ..Default::default() }),
        };
        let selected = state.after(placed.file(), sg_proto::scene::command::Action::CommitSelection(select)).unwrap();
        let gone = selected.after(placed.file(), sg_proto::scene::command::Action::DeleteGaussians(delete)).unwrap();
        let regions = Regions::new(&placed, &gone, &labels, &[region(&[1, 2])]);
        assert_eq!(regions.sizes, [150]);
        assert!(!looks_alike(&state, &gone));
    }

    #[test]
    fn pictures_lead_to_a_region_where_they_are_embedded() {
        let (placed, state, labels) = striped();
        let regions = Regions::new(&placed, &state, &labels, &[region(&[1, 2]), region(&[0, 3])]);
        let embeddings = UnitEmbeddings::new(PictureEncoder::tiny(1), FusionChoice::default(), false).unwrap();
        let find = || regions.find("the handle", Frame::XYZ, Some(&embeddings)).unwrap();
        assert!(find().is_empty() && regions.embedded() == 0);
        // The second region's pictures are what the text says.
        let handle = embeddings.encoder().encode_texts(&["handle"]).unwrap().remove(0);
        regions.embed(1, &embeddings, handle);
        assert!(regions.has_pictures(1) && !regions.has_pictures(0) && regions.embedded() == 1);
        let share = RegionPictures { regions: &regions, embeddings: &embeddings }.shares("handle").unwrap();
        assert_eq!(share.units[0], None);
        // Random weights set no distance between texts: the share decides.
        let is_likely = share.units[1].is_some_and(|share| share >= 0.5);
        assert_eq!(find().len(), usize::from(is_likely), "{share:?}");
    }

    #[test]
    fn regions_are_asked_for_where_they_may_help() {
        let (placed, state, _) = striped();
        let look = measure(&placed.of(&state), &state, &state.members(UnitRef::Base(0)));
        let units = Queryable::new([Item { label: Some("vase".into()), attributes: look }], Frame::XYZ).unwrap();
        for (text, without, with) in [
            ("the blue part", true, true),
            ("the handle", false, true),
            ("the blue vase", false, true),
            ("the vase", false, false),
            ("everything but the vase", false, false),
            ("???", false, false),
        ] {
            let outcome = units.find(text);
            assert_eq!((may_be_region(&outcome, false), may_be_region(&outcome, true)), (without, with), "{text}");
        }
    }
}
