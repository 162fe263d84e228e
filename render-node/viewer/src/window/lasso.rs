//! Lassos and rectangles: they select the visible surface within.

use egui::{Pos2, Rect, Response};
use glam::DVec2;
use sg_proto::scene::{Combine, InLasso, SelectionOperation, SelectionStep, selection_operation, selection_step};
use sg_proto::selection::StrokesRequest;
use sg_scene::camera::Camera;

use super::mouse_tool::MouseTool;
use super::scene_view::SceneView;
use crate::display::{BrushSign, Request, Tools, ViewState};

/// Fewest pixels between two corners of a lasso, and most corners.
const CORNER: (f32, usize) = (3.0, 2000);

/// Sample points per axis of the search for the surface within a lasso.
const SAMPLES: u32 = 32;

impl SceneView {
    /// Lets the mouse draw a lasso or a rectangle, and requests its selection on release.
    pub(super) fn draw_around(
        &mut self,
        response: &Response,
        alt: bool,
        sign: BrushSign,
        (state, tools): (&ViewState, &Tools),
        requests: &mut Vec<Request>,
    ) {
        if !state.services.selection {
            return;
        }
        let button = egui::PointerButton::Primary;
        // egui reports a drag after a few points of movement; the drag begins at the press. A cancelled drag does not begin
        // again.
        if response.drag_started_by(button) && !alt {
            self.lasso.extend(response.ctx.input(|i| i.pointer.press_origin()));
        }
        if response.dragged_by(button)
            && let (Some(first), Some(at)) = (self.lasso.first().copied(), response.interact_pointer_pos())
        {
            if self.mouse_tool == MouseTool::Rectangle {
                self.lasso = vec![first, Pos2::new(at.x, first.y), at, Pos2::new(first.x, at.y)];
            } else if self.lasso.last().is_none_or(|last| last.distance(at) >= CORNER.0) {
                self.lasso.push(at);
                self.lasso.truncate(CORNER.1);
            }
        }
        if response.drag_stopped() {
            let lasso = std::mem::take(&mut self.lasso);
            if lasso.len() >= 3 {
                requests.push(self.select_within(response.rect, &lasso, sign, tools));
            }
        }
    }

    /// The request that selects within a polygon of the picture, with *in front* to the lasso depth.
    pub(super) fn select_within(&self, rect: Rect, lasso: &[Pos2], sign: BrushSign, tools: &Tools) -> Request {
        let camera = self.camera(rect);
        let corners: Vec<DVec2> =
            lasso.iter().map(|p| *p - rect.min).map(|v| DVec2::new(v.x.into(), v.y.into())).collect();
        let surface = if tools.front_only { self.surface_within(&camera, &corners) } else { None };
        let far = surface.map_or(0.0, |depth| depth + tools.lasso_depth * self.scene.bounds.longest_edge());
        let found = InLasso {
            width: camera.width,
            height: camera.height,
            fx: camera.fx,
            fy: camera.fy,
            cx: camera.cx,
            cy: camera.cy,
            world_to_camera: camera.world_to_camera.to_vec(),
            polygon: corners.iter().flat_map(DVec2::to_array).collect(),
            near: 0.0,
            far,
        };
        let combine = match sign {
            BrushSign::Add => Combine::Add,
            BrushSign::Remove => Combine::Remove,
        };
        let operation = SelectionOperation {
            operation: Some(selection_operation::Operation::Lasso(found)),
            combine: combine.into(),
        };
        let step = SelectionStep { step: Some(selection_step::Step::Operation(operation)) };
        Request::Select(StrokesRequest {
            steps: vec![step],
            include_hidden: tools.include_hidden,
            ..StrokesRequest::default()
        })
    }

    /// Median depth of the surfaces seen within a polygon, along the view axis; `None` without a surface.
    fn surface_within(&self, camera: &Camera, corners: &[DVec2]) -> Option<f64> {
        let front = self.front.as_ref().filter(|f| !self.stereo && f.is_of(camera))?;
        let low = corners.iter().copied().reduce(DVec2::min)?;
        let high = corners.iter().copied().reduce(DVec2::max)?;
        let places = (0..SAMPLES * SAMPLES).map(|k| {
            let share = DVec2::new(f64::from(k % SAMPLES) + 0.5, f64::from(k / SAMPLES) + 0.5) / f64::from(SAMPLES);
            low + share * (high - low)
        });
        let seen = places.filter(|at| is_within(*at, corners)).filter_map(|at| Some(front.at(at)?.depth));
        let mut depths: Vec<f64> = seen.collect();
        depths.sort_by(f64::total_cmp);
        depths.get(depths.len() / 2).copied()
    }
}

/// Whether a place is within a polygon, by how often a line from it crosses the edges.
fn is_within(at: DVec2, corners: &[DVec2]) -> bool {
    let edges = corners.iter().zip(corners.iter().skip(1).chain(corners.first()));
    let crossed =
        edges.filter(|(a, b)| (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x));
    crossed.count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_within_what_goes_around_it() {
        let bent = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0]].map(DVec2::from);
        for (at, within) in [([1.0, 1.0], true), ([2.0, 3.0], false), ([2.0, 0.5], true), ([5.0, 1.0], false)] {
            assert_eq!(is_within(DVec2::from(at), &bent), within, "{at:?}");
        }
        assert!(!is_within(DVec2::ZERO, &[]));
    }
}
