//! Changes of a state: what an event carries, and what undo and redo apply.

use std::sync::Arc;

use glam::Vec3;
use sg_scene::appearance::ShadingTerm;
use sg_scene::camera::Light;
use sg_scene::mask::Mask;
use sg_scene::orientation::Axis;
use sg_scene::view::View;
use sg_volume::TransferFunction;

use super::duplicates::{self, Duplicate};
use super::placement::{self, Placement};
use super::state::{BaseUnitState, EditState, KeptView, Selection, Unit};

/// One value as it stands after a change.
#[derive(Debug, Clone, PartialEq)]
pub enum Change {
    /// A base unit.
    Base(BaseUnitState),
    /// An editable unit, new or changed.
    Unit(Unit),
    /// Id of an editable unit that is gone.
    Deleted(u64),
    /// The selection.
    Selection(Selection),
    /// All deleted Gaussians.
    DeletedGaussians(Arc<Mask>),
    /// All Gaussians that are not in the file. It comes before changes with masks of the new length.
    Duplicates(Arc<[Duplicate]>),
    /// All Gaussians that are not where the file has them.
    Placements(Arc<[Placement]>),
    /// The light.
    Light(Light),
    /// The background.
    Background(Vec3),
    /// The viewpoint.
    View(View),
    /// All kept viewpoints.
    KeptViews(Arc<[KeptView]>),
    /// The direction that is up; `None` for the file's own.
    Up(Option<Axis>),
    /// The transfer function in place of the file's; `None` for that of the file.
    TransferFunction(Option<Arc<TransferFunction>>),
    /// The shown part of the shading.
    Term(ShadingTerm),
    /// Names of the units that the last command addressed.
    Focus(Vec<String>),
}

/// A change that does not belong to this state.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StateMismatch {
    /// The base unit is not one of this scene.
    #[error("the scene has no base unit `{0}` with these Gaussians")]
    Base(String),
    /// Copies are of no Gaussian, or of Gaussians of several base units.
    #[error("a base unit of duplicates needs originals of one base unit")]
    Originals,
    /// The length of a mask is not the number of Gaussians.
    #[error("a mask of {found} Gaussians does not fit a scene of {expected}")]
    Mask {
        /// Its length.
        found: usize,
        /// Number of Gaussians.
        expected: usize,
    },
}

impl EditState {
    /// Applies one change.
    pub(crate) fn apply_change(&mut self, change: Change) -> Result<(), StateMismatch> {
        let expected = self.count();
        let fits = |mask: &Mask| {
            let found = mask.len();
            if found == expected { Ok(()) } else { Err(StateMismatch::Mask { found, expected }) }
        };
        match change {
            Change::Base(look) => {
                let same = |b: &&mut BaseUnitState| {
                    let is_named_so = b.duplicated || b.name == look.name;
                    b.range() == look.range() && b.duplicated == look.duplicated && is_named_so
                };
                match self.base.iter_mut().find(same) {
                    Some(base) => *base = look,
                    None => return Err(StateMismatch::Base(look.name)),
                }
            }
            Change::Unit(unit) => {
                fits(&unit.mask)?;
                unit.deleted.as_deref().map_or(Ok(()), fits)?;
                self.units.insert(unit.id, unit);
            }
            Change::Deleted(id) => {
                self.units.remove(&id);
            }
            Change::Selection(selection) => {
                fits(selection.mask())?;
                self.selection = selection;
            }
            Change::DeletedGaussians(deleted) => {
                fits(&deleted)?;
                self.deleted = deleted;
            }
            Change::Duplicates(duplicates) => self.set_duplicates(duplicates)?,
            Change::Placements(placements) => {
                placements.iter().try_for_each(|part| fits(&part.members))?;
                self.placements = placements;
            }
            Change::Light(light) => self.light = light,
            Change::Background(color) => self.background = color,
            Change::View(view) => self.view = view,
            Change::KeptViews(views) => self.kept_views = views,
            Change::Up(up) => self.up = up,
            Change::TransferFunction(function) => self.transfer_function = function,
            Change::Term(term) => self.term = term,
            Change::Focus(names) => self.focus = names,
        }
        Ok(())
    }

    /// Removes names of deleted units from the focus.
    pub(crate) fn prune_focus(&mut self) {
        let focus = std::mem::take(&mut self.focus);
        self.focus = focus.into_iter().filter(|name| self.names().any(|(n, _)| n == name)).collect();
    }

    /// The values of `after` that differ. [`Self::apply_change`] of each turns this state into `after`.
    pub(crate) fn changes_to(&self, after: &Self) -> Vec<Change> {
        let mut changes = Vec::new();
        if !duplicates::same(&self.duplicates, &after.duplicates) {
            let mut resized = self.clone();
            // Copies of a valid state fit every state of the same file.
            if resized.set_duplicates(Arc::clone(&after.duplicates)).is_ok() {
                changes.push(Change::Duplicates(Arc::clone(&after.duplicates)));
                // Readers tell a newer selection by its change.
                changes.push(Change::Selection(after.selection.clone()));
                resized.selection = after.selection.clone();
                changes.extend(resized.changes_to(after));
                return changes;
            }
        }
        let gone = self.units.keys().filter(|id| !after.units.contains_key(id));
        changes.extend(gone.map(|id| Change::Deleted(*id)));
        let looks = self.base.iter().zip(&after.base).filter(|(a, b)| a != b);
        changes.extend(looks.map(|(_, b)| Change::Base(b.clone())));
        let units =
            after.units.iter().filter(|(id, unit)| !self.units.get(id).is_some_and(|before| same(before, unit)));
        changes.extend(units.map(|(_, unit)| Change::Unit(unit.clone())));
        if self.selection != after.selection {
            changes.push(Change::Selection(after.selection.clone()));
        }
        if !Arc::ptr_eq(&self.deleted, &after.deleted) && self.deleted != after.deleted {
            changes.push(Change::DeletedGaussians(Arc::clone(&after.deleted)));
        }
        if !placement::same(&self.placements, &after.placements) {
            changes.push(Change::Placements(Arc::clone(&after.placements)));
        }
        if self.light != after.light {
            changes.push(Change::Light(after.light));
        }
        if self.background != after.background {
            changes.push(Change::Background(after.background));
        }
        if self.view != after.view {
            changes.push(Change::View(after.view));
        }
        if !Arc::ptr_eq(&self.kept_views, &after.kept_views) && self.kept_views != after.kept_views {
            changes.push(Change::KeptViews(Arc::clone(&after.kept_views)));
        }
        if self.up != after.up {
            changes.push(Change::Up(after.up));
        }
        if !self.has_function_of(after) {
            changes.push(Change::TransferFunction(after.transfer_function.clone()));
        }
        if self.term != after.term {
            changes.push(Change::Term(after.term));
        }
        if self.focus != after.focus {
            changes.push(Change::Focus(after.focus.clone()));
        }
        changes
    }
}

/// Equality of units that does not read masks which are the same allocation.
fn same(a: &Unit, b: &Unit) -> bool {
    (a.id, &a.name, a.color, a.opacity, a.visible, a.derived, a.locked, a.tone)
        == (b.id, &b.name, b.color, b.opacity, b.visible, b.derived, b.locked, b.tone)
        && (Arc::ptr_eq(&a.mask, &b.mask) || a.mask == b.mask)
        && a.deleted == b.deleted
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_scene::synthetic::test_scene;

    #[test]
    fn changes_of_another_scene_are_refused() {
        let scene = test_scene(&[("bone", 5)]);
        let mut state = EditState::of_scene(&scene, "", "");
        let other = BaseUnitState { name: "skin".into(), ..state.base[0].clone() };
        assert_eq!(state.apply_change(Change::Base(other)), Err(StateMismatch::Base("skin".into())));
        let short = Selection::new(Arc::new(Mask::empty(4)), Arc::new([]));
        assert_eq!(state.apply_change(Change::Selection(short)), Err(StateMismatch::Mask { found: 4, expected: 5 }));
    }
}
