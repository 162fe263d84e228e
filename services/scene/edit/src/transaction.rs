//! The transaction of one command.

use super::change::Change;
use super::error::EditError;
use super::placed_scene::PlacedScene;
use super::state::{EditState, Unit};
use sg_proto::limits::MAX_UNITS;

/// A copy of the state that one command changes; dropped if the command is refused.
#[derive(Debug)]
pub(super) struct Transaction<'a> {
    /// The geometry, for framing.
    pub(super) scene: &'a PlacedScene,
    /// The state as the scene was opened.
    pub(super) initial: &'a EditState,
    /// The state being changed.
    pub(super) state: EditState,
    /// Id of the next unit.
    pub(super) next_unit: u64,
}

impl Transaction<'_> {
    /// A fresh id.
    ///
    /// # Errors
    /// [`EditError::TooMany`] where the scene has as many units as it may.
    pub(super) fn fresh_id(&mut self) -> Result<u64, EditError> {
        if self.state.units.len() >= MAX_UNITS {
            let remedy = "delete some first";
            return Err(EditError::TooMany { what: "editable units", limit: MAX_UNITS, remedy });
        }
        let id = self.next_unit;
        self.next_unit += 1;
        Ok(id)
    }

    /// Puts a unit in place.
    pub(super) fn insert(&mut self, unit: Unit) {
        self.state.units.insert(unit.id, unit);
    }

    /// Sets the focus to the names that the command addressed.
    pub(super) fn focus_on(&mut self, names: Vec<String>) {
        self.state.focus = names;
    }

    /// Removes neutral derived units, and names of deleted units from the focus.
    pub(super) fn prune(&mut self) {
        self.state.units.retain(|_, unit| !unit.derived || !(unit.is_neutral() || unit.mask.is_none()));
        self.state.prune_focus();
    }
}

/// Names of the changed units, in the order of the changes; deleted ones by their former names.
pub(super) fn affected_units(changes: &[Change], before: &EditState) -> Vec<String> {
    let mut names = Vec::new();
    for change in changes {
        let name = match change {
            Change::Base(base) => Some(base.name.clone()),
            Change::Unit(unit) => Some(unit.name.clone()),
            Change::Deleted(id) => before.units.get(id).map(|u| u.name.clone()),
            _ => None,
        };
        names.extend(name.filter(|n| !names.contains(n)));
    }
    names
}
