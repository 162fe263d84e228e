//! Deletion of Gaussians, and their return.
//!
//! The state holds one mask of deleted Gaussians. It alone decides whether a Gaussian exists. The masks of units and of the
//! selection never contain a deleted one, so that their readers need no second look. A unit keeps its deleted members apart,
//! so that they return to it.

use std::sync::Arc;

use sg_proto::scene::DeleteGaussians;

use super::error::EditError;
use super::membership::gaussians;
use super::state::{BaseUnitState, EditState};
use super::transaction::Transaction;
use sg_scene::mask::Mask;

impl EditState {
    /// The deleted Gaussians. No unit and no selection contains one, and none is drawn.
    #[must_use]
    pub fn deleted(&self) -> &Arc<Mask> {
        &self.deleted
    }

    /// Number of Gaussians that are not deleted.
    #[must_use]
    pub fn existing_count(&self) -> usize {
        self.base.iter().map(BaseUnitState::existing).sum()
    }

    /// The Gaussians that are not deleted.
    #[must_use]
    pub fn existing(&self) -> Mask {
        self.rest_of(&Mask::empty(self.count()))
    }

    /// The Gaussians that are neither deleted nor in `members`.
    pub(super) fn rest_of(&self, members: &Mask) -> Mask {
        let mut rest = members.clone();
        rest.union_with(&self.deleted);
        rest.invert();
        rest
    }
}

impl Transaction<'_> {
    pub(super) fn delete_gaussians(&mut self, command: &DeleteGaussians) -> Result<String, EditError> {
        let target = self.state.resolve(command.target.as_ref())?;
        if target.members.is_none() {
            return Err(EditError::EmptyTarget(target.phrase));
        }
        self.refuse_locked(&target)?;
        for unit in self.state.units.values_mut().filter(|u| u.mask.intersects(&target.members)) {
            let mut gone = (*unit.mask).clone();
            gone.intersect_with(&target.members);
            let mask = Arc::make_mut(&mut unit.mask);
            mask.subtract(&gone);
            if let Some(earlier) = &unit.deleted {
                gone.union_with(earlier);
            }
            unit.deleted = Some(Arc::new(gone));
        }
        let mut deleted = (*self.state.deleted).clone();
        deleted.union_with(&target.members);
        self.set_deleted(deleted);
        // The steps of a selection could bring deleted Gaussians back into it.
        let mut selected = (**self.state.selection.mask()).clone();
        selected.subtract(&target.members);
        self.select_mask(selected);
        self.focus_on(target.names);
        Ok(format!("deleted {}: {}", target.phrase, gaussians(target.members.count())))
    }

    /// Brings all deleted Gaussians back, to the saved units that they belonged to.
    pub(super) fn restore_gaussians(&mut self) -> Result<String, EditError> {
        let count = self.state.deleted.count();
        if count == 0 {
            return Err(EditError::NothingDeleted);
        }
        for unit in self.state.units.values_mut() {
            if let Some(deleted) = unit.deleted.take() {
                Arc::make_mut(&mut unit.mask).union_with(&deleted);
            }
        }
        self.set_deleted(Mask::empty(self.state.count()));
        let selected = (**self.state.selection.mask()).clone();
        self.select_mask(selected);
        Ok(format!("restored all deleted Gaussians: {}", gaussians(count)))
    }

    /// The only place that changes which Gaussians exist.
    fn set_deleted(&mut self, deleted: Mask) {
        for base in &mut self.state.base {
            base.deleted = base.range().filter(|i| deleted.get(*i)).count();
        }
        self.state.deleted = Arc::new(deleted);
    }
}
