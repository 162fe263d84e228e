//! Edits of colour, opacity and visibility.

use glam::Vec3;
use sg_proto::scene::{SetColor, SetOpacity, SetVisibility, ShowOnly};

use super::command_number;
use super::derived::Attribute;
use super::error::EditError;
use super::state::{Unit, UnitRef};
use super::target::ResolvedTarget;
use super::transaction::Transaction;
use sg_input::number_format::decimals;
use sg_scene::mask::Mask;

/// Name of the derived unit of all that a command did not name.
const REST: &str = "Rest of scene";

impl Transaction<'_> {
    pub(super) fn set_color(&mut self, command: &SetColor) -> Result<String, EditError> {
        let color = command.color.as_ref().map(|c| command_number::color(c, "set_color.color")).transpose()?;
        let target = self.state.resolve(command.target.as_ref())?;
        self.refuse_locked(&target)?;
        for unit in self.base_and_named(&target) {
            self.paint(unit, color);
        }
        self.supersede_named(Attribute::Color, &target)?;
        if target.everything {
            // Saved units are parts of everything, so they have its colour and none of their own.
            self.saved_units_mut().for_each(|unit| unit.color = None);
        }
        let mut made = None;
        if let Some(members) = &target.unnamed {
            if let Some(color) = color {
                // It lies over every other colour, so those of partly covered units may stay under it.
                let here = self.derived_of(members, true);
                self.drop_covered_colors(members, here);
                let id = self.derived_or_new(here, members, &target)?;
                self.with_unit(id, |unit| unit.color = Some(color));
                made = Some(id);
            } else {
                self.supersede(Attribute::Color, members, None)?;
                for unit in self.units_inside(members) {
                    self.paint(unit, None);
                }
            }
        }
        self.focus_after(&target, made);
        Ok(match color {
            Some(c) => format!("coloured {} {}", target.phrase, hex(c)),
            None => format!("restored the original colours of {}", target.phrase),
        })
    }

    pub(super) fn set_opacity(&mut self, command: &SetOpacity) -> Result<String, EditError> {
        const FIELD: &str = "set_opacity.factor";
        let factor = command_number::factor(command.factor, FIELD)?;
        let target = self.state.resolve(command.target.as_ref())?;
        self.refuse_locked(&target)?;
        let changed =
            |present: f32| if command.relative { command_number::factor(present * factor, FIELD) } else { Ok(factor) };
        for unit in self.base_and_named(&target) {
            match unit {
                UnitRef::Base(i) => {
                    if let Some(base) = self.state.base.get_mut(i) {
                        base.opacity = changed(base.opacity)?;
                    }
                }
                UnitRef::Editable(id) => {
                    if let Some(unit) = self.state.units.get_mut(&id) {
                        unit.opacity = changed(unit.opacity)?;
                    }
                }
            }
        }
        // Multiplying the factor leaves other units' factors as they are; setting a factor overrides them.
        if !command.relative {
            self.supersede_named(Attribute::Opacity, &target)?;
            if target.everything {
                self.saved_units_mut().for_each(|unit| unit.opacity = 1.0);
            }
        }
        let mut made = None;
        if let Some(members) = &target.unnamed {
            let here = self.derived_of(members, false);
            if !command.relative {
                self.supersede(Attribute::Opacity, members, here)?;
                // The factors of units inside would multiply: 20 % of what had 40 % is to be 20 %.
                for unit in self.units_inside(members) {
                    match unit {
                        UnitRef::Base(i) => {
                            if let Some(base) = self.state.base.get_mut(i) {
                                base.opacity = 1.0;
                            }
                        }
                        UnitRef::Editable(id) => self.with_unit(id, |unit| unit.opacity = 1.0),
                    }
                }
            }
            let id = self.derived_or_new(here, members, &target)?;
            if let Some(unit) = self.state.units.get_mut(&id) {
                unit.opacity = changed(unit.opacity)?;
            }
            made = Some(id);
        }
        self.focus_after(&target, made);
        let percent = decimals(100.0 * f64::from(factor), 2);
        let by = if command.relative { "by" } else { "to" };
        Ok(format!("opacity of {} {by} {percent} %", target.phrase))
    }

    pub(super) fn set_visibility(&mut self, command: &SetVisibility) -> Result<String, EditError> {
        let target = self.state.resolve(command.target.as_ref())?;
        let mut made = None;
        if command.visible {
            self.show(&target, true)?;
        } else {
            self.refuse_locked(&target)?;
            for unit in self.base_and_named(&target) {
                match unit {
                    UnitRef::Base(i) => {
                        if let Some(base) = self.state.base.get_mut(i) {
                            base.visible = false;
                        }
                    }
                    UnitRef::Editable(id) => self.with_unit(id, |unit| unit.visible = false),
                }
            }
            if let Some(members) = &target.unnamed {
                made = Some(self.hide(members, &target)?);
            }
        }
        self.focus_after(&target, made);
        Ok(format!("{} {}", if command.visible { "showed" } else { "hid" }, target.phrase))
    }

    pub(super) fn show_only(&mut self, command: &ShowOnly) -> Result<String, EditError> {
        let target = self.state.resolve(command.target.as_ref())?;
        if target.members.is_none() {
            return Err(EditError::EmptyTarget(target.phrase));
        }
        // Earlier commands on unnamed Gaussians are overridden.
        self.supersede(Attribute::Visibility, &Mask::full(self.state.count()), None)?;
        self.show(&target, false)?;
        let rest = self.state.rest_of(&target.members);
        if !rest.is_none() {
            let id = match self.derived_of(&rest, false) {
                Some(id) => id,
                None => self.derive(&rest, REST, false)?,
            };
            self.with_unit(id, |unit| unit.visible = false);
        }
        let shown = target.unnamed.as_ref().and_then(|members| self.derived_of(members, false));
        self.focus_after(&target, shown);
        Ok(format!("showed only {}", target.phrase))
    }

    /// Shows every member of a target. Named hidden units are shown. Hidden derived units lose the members. Base units
    /// that hide some members are shown; with `keep_rest`, a derived unit keeps their other Gaussians hidden. A hidden
    /// saved unit stays hidden, unless the target names it or, without names, contains it.
    fn show(&mut self, target: &ResolvedTarget, keep_rest: bool) -> Result<(), EditError> {
        for unit in self.base_and_named(target) {
            match unit {
                UnitRef::Base(i) => {
                    if let Some(base) = self.state.base.get_mut(i) {
                        base.visible = true;
                    }
                }
                UnitRef::Editable(id) => self.with_unit(id, |unit| unit.visible = true),
            }
        }
        let wholly_inside = |unit: &Unit| target.unnamed.as_ref().is_some_and(|m| unit.mask.is_subset_of(m));
        for unit in self.state.units.values_mut() {
            if !unit.derived && (target.everything || wholly_inside(unit)) {
                unit.visible = true;
            }
        }
        self.supersede(Attribute::Visibility, &target.members, None)?;
        for i in 0..self.state.base.len() {
            let mut rest = (*self.state.members(UnitRef::Base(i))).clone();
            let Some(base) = self.state.base.get_mut(i) else { continue };
            if base.visible || !rest.intersects(&target.members) {
                continue;
            }
            base.visible = true;
            let stem = format!("Rest of {}", base.name);
            rest.subtract(&target.members);
            if keep_rest && !rest.is_none() {
                let id = match self.derived_of(&rest, false) {
                    Some(id) => id,
                    None => self.derive(&rest, &stem, false)?,
                };
                self.with_unit(id, |unit| unit.visible = false);
            }
        }
        Ok(())
    }

    fn hide(&mut self, members: &Mask, target: &ResolvedTarget) -> Result<u64, EditError> {
        let here = self.derived_of(members, false);
        self.supersede(Attribute::Visibility, members, here)?;
        let id = self.derived_or_new(here, members, target)?;
        self.with_unit(id, |unit| unit.visible = false);
        Ok(id)
    }

    /// Sets the colour of a unit; `None` restores that of the file.
    fn paint(&mut self, unit: UnitRef, color: Option<Vec3>) {
        match unit {
            UnitRef::Base(i) => {
                let file = self.initial.base.get(self.state.file_unit(i)).map(|b| b.palette);
                if let (Some(base), Some(palette)) = (self.state.base.get_mut(i), color.or(file)) {
                    base.palette = palette;
                }
            }
            UnitRef::Editable(id) => self.with_unit(id, |unit| unit.color = color),
        }
    }

    fn saved_units_mut(&mut self) -> impl Iterator<Item = &mut Unit> {
        self.state.units.values_mut().filter(|unit| !unit.derived)
    }

    /// The base units and the saved units of which some Gaussians hold all.
    fn units_inside(&self, members: &Mask) -> Vec<UnitRef> {
        let base = (0..self.state.base.len()).map(UnitRef::Base);
        let base = base.filter(|unit| {
            let own = self.state.members(*unit);
            !own.is_none() && own.is_subset_of(members)
        });
        let saved = self.state.units.iter().filter(|(_, unit)| !unit.derived && unit.mask.is_subset_of(members));
        base.chain(saved.map(|(id, _)| UnitRef::Editable(*id))).collect()
    }

    /// The named units, or all base units if the target is everything.
    pub(super) fn base_and_named(&self, target: &ResolvedTarget) -> Vec<UnitRef> {
        if target.everything { (0..self.state.base.len()).map(UnitRef::Base).collect() } else { target.named.clone() }
    }

    /// Edits of a named unit or of everything override derived units.
    pub(super) fn supersede_named(&mut self, attribute: Attribute, target: &ResolvedTarget) -> Result<(), EditError> {
        if target.everything {
            return self.supersede(attribute, &target.members, None);
        }
        for unit in &target.named {
            let itself = match unit {
                UnitRef::Base(_) => None,
                UnitRef::Editable(id) => Some(*id),
            };
            let members = self.state.members(*unit);
            self.supersede(attribute, &members, itself)?;
        }
        Ok(())
    }

    pub(super) fn derived_or_new(
        &mut self,
        here: Option<u64>,
        members: &Mask,
        target: &ResolvedTarget,
    ) -> Result<u64, EditError> {
        // Superseding may have removed the unit with its last attribute.
        match here.filter(|id| self.state.units.contains_key(id)) {
            Some(id) => Ok(id),
            None if target.of_selection => self.derive(members, "selection", true),
            // Its members have a name only by what they are not.
            None => self.derive(members, REST, false),
        }
    }

    pub(super) fn with_unit(&mut self, id: u64, change: impl FnOnce(&mut Unit)) {
        if let Some(unit) = self.state.units.get_mut(&id) {
            change(unit);
        }
    }

    /// Sets the meaning of "it": the units in the target, named or excepted. For the selection, it is the unit with the
    /// new look.
    pub(super) fn focus_after(&mut self, target: &ResolvedTarget, made: Option<u64>) {
        let mut names = target.names.clone();
        if names.is_empty() && target.of_selection {
            names.extend(made.and_then(|id| self.state.units.get(&id)).map(|u| u.name.clone()));
        }
        self.focus_on(names);
    }
}

pub(super) fn hex(c: Vec3) -> String {
    let [r, g, b] = c.to_array().map(|x| (255.0 * x).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_written_in_hexadecimal() {
        assert_eq!(hex(Vec3::new(1.0, 0.5, 0.0)), "#ff8000");
    }
}
