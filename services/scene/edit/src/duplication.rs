//! The command that duplicates Gaussians, and the state with other duplicates.
//!
//! Every mask grows with the scene. An undo takes the copies away again and makes all masks shorter.

use std::sync::Arc;

use sg_proto::scene::DuplicateGaussians;
use sg_scene::mask::Mask;

use super::change::StateMismatch;
use super::duplicates::{Duplicate, same_part};
use super::error::EditError;
use super::membership::gaussians;
use super::names::{checked_name, first_name, join_names};
use super::placement::Placement;
use super::state::{BaseUnitState, EditState, Selection, Unit};
use super::transaction::Transaction;

/// Most base units of copies: each takes a mask in every snapshot.
const MAX_DUPLICATES: usize = 64;
/// Most copies in all: this many times the Gaussians of the file, and this many where that is less.
const MAX_COPIES: (usize, usize) = (3, 1_000_000);
/// Behind the name of a copied unit.
const ENDING: &str = " copy";

impl EditState {
    /// The Gaussians that are not in the file, one entry for each of the last base units.
    #[must_use]
    pub fn duplicates(&self) -> &Arc<[Duplicate]> {
        &self.duplicates
    }

    /// The base unit of the file that the Gaussians of a base unit were copied from: itself for one of the file.
    #[must_use]
    pub(super) fn file_unit(&self, mut unit: usize) -> usize {
        let of_file = self.base.len() - self.duplicates.len();
        while let Some(duplicate) = unit.checked_sub(of_file).and_then(|k| self.duplicates.get(k)) {
            unit = self.originals_unit(duplicate.originals()).unwrap_or(0);
        }
        unit
    }

    /// The base unit of the first of some Gaussians.
    fn originals_unit(&self, originals: &Mask) -> Option<usize> {
        let first = originals.ones().next()?;
        self.base.iter().position(|base| base.range().contains(&first))
    }

    /// Replaces the copies. Base units of copies that stay keep their state, the others begin with the look of their originals.
    /// Masks get the new length: no new Gaussian is in one.
    pub(super) fn set_duplicates(&mut self, duplicates: Arc<[Duplicate]>) -> Result<(), StateMismatch> {
        let kept = self.duplicates.iter().zip(duplicates.iter()).take_while(|(a, b)| same_part(a, b)).count();
        let of_file = self.base.len() - self.duplicates.len();
        let mut next = self.clone();
        next.base.truncate(of_file + kept);
        next.duplicates = duplicates.iter().take(kept).cloned().collect();
        let remaining = next.count();
        for duplicate in duplicates.iter().skip(kept) {
            let (found, expected) = (duplicate.originals().len(), duplicate.range());
            let before = next.base.last().map_or(0, |base| base.range().end);
            if found != before {
                return Err(StateMismatch::Mask { found, expected: before });
            }
            let source = next.originals_unit(duplicate.originals()).and_then(|unit| next.base.get(unit));
            let within = |base: &&BaseUnitState| duplicate.originals().ones().all(|i| base.range().contains(&i));
            let source = source.filter(within).ok_or(StateMismatch::Originals)?.clone();
            let name = next.free_name(&format!("{}{ENDING}", source.name));
            next.base.push(BaseUnitState {
                name,
                first: expected.start,
                count: expected.len(),
                deleted: 0,
                locked: false,
                duplicated: true,
                ..source
            });
        }
        next.duplicates = duplicates;
        next.resize_masks(remaining);
        *self = next;
        Ok(())
    }

    /// Gives all masks the present number of Gaussians. None from `remaining` on stays in one.
    fn resize_masks(&mut self, remaining: usize) {
        let count = self.count();
        let resized = |mask: &Arc<Mask>| {
            if mask.len() == count && remaining >= count {
                return Arc::clone(mask);
            }
            Arc::new(mask.resized(remaining.min(mask.len())).resized(count))
        };
        for unit in self.units.values_mut() {
            unit.mask = resized(&unit.mask);
            unit.deleted = unit.deleted.as_ref().map(&resized).filter(|mask| !mask.is_none());
        }
        self.deleted = resized(&self.deleted);
        self.selection = Selection::new(resized(self.selection.mask()), Arc::clone(self.selection.steps()));
        let part = |part: &Placement| Placement { members: resized(&part.members), ..part.clone() };
        self.placements = self.placements.iter().map(part).filter(|part| !part.members.is_none()).collect();
    }
}

impl Transaction<'_> {
    pub(super) fn duplicate_gaussians(&mut self, command: &DuplicateGaussians) -> Result<String, EditError> {
        let target = self.state.resolve(command.target.as_ref())?;
        if target.members.is_none() {
            return Err(EditError::EmptyTarget(target.phrase));
        }
        let originals: Vec<usize> = target.members.ones().collect();
        let parts = self.parts_of_base_units(&target.members);
        self.check_room(parts.len(), originals.len())?;
        let names = self.names_of_copies(&command.name, &target.members, &parts)?;

        let first = self.state.count();
        let mut duplicates = self.state.duplicates.to_vec();
        for (_, part) in &parts {
            let before = duplicates.last().map_or(self.state.count(), |last| last.range().end);
            duplicates.push(Duplicate::of(Arc::new(part.resized(before))));
        }
        let malformed = |e: StateMismatch| EditError::Malformed { field: "duplicate_gaussians", reason: e.to_string() };
        self.state.set_duplicates(duplicates.into()).map_err(malformed)?;
        let new = self.state.base.len() - parts.len();
        for (base, name) in self.state.base.iter_mut().skip(new).zip(&names) {
            base.name.clone_from(name);
        }

        let count = self.state.count();
        // The copy of the k-th original is the k-th of all copies: both are in the order of base units.
        let copies = |mask: &Mask| {
            let mut copies = Mask::empty(count);
            (first..).zip(&originals).filter(|(_, i)| mask.get(**i)).for_each(|(copy, _)| copies.set(copy, true));
            copies
        };
        let looks: Vec<Unit> = self.state.units().filter(|unit| !unit.is_neutral()).cloned().collect();
        for look in looks {
            let mask = copies(&look.mask);
            if !mask.is_none() {
                let (id, name) = (self.fresh_id()?, self.state.free_name(&format!("{}{ENDING}", look.name)));
                let mask = Arc::new(mask);
                self.insert(Unit { id, name, mask, deleted: None, derived: true, locked: false, ..look });
            }
        }
        let moved = |part: &Placement| {
            let mut members = (*part.members).clone();
            members.union_with(&copies(&part.members));
            Placement { map: part.map, members: Arc::new(members) }
        };
        self.state.placements = self.state.placements.iter().map(moved).collect();
        let mut selected = Mask::empty(count);
        selected.select_range(first..count);
        self.select_mask(selected);
        self.focus_on(names.clone());
        Ok(format!("duplicated {} as {}: {}", target.phrase, join_names(&names), gaussians(originals.len())))
    }

    /// The base units that have some of these Gaussians, with theirs.
    fn parts_of_base_units(&self, members: &Mask) -> Vec<(usize, Mask)> {
        let part = |(i, base): (usize, &BaseUnitState)| {
            let mut part = Mask::empty(members.len());
            part.select_range(base.range());
            part.intersect_with(members);
            (!part.is_none()).then_some((i, part))
        };
        self.state.base.iter().enumerate().filter_map(part).collect()
    }

    fn check_room(&self, units: usize, copies: usize) -> Result<(), EditError> {
        let remedy = "undo earlier ones, or save the scene to a file and open that";
        if self.state.duplicates.len() + units > MAX_DUPLICATES {
            return Err(EditError::TooMany { what: "base units of duplicates", limit: MAX_DUPLICATES, remedy });
        }
        let of_file = self.state.geometry().count;
        let limit = of_file.saturating_mul(MAX_COPIES.0).max(MAX_COPIES.1);
        if self.state.count() - of_file + copies > limit {
            return Err(EditError::TooMany { what: "duplicated Gaussians", limit, remedy });
        }
        Ok(())
    }

    /// Names of the base units of copies: the given one, else that of a saved unit of just these Gaussians, else those of the base
    /// units, with an ending.
    fn names_of_copies(
        &mut self,
        given: &str,
        members: &Mask,
        parts: &[(usize, Mask)],
    ) -> Result<Vec<String>, EditError> {
        let saved = self.state.units().find(|unit| !unit.derived && *unit.mask == *members);
        let ended = |name: &str| format!("{}{ENDING}", name.strip_suffix(ENDING).unwrap_or(name));
        let saved = saved.map(|unit| ended(&unit.name));
        let given = match given.trim() {
            "" => None,
            name => Some(checked_name(name, "duplicate_gaussians.name")?),
        };
        if let Some(name) = &given {
            self.claim_name(name, None)?;
        }
        let mut names: Vec<String> = Vec::new();
        for (unit, _) in parts {
            let of_base = || self.state.base.get(*unit).map(|base| ended(&base.name)).unwrap_or_default();
            let stem = given.clone().or_else(|| saved.clone()).unwrap_or_else(of_base);
            let is_free = |name: &str| {
                let folded = name.to_lowercase();
                self.state.is_taken(name, None).is_none() && names.iter().all(|taken| taken.to_lowercase() != folded)
            };
            names.push(first_name(&stem, is_free));
        }
        Ok(names)
    }
}
