//! The sphere or box on the window's picture: drawn by the mouse, with its numbers beside it.

use egui::{Color32, Rect, Response, Shape as Drawn, Ui};
use glam::{DVec2, DVec3};
use sg_proto::scene::Combine;

use super::mouse_tool::MouseTool;
use super::press::Press;
use super::scene_lines::LineStyle;
use super::scene_view::SceneView;
use super::shape_tool::{BUTTONS, Drag, LEAST_DRAG, Reach, Shape, distance_from_sight};
use super::tool_card;
use crate::display::number_format::count;
use crate::display::{BrushSign, Request, Tools, ViewState};
use crate::panels::theme::color_of;

impl SceneView {
    /// Lets the mouse draw a sphere or a box about a place of the surface in front. Its release requests the selection; a click
    /// moves the shape there.
    pub(super) fn draw_shape(
        &mut self,
        ui: &Ui,
        response: &Response,
        alt: bool,
        sign: BrushSign,
        (state, tools): (&ViewState, &Tools),
        requests: &mut Vec<Request>,
    ) {
        if !state.services.selection || self.stereo {
            self.shape_tool.clear();
            return;
        }
        let is_box = self.mouse_tool == MouseTool::Box;
        if self.shape_tool.shape.is_some_and(|shape| is_box != matches!(shape.reach, Reach::HalfEdges(_))) {
            self.shape_tool.clear();
        }
        let bounds = self.scene.bounds;
        let Press { presses, is_down, at } = Press::of(ui, response, alt);
        if bounds.longest_edge() > 0.0
            && let Some(press) = presses.last().copied()
            && let Some(centre) = self.front_at(response.rect, press)
        {
            let before = self.shape_tool.shape;
            let none = if is_box { Reach::HalfEdges(DVec3::ZERO) } else { Reach::Radius(0.0) };
            let reach = before.map_or(none, |shape| shape.reach);
            self.shape_tool.shape = Some(Shape { centre, reach });
            self.shape_tool.drag = Some(Drag { press, before });
            self.shape_tool.is_changed = true;
        }
        if let Some(drag) = self.shape_tool.drag
            && let Some(Shape { centre, .. }) = self.shape_tool.shape
        {
            let is_click = at.is_none_or(|at| at.distance(drag.press) < LEAST_DRAG);
            if let Some(at) = at.filter(|_| !is_click) {
                let place = at - response.rect.min;
                let place = DVec2::new(place.x.into(), place.y.into());
                let reach = distance_from_sight(&self.camera(response.rect), place, centre);
                let reach = if is_box { Reach::HalfEdges(DVec3::splat(reach)) } else { Reach::Radius(reach) };
                self.shape_tool.shape = Some(Shape { centre, reach });
            }
            if !is_down {
                self.shape_tool.drag = None;
                if !is_click {
                    let combine = if sign == BrushSign::Add { Combine::Add } else { Combine::Remove };
                    self.apply_shape(combine, tools, requests);
                } else if drag.before.is_none() {
                    self.shape_tool.clear();
                }
            }
        }
        // The numbers of the card are to be added; only a drag takes away with Shift.
        let sign = if self.shape_tool.drag.is_some() { sign } else { BrushSign::Add };
        self.shape_tool.update(&self.scene, sign, state, tools.include_hidden);
    }

    fn apply_shape(&mut self, combine: Combine, tools: &Tools, requests: &mut Vec<Request>) {
        let Some(shape) = self.shape_tool.shape else { return };
        requests.extend(shape.request(self.scene.bounds, combine, tools.include_hidden));
        self.shape_tool.is_changed = false;
    }

    /// Draws the shape, and shows its numbers beside the picture with buttons that select by it.
    pub(super) fn show_shape(
        &mut self,
        ui: &Ui,
        rect: Rect,
        (state, tools): (&ViewState, &Tools),
        requests: &mut Vec<Request>,
    ) {
        let name = match self.mouse_tool {
            MouseTool::Sphere => "sphere",
            MouseTool::Box => "box",
            _ => return,
        };
        if self.stereo || !state.services.selection {
            return;
        }
        if let Some(shape) = self.shape_tool.shape {
            let removes = self.shape_tool.drag.is_some() && ui.input(|i| i.modifiers.shift);
            let color = color_of(if removes { BrushSign::Remove } else { BrushSign::Add });
            let mut drawn: Vec<Drawn> = Vec::new();
            let lines = self.scene_lines(rect);
            // A dark edge below makes the lines visible on every picture.
            for (color, width) in [(Color32::from_black_alpha(130), 4.0), (color, 2.0)] {
                let style = LineStyle { color, width, hidden: 0.3, unknown: 0.8 };
                for ends in shape.lines(self.navigator.view.eye) {
                    lines.add(ends, style, &mut drawn);
                }
            }
            ui.painter_at(rect).extend(drawn);
        }
        let (mut shape, inside) = (self.shape_tool.shape, self.shape_tool.preview.as_ref().map(|p| p.inside));
        let (length, unit) = (self.scene.bounds.longest_edge(), self.scene.orientation.unit);
        let mut asked = None;
        tool_card::show(ui, rect, (name, shape.is_some()), |ui| match &mut shape {
            None => {
                let reach = if name == "box" { "half an edge" } else { "the radius" };
                ui.label(format!(
                    "Press on the surface and drag: the press is the centre of the {name}, the way is {reach}. With Shift it \
                     takes away. Its numbers are here then."
                ));
            }
            Some(shape) => {
                shape.numbers(ui, length, unit);
                let inside = inside.map_or_else(String::new, |inside| format!("{} Gaussians inside", count(inside)));
                ui.label(inside);
                ui.horizontal_wrapped(|ui| {
                    for (name, combine, does) in BUTTONS {
                        if ui.button(name).on_hover_text(does).clicked() {
                            asked = Some(combine);
                        }
                    }
                });
                ui.weak("A click on the surface moves it there; Esc removes it.");
            }
        });
        if shape != self.shape_tool.shape {
            (self.shape_tool.shape, self.shape_tool.is_changed) = (shape, true);
            // Its preview is asked for at the next frame.
            ui.ctx().request_repaint();
        }
        if let Some(combine) = asked {
            self.apply_shape(combine, tools, requests);
        }
    }
}
