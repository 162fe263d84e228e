//! Locks of units.
//!
//! The Gaussians of a locked unit keep their look and stay. They are not selected, so that neither a stroke nor a command on the
//! selection reaches them. Every other command that would change one of them is refused with the unit's name.

use sg_proto::scene::SetLock;

use super::error::EditError;
use super::names::join_names;
use super::state::{EditState, UnitRef};
use super::target::ResolvedTarget;
use super::transaction::Transaction;
use sg_scene::mask::Mask;

impl EditState {
    /// Whether a unit is locked; `false` for one that does not exist.
    #[must_use]
    pub fn is_locked(&self, unit: UnitRef) -> bool {
        match unit {
            UnitRef::Base(i) => self.base.get(i).is_some_and(|base| base.locked),
            UnitRef::Editable(id) => self.units.get(&id).is_some_and(|unit| unit.locked),
        }
    }

    /// The Gaussians that no selection contains: the deleted ones and those of locked units.
    #[must_use]
    pub fn unselectable(&self) -> Mask {
        let mut mask = (**self.deleted()).clone();
        for (_, unit) in self.names().filter(|(_, unit)| self.is_locked(*unit)) {
            mask.union_with(&self.members(unit));
        }
        mask
    }
}

impl Transaction<'_> {
    pub(super) fn set_lock(&mut self, command: &SetLock) -> Result<String, EditError> {
        let target = self.state.resolve(command.target.as_ref())?;
        let units: Vec<UnitRef> = if target.everything {
            self.state.names().map(|(_, unit)| unit).collect()
        } else if target.unnamed.is_some() {
            let reason = "only units have a lock; name them, or everything".to_owned();
            return Err(EditError::Malformed { field: "set_lock.target", reason });
        } else {
            target.named
        };
        for unit in units {
            match unit {
                UnitRef::Base(i) => {
                    if let Some(base) = self.state.base.get_mut(i) {
                        base.locked = command.locked;
                    }
                }
                UnitRef::Editable(id) => self.with_unit(id, |unit| unit.locked = command.locked),
            }
        }
        let unselectable = self.state.unselectable();
        if self.state.selection.mask().intersects(&unselectable) {
            let mut selected = (**self.state.selection.mask()).clone();
            selected.subtract(&unselectable);
            self.select_mask(selected);
        }
        let phrase = if target.everything { target.phrase } else { join_names(&target.names) };
        self.focus_on(target.names);
        Ok(format!("{} {phrase}", if command.locked { "locked" } else { "unlocked" }))
    }

    /// Refuses a change of Gaussians of which a locked unit has some.
    pub(super) fn refuse_locked(&self, target: &ResolvedTarget) -> Result<(), EditError> {
        self.refuse_locked_units(&target.named)?;
        let locked = self
            .state
            .names()
            .find(|(_, unit)| self.state.is_locked(*unit) && self.state.members(*unit).intersects(&target.members));
        locked.map_or(Ok(()), |(name, _)| Err(EditError::Locked(name.to_owned())))
    }

    /// Refuses a change of units of which one is locked.
    pub(super) fn refuse_locked_units(&self, units: &[UnitRef]) -> Result<(), EditError> {
        let locked = units.iter().find(|unit| self.state.is_locked(**unit));
        let name = |unit| self.state.name_of(unit).unwrap_or_default().to_owned();
        locked.map_or(Ok(()), |unit| Err(EditError::Locked(name(*unit))))
    }
}
