//! Overlays of a window's picture: the brush's ring, a lasso, and proposals for a next stroke.

use egui::{Color32, Pos2, Rect, Stroke, Ui, Vec2};
use glam::{DVec2, DVec3};
use sg_scene::camera::Camera;

use super::scene_view::SceneView;
use crate::display::{BrushSign, Tools, ViewState};
use crate::panels::theme::{color_of, mark};

/// Position of a scene point in the window, and its depth along the axis; `None` behind the eye.
fn seen_at(camera: &Camera, rect: Rect, at: DVec3) -> Option<(Pos2, f64)> {
    let seen = camera.view().transform_point3(at);
    if seen.z <= 0.0 {
        return None;
    }
    let place = DVec2::new(camera.fx * seen.x, camera.fy * seen.y) / seen.z + DVec2::new(camera.cx, camera.cy);
    Some((rect.min + Vec2::new(place.x as f32, place.y as f32), seen.z))
}

impl SceneView {
    /// Numbers of the proposals, in front of everything: they mark a direction, not a hidden surface.
    pub(super) fn draw_markers(&self, ui: &Ui, rect: Rect, state: &ViewState) {
        if self.stereo {
            return;
        }
        let (painter, camera) = (ui.painter_at(rect), self.camera(rect));
        for k in 0..state.proposals().len() {
            let seen = state.proposal_at(self.scene.bounds, k).and_then(|at| seen_at(&camera, rect, at));
            let Some((at, _)) = seen.filter(|(at, _)| rect.contains(*at)) else { continue };
            mark(&painter, at, k, false);
        }
    }

    /// Draws the brush's tip in its size at that depth, or the lasso.
    pub(super) fn draw_brush_ring(&self, ui: &Ui, rect: Rect, tools: &Tools) {
        let painter = ui.painter_at(rect);
        let camera = self.camera(rect);
        if let Some((sample, sign)) = self.hover
            && let Some((at, depth)) = seen_at(&camera, rect, sample.at)
        {
            let radius = (camera.fy * self.brush_controller.radius(tools) / depth) as f32;
            painter.circle_stroke(at, radius + 1.0, Stroke::new(3.0, Color32::from_black_alpha(120)));
            painter.circle_stroke(at, radius, Stroke::new(1.5, color_of(sign)));
        }
        if self.lasso.len() > 1 {
            let sign = if ui.input(|i| i.modifiers.shift) { BrushSign::Remove } else { BrushSign::Add };
            let closed: Vec<Pos2> = self.lasso.iter().chain(self.lasso.first()).copied().collect();
            painter.line(closed, Stroke::new(2.0, color_of(sign)));
        }
    }
}
