//! The tool that moves, turns and scales the selection: by a gizmo and by numbers.

use std::sync::Arc;

use egui::{DragValue, Grid, Rect, Response, Ui};
use glam::{DVec2, DVec3};
use sg_edit::{EditState, middle};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Target, TransformGaussians};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_scene::orientation::LengthUnit;

use super::gizmo::{AXES, Change, Drag, Gizmo, Handle};
use super::mouse_tool::MouseTool;
use super::scene_view::SceneView;
use super::tool_card;
use super::window_ui::WindowUi;
use crate::display::{LatestWorker, Request, Tools, ViewState};
use crate::panels::{Draft, Output};

/// A drag over one point changes a shift by this share of the scene's longest edge, an angle by so many degrees, a factor by so much.
const SPEEDS: (f64, f64, f64) = (1e-3, 1.0, 0.01);

/// Shares of the scene's longest edge: the finest step that numbers show, and the largest shift that they take.
const SHIFTS: (f64, f64) = (1e-5, 1e3);

/// Least and greatest factor that the numbers take.
const FACTORS: (f64, f64) = (1e-3, 1e3);

/// What a middle is of.
type Middle = (Arc<Scene>, Arc<Mask>);

/// The tool that moves the selection.
pub(super) struct MoveTool {
    /// Finds the middle of the selection.
    worker: LatestWorker<Middle, (Middle, Option<DVec3>)>,
    wanted: Option<Middle>,
    found: Option<(Middle, Option<DVec3>)>,
    drag: Option<Drag>,
    hovered: Option<Handle>,
    /// The change under the hand or in the numbers, and the pivot that it is about.
    change: Change,
    pivot: Option<DVec3>,
    /// What the display has to show of it, once.
    draft: Option<Draft>,
    /// Whether a change is shown that was not asked for yet.
    is_pending: bool,
    /// Whether such a change was given up, and the display has not heard of it.
    is_dropped: bool,
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
    fn middle(&mut self, scene: &Arc<Scene>, selected: &Arc<Mask>) -> Option<DVec3> {
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
    fn hold(&mut self, change: Change) {
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
    fn apply(&mut self, requests: &mut Vec<Request>) {
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
fn is_moved(state: &EditState) -> bool {
    state.placements().iter().any(|part| part.members.intersects(state.selection().mask()))
}

impl SceneView {
    /// Lets the mouse take hold of the gizmo. Its release requests the change. Returns whether the gizmo has the mouse.
    pub(super) fn drag_gizmo(
        &mut self,
        ui: &Ui,
        response: &Response,
        alt: bool,
        (state, tools): (&ViewState, &Tools),
        requests: &mut Vec<Request>,
    ) -> bool {
        if !state.services.scene || self.stereo || state.uncommitted || state.scene.selection().mask().is_none() {
            self.move_tool.clear();
            return false;
        }
        let rect = response.rect;
        let middle = self.move_tool.middle(&self.scene, state.scene.selection().mask());
        let camera = self.camera(rect);
        // A drag is about the gizmo of its press.
        let pivot = self.move_tool.drag.map(|drag| drag.pivot).or(middle);
        let Some(gizmo) = pivot.and_then(|pivot| Gizmo::new(&camera, rect, pivot, f64::from(tools.scale))) else {
            return self.move_tool.drag.is_some();
        };
        let (pressed, down, at, in_steps) = ui.input(|i| {
            (i.pointer.primary_pressed(), i.pointer.primary_down(), i.pointer.latest_pos(), i.modifiers.command)
        });
        let place = at.map(|at| at - rect.min).map(|at| DVec2::new(at.x.into(), at.y.into()));
        let tool = &mut self.move_tool;
        if let (Some(mut drag), Some(place)) = (tool.drag, place) {
            if down {
                tool.hold(gizmo.drag(&mut drag, place, in_steps));
                tool.drag = Some(drag);
            } else {
                tool.apply(requests);
            }
            return true;
        }
        tool.hovered = place.filter(|_| response.hovered() && !alt).and_then(|place| gizmo.handle_at(place));
        if let (Some(handle), Some(place), true) = (tool.hovered, place, pressed && !alt) {
            // A change of the numbers that was not applied is given up.
            tool.clear();
            (tool.hovered, tool.pivot) = (Some(handle), Some(gizmo.pivot));
            tool.drag = Some(gizmo.press(handle, place));
            return true;
        }
        false
    }

    /// Draws the gizmo, and shows its numbers beside the picture.
    pub(super) fn show_move_tool(
        &mut self,
        ui: &Ui,
        rect: Rect,
        (state, tools): (&ViewState, &Tools),
        requests: &mut Vec<Request>,
    ) {
        if self.mouse_tool != MouseTool::Move || self.stereo || !state.services.scene {
            return;
        }
        let is_empty = state.scene.selection().mask().is_none();
        let middle = if is_empty { None } else { self.move_tool.middle(&self.scene, state.scene.selection().mask()) };
        let camera = self.camera(rect);
        let tool = &self.move_tool;
        let shown = middle.map(|middle| middle + if tool.is_pending { tool.change.shift } else { DVec3::ZERO });
        if let Some(gizmo) = shown.and_then(|at| Gizmo::new(&camera, rect, at, f64::from(tools.scale))) {
            gizmo.show(&ui.painter_at(rect), tool.drag.map(|drag| drag.handle).or(tool.hovered));
        }
        let (length, unit) = (self.scene.bounds.longest_edge(), self.scene.orientation.unit);
        let mut change = self.move_tool.change;
        let (mut applies, mut gives_up, mut puts_back) = (false, false, false);
        let (is_ready, is_pending) = (middle.is_some(), self.move_tool.is_pending && !change.is_none());
        let is_moved = is_moved(&state.scene);
        tool_card::show(ui, rect, ("move", is_ready), |ui| {
            if state.uncommitted {
                ui.label("Updating…");
            } else if is_empty {
                ui.label("Nothing is selected. Select what is to be moved, for example with the brush (B).");
            } else if !is_ready {
                ui.label("Finding the middle of the selection…");
            } else {
                numbers(ui, &mut change, (length, unit));
                ui.horizontal_wrapped(|ui| {
                    let apply = ui.add_enabled(is_pending, egui::Button::new("apply"));
                    applies = apply.on_hover_text("moves the selection by these numbers, in one step").clicked();
                    gives_up = ui.add_enabled(is_pending, egui::Button::new("cancel")).clicked();
                    let back = ui.add_enabled(is_moved, egui::Button::new("put back"));
                    puts_back = back.on_hover_text("puts the selection where the file has it").clicked();
                });
                ui.weak("Arrows move, rings turn, the square scales; Ctrl turns in steps of 15°. Esc cancels.");
            }
        });
        if gives_up {
            self.move_tool.clear();
            ui.ctx().request_repaint();
        } else if (Change { axis: change.axis, ..self.move_tool.change }) == change && change.degrees == 0.0 {
            // Another axis of no turn.
            self.move_tool.change.axis = change.axis;
        } else if change != self.move_tool.change && self.move_tool.drag.is_none() {
            if !self.move_tool.is_pending {
                self.move_tool.pivot = middle;
            }
            self.move_tool.hold(change);
            // Its picture is asked for at the next frame.
            ui.ctx().request_repaint();
        }
        if applies {
            self.move_tool.apply(requests);
        } else if puts_back {
            self.move_tool.clear();
            let target = Some(Target { selection: true, ..Target::default() });
            let back = TransformGaussians { target, restore: true, ..TransformGaussians::default() };
            requests.push(Request::Change(Box::new(Action::TransformGaussians(back))));
        }
    }
}

impl WindowUi {
    /// Shows the change of the tool that moves the selection, or shows it no more. `newest` is the state without drafts: a released
    /// move shows until the scene is past that revision, and over its own result it would be shown twice.
    pub(super) fn take_move_draft(&mut self, ui: &Ui, newest: &ViewState) {
        let (is_dropped, draft) = self.scene_view.move_tool.take_draft();
        if is_dropped {
            self.drafts.drop_held();
        }
        if is_dropped || draft.is_some() {
            // The scene is found beside the loop, from the next frame on.
            ui.ctx().request_repaint();
        }
        Output { draft, ..Output::default() }.show_draft(&mut self.drafts, newest);
    }
}

/// The numbers of a change, in the scene's unit, where `length` is the scene's longest edge.
fn numbers(ui: &mut Ui, change: &mut Change, (length, unit): (f64, Option<LengthUnit>)) {
    let decimals = (-(SHIFTS.0 * length).log10()).ceil().clamp(0.0, 12.0) as usize;
    let number = |ui: &mut Ui, name: &str, field: DragValue<'_>, decimals: usize| {
        let text = move |x: f64, _| tool_card::plain(x, decimals);
        let response = ui.add(field.custom_formatter(text).update_while_editing(false));
        ui.ctx().accesskit_node_builder(response.id, |node| node.set_label(name));
    };
    Grid::new("numbers of a move").num_columns(4).show(ui, |ui| {
        ui.label(tool_card::in_unit("shift", unit));
        let DVec3 { x, y, z } = &mut change.shift;
        for (name, value) in [("shift x", x), ("shift y", y), ("shift z", z)] {
            let most = SHIFTS.1 * length;
            number(ui, name, DragValue::new(value).speed(SPEEDS.0 * length).range(-most..=most), decimals);
        }
        ui.end_row();
        ui.label("turn");
        number(ui, "degrees", DragValue::new(&mut change.degrees).speed(SPEEDS.1).suffix("°"), 2);
        ui.label("about");
        ui.horizontal(|ui| {
            for (k, (_, color, name)) in AXES.into_iter().enumerate() {
                ui.selectable_value(&mut change.axis, k, egui::RichText::new(name).color(color).strong());
            }
        });
        ui.end_row();
        ui.label("scale");
        let field = DragValue::new(&mut change.factor).speed(SPEEDS.2).range(FACTORS.0..=FACTORS.1).prefix("× ");
        number(ui, "factor", field, 4);
        ui.end_row();
    });
}
