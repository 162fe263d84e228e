//! The editable state of a scene. Masks are shared, so that a copy is cheap.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use glam::Vec3;
use sg_proto::prost::Message as _;
use sg_proto::scene::SelectionStep;

use sg_reclassify::VolumeOfScene;
use sg_scene::appearance::{Appearance, BaseAppearance, PixelFilter, ShadingTerm, UnitAppearance};
use sg_scene::camera::Light;
use sg_scene::framing::initial_view;
use sg_scene::mask::Mask;
use sg_scene::model::{Scene, SceneBox};
use sg_scene::orientation::Axis;
use sg_scene::tone::Tone;
use sg_scene::view::View;
use sg_volume::TransferFunction;

use super::duplicates::Duplicate;
use super::placement::Placement;

/// A base unit as edits see it.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseUnitState {
    /// Name, unique among base and editable units.
    pub name: String,
    /// Scene-wide index of its first Gaussian.
    pub first: usize,
    /// Number of its Gaussians.
    pub count: usize,
    /// Palette colour, RGB 0 to 1.
    pub palette: Vec3,
    /// Factor on the opacity, at least 0.
    pub opacity: f32,
    /// Whether it is drawn.
    pub visible: bool,
    /// Number of its Gaussians that are deleted; `count` includes them.
    pub deleted: usize,
    /// Whether edits of its Gaussians are refused.
    pub locked: bool,
    /// Change of its colours.
    pub tone: Tone,
    /// Whether its Gaussians are duplicates, which are not in the file. Such a unit can be renamed.
    pub duplicated: bool,
}

impl BaseUnitState {
    /// Scene-wide indices of its Gaussians, deleted ones too.
    #[must_use]
    pub fn range(&self) -> Range<usize> {
        self.first..self.first + self.count
    }

    /// Number of its Gaussians without the deleted ones.
    #[must_use]
    pub fn existing(&self) -> usize {
        self.count.saturating_sub(self.deleted)
    }
}

/// An editable unit: members and how they look.
#[derive(Debug, Clone, PartialEq)]
pub struct Unit {
    /// Id, never reused within a scene; units with greater ids lie over those with lesser.
    pub id: u64,
    /// Name, unique among base and editable units.
    pub name: String,
    /// Its Gaussians, without deleted ones.
    pub mask: Arc<Mask>,
    /// Its deleted Gaussians, to come back with them; `None` for none.
    pub deleted: Option<Arc<Mask>>,
    /// Colour that replaces the diffuse colour of its members.
    pub color: Option<Vec3>,
    /// Factor on the opacity of its members, at least 0.
    pub opacity: f32,
    /// Whether its members are drawn.
    pub visible: bool,
    /// Created by a command on unnamed Gaussians, not saved by name.
    pub derived: bool,
    /// Whether edits of its Gaussians are refused.
    pub locked: bool,
    /// Change of the colours of its members.
    pub tone: Tone,
}

impl Unit {
    /// Whether it changes nothing of how its members look.
    #[must_use]
    pub fn is_neutral(&self) -> bool {
        self.color.is_none() && self.opacity == 1.0 && self.visible && self.tone.is_neutral()
    }
}

/// A kept viewpoint.
#[derive(Debug, Clone, PartialEq)]
pub struct KeptView {
    /// Name, unique among kept viewpoints in any capitals.
    pub name: String,
    /// The viewpoint.
    pub view: View,
}

/// The selected Gaussians and the way they were selected.
#[derive(Debug, Clone, PartialEq)]
pub struct Selection {
    mask: Arc<Mask>,
    steps: Arc<[SelectionStep]>,
    hash: String,
}

impl Selection {
    /// A selection and its steps, oldest first; no steps for a selection without a brush.
    #[must_use]
    pub fn new(mask: Arc<Mask>, steps: Arc<[SelectionStep]>) -> Self {
        let hash = mask_hash(&mask);
        Self { mask, steps, hash }
    }

    /// The selected Gaussians.
    #[must_use]
    pub fn mask(&self) -> &Arc<Mask> {
        &self.mask
    }

    /// The steps it was made in, oldest first.
    #[must_use]
    pub fn steps(&self) -> &Arc<[SelectionStep]> {
        &self.steps
    }

    /// At most how many bytes its mask and steps take, as if nothing were shared.
    pub(crate) fn bytes(&self) -> usize {
        let of = |step: &SelectionStep| 64 + step.encoded_len();
        self.mask.len().div_ceil(8) + self.steps.iter().map(of).sum::<usize>()
    }

    /// [`mask_hash`] of its mask.
    #[must_use]
    pub fn hash(&self) -> &str {
        &self.hash
    }
}

/// BLAKE3 of a mask's length (u64, little endian) and packed bits, hexadecimal. It names a selection on the bus.
#[must_use]
pub fn mask_hash(mask: &Mask) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&(mask.len() as u64).to_le_bytes());
    hasher.update(&mask.to_bytes());
    hasher.finalize().to_hex().to_string()
}

/// The identity of the geometry of a scene's file; it never changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// File the Gaussians are read from.
    pub path: String,
    /// BLAKE3 of the columns, hexadecimal ([`Scene::content_hash`]).
    pub hash: String,
    /// Number of Gaussians in the file.
    pub count: usize,
    /// The stored box that strokes are normalized by.
    pub bounds: SceneBox,
    /// The volume behind it, where the Gaussians keep its values.
    pub volume: Option<VolumeOfScene>,
}

/// Everything that edits change, at one revision.
#[derive(Debug, Clone, PartialEq)]
pub struct EditState {
    pub(crate) revision: u64,
    pub(crate) geometry: Arc<Geometry>,
    pub(crate) base: Vec<BaseUnitState>,
    pub(crate) units: BTreeMap<u64, Unit>,
    pub(crate) selection: Selection,
    pub(crate) deleted: Arc<Mask>,
    pub(crate) duplicates: Arc<[Duplicate]>,
    pub(crate) placements: Arc<[Placement]>,
    pub(crate) transfer_function: Option<Arc<TransferFunction>>,
    pub(crate) light: Light,
    pub(crate) background: Vec3,
    pub(crate) view: View,
    pub(crate) kept_views: Arc<[KeptView]>,
    pub(crate) up: Option<Axis>,
    pub(crate) term: ShadingTerm,
    pub(crate) focus: Vec<String>,
}

/// A unit of either kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UnitRef {
    /// Index of a base unit in scene order.
    Base(usize),
    /// Id of an editable unit.
    Editable(u64),
}

impl EditState {
    /// The state of an opened scene at revision 0: appearance of the file, empty selection, view from the front.
    #[must_use]
    pub fn of_scene(scene: &Scene, path: impl Into<String>, hash: impl Into<String>) -> Self {
        let look = Appearance::of(scene);
        let base = scene.units.iter().zip(&look.base).map(|(unit, look)| BaseUnitState {
            name: unit.name.clone(),
            first: unit.first,
            count: unit.gaussians.len(),
            palette: look.palette,
            opacity: look.opacity,
            visible: look.visible,
            deleted: 0,
            locked: false,
            tone: Tone::NEUTRAL,
            duplicated: false,
        });
        let (count, bounds) = (scene.len(), scene.bounds);
        let geometry = Geometry { path: path.into(), hash: hash.into(), count, bounds, volume: None };
        Self {
            revision: 0,
            base: base.collect(),
            units: BTreeMap::new(),
            selection: Selection::new(Arc::new(Mask::empty(scene.len())), Arc::new([])),
            deleted: Arc::new(Mask::empty(scene.len())),
            duplicates: Arc::new([]),
            placements: Arc::new([]),
            transfer_function: None,
            light: look.light,
            background: look.background,
            view: initial_view(scene),
            kept_views: Arc::new([]),
            up: None,
            term: look.term,
            focus: Vec::new(),
            geometry: Arc::new(geometry),
        }
    }

    /// Number of accepted changes behind this state.
    #[must_use]
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The same state with the volume behind the scene's file.
    #[must_use]
    pub fn with_volume(mut self, volume: Option<VolumeOfScene>) -> Self {
        self.geometry = Arc::new(Geometry { volume, ..Geometry::clone(&self.geometry) });
        self
    }

    /// The same state over the geometry of another. The files of that geometry may have moved since.
    #[must_use]
    pub fn with_geometry_of(mut self, other: &Self) -> Self {
        self.geometry = Arc::clone(&other.geometry);
        self
    }

    /// The identity of the geometry.
    #[must_use]
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Number of Gaussians of the file and of copies, deleted ones too: the length of every mask.
    #[must_use]
    pub fn count(&self) -> usize {
        self.duplicates.last().map_or(self.geometry.count, |last| last.range().end)
    }

    /// Base units in scene order.
    #[must_use]
    pub fn base_units(&self) -> &[BaseUnitState] {
        &self.base
    }

    /// Editable units, oldest first, derived ones among them.
    pub fn units(&self) -> impl Iterator<Item = &Unit> {
        self.units.values()
    }

    /// The current selection.
    #[must_use]
    pub fn selection(&self) -> &Selection {
        &self.selection
    }

    /// The transfer function in place of the file's; `None` for that of the file.
    #[must_use]
    pub fn transfer_function(&self) -> Option<&Arc<TransferFunction>> {
        self.transfer_function.as_ref()
    }

    /// Whether both states have the same transfer function. One that is the same allocation is not read.
    pub(crate) fn has_function_of(&self, other: &Self) -> bool {
        match (&self.transfer_function, &other.transfer_function) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b) || a == b,
            (a, b) => a.is_none() && b.is_none(),
        }
    }

    /// The light.
    #[must_use]
    pub fn light(&self) -> Light {
        self.light
    }

    /// Background colour, RGB 0 to 1.
    #[must_use]
    pub fn background(&self) -> Vec3 {
        self.background
    }

    /// The shared viewpoint.
    #[must_use]
    pub fn view(&self) -> View {
        self.view
    }

    /// The direction that somebody chose to be up; `None` for the file's own.
    #[must_use]
    pub fn up(&self) -> Option<Axis> {
        self.up
    }

    /// The shown part of the shading.
    #[must_use]
    pub fn term(&self) -> ShadingTerm {
        self.term
    }

    /// Names of the units that the last command addressed.
    #[must_use]
    pub fn focus(&self) -> &[String] {
        &self.focus
    }

    /// The Gaussians of a unit, without deleted ones.
    #[must_use]
    pub fn members(&self, unit: UnitRef) -> Arc<Mask> {
        let mut mask = Mask::empty(self.count());
        match unit {
            UnitRef::Base(i) => {
                if let Some(base) = self.base.get(i) {
                    mask.select_range(base.range());
                    mask.subtract(&self.deleted);
                }
            }
            UnitRef::Editable(id) => {
                if let Some(unit) = self.units.get(&id) {
                    return Arc::clone(&unit.mask);
                }
            }
        }
        Arc::new(mask)
    }

    /// The look that a renderer draws, without an overlay. Editable units that change nothing are left out. The first units are
    /// base units of which the tone is changed. The last unit hides the deleted Gaussians.
    #[must_use]
    pub fn appearance(&self) -> Appearance {
        let base = self.base.iter().map(|b| BaseAppearance {
            palette: b.palette,
            opacity: b.opacity,
            visible: b.visible,
            multipliers: [1.0; 4],
        });
        let toned = self.base.iter().enumerate().filter(|(_, b)| !b.tone.is_neutral()).map(|(i, b)| UnitAppearance {
            mask: self.members(UnitRef::Base(i)),
            color: None,
            opacity: 1.0,
            visible: true,
            tone: b.tone,
        });
        let units = self.units.values().filter(|u| !u.is_neutral()).map(|u| UnitAppearance {
            mask: Arc::clone(&u.mask),
            color: u.color,
            opacity: u.opacity,
            visible: u.visible,
            tone: u.tone,
        });
        let deleted = (!self.deleted.is_none()).then(|| UnitAppearance {
            mask: Arc::clone(&self.deleted),
            color: None,
            opacity: 1.0,
            visible: false,
            tone: Tone::NEUTRAL,
        });
        Appearance {
            base: base.collect(),
            units: toned.chain(units).chain(deleted).collect(),
            overlay: None,
            light: self.light,
            background: self.background,
            term: self.term,
            clips: Vec::new(),
            colors: None,
            occlusion: None,
            filter: PixelFilter::FromFile,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_scene::synthetic::test_scene;

    #[test]
    fn an_opened_scene_looks_as_its_file_says() {
        let scene = test_scene(&[("bone", 5), ("skin", 7)]);
        let state = EditState::of_scene(&scene, "scene.toml", "hash");
        assert_eq!(state.appearance(), Appearance::of(&scene));
        assert_eq!((state.revision(), state.count(), state.selection().mask().count()), (0, 12, 0));
        assert_eq!(state.members(UnitRef::Base(1)).ones().collect::<Vec<_>>(), (5..12).collect::<Vec<_>>());
        assert_eq!(state.view().check(), Ok(()));
        assert!(state.view().eye.y < scene.bounds.min.y, "seen from the front");
    }

    #[test]
    fn the_hash_of_a_selection_is_over_length_and_bits() {
        let bytes = [3_u64.to_le_bytes().as_slice(), &[0b101]].concat();
        assert_eq!(mask_hash(&Mask::from_fn(3, |i| i != 1)), blake3::hash(&bytes).to_hex().to_string());
        assert_ne!(mask_hash(&Mask::empty(3)), mask_hash(&Mask::empty(4)));
    }
}
