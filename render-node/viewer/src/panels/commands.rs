//! Changes as commands of the scene, and the edit under a hand.

use egui::Ui;
use glam::Vec3;
use sg_edit::wire::{encode_axis, encode_color, encode_mask};
use sg_edit::{EditError, EditState, Part};
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    CommitSelection, DeleteGaussians, DuplicateGaussians, MergeUnits, SetColor, SetLock, SetOpacity, SetTone, SetView,
    SetVisibility, ShowOnly, Target, set_view,
};
use sg_scene::orientation::Axis;

use super::output::{Draft, Output};
use super::panel::Panel;
use super::state::{ActiveEdit, Panels};

/// One unit by its name.
pub(super) fn unit(name: &str) -> Target {
    Target { units: vec![name.to_owned()], ..Target::default() }
}

/// The whole scene.
pub(super) fn everything() -> Target {
    Target { everything: true, ..Target::default() }
}

/// A unit's colour; `None` gives its own back.
pub(super) fn set_color(name: &str, rgb: Option<Vec3>) -> Action {
    Action::SetColor(SetColor { target: Some(unit(name)), color: rgb.map(encode_color) })
}

/// A unit's factor on the opacity.
pub(super) fn set_opacity(name: &str, factor: f32) -> Action {
    Action::SetOpacity(SetOpacity { target: Some(unit(name)), factor, relative: false })
}

/// Terms of a unit's tone; absent ones stay.
pub(super) fn set_tone(name: &str, terms: &SetTone) -> Action {
    Action::SetTone(SetTone { target: Some(unit(name)), ..terms.clone() })
}

/// Merges units into the first one, or into a new one of this name.
pub(super) fn merge(units: Vec<String>, name: String) -> Action {
    Action::MergeUnits(MergeUnits { units, name })
}

/// Shows or hides.
pub(super) fn set_visibility(target: Target, visible: bool) -> Action {
    Action::SetVisibility(SetVisibility { target: Some(target), visible })
}

/// Locks a unit, or unlocks it.
pub(super) fn set_lock(name: &str, locked: bool) -> Action {
    Action::SetLock(SetLock { target: Some(unit(name)), locked })
}

/// Shows one unit and hides all else.
pub(super) fn show_only(name: &str) -> Action {
    Action::ShowOnly(ShowOnly { target: Some(unit(name)) })
}

/// Frames a target from the present direction.
pub(super) fn focus(target: Target) -> Action {
    Action::SetView(SetView { change: Some(set_view::Change::Focus(target)) })
}

/// Deletes the selected Gaussians.
pub(crate) fn delete_selection() -> Action {
    let target = Some(Target { selection: true, ..Target::default() });
    Action::DeleteGaussians(DeleteGaussians { target })
}

/// Copies the selected Gaussians; the copies are selected afterwards.
pub(crate) fn duplicate_selection() -> Action {
    let target = Some(Target { selection: true, ..Target::default() });
    Action::DuplicateGaussians(DuplicateGaussians { target, ..DuplicateGaussians::default() })
}

/// Deletes everything but the selected Gaussians.
pub(crate) fn crop_to_selection() -> Action {
    let target = Some(Target { selection: true, complement: true, ..Target::default() });
    Action::DeleteGaussians(DeleteGaussians { target })
}

/// Selects every visible Gaussian.
///
/// # Errors
/// Where nothing is visible.
pub(crate) fn select_visible(state: &EditState) -> Result<Action, EditError> {
    let mask = Some(encode_mask(&state.part(Part::Visible)?));
    Ok(Action::CommitSelection(CommitSelection { mask, ..CommitSelection::default() }))
}

/// Turns a direction of the scene up; `None` for the file's own.
pub(crate) fn turn_up(up: Option<Axis>) -> Action {
    Action::SetView(SetView { change: Some(set_view::Change::Up(encode_axis(up).into())) })
}

/// Frames the selection from the present direction.
pub(crate) fn frame_selection() -> Action {
    focus(Target { selection: true, ..Target::default() })
}

impl Panels {
    /// A control of the drawn panel is moving: the change is a draft until the hand lets go.
    pub(super) fn hold(&mut self, action: Action) {
        let said = self.held.as_ref().is_some_and(|held| held.action == action && held.said);
        self.held = Some(ActiveEdit { panel: self.drawing, action, said });
    }

    /// Called at the end of a panel: continues the edit under the hand, or requests it once after release.
    pub(super) fn settle(&mut self, panel: Panel, ui: &Ui, output: &mut Output) {
        if !ui.input(|i| i.pointer.any_down()) {
            output.join(self.put_away(panel));
        } else if let Some(held) = self.held.as_mut().filter(|held| held.panel == panel.name && !held.said) {
            held.said = true;
            output.draft = Some(Draft::Hold(held.action.clone()));
        }
    }

    /// Ends the edit of a closed panel and returns its request.
    #[must_use]
    pub fn put_away(&mut self, panel: Panel) -> Output {
        let mut output = Output::default();
        if let Some(held) = self.held.take_if(|held| held.panel == panel.name) {
            output.change(held.action.clone());
            output.draft = Some(Draft::Release(held.action));
        }
        if self.select.dragged_in == panel.name {
            output.requests.extend(self.select.drag.release(self.revision));
        }
        output
    }
}
