//! The command that merges units.

use std::sync::Arc;

use sg_proto::scene::{MergeUnits, Target};
use sg_scene::mask::Mask;
use sg_scene::tone::Tone;

use super::error::EditError;
use super::membership::gaussians;
use super::names::{checked_name, join_names};
use super::state::{BaseUnitState, Unit, UnitRef};
use super::transaction::Transaction;

impl Transaction<'_> {
    pub(super) fn merge_units(&mut self, command: &MergeUnits) -> Result<String, EditError> {
        let mut merged: Vec<UnitRef> = Vec::new();
        for name in &command.units {
            let unit = self.state.find(name)?;
            if !merged.contains(&unit) {
                merged.push(unit);
            }
        }
        let &[first, _, ..] = merged.as_slice() else {
            let reason = "one unit alone cannot be merged; name at least two".to_owned();
            return Err(EditError::Malformed { field: "merge_units.units", reason });
        };
        let target = Target { units: command.units.clone(), ..Target::default() };
        self.refuse_locked(&self.state.resolve(Some(&target))?)?;
        let names: Vec<String> = merged.iter().filter_map(|u| self.state.name_of(*u)).map(str::to_owned).collect();
        let first_name = names.first().cloned().unwrap_or_default();
        let name = match (command.name.trim().is_empty(), first) {
            (false, _) => checked_name(&command.name, "merge_units.name")?,
            (true, UnitRef::Editable(_)) => first_name,
            (true, UnitRef::Base(_)) => {
                let remedy = "it stays; give the merged unit a name of its own, or name a saved unit first";
                return Err(EditError::BaseUnit { name: first_name, verb: "renamed or enlarged", remedy });
            }
        };
        // The name of a unit that goes, or of the first one, is free.
        match self.state.is_taken(&name, Some(first)) {
            Some(unit @ UnitRef::Editable(_)) if merged.contains(&unit) => {}
            _ => self.claim_name(&name, Some(first))?,
        }
        if let UnitRef::Base(i) = first
            && self.state.base.get(i).is_some_and(|base| base.name.to_lowercase() == name.to_lowercase())
        {
            return Err(EditError::NameTaken(name));
        }
        let (mut mask, mut deleted) = (Mask::empty(self.state.count()), Mask::empty(self.state.count()));
        for unit in &merged {
            mask.union_with(&self.state.members(*unit));
            match unit {
                UnitRef::Base(i) => {
                    let mut gone = Mask::empty(self.state.count());
                    gone.select_range(self.state.base.get(*i).map_or(0..0, BaseUnitState::range));
                    gone.intersect_with(&self.state.deleted);
                    deleted.union_with(&gone);
                }
                UnitRef::Editable(id) => {
                    if let Some(gone) = self.state.units.get(id).and_then(|unit| unit.deleted.as_deref()) {
                        deleted.union_with(gone);
                    }
                }
            }
        }
        let mut parts = Vec::new();
        for unit in &merged {
            if let UnitRef::Editable(id) = unit {
                parts.extend(self.state.units.remove(id));
            }
        }
        let look = match first {
            UnitRef::Editable(id) => parts.into_iter().find(|unit| unit.id == id),
            UnitRef::Base(_) => None,
        };
        let look = match look {
            Some(look) => look,
            None => Unit {
                id: self.fresh_id()?,
                name: String::new(),
                mask: Arc::new(Mask::empty(0)),
                deleted: None,
                color: None,
                opacity: 1.0,
                visible: true,
                derived: false,
                locked: false,
                tone: Tone::NEUTRAL,
            },
        };
        let count = gaussians(mask.count());
        let deleted = (!deleted.is_none()).then(|| Arc::new(deleted));
        self.insert(Unit { name: name.clone(), mask: Arc::new(mask), deleted, derived: false, ..look });
        self.focus_on(vec![name.clone()]);
        Ok(format!("merged {} as {name}: {count}", join_names(&names)))
    }
}
