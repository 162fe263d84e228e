//! The gizmo on the window's picture: held by the mouse, with its numbers beside it.

use super::gizmo::{AXES, Change, Gizmo};
use super::mouse_tool::MouseTool;
use super::move_tool::is_moved;
use super::scene_view::SceneView;
use super::tool_card;
use super::window_ui::WindowUi;
use crate::display::{Request, Tools, ViewState};
use crate::panels::Output;
use egui::{DragValue, Grid, Rect, Response, Ui};
use glam::{DVec2, DVec3};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Target, TransformGaussians};
use sg_scene::orientation::LengthUnit;

/// A drag over one point changes a shift by this share of the scene's longest edge, an angle by so many degrees, a factor by so much.
const SPEEDS: (f64, f64, f64) = (1e-3, 1.0, 0.01);

/// Shares of the scene's longest edge: the finest step that numbers show, and the largest shift that they take.
const SHIFTS: (f64, f64) = (1e-5, 1e3);

/// Least and greatest factor that the numbers take.
const FACTORS: (f64, f64) = (1e-3, 1e3);

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
