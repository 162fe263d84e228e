//! The orientation cube in the corner of a window's picture. It turns with the eye, and each side carries its label: a patient's
//! A, P, L, R, S and I, else the axis. A click on a side looks from there.

use egui::{Align2, Color32, FontId, Pos2, Rect, Sense, Shape, Stroke, Ui, Vec2};
use glam::{DVec2, DVec3};
use sg_scene::orientation::{Axis, Orientation};
use sg_scene::view::View;

use super::scene_view::SceneView;

/// Half an edge of the cube in points, at the usual text size.
const HALF: f32 = 24.0;

/// Points from the picture's edges to the middle of the cube: the corners of a turned cube reach √3 of half an edge.
pub(super) const INSET: f32 = 50.0;

/// Least share of a side's area that faces the eye and carries a label.
const READABLE: f64 = 0.25;

/// Share below which a side is a line on the picture, whose pointed corners would reach beyond the cube.
const EDGE_ON: f64 = 0.02;

/// Share from which a side faces the eye: a click then looks from the other side.
const FACES: f64 = 0.999;

/// Drag over this many half edges turns by half a circle.
const TURN: f32 = 4.0;

/// A visible side of the cube.
#[derive(Debug, Clone, PartialEq)]
struct CubeSide {
    /// The axis that it lies on.
    axis: Axis,
    /// Share of its area that faces the eye, 0 to 1.
    facing: f64,
    /// Its corners in order, in half edges from the middle of the cube, x to the right and y down.
    corners: [DVec2; 4],
    /// Its middle.
    middle: DVec2,
}

impl CubeSide {
    /// Whether a place, in half edges from the middle of the cube, is within the side.
    fn contains(&self, at: DVec2) -> bool {
        let turns = (0..4).map(|k| {
            let (a, b) = (self.corners[k], self.corners[(k + 1) % 4]);
            (b - a).perp_dot(at - a)
        });
        let (low, high) = turns.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(t), h.max(t)));
        low >= 0.0 || high <= 0.0
    }
}

/// The sides of a cube along the scene's axes that a view shows, without perspective. At most three; they do not overlap.
fn visible_sides(view: &View) -> Vec<CubeSide> {
    let Some(forward) = (view.target - view.eye).try_normalize() else { return Vec::new() };
    let Some(right) = forward.cross(view.up).try_normalize() else { return Vec::new() };
    let up = right.cross(forward);
    let flat = |p: DVec3| DVec2::new(p.dot(right), -p.dot(up));
    let side = |axis: Axis| {
        let normal = axis.vector();
        let facing = -normal.dot(forward);
        // Two edges of the side, whatever their sense: the other two axes in turn.
        let (a, b) = (DVec3::new(normal.y, normal.z, normal.x), DVec3::new(normal.z, normal.x, normal.y));
        let corners = [a + b, a - b, -a - b, b - a].map(|edge| flat(normal + edge));
        (facing > EDGE_ON).then(|| CubeSide { axis, facing, corners, middle: flat(normal) })
    };
    Axis::ALL.into_iter().filter_map(side).collect()
}

/// The colour of a side: that of its axis (Okabe and Ito's vermilion, bluish green and blue), darker where it turns away.
fn color(axis: Axis, facing: f64) -> Color32 {
    let [r, g, b] = match axis {
        Axis::PlusX | Axis::MinusX => [213.0, 94.0, 0.0],
        Axis::PlusY | Axis::MinusY => [0.0, 130.0, 95.0],
        Axis::PlusZ | Axis::MinusZ => [0.0, 114.0, 178.0],
    };
    let shade = |x: f64| (x * (0.45 + 0.4 * facing)) as u8;
    Color32::from_rgb(shade(r), shade(g), shade(b))
}

impl SceneView {
    /// Shows the cube at the picture's upper right corner, with its mouse: a click looks from a side, a drag turns the eye.
    pub(super) fn orientation_cube(&mut self, ui: &Ui, rect: Rect, orientation: Orientation, scale: f32) {
        let (half, inset) = (HALF * scale, INSET * scale);
        if self.stereo || rect.width().min(rect.height()) < 4.0 * inset {
            return;
        }
        let middle = Pos2::new(rect.right() - inset, rect.top() + inset);
        let area = Rect::from_center_size(middle, Vec2::splat(2.0 * inset - 8.0 * scale));
        let response = ui.interact(area, egui::Id::unique("orientation cube"), Sense::click_and_drag());
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, "orientation cube"));
        if response.dragged() {
            let delta = response.drag_delta() / (TURN * half);
            self.navigator.turn(DVec2::new(f64::from(delta.x), f64::from(delta.y)));
        }
        let sides = visible_sides(&self.navigator.view);
        let within = |at: Pos2| {
            let from = (at - middle) / half;
            let from = DVec2::new(f64::from(from.x), f64::from(from.y));
            sides.iter().find(|side| side.contains(from))
        };
        let pointed = response.hover_pos().and_then(within).map(|side| side.axis);
        let painter = ui.painter_at(rect);
        for side in &sides {
            let place = |at: DVec2| middle + half * Vec2::new(at.x as f32, at.y as f32);
            let fill = if pointed == Some(side.axis) { Color32::from_gray(200) } else { color(side.axis, side.facing) };
            let edge = Stroke::new(1.5, Color32::from_gray(230));
            painter.add(Shape::convex_polygon(side.corners.map(place).to_vec(), fill, edge));
            if side.facing > READABLE {
                let text = if pointed == Some(side.axis) { Color32::BLACK } else { Color32::WHITE };
                let label = orientation.label(side.axis);
                let size = if label.len() == 1 { 22.0 } else { 16.0 };
                // Narrow sides have small letters, so that none leaves its side.
                let font = FontId::proportional(scale * size * side.facing.sqrt() as f32);
                painter.text(place(side.middle), Align2::CENTER_CENTER, label, font, text);
            }
        }
        if response.clicked()
            && let Some(side) = response.interact_pointer_pos().and_then(within)
        {
            let axis = if side.facing > FACES { side.axis.opposite() } else { side.axis };
            self.look_from_side(orientation, axis);
        }
        response.on_hover_text("click a side to look from there; drag to turn");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_scene::orientation::PatientFrame;

    fn view(eye: DVec3, up: DVec3) -> View {
        View { eye, target: DVec3::ZERO, up, fov_y_degrees: 40.0 }
    }

    #[test]
    fn from_a_side_that_side_alone_is_seen_square_and_upright() {
        for patient in [None, Some(PatientFrame::Lps), Some(PatientFrame::Ras)] {
            let orientation = Orientation { patient, ..Orientation::default() };
            for axis in Axis::ALL {
                let (direction, up) = orientation.direction_and_up(orientation.side(axis));
                let sides = visible_sides(&view(-3.0 * direction, up));
                let [side] = sides.as_slice() else { panic!("{sides:?}") };
                assert_eq!((side.axis, side.facing), (axis, 1.0));
                assert!(side.corners.iter().all(|c| (c.abs() - DVec2::ONE).length() < 1e-12), "{side:?}");
                assert!(side.middle.length() < 1e-12 && side.contains(DVec2::new(0.9, -0.9)));
                assert!(!side.contains(DVec2::new(1.1, 0.0)));
            }
        }
    }

    #[test]
    fn a_patient_seen_from_the_front_right_has_anterior_left_of_right_and_superior_above() {
        // LPS: the patient's right is -x, anterior is -y. From there the eye sees R at the left of A.
        let eye = DVec3::new(-1.0, -1.0, 1.0);
        let sides = visible_sides(&view(4.0 * eye, DVec3::Z));
        let at = |letter: &str| {
            sides.iter().find(|side| PatientFrame::Lps.letter(side.axis) == letter).map(|side| side.middle).unwrap()
        };
        assert_eq!(sides.len(), 3);
        assert!(at("R").x < -0.5 && at("A").x > 0.5, "{sides:?}");
        assert!(at("S").y < -0.5 && at("S").x.abs() < 1e-12, "{sides:?}");
        // Sides do not overlap: each place within belongs to one of them.
        for (x, y) in (-20..=20).flat_map(|x| (-20..=20).map(move |y| (x, y))) {
            let place = DVec2::new(0.0813 * f64::from(x) + 0.001, 0.0813 * f64::from(y) + 0.002);
            assert!(sides.iter().filter(|side| side.contains(place)).count() <= 1, "{place}");
        }
    }

    #[test]
    fn the_cube_follows_the_picture() {
        // What the eye sees at the right lies at the right of the cube.
        let view = view(DVec3::new(3.0, -4.0, 2.0), DVec3::Z);
        let camera = view.camera(200, 200);
        for side in visible_sides(&view) {
            let seen = camera.view().transform_point3(0.01 * side.axis.vector());
            let seen = DVec2::new(seen.x, seen.y) / 0.01;
            assert!((seen - side.middle).length() < 1e-9, "{side:?} {seen}");
        }
    }

    #[test]
    fn a_view_that_looks_nowhere_shows_no_side() {
        assert_eq!(visible_sides(&view(DVec3::ZERO, DVec3::Z)), []);
        assert_eq!(visible_sides(&view(DVec3::Z, DVec3::Z)), []);
    }
}
