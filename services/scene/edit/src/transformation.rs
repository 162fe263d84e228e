//! The command that moves, turns and scales Gaussians.

use std::sync::Arc;

use glam::{DQuat, DVec3};
use sg_input::number_format::{decimals, significant};
use sg_proto::scene::{PatientSide, TransformGaussians, Vector};
use sg_scene::mask::Mask;
use sg_scene::orientation::{Axis, LengthUnit};
use sg_scene::similarity::Similarity;

use super::command_number;
use super::error::EditError;
use super::placement::{Placement, middle, same};
use super::state::{BaseUnitState, UnitRef};
use super::target::ResolvedTarget;
use super::transaction::Transaction;
use super::wire::{decode_vector, encode_vector};

/// Most parts of a scene with places of their own: each takes a mask in every snapshot.
const MAX_PARTS: usize = 64;

/// Least and greatest factor on lengths, of one command and of all together.
const SCALES: (f64, f64) = (1e-6, 1e6);

/// Greatest distance of a place from the middle of the scene's box, in longest edges of the box.
const MOST_EDGES: f64 = 1e6;

/// What a command asks for.
enum Wish {
    Restore,
    /// A map, and what it does in words: before and behind the target.
    Map {
        map: Similarity,
        done: (String, String),
    },
}

impl Transaction<'_> {
    pub(super) fn transform_gaussians(&mut self, command: &TransformGaussians) -> Result<String, EditError> {
        let target = self.state.resolve(command.target.as_ref())?;
        if target.members.is_none() {
            return Err(EditError::EmptyTarget(target.phrase));
        }
        self.refuse_locked(&target)?;
        let wish = self.wish(command, &target.members)?;
        let moved = self.with_deleted(&target);
        let mut parts: Vec<(Similarity, Mask)> = Vec::new();
        let mut add = |map: Similarity, members: Mask| {
            if members.is_none() || map == Similarity::IDENTITY {
                return;
            }
            match parts.iter_mut().find(|(present, _)| *present == map) {
                Some((_, present)) => present.union_with(&members),
                None => parts.push((map, members)),
            }
        };
        let mut rest = moved.clone();
        for part in self.state.placements.iter() {
            let (mut inside, mut outside) = ((*part.members).clone(), (*part.members).clone());
            inside.intersect_with(&moved);
            outside.subtract(&moved);
            rest.subtract(&inside);
            add(part.map, outside);
            if let Wish::Map { map, .. } = &wish {
                add(part.map.then(map), inside);
            }
        }
        if let Wish::Map { map, .. } = &wish {
            add(*map, rest);
        }
        if parts.len() > MAX_PARTS && parts.len() > self.state.placements.len() {
            let remedy = "move larger parts, or put some back";
            return Err(EditError::TooMany { what: "parts with places of their own", limit: MAX_PARTS, remedy });
        }
        for (map, _) in &parts {
            self.check_reach(map)?;
        }
        let placements: Arc<[Placement]> =
            parts.into_iter().map(|(map, members)| Placement { map, members: Arc::new(members) }).collect();
        if !same(&self.state.placements, &placements) {
            self.state.placements = placements;
            // The strokes of a selection would hit other Gaussians now.
            if !self.state.selection.steps().is_empty() {
                let selected = (**self.state.selection.mask()).clone();
                self.select_mask(selected);
            }
        }
        self.focus_on(target.names);
        Ok(match wish {
            Wish::Restore => format!("put {} back", target.phrase),
            Wish::Map { done: (verb, how), .. } => format!("{verb} {}{how}", target.phrase),
        })
    }

    /// The Gaussians of a target with the deleted ones of its units: these come back to a unit where it is then.
    fn with_deleted(&self, target: &ResolvedTarget) -> Mask {
        let mut members = target.members.clone();
        if target.everything {
            members.union_with(&self.state.deleted);
        }
        for unit in &target.named {
            match unit {
                UnitRef::Base(i) => {
                    members.select_range(self.state.base.get(*i).map_or(0..0, BaseUnitState::range));
                }
                UnitRef::Editable(id) => {
                    if let Some(deleted) = self.state.units.get(id).and_then(|unit| unit.deleted.as_deref()) {
                        members.union_with(deleted);
                    }
                }
            }
        }
        members
    }

    /// What a command asks for.
    fn wish(&self, command: &TransformGaussians, members: &Mask) -> Result<Wish, EditError> {
        let TransformGaussians { pivot, shift, axis, degrees, factor, restore, millimetres, towards, distance, .. } =
            command;
        const NOTHING: &str = "nothing is set; give a shift, an axis with degrees, a factor, or `restore`";
        let malformed = |reason: &str| EditError::Malformed { field: "transform_gaussians", reason: reason.to_owned() };
        if *restore {
            let alone = pivot.is_none()
                && shift.is_none()
                && axis.is_none()
                && factor.is_none()
                && *degrees == 0.0
                && *towards == 0;
            return if alone { Ok(Wish::Restore) } else { Err(malformed("`restore` goes with no other field")) };
        }
        let towards = self.towards(*towards, *distance)?;
        if shift.is_some() && towards.is_some() {
            return Err(malformed("`shift` and `towards` exclude each other"));
        }
        let shift = &towards.or(*shift);
        if shift.is_none() && axis.is_none() && factor.is_none() {
            return Err(malformed(NOTHING));
        }
        if axis.is_none() && *degrees != 0.0 {
            return Err(malformed("degrees need an axis"));
        }
        let point = |vector: &Option<_>, field| {
            let Some(vector) = vector else { return Ok(None) };
            let vector = decode_vector(vector);
            match vector.to_array().into_iter().find(|x| !x.is_finite()) {
                Some(found) => Err(EditError::NotFinite { field, found }),
                None => Ok(Some(vector)),
            }
        };
        let unit = || self.scene.file().orientation.unit.map(LengthUnit::millimetres);
        let shift = match (point(shift, "transform_gaussians.shift")?, millimetres) {
            (Some(shift), true) => {
                let unit =
                    unit().ok_or_else(|| malformed("the scene's file gives no length unit, so no millimetres"))?;
                Some((shift, shift / unit, " mm"))
            }
            (shift, _) => shift.map(|shift| (shift, shift, "")),
        };
        if !degrees.is_finite() {
            return Err(EditError::NotFinite { field: "transform_gaussians.degrees", found: *degrees });
        }
        let rotation = match axis {
            Some(axis) if *degrees != 0.0 => {
                let axis = command_number::direction(axis, "transform_gaussians.axis")?.as_dvec3().normalize();
                DQuat::from_axis_angle(axis, (degrees % 360.0).to_radians())
            }
            _ => DQuat::IDENTITY,
        };
        let factor = factor.unwrap_or(1.0);
        if !(SCALES.0..=SCALES.1).contains(&factor) {
            let want = "a factor from a millionth to a million";
            return Err(EditError::OutOfRange { field: "transform_gaussians.factor", found: factor, want });
        }
        let pivot = match point(pivot, "transform_gaussians.pivot")? {
            Some(pivot) => pivot,
            None if rotation == DQuat::IDENTITY && factor == 1.0 => DVec3::ZERO,
            None => middle(&self.scene.of(&self.state), members)
                .ok_or_else(|| EditError::EmptyTarget("what has a finite centre".to_owned()))?,
        };
        let by = shift.map_or(DVec3::ZERO, |(_, by, _)| by);
        let shift = shift.filter(|(given, ..)| *given != DVec3::ZERO).map(|(given, _, symbol)| {
            let [x, y, z] = given.to_array().map(significant);
            (format!(" by ({x}, {y}, {z}){symbol}"), "moved")
        });
        let turn = (*degrees != 0.0 && axis.is_some()).then(|| (format!(" by {}°", decimals(*degrees, 1)), "turned"));
        let scale = (factor != 1.0).then(|| (format!(" by {}", significant(factor)), "scaled"));
        let all: Vec<_> = [shift, turn, scale].into_iter().flatten().collect();
        let done = match all.as_slice() {
            [] => ("left".to_owned(), " where it is".to_owned()),
            [(by, verb)] => ((*verb).to_owned(), by.clone()),
            [(_, first), (_, second)] => (format!("{first} and {second}"), String::new()),
            _ => ("moved, turned and scaled".to_owned(), String::new()),
        };
        Ok(Wish::Map { map: Similarity::about(pivot, rotation, factor, by), done })
    }

    /// The shift by a distance towards a side of the patient, scene coordinates in the unit of the distance.
    fn towards(&self, side: i32, distance: f64) -> Result<Option<Vector>, EditError> {
        const FIELD: &str = "transform_gaussians.towards";
        let letter = match PatientSide::try_from(side) {
            Ok(PatientSide::Unspecified) => return Ok(None),
            Ok(PatientSide::Left) => "L",
            Ok(PatientSide::Right) => "R",
            Ok(PatientSide::Anterior) => "A",
            Ok(PatientSide::Posterior) => "P",
            Ok(PatientSide::Superior) => "S",
            Ok(PatientSide::Inferior) => "I",
            Err(_) => {
                return Err(EditError::Malformed { field: FIELD, reason: format!("{side} is no side of a patient") });
            }
        };
        let frame = self.scene.file().orientation.patient.ok_or_else(|| EditError::Malformed {
            field: FIELD,
            reason: "the scene's file names no patient's sides; use left, right, up, down, nearer or farther"
                .to_owned(),
        })?;
        let axis = Axis::ALL.into_iter().find(|axis| frame.letter(*axis) == letter);
        Ok(axis.map(|axis| encode_vector(axis.vector() * distance)))
    }

    /// Refuses a map that takes the scene's box out of what pictures can hold.
    fn check_reach(&self, map: &Similarity) -> Result<(), EditError> {
        if !(SCALES.0..=SCALES.1).contains(&map.scale) {
            let want = "a factor from a millionth to a million of the size in the file";
            return Err(EditError::OutOfRange { field: "transform_gaussians.factor", found: map.scale, want });
        }
        let bounds = self.state.geometry().bounds;
        let middle = 0.5 * (bounds.min + bounds.max);
        let far = [bounds.min, bounds.max].map(|corner| map.apply(corner).distance(middle)).into_iter();
        let far = far.fold(0.0_f64, |a, b| if b.is_nan() { f64::INFINITY } else { a.max(b) });
        let most = MOST_EDGES * bounds.longest_edge().max(f64::MIN_POSITIVE);
        if far <= most {
            return Ok(());
        }
        let want = "a way that ends within a million lengths of the scene";
        Err(EditError::OutOfRange { field: "transform_gaussians.shift", found: far, want })
    }
}
