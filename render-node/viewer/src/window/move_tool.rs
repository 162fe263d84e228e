//! The tool that moves, turns and scales the selection: by a gizmo and by numbers.

use std::sync::Arc;

use glam::DVec3;
use sg_edit::{EditState, middle};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Target, TransformGaussians};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;

use super::gizmo::{AXES, Change, Drag, Handle};
use crate::display::{LatestWorker, Request};
use crate::panels::Draft;

/// What a middle is of.
type Middle = (Arc<Scene>, Arc<Mask>);

/// The tool that moves the selection.
pub(super) struct MoveTool {
    /// Finds the middle of the selection.
    pub(super) worker: LatestWorker<Middle, (Middle, Option<DVec3>)>,
    pub(super) wanted: Option<Middle>,
    pub(super) found: Option<(Middle, Option<DVec3>)>,
    pub(super) drag: Option<Drag>,
    pub(super) hovered: Option<Handle>,
    /// The change under the hand or in the numbers, and the pivot that it is about.
    pub(super) change: Change,
    pub(super) pivot: Option<DVec3>,
    /// What the display has to show of it, once.
    pub(super) draft: Option<Draft>,
    /// Whether a change is shown that was not asked for yet.
    pub(super) is_pending: bool,
    /// Whether such a change was given up, and the display has not heard of it.
    pub(super) is_dropped: bool,
}

/// Whether two are of the very same scene and selection.
fn same(a: &Middle, b: &Middle) -> bool {
    Arc::ptr_eq(&a.0, &b.0) && Arc::ptr_eq(&a.1, &b.1)
}

impl MoveTool {
    /// A tool without a change. `wake` is called when the middle of a selection is found.
    ///
    /// # Errors
    /// The system's error if it cannot start a thread.
    pub(super) fn new(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let work = |of: Middle| {
            let found = middle(&of.0, &of.1);
            (of, found)
        };
        Ok(Self {
            worker: LatestWorker::new("finds-middle", work, wake)?,
            wanted: None,
            found: None,
            drag: None,
            hovered: None,
            change: Change::default(),
            pivot: None,
            draft: None,
            is_pending: false,
            is_dropped: false,
        })
    }

    /// Forgets a change that was not applied.
    pub(super) fn clear(&mut self) {
        self.is_dropped |= self.is_pending;
        (self.drag, self.hovered, self.draft) = (None, None, None);
        (self.change, self.is_pending) = (Change::default(), false);
    }

    /// Whether a change that was shown is given up, and the draft to show now; each once.
    pub(super) fn take_draft(&mut self) -> (bool, Option<Draft>) {
        (std::mem::take(&mut self.is_dropped), self.draft.take())
    }

    /// Whether no middle is computed or waits.
    pub(super) fn is_idle(&self) -> bool {
        self.worker.is_idle()
    }

    /// The middle of the selection, as far as it is known. A change under way keeps the one that it is about.
    pub(super) fn middle(&mut self, scene: &Arc<Scene>, selected: &Arc<Mask>) -> Option<DVec3> {
        if let Some(found) = self.worker.take() {
            self.found = Some(found);
        }
        let of = (Arc::clone(scene), Arc::clone(selected));
        if self.is_pending {
            return self.pivot;
        }
        if !self.wanted.as_ref().is_some_and(|wanted| same(wanted, &of)) {
            self.worker.submit(of.clone());
            self.wanted = Some(of.clone());
        }
        // That of a former place is better than none: a released gizmo stays where it is until its middle is known again.
        let of_selection = |found: &&(Middle, Option<DVec3>)| found.0.1 == *selected;
        self.found.as_ref().filter(of_selection).and_then(|(_, middle)| *middle)
    }

    /// The change as a command on the selection; `None` for one that changes nothing.
    fn action(&self) -> Option<Action> {
        let (change, pivot) = (self.change, self.pivot?);
        if change.is_none() {
            return None;
        }
        let vector = sg_edit::wire::encode_vector;
        let axis = AXES.get(change.axis).filter(|_| change.degrees != 0.0).map(|(axis, ..)| vector(*axis));
        Some(Action::TransformGaussians(TransformGaussians {
            target: Some(Target { selection: true, ..Target::default() }),
            pivot: Some(vector(pivot)),
            shift: (change.shift != DVec3::ZERO).then(|| vector(change.shift)),
            axis,
            degrees: change.degrees,
            factor: (change.factor != 1.0).then_some(change.factor),
            ..TransformGaussians::default()
        }))
    }

    /// Shows the change.
    pub(super) fn hold(&mut self, change: Change) {
        if change == self.change && self.is_pending {
            return;
        }
        (self.change, self.is_pending) = (change, true);
        // The way back to the scene's own state has to be shown too: a shift by nothing.
        let target = Some(Target { selection: true, ..Target::default() });
        let nothing = || TransformGaussians { target, factor: Some(1.0), ..TransformGaussians::default() };
        self.draft = Some(Draft::Hold(self.action().unwrap_or_else(|| Action::TransformGaussians(nothing()))));
    }

    /// Asks for the change, which is shown until the scene has it.
    pub(super) fn apply(&mut self, requests: &mut Vec<Request>) {
        if let Some(action) = self.action() {
            requests.push(Request::Change(Box::new(action.clone())));
            self.draft = Some(Draft::Release(action));
        }
        let moved = self.pivot.map(|pivot| pivot + self.change.shift);
        if let Some((_, middle)) = &mut self.found {
            *middle = moved;
        }
        (self.drag, self.change, self.is_pending) = (None, Change::default(), false);
    }
}

/// Whether some selected Gaussian is elsewhere than in the file.
pub(super) fn is_moved(state: &EditState) -> bool {
    state.placements().iter().any(|part| part.members.intersects(state.selection().mask()))
}
