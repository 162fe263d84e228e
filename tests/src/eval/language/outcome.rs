//! The state of a scene as a person sees it, for comparison.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use sg_edit::{EditState, UnitRef};
use sg_proto::language::Tour;
use sg_scene::camera::{Light, LightMode};
use sg_scene::mask::Mask;
use sg_scene::view::View;

/// Greatest distance of two eyes that count as one, as a share of the distance to the target.
const SAME_PLACE: f64 = 1e-3;

/// How a unit looks.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// Colour, RGB 0 to 1.
    pub color: Vec3,
    /// Colour in the file.
    pub own_color: Vec3,
    /// Factor on the opacity.
    pub opacity: f32,
    /// Whether it is drawn.
    pub visible: bool,
    /// Whether it is locked.
    pub locked: bool,
    /// Saturation, brightness and temperature.
    pub tone: [f32; 3],
    /// Whether its Gaussians are deleted.
    pub deleted: bool,
}

impl Look {
    /// Whether a person sees it.
    #[must_use]
    pub fn is_seen(&self) -> bool {
        self.visible && self.opacity > 0.0 && !self.deleted
    }
}

/// Where an eye is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eye {
    /// Place of the eye.
    pub eye: DVec3,
    /// Middle of the picture.
    pub target: DVec3,
    /// The direction that is up.
    pub up: DVec3,
}

impl Eye {
    fn of(view: View) -> Self {
        Self { eye: view.eye, target: view.target, up: view.up.normalize_or_zero() }
    }

    /// Distance to the middle of the picture.
    #[must_use]
    pub fn distance(&self) -> f64 {
        self.eye.distance(self.target)
    }

    /// Whether two eyes see the same.
    #[must_use]
    pub fn is_near(&self, other: &Self) -> bool {
        let reach = SAME_PLACE * self.distance();
        let places = [(self.eye, other.eye), (self.target, other.target)];
        places.iter().all(|(a, b)| a.distance(*b) <= reach) && self.up.distance(other.up) <= SAME_PLACE
    }
}

/// What a person sees of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Looks of the units by name. One that is gone has none.
    pub looks: BTreeMap<String, Look>,
    /// Members of all units, ascending.
    pub members: BTreeMap<String, Vec<usize>>,
    /// Names of all units.
    pub names: Vec<String>,
    /// Selected Gaussians, ascending.
    pub selected: Vec<usize>,
    /// Number of Gaussians that are not deleted.
    pub existing: usize,
    /// Background colour.
    pub background: Vec3,
    /// The light, in words.
    pub light: String,
    /// The displayed part of the shading.
    pub term: String,
    /// The viewpoint.
    pub view: Eye,
    /// The viewpoint at the opening.
    pub initial: Eye,
    /// Kept viewpoints.
    pub kept: Vec<(String, Eye)>,
    /// Whether a tour waits; `None` without one.
    pub tour: Option<bool>,
}

impl Outcome {
    /// The outcome of a state. `samples` has a Gaussian of each unit of the start, `opened` is the state at the opening.
    #[must_use]
    pub fn of(state: &EditState, opened: &EditState, samples: &BTreeMap<String, usize>, tour: Option<&Tour>) -> Self {
        let units = state.names().filter(|(_, unit)| !is_derived(state, *unit));
        let units: Vec<(String, UnitRef)> = units.map(|(name, unit)| (name.to_owned(), unit)).collect();
        let members = units.iter().map(|(name, unit)| (name.clone(), ones(&state.members(*unit))));
        let looks = units.iter().filter_map(|(name, unit)| {
            // A unit of another name has no look that others share: any of its Gaussians stands for it.
            let is_of_file = opened.base_units().iter().any(|base| base.name == *name);
            let any = || if is_of_file { None } else { state.members(*unit).ones().next() };
            let sample = samples.get(name).copied().or_else(any)?;
            Some((name.clone(), look(state, opened, *unit, sample)))
        });
        let mut names: Vec<String> = units.iter().map(|(name, _)| name.clone()).collect();
        names.sort_unstable();
        Self {
            looks: looks.collect(),
            members: members.collect(),
            names,
            selected: ones(state.selection().mask()),
            existing: state.count() - state.deleted().count(),
            background: state.background(),
            light: light(state.light()),
            term: format!("{:?}", state.term()).to_lowercase(),
            view: Eye::of(state.view()),
            initial: Eye::of(opened.view()),
            kept: state.kept_views().iter().map(|kept| (kept.name.clone(), Eye::of(kept.view))).collect(),
            tour: tour.map(|tour| tour.paused),
        }
    }

    /// Takes over which units there are, and the looks of new and of deleted ones.
    pub(super) fn take_units(&mut self, after: &Self) {
        self.names.clone_from(&after.names);
        self.members.clone_from(&after.members);
        self.looks.retain(|name, _| after.looks.contains_key(name));
        for (name, look) in &after.looks {
            let known = self.looks.entry(name.clone()).or_insert_with(|| look.clone());
            known.deleted = look.deleted;
        }
    }

    /// What differs from another outcome, in words.
    #[must_use]
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let mut all = Vec::new();
        for (name, look) in &self.looks {
            match other.looks.get(name) {
                Some(new) if new != look => all.push(format!("also: {name} from {look:?} to {new:?}")),
                Some(_) => {}
                None => all.push(format!("also: {name} is gone")),
            }
        }
        let mut note = |what: &str, differs: bool| {
            if differs {
                all.push(format!("also: the {what} changed"));
            }
        };
        note("names", self.names != other.names);
        note("selection", self.selected != other.selected);
        note("deleted Gaussians", self.existing != other.existing);
        note("background", self.background != other.background);
        note("light", self.light != other.light);
        note("shading term", self.term != other.term);
        note("view", !self.view.is_near(&other.view));
        note("kept views", self.kept != other.kept);
        note("tour", self.tour != other.tour);
        all
    }
}

/// A light in words. One that comes from the eye has no direction.
fn light(light: Light) -> String {
    match light.mode {
        LightMode::Headlight => format!("{:?}", Light { direction: [0.0; 3], ..light }),
        LightMode::Direction => format!("{light:?}"),
    }
}

/// Whether a unit was made by a command, without a name of its own.
fn is_derived(state: &EditState, unit: UnitRef) -> bool {
    matches!(unit, UnitRef::Editable(id) if state.units().any(|unit| unit.id == id && unit.derived))
}

fn ones(mask: &Mask) -> Vec<usize> {
    mask.ones().collect()
}

/// The look of a unit by one of its Gaussians, whose looks are alike.
fn look(state: &EditState, opened: &EditState, unit: UnitRef, sample: usize) -> Look {
    let has_sample = |base: &&sg_edit::BaseUnitState| base.range().contains(&sample);
    let base = state.base_units().iter().find(has_sample);
    let own_color = opened.base_units().iter().find(has_sample).map_or(Vec3::ZERO, |base| base.palette);
    let mut look = Look {
        color: base.map_or(own_color, |base| base.palette),
        own_color,
        opacity: base.map_or(1.0, |base| base.opacity),
        visible: base.is_none_or(|base| base.visible),
        locked: match unit {
            UnitRef::Base(at) => state.base_units().get(at).is_some_and(|base| base.locked),
            UnitRef::Editable(id) => state.units().any(|unit| unit.id == id && unit.locked),
        },
        tone: base.map_or([1.0, 1.0, 0.0], |base| [base.tone.saturation, base.tone.brightness, base.tone.temperature]),
        deleted: state.deleted().get(sample),
    };
    for unit in state.units().filter(|unit| unit.mask.get(sample)) {
        look.color = unit.color.unwrap_or(look.color);
        look.opacity *= unit.opacity;
        look.visible &= unit.visible;
        look.tone = [
            look.tone[0] * unit.tone.saturation,
            look.tone[1] * unit.tone.brightness,
            look.tone[2] + unit.tone.temperature,
        ];
    }
    look
}
