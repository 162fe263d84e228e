//! The units of a scene that a text can mean, with their measured looks.

use std::sync::Arc;

use glam::Vec3;
use sg_edit::{EditState, PlacedScene, UnitRef};
use sg_labeling::attributes::{Attributes, Gaussian};
use sg_labeling::frame::Frame;
use sg_labeling::query::{Item, Scene as Queryable};
use sg_labeling::wordnet::WordNetError;
use sg_scene::mask::Mask;
use sg_scene::model::{BaseUnit, Scene};

/// Most Gaussians of a unit that are measured, evenly in the order of the scene. Means of more would hardly differ.
const SAMPLES: usize = 16_384;

/// The units of one revision.
pub(crate) struct Units {
    /// Their names, in the order of the items.
    pub(crate) names: Vec<String>,
    /// An index of the names and of the measured looks. Words such as "left" are those of the shared view.
    pub(crate) queryable: Queryable,
    /// The revision.
    pub(crate) revision: u64,
}

/// The looks of the units of a state.
struct Measured {
    of: EditState,
    looks: Vec<(UnitRef, Option<Attributes>)>,
}

/// Measures units, and keeps what the next revision has as well.
pub(crate) struct MeasuredUnits {
    scene: PlacedScene,
    measured: Option<Measured>,
    newest: Option<Arc<Units>>,
}

impl MeasuredUnits {
    /// The units of a scene file.
    pub(crate) fn new(scene: PlacedScene) -> Self {
        Self { scene, measured: None, newest: None }
    }

    /// Base units and saved units of a state. The same revision is measured once. So are looks that no edit has changed since.
    ///
    /// # Errors
    /// [`WordNetError`] if the embedded synonyms are damaged.
    pub(crate) fn of(&mut self, state: &EditState) -> Result<Arc<Units>, WordNetError> {
        if let Some(newest) = self.newest.as_ref().filter(|units| units.revision == state.revision()) {
            return Ok(Arc::clone(newest));
        }
        let (refs, names): (Vec<UnitRef>, Vec<String>) =
            labelled(state).map(|(name, unit)| (unit, name.to_owned())).unzip();
        let attributes = self.attributes(state, &refs);
        let frame = frame_of(state);
        let items = names.iter().zip(attributes);
        let items = items.map(|(name, attributes)| Item { label: Some(name.clone()), attributes });
        let queryable = Queryable::new(items, frame)?.with_covered(covered(state, &refs));
        let units = Arc::new(Units { names, queryable, revision: state.revision() });
        self.newest = Some(Arc::clone(&units));
        Ok(units)
    }

    /// The look of any Gaussians.
    pub(crate) fn look_of(&self, state: &EditState, members: &Mask) -> Option<Attributes> {
        measure(&self.scene.of(state), state, members)
    }

    fn attributes(&mut self, state: &EditState, refs: &[UnitRef]) -> Vec<Option<Attributes>> {
        let known = self.measured.take().filter(|known| looks_alike(&known.of, state));
        let placed = self.scene.of(state);
        let looks: Vec<(UnitRef, Option<Attributes>)> = refs
            .iter()
            .map(|unit| {
                let known = known.iter().flat_map(|known| &known.looks).find(|(of, _)| of == unit);
                let newly = || measure(&placed, state, &state.members(*unit));
                let attributes = known.map_or_else(newly, |(_, attributes)| *attributes);
                (*unit, attributes)
            })
            .collect();
        let attributes = looks.iter().map(|(_, attributes)| *attributes).collect();
        self.measured = Some(Measured { of: state.clone(), looks });
        attributes
    }
}

/// For each unit whether saved units have all of its Gaussians, if it is a base unit.
fn covered(state: &EditState, refs: &[UnitRef]) -> Vec<bool> {
    let mut saved: Option<Mask> = None;
    for unit in state.units().filter(|unit| !unit.derived) {
        match &mut saved {
            Some(saved) => saved.union_with(&unit.mask),
            None => saved = Some(Mask::clone(&unit.mask)),
        }
    }
    let is_covered = |unit: &UnitRef| {
        let saved = saved.as_ref().filter(|_| matches!(unit, UnitRef::Base(_)));
        saved.is_some_and(|saved| state.members(*unit).is_subset_of(saved))
    };
    refs.iter().map(is_covered).collect()
}

/// The frame of words such as "left": that of the shared view.
pub(crate) fn frame_of(state: &EditState) -> Frame {
    Frame::of_view(&state.view()).unwrap_or(Frame::XYZ)
}

/// Names of the units that a text can mean, in scene order: base units that still have Gaussians, then saved units.
pub(crate) fn labelled(state: &EditState) -> impl Iterator<Item = (&str, UnitRef)> {
    let base = state.base_units().iter().enumerate().filter(|(_, base)| base.existing() > 0);
    let base = base.map(|(at, base)| (base.name.as_str(), UnitRef::Base(at)));
    base.chain(state.units().filter(|u| !u.derived).map(|u| (u.name.as_str(), UnitRef::Editable(u.id))))
}

/// Whether all units that two states have look the same in both. Names, selection, light, background and viewpoint may differ. A
/// unit that only one of them has may not change how others look.
pub(crate) fn looks_alike(a: &EditState, b: &EditState) -> bool {
    let same_base = a.base_units().len() == b.base_units().len()
        && a.base_units().iter().zip(b.base_units()).all(|(a, b)| {
            (a.palette, a.opacity, a.tone, a.first, a.count) == (b.palette, b.opacity, b.tone, b.first, b.count)
        });
    let same_mask = |a: &Arc<Mask>, b: &Arc<Mask>| Arc::ptr_eq(a, b) || a == b;
    // A merge or another change of members keeps the id of a unit.
    let same_members = b.units().all(|unit| {
        let former = a.units().find(|former| former.id == unit.id);
        former.is_none_or(|former| same_mask(&former.mask, &unit.mask))
    });
    let effects = |state: &EditState| -> Vec<_> {
        let effective = state.units().filter(|unit| !unit.is_neutral());
        effective.map(|unit| (unit.id, unit.color, unit.opacity, unit.tone)).collect()
    };
    same_base && same_members && effects(a) == effects(b) && a.has_scene_of(b) && same_mask(a.deleted(), b.deleted())
}

/// The look of some Gaussians of a state, of which `scene` is the placed scene. Hidden ones count. `None` for Gaussians that
/// are not finite or transparent all of them.
pub(crate) fn measure(scene: &Scene, state: &EditState, members: &Mask) -> Option<Attributes> {
    let count = members.count();
    let mut sampled = Mask::empty(members.len());
    for i in members.samples(SAMPLES) {
        sampled.set(i, true);
    }
    let edited = state.edited_placed(scene, &sampled);
    let edited = edited.inspect_err(|error| tracing::warn!(%error, "a unit has no measured look")).ok()?;
    let gaussians = edited.units.iter().flat_map(|unit| (0..unit.gaussians.len()).map(move |i| displayed(unit, i)));
    let attributes = Attributes::of(gaussians).ok()?;
    let share = count as f64 / sampled.count().max(1) as f64;
    Some(Attributes { count: (attributes.count as f64 * share).round() as usize, ..attributes })
}

/// One Gaussian without light.
fn displayed(unit: &BaseUnit, i: usize) -> Gaussian {
    let gaussians = &unit.gaussians;
    let stretch = unit.transform.determinant().abs().cbrt();
    Gaussian {
        position: unit.transform.transform_point3(gaussians.position[i].as_dvec3()),
        color: unit.unlit_color(i).as_vec3().clamp(Vec3::ZERO, Vec3::ONE).to_array(),
        opacity: (gaussians.opacity(i) * unit.opacity).min(1.0),
        deviation: stretch * (f64::from(gaussians.log_scale[i].element_sum()) / 3.0).exp(),
        area: stretch * stretch * gaussians.mean_area(i),
    }
}

#[cfg(test)]
mod tests {
    use sg_proto::scene::command::Action;
    use sg_proto::scene::{
        Color, DeleteGaussians, RenameUnit, SaveUnit, Select, SetColor, Target, TransformGaussians, Vector,
    };
    use sg_scene::synthetic::test_scene;

    use super::*;

    fn named(name: &str) -> Option<Target> {
        Some(Target { units: vec![name.to_owned()], ..Target::default() })
    }

    fn red(name: &str) -> Action {
        let color = Some(Color { red: 0.9, green: 0.1, blue: 0.1 });
        Action::SetColor(SetColor { target: named(name), color })
    }

    #[test]
    fn looks_follow_the_edits_that_change_them() {
        let scene = Arc::new(test_scene(&[("bone", 300), ("skin", 40_000)]));
        let opened = EditState::of_scene(&scene, "", "");
        let mut measured = MeasuredUnits::new(PlacedScene::new(Arc::clone(&scene)));
        let first = measured.of(&opened).unwrap();
        assert_eq!(first.names, ["bone", "skin"]);
        let look = |units: &Units, at: usize| *units.queryable.looks().of(at).unwrap();
        assert_eq!((look(&first, 0).count, look(&first, 1).count), (300, 40_000));
        assert!(Arc::ptr_eq(&first, &measured.of(&opened).unwrap()));

        let painted = opened.after(&scene, red("bone")).unwrap();
        let color = look(&measured.of(&painted).unwrap(), 0).color;
        assert!(color[0] > 0.5 && color[1] < 0.4, "{color:?}");
        let edges = scene.bounds.longest_edge();
        let shift = Some(Vector { x: 10.0 * edges, y: 0.0, z: 0.0 });
        let action = TransformGaussians { target: named("skin"), shift, ..TransformGaussians::default() };
        let moved = painted.after(&scene, Action::TransformGaussians(action)).unwrap();
        let units = measured.of(&moved).unwrap();
        let by = look(&units, 1).center.x - look(&first, 1).center.x;
        assert!((by - 10.0 * edges).abs() < 1e-3 * edges, "{by}");
        let back = measured.of(&opened).unwrap();
        assert_eq!([0, 1].map(|at| look(&back, at)), [0, 1].map(|at| look(&first, at)));
        let gone = opened.after(&scene, Action::DeleteGaussians(DeleteGaussians { target: named("bone") })).unwrap();
        assert_eq!(measured.of(&gone).unwrap().names, ["skin"]);
    }

    #[test]
    fn a_name_alone_changes_no_look() {
        let scene = Arc::new(test_scene(&[("bone", 300), ("skin", 400)]));
        let opened = EditState::of_scene(&scene, "", "");
        let select = Select { target: named("bone"), ..Select::default() };
        let selected = opened.after(&scene, Action::Select(select)).unwrap();
        let save = SaveUnit { name: "skul".into(), ..SaveUnit::default() };
        let saved = selected.after(&scene, Action::SaveUnit(save)).unwrap();
        let rename = RenameUnit { name: "skul".into(), new_name: "skull".into() };
        let renamed = saved.after(&scene, Action::RenameUnit(rename)).unwrap();
        assert!(looks_alike(&opened, &selected) && looks_alike(&saved, &renamed));
        assert!(!looks_alike(&saved, &saved.after(&scene, red("bone")).unwrap()));
        let mut measured = MeasuredUnits::new(PlacedScene::new(scene));
        assert_eq!(measured.of(&opened).unwrap().names, ["bone", "skin"]);
        assert_eq!(measured.of(&saved).unwrap().names, ["bone", "skin", "skul"]);
        assert_eq!(measured.of(&renamed).unwrap().names, ["bone", "skin", "skull"]);
    }

    #[test]
    fn samples_measure_what_all_gaussians_measure() {
        let scene = Arc::new(test_scene(&[("skin", 3 * SAMPLES)]));
        let state = EditState::of_scene(&scene, "", "");
        let sampled = measure(&scene, &state, &state.members(UnitRef::Base(0))).unwrap();
        let all = (0..scene.len()).map(|i| displayed(&scene.units[0], i));
        let exact = Attributes::of(all).unwrap();
        assert_eq!(sampled.count, exact.count);
        let size = scene.bounds.longest_edge();
        assert!(sampled.center.distance(exact.center) < 0.01 * size, "{sampled:?} {exact:?}");
        let near = |a: f64, b: f64| (a - b).abs() < 0.02 * b.abs();
        assert!(sampled.deviations.iter().zip(exact.deviations).all(|(a, b)| near(*a, b)), "{sampled:?} {exact:?}");
        assert!(near(sampled.opacity, exact.opacity));
        assert!(sampled.color.iter().zip(exact.color).all(|(a, b)| (a - b).abs() < 0.01), "{sampled:?} {exact:?}");
    }
}
