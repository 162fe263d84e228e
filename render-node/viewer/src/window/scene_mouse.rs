//! Mouse and keys over the picture: the eye's motion, the wheel and the tools.

use egui::{Response, Sense as EguiSense, Ui, Vec2};
use glam::{DVec2, DVec3};

use super::mouse_tool::MouseTool;
use super::navigation::NavigationMode;
use super::scene_view::SceneView;
use crate::display::{BrushSample, BrushSign, Request, Tools, ViewState};

/// Points that one notch of the wheel scrolls.
const WHEEL: f64 = 75.0;

/// Factor on the eye's distance for one point of the wheel.
const NOTCH: f64 = 1.0015;

/// Way that keys fly in a second, as a share of the scene's length.
const SPEED: f64 = 0.4;

impl SceneView {
    /// Handles mouse and keys in `ui`; the picture fills all of it. Returns the resulting requests.
    pub(super) fn interact(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools) -> (Response, Vec<Request>) {
        let response = ui.allocate_rect(ui.available_rect_before_wrap(), EguiSense::click_and_drag());
        let rect = response.rect;
        let height = f64::from(rect.height().max(1.0));
        let (shift, alt, scroll, dt) = ui
            .input(|i| (i.modifiers.shift, i.modifiers.alt, i.smooth_scroll_delta(), f64::from(i.stable_dt.min(0.1))));
        let moved = |v: Vec2| DVec2::new(f64::from(v.x), f64::from(v.y)) / height;
        let delta = moved(response.drag_delta());
        self.notches = 0.0;
        let turned =
            |e: &egui::Event| if let egui::Event::MouseWheel { modifiers, .. } = e { Some(*modifiers) } else { None };
        // The rest of a smooth scroll keeps the modifiers of the wheel's turn.
        self.wheel = ui.input(|i| i.events.iter().rev().find_map(turned)).unwrap_or(self.wheel);
        if response.hovered() && scroll != Vec2::ZERO {
            // Shift turns the wheel sideways.
            let notches = f64::from(if scroll.y == 0.0 { scroll.x } else { scroll.y });
            if self.wheel.alt {
                self.notches = notches / WHEEL;
            } else if self.wheel.shift {
                tools.widen(NOTCH.powf(notches));
            } else {
                self.navigator.approach(NOTCH.powf(notches));
            }
        }
        let mut requests = Vec::new();
        let left = response.dragged_by(egui::PointerButton::Primary);
        let is_move = self.mouse_tool == MouseTool::Move;
        if !is_move {
            self.move_tool.clear();
        }
        let holds_gizmo = is_move && self.drag_gizmo(ui, &response, alt, (state, &*tools), &mut requests);
        let turns = response.dragged_by(egui::PointerButton::Middle) || (left && alt);
        if turns || (left && (self.mouse_tool == MouseTool::Navigate || (is_move && !holds_gizmo))) {
            self.navigator.turn(delta);
        } else if response.dragged_by(egui::PointerButton::Secondary) {
            self.navigator.slide(delta);
        }
        if response.hovered()
            && self.navigator.navigation_mode == NavigationMode::Fly
            && !ui.ctx().egui_wants_keyboard_input()
        {
            self.fly(ui, dt);
        }
        let sign = if shift { BrushSign::Remove } else { BrushSign::Add };
        if self.mouse_tool != MouseTool::Brush {
            self.hover = None;
        }
        if self.mouse_tool != MouseTool::Polygon {
            self.polygon.clear();
        }
        if !matches!(self.mouse_tool, MouseTool::Sphere | MouseTool::Box) {
            self.shape_tool.clear();
        }
        match self.mouse_tool {
            MouseTool::Navigate | MouseTool::Move => (),
            MouseTool::Brush => self.brush(ui, &response, alt, sign, tools, state, &mut requests),
            MouseTool::Lasso | MouseTool::Rectangle => {
                self.draw_around(&response, alt, sign, (state, tools), &mut requests);
            }
            MouseTool::Polygon => self.draw_polygon(ui, &response, alt, sign, (state, tools), &mut requests),
            MouseTool::Sphere | MouseTool::Box => {
                self.draw_shape(ui, &response, alt, sign, (state, tools), &mut requests);
            }
        }
        if response.double_clicked()
            && self.mouse_tool == MouseTool::Navigate
            && let Some(at) = response.interact_pointer_pos()
            && let Some(hit) = self.front_at(rect, at)
        {
            self.navigator.view.target = hit;
        }
        (response, requests)
    }

    fn fly(&mut self, ui: &Ui, dt: f64) {
        let way = ui.input(|i| {
            // With Ctrl, a letter is a shortcut.
            if i.modifiers.command {
                return DVec3::ZERO;
            }
            let axis = |plus, minus| f64::from(u8::from(i.key_down(plus))) - f64::from(u8::from(i.key_down(minus)));
            DVec3::new(
                axis(egui::Key::D, egui::Key::A),
                axis(egui::Key::E, egui::Key::Q),
                axis(egui::Key::W, egui::Key::S),
            )
        });
        if way != DVec3::ZERO {
            self.navigator.fly(way.normalize() * SPEED * self.navigator.length() * dt);
            ui.ctx().request_repaint();
        }
    }

    #[allow(clippy::too_many_arguments, reason = "one frame of one tool")]
    fn brush(
        &mut self,
        ui: &Ui,
        response: &Response,
        alt: bool,
        sign: BrushSign,
        tools: &Tools,
        state: &ViewState,
        requests: &mut Vec<Request>,
    ) {
        let at = response.hover_pos().or(response.interact_pointer_pos());
        let sample = at.and_then(|at| self.front_at(response.rect, at)).map(|at| BrushSample { at, pressure: 1.0 });
        self.hover = sample.map(|sample| (sample, sign));
        self.brush_controller.eye = Some(self.navigator.view.eye);
        if !state.services.selection {
            return;
        }
        // A stroke begins at the surface, independent of the press position in the picture.
        let (pressed, down) = ui.input(|i| (i.pointer.primary_pressed(), i.pointer.primary_down()));
        let here = response.is_pointer_button_down_on() || (pressed && response.hovered());
        match sample {
            Some(sample) if self.brush_controller.is_drawing() => self.brush_controller.sample(sample),
            Some(sample) if here && (down || pressed) && !alt => self.brush_controller.press(tools, sample, sign),
            _ => (),
        }
        requests.extend(self.brush_controller.pending_samples());
        if self.brush_controller.is_drawing() && !down {
            requests.extend(self.brush_controller.release());
        }
    }
}
