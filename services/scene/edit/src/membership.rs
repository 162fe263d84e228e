//! The selection, and the Gaussians of units.

use std::sync::Arc;

use sg_proto::limits::{MAX_STROKE_POINTS, MAX_STROKES};
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::{
    CommitSelection, DeleteUnit, RenameUnit, SaveUnit, Select, SelectionStep, SetOperation, Stroke, StrokeDepth,
    StrokeKind, StrokeMode,
};

use super::command_number::malformed;
use super::error::EditError;
use super::names::checked_name;
use super::reach::reach_of;
use super::state::{Selection, Unit, UnitRef};
use super::transaction::Transaction;
use super::wire::{decode_mask, steps_of};
use sg_input::number_format::{decimals, grouped};
use sg_scene::mask::Mask;
use sg_scene::tone::Tone;

/// The history text of a selection that became empty.
const CLEARED: &str = "cleared selection";

impl Transaction<'_> {
    pub(super) fn commit_selection(&mut self, command: &CommitSelection) -> Result<String, EditError> {
        let present = self.state.selection.hash();
        if !command.expected_hash.is_empty() && command.expected_hash != present {
            return Err(EditError::SelectionConflict { found: present.to_owned() });
        }
        const FIELD: &str = "commit_selection.mask";
        let missing = || EditError::Malformed { field: FIELD, reason: "the mask is missing; send one".to_owned() };
        let mask = command.mask.as_ref().ok_or_else(missing)?;
        let mut mask = decode_mask(mask, self.state.count(), FIELD).map_err(|e| malformed(&e))?;
        mask.subtract(&self.state.unselectable());
        let steps = steps_of(&command.strokes, &command.steps);
        check_steps(&steps, self.state.count())?;
        let count = mask.count();
        let strokes = steps.iter().filter(|s| matches!(s.step, Some(Step::Stroke(_)))).count();
        let operations = steps.iter().filter(|s| matches!(s.step, Some(Step::Operation(_)))).count();
        let tuned = steps.iter().rev().find_map(|s| if let Some(Step::Tuning(t)) = &s.step { Some(*t) } else { None });
        let tuned = tuned.map_or_else(String::new, |t| {
            let reach = decimals(100.0 * reach_of(t.leak), 0);
            format!(", Reach {reach} %, Strictness {}", decimals(t.threshold, 2))
        });
        self.state.selection = Selection::new(Arc::new(mask), steps.into());
        self.focus_on(Vec::new());
        let counted = |n: usize, what: &str| match n {
            0 => None,
            1 => Some(format!("1 {what}")),
            n => Some(format!("{} {what}s", grouped(n as u64))),
        };
        let with: Vec<_> = counted(strokes, "stroke").into_iter().chain(counted(operations, "operation")).collect();
        let with = if with.is_empty() { String::new() } else { format!(" with {}", with.join(" and ")) };
        if count == 0 {
            return Ok(CLEARED.to_owned());
        }
        Ok(format!("selected {}{with}{tuned}", gaussians(count)))
    }

    pub(super) fn select(&mut self, command: &Select) -> Result<String, EditError> {
        let operation = SetOperation::try_from(command.operation).map_err(|_| EditError::Malformed {
            field: "select.operation",
            reason: format!("{} is no set operation", command.operation),
        })?;
        let replaces = matches!(operation, SetOperation::Unspecified | SetOperation::Replace);
        let empty = command
            .target
            .as_ref()
            .is_none_or(|t| t.units.is_empty() && !t.selection && !t.everything && !t.complement);
        if empty && replaces {
            self.select_mask(Mask::empty(self.state.count()));
            return Ok(CLEARED.to_owned());
        }
        let target = self.state.resolve(command.target.as_ref())?;
        if operation != SetOperation::Remove {
            self.refuse_locked_units(&target.named)?;
        }
        let mut mask = (**self.state.selection.mask()).clone();
        match operation {
            SetOperation::Unspecified | SetOperation::Replace => mask = target.members,
            SetOperation::Add => mask.union_with(&target.members),
            SetOperation::Remove => mask.subtract(&target.members),
            SetOperation::Intersect => mask.intersect_with(&target.members),
        }
        mask.subtract(&self.state.unselectable());
        let count = gaussians(mask.count());
        self.select_mask(mask);
        let phrase = target.phrase;
        Ok(match operation {
            SetOperation::Unspecified | SetOperation::Replace => format!("selected {phrase}: {count}"),
            SetOperation::Add => format!("added {phrase} to the selection: {count}"),
            SetOperation::Remove => format!("removed {phrase} from the selection: {count}"),
            SetOperation::Intersect => format!("intersected the selection with {phrase}: {count}"),
        })
    }

    pub(super) fn select_mask(&mut self, mask: Mask) {
        self.state.selection = Selection::new(Arc::new(mask), Arc::new([]));
        self.focus_on(Vec::new());
    }

    /// Saves the selection. The look that earlier commands gave to exactly this selection becomes the unit's own.
    pub(super) fn save_unit(&mut self, command: &SaveUnit) -> Result<String, EditError> {
        let name = checked_name(&command.name, "save_unit.name")?;
        let mask = Arc::clone(self.state.selection.mask());
        if mask.is_none() {
            return Err(EditError::NothingSelected);
        }
        let count = gaussians(mask.count());
        let existing = self.state.is_taken(&name, None);
        if let Some(UnitRef::Base(_)) = existing {
            let remedy = "choose another name";
            return Err(EditError::BaseUnit { name, verb: "replaced", remedy });
        }
        if let Some(UnitRef::Editable(id)) = existing
            && let Some(unit) = self.state.units.get_mut(&id)
            && !unit.derived
        {
            if !command.replace {
                return Err(EditError::NameTaken(unit.name.clone()));
            }
            let name = unit.name.clone();
            if unit.locked {
                return Err(EditError::Locked(name));
            }
            (unit.mask, unit.deleted) = (mask, None);
            self.focus_on(vec![name.clone()]);
            return Ok(format!("replaced {name} with the selection: {count}"));
        }
        let (mut color, mut opacity, mut visible, mut tone) = (None, 1.0_f32, true, Tone::NEUTRAL);
        self.state.units.retain(|_, unit| {
            let same = unit.derived && unit.mask == mask;
            if same {
                color = unit.color.or(color);
                opacity = (opacity * unit.opacity).min(super::command_number::MAX_FACTOR);
                visible &= unit.visible;
                tone = tone.and(unit.tone);
            }
            !same
        });
        self.yield_name(&name);
        let id = self.fresh_id()?;
        self.insert(Unit {
            id,
            name: name.clone(),
            mask,
            deleted: None,
            color,
            opacity,
            visible,
            derived: false,
            locked: false,
            tone,
        });
        self.focus_on(vec![name.clone()]);
        Ok(format!("saved the selection as {name}: {count}"))
    }

    pub(super) fn delete_unit(&mut self, command: &DeleteUnit) -> Result<String, EditError> {
        let (id, name) = self.editable(&command.name, "unnamed", "delete its Gaussians or hide it")?;
        self.state.units.remove(&id);
        self.focus_on(Vec::new());
        Ok(format!("removed the name {name}; its Gaussians stay"))
    }

    /// Renames a unit; a derived one that is given a name is saved by that.
    pub(super) fn rename_unit(&mut self, command: &RenameUnit) -> Result<String, EditError> {
        let (unit, name) = self.renamable(&command.name)?;
        let new = checked_name(&command.new_name, "rename_unit.new_name")?;
        self.claim_name(&new, Some(unit))?;
        match unit {
            UnitRef::Base(i) => {
                if let Some(base) = self.state.base.get_mut(i) {
                    base.name.clone_from(&new);
                }
            }
            UnitRef::Editable(id) => self.with_unit(id, |unit| {
                unit.name.clone_from(&new);
                unit.derived = false;
            }),
        }
        self.focus_on(vec![new.clone()]);
        Ok(format!("renamed {name} to {new}"))
    }

    /// Makes a name free for a unit other than `except`, unless a person or the file gave it to another one.
    pub(super) fn claim_name(&mut self, name: &str, except: Option<UnitRef>) -> Result<(), EditError> {
        match self.state.is_taken(name, except) {
            Some(UnitRef::Editable(other)) if self.state.units.get(&other).is_some_and(|u| u.derived) => {
                self.yield_name(name);
                Ok(())
            }
            Some(_) => Err(EditError::NameTaken(name.to_owned())),
            None => Ok(()),
        }
    }

    /// Frees a name that a derived unit has: names given by people go first.
    pub(super) fn yield_name(&mut self, name: &str) {
        let Some(UnitRef::Editable(id)) = self.state.is_taken(name, None) else { return };
        let free = self.state.free_name(&format!("{name} (unsaved)"));
        if let Some(unit) = self.state.units.get_mut(&id) {
            unit.name = free;
        }
    }

    /// A unit of which the name is not the file's own: an editable one, or a base unit of copies.
    fn renamable(&self, name: &str) -> Result<(UnitRef, String), EditError> {
        let unit = self.state.find(name)?;
        match unit {
            UnitRef::Base(i) if self.state.base.get(i).is_some_and(|base| base.duplicated) => {
                self.refuse_locked_units(&[unit])?;
                Ok((unit, self.state.name_of(unit).unwrap_or_default().to_owned()))
            }
            _ => {
                let (id, name) = self.editable(name, "renamed", "name it in the scene file")?;
                Ok((UnitRef::Editable(id), name))
            }
        }
    }

    /// An editable unit by name.
    fn editable(&self, name: &str, verb: &'static str, remedy: &'static str) -> Result<(u64, String), EditError> {
        let unit = self.state.find(name)?;
        let name = self.state.name_of(unit).unwrap_or_default().to_owned();
        match unit {
            UnitRef::Editable(id) => {
                self.refuse_locked_units(&[unit])?;
                Ok((id, name))
            }
            UnitRef::Base(_) => Err(EditError::BaseUnit { name, verb, remedy }),
        }
    }
}

/// Refuses steps that their readers could not use later.
fn check_steps(steps: &[SelectionStep], gaussians: usize) -> Result<(), EditError> {
    const FIELD: &str = "commit_selection.steps";
    for (i, step) in steps.iter().enumerate() {
        match &step.step {
            Some(Step::Stroke(_)) => {}
            Some(Step::Operation(operation)) if operation.operation.is_some() => {}
            Some(Step::Tuning(tuning)) if tuning.leak.is_finite() && tuning.threshold.is_finite() => {}
            Some(Step::Mask(mask) | Step::Exclude(mask)) => {
                drop(decode_mask(mask, gaussians, FIELD).map_err(|e| malformed(&e))?);
            }
            _ => return Err(EditError::Malformed { field: FIELD, reason: format!("step {i} is empty or malformed") }),
        }
    }
    let strokes: Vec<Stroke> = steps
        .iter()
        .filter_map(|s| if let Some(Step::Stroke(stroke)) = &s.step { Some(stroke.clone()) } else { None })
        .collect();
    check_strokes(&strokes, steps.len())
}

fn check_strokes(strokes: &[Stroke], steps: usize) -> Result<(), EditError> {
    const FIELD: &str = "commit_selection.strokes";
    if steps > MAX_STROKES {
        let remedy = "clear the selection and begin again";
        return Err(EditError::TooMany { what: "strokes of one selection", limit: MAX_STROKES, remedy });
    }
    for (i, stroke) in strokes.iter().enumerate() {
        let wrong = |reason: &str| Err(EditError::Malformed { field: FIELD, reason: format!("stroke {i}: {reason}") });
        let mode = StrokeMode::try_from(stroke.mode).unwrap_or_default();
        let kind = StrokeKind::try_from(stroke.kind).unwrap_or_default();
        if mode == StrokeMode::Unspecified || kind == StrokeKind::Unspecified {
            return wrong("mode and kind must be set");
        }
        if kind == StrokeKind::Toggle && mode != StrokeMode::Cluster {
            return wrong("only cluster mode can toggle");
        }
        if !(stroke.radius.is_finite() && stroke.radius > 0.0) {
            return wrong("the radius must be finite and above 0");
        }
        if stroke.points.is_empty() || !stroke.points.len().is_multiple_of(3) {
            return wrong("the points must be x y z one after another, at least one");
        }
        if stroke.points.len() / 3 > MAX_STROKE_POINTS {
            let remedy = "split the stroke";
            return Err(EditError::TooMany { what: "corners of one stroke", limit: MAX_STROKE_POINTS, remedy });
        }
        if !stroke.points.iter().all(|x| x.is_finite()) {
            return wrong("the points must be finite");
        }
        if !(stroke.pressure.is_empty() || 3 * stroke.pressure.len() == stroke.points.len()) {
            return wrong("there must be one pressure a point, or none");
        }
        if !stroke.pressure.iter().all(|f| *f >= 0.0 && f.is_finite()) {
            return wrong("the pressure must be finite and at least 0");
        }
        let sound = |d: &StrokeDepth| {
            d.eye.len() == 3 && d.eye.iter().all(|x| x.is_finite()) && d.reach >= 0.0 && d.reach.is_finite()
        };
        if !stroke.depth.as_ref().is_none_or(sound) {
            return wrong("its depth must be an eye of three finite numbers and at least 0 behind it");
        }
    }
    Ok(())
}

/// A number of Gaussians in words.
pub(super) fn gaussians(count: usize) -> String {
    grouped(count as u64) + if count == 1 { " Gaussian" } else { " Gaussians" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_grouped() {
        assert_eq!(gaussians(1), "1 Gaussian");
        assert_eq!(gaussians(999), "999 Gaussians");
        assert_eq!(gaussians(1_234_567), "1,234,567 Gaussians");
    }

    #[test]
    fn strokes_that_make_no_sense_are_refused() {
        let good = Stroke {
            mode: StrokeMode::Cluster.into(),
            kind: StrokeKind::Toggle.into(),
            radius: 0.1,
            points: vec![0.0, 0.5, 1.0],
            pressure: vec![0.5],
            depth: Some(StrokeDepth { eye: vec![0.5; 3], reach: 0.1 }),
        };
        assert_eq!(check_strokes(std::slice::from_ref(&good), 1), Ok(()));
        for bad in [
            Stroke { mode: 0, ..good.clone() },
            Stroke { mode: 9, ..good.clone() },
            Stroke { kind: 0, ..good.clone() },
            Stroke { mode: StrokeMode::Point.into(), ..good.clone() },
            Stroke { radius: 0.0, ..good.clone() },
            Stroke { radius: f64::NAN, ..good.clone() },
            Stroke { points: vec![], ..good.clone() },
            Stroke { pressure: vec![0.5; 2], ..good.clone() },
            Stroke { pressure: vec![-0.5], ..good.clone() },
            Stroke { pressure: vec![f64::INFINITY], ..good.clone() },
            Stroke { points: vec![0.0, 1.0], ..good.clone() },
            Stroke { depth: Some(StrokeDepth { eye: vec![0.5; 2], reach: 0.1 }), ..good.clone() },
            Stroke { depth: Some(StrokeDepth { eye: vec![0.5; 3], reach: -0.1 }), ..good.clone() },
            Stroke { points: vec![0.0, 1.0, f64::INFINITY], ..good.clone() },
            Stroke { points: vec![0.0; 3 * MAX_STROKE_POINTS + 3], pressure: vec![], ..good.clone() },
        ] {
            assert!(check_strokes(&[good.clone(), bad], 2).is_err());
        }
        assert!(check_strokes(&vec![good; MAX_STROKES + 1], MAX_STROKES + 1).is_err());
    }
}
