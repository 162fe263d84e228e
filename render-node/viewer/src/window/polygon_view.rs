//! The polygon under way on the window's picture: its corners by the mouse and the keys, and its lines.

use egui::{Color32, Key, Modifiers, Pos2, Rect, Response, Stroke, Ui};

use super::mouse_tool::MouseTool;
use super::polygon::{CLOSE, HINT};
use super::press::Press;
use super::scene_view::SceneView;
use crate::display::{BrushSign, Request, Tools, ViewState};
use crate::panels::theme::color_of;

impl SceneView {
    /// Takes Enter and Backspace for the polygon under way, before they are shortcuts of the window.
    pub(super) fn take_polygon_keys(&mut self, ui: &Ui) {
        if self.mouse_tool != MouseTool::Polygon || self.polygon.corners.is_empty() {
            return;
        }
        let (enter, back) = ui.input_mut(|i| {
            (i.consume_key(Modifiers::NONE, Key::Enter), i.count_and_consume_key(Modifiers::NONE, Key::Backspace))
        });
        self.polygon.is_closed |= enter;
        let left = self.polygon.corners.len().saturating_sub(back);
        self.polygon.corners.truncate(left);
    }

    /// Lets the mouse set the corners of a polygon, and requests its selection once it is closed.
    pub(super) fn draw_polygon(
        &mut self,
        ui: &Ui,
        response: &Response,
        alt: bool,
        sign: BrushSign,
        (state, tools): (&ViewState, &Tools),
        requests: &mut Vec<Request>,
    ) {
        if !state.services.selection {
            self.polygon.clear();
            return;
        }
        let Press { presses, is_down, at } = Press::of(ui, response, alt);
        let mut closed = std::mem::take(&mut self.polygon.is_closed);
        if presses.is_empty() {
            if let (Some(at), Some(last)) = (at, self.polygon.corners.last_mut())
                && self.polygon.is_held
                && is_down
            {
                *last = at;
            }
        } else {
            closed |= presses.into_iter().any(|at| self.polygon.press(at));
        }
        self.polygon.is_held &= is_down;
        if closed && self.polygon.corners.len() >= 3 {
            let corners = std::mem::take(&mut self.polygon).corners;
            requests.push(self.select_within(response.rect, &corners, sign, tools));
        }
    }

    /// Draws the polygon under way, with a line to the mouse, and the tool's instruction.
    pub(super) fn show_polygon(&self, ui: &Ui, rect: Rect) {
        if self.mouse_tool != MouseTool::Polygon {
            return;
        }
        super::tool_card::show(ui, rect, ("polygon", false), |ui| {
            ui.label(HINT);
        });
        let (mouse, shift) = ui.input(|i| (i.pointer.hover_pos().filter(|at| rect.contains(*at)), i.modifiers.shift));
        let corners = &self.polygon.corners;
        let Some(first) = corners.first() else { return };
        let closes = mouse.is_some_and(|at| self.polygon.closes_at(at));
        let end = if closes { Some(*first) } else { mouse };
        let line: Vec<Pos2> = corners.iter().copied().chain(end).collect();
        let color = color_of(if shift { BrushSign::Remove } else { BrushSign::Add });
        let painter = ui.painter_at(rect);
        for (width, color) in [(4.0, Color32::from_black_alpha(120)), (2.0, color)] {
            painter.line(line.clone(), Stroke::new(width, color));
        }
        for (k, corner) in corners.iter().enumerate() {
            let radius = if k == 0 && closes { CLOSE } else { 4.0 };
            painter.circle(*corner, radius, Color32::from_black_alpha(160), Stroke::new(2.0, color));
        }
    }
}
