//! Lines of the scene frame over a window's picture, behind the eye's near side cut off and behind the surface in front faint.

use egui::{Color32, Pos2, Rect, Shape, Stroke, Vec2};
use glam::{DVec2, DVec3};
use sg_scene::camera::Camera;

use super::drawing::FrontSurface;
use super::scene_view::SceneView;

/// Points between two comparisons with the surface in front.
const PIECE: f64 = 8.0;

/// Most comparisons for one line.
const MOST_PIECES: f64 = 512.0;

/// Least depth of a drawn line, as a share of the distance from the eye to the target.
const NEAREST: f64 = 1e-3;

/// Share of its depth by which a line may lie behind the surface and still count as on it.
const SLACK: f64 = 2e-3;

/// The look of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LineStyle {
    /// Colour and opacity where nothing is in front of the line.
    pub(super) color: Color32,
    /// Width in points.
    pub(super) width: f32,
    /// Factor on the opacity behind the surface in front.
    pub(super) hidden: f32,
    /// Factor on the opacity where that surface is not known, such as in motion.
    pub(super) unknown: f32,
}

/// What lines are drawn over: a camera in a rectangle of the window, and the surface in front of it.
pub(super) struct SceneLines<'a> {
    camera: Camera,
    rect: Rect,
    nearest: f64,
    front: Option<&'a FrontSurface>,
}

impl SceneView {
    /// Lines over the picture in `rect`.
    pub(super) fn scene_lines(&self, rect: Rect) -> SceneLines<'_> {
        let camera = self.camera(rect);
        let view = self.navigator.view;
        let front = self.front.as_ref().filter(|front| front.is_of(&camera));
        SceneLines { camera, rect, nearest: NEAREST * view.eye.distance(view.target), front }
    }
}

impl SceneLines<'_> {
    /// The camera, one pixel a point, and whether the surface in front of it is known: lines are the same where both are.
    pub(super) fn seen_by(&self) -> (&Camera, bool) {
        (&self.camera, self.front.is_some())
    }

    /// Adds the visible parts of the line between two scene points to `shapes`.
    pub(super) fn add(&self, ends: [DVec3; 2], style: LineStyle, shapes: &mut Vec<Shape>) {
        let view = self.camera.view();
        let ends = ends.map(|end| view.transform_point3(end));
        let Some(ends) = before_eye(ends, self.nearest).filter(|_| ends.iter().all(|end| end.is_finite())) else {
            return;
        };
        let [from, to] = ends.map(|p| {
            DVec2::new(self.camera.fx * p.x, self.camera.fy * p.y) / p.z + DVec2::new(self.camera.cx, self.camera.cy)
        });
        let size = DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        let Some((first, last)) = within(from, to - from, size) else { return };
        let place = |t: f64| from.lerp(to, t);
        // Along a line on the picture the inverse of the depth is linear.
        let depth = |t: f64| 1.0 / (ends[0].z.recip() * (1.0 - t) + ends[1].z.recip() * t);
        let factor = |t: f64| match self.front {
            None => style.unknown,
            Some(front) => match front.at(place(t)) {
                Some(hit) if hit.depth < depth(t) * (1.0 - SLACK) => style.hidden,
                _ => 1.0,
            },
        };
        let count = match self.front {
            Some(_) => (place(first).distance(place(last)) / PIECE).ceil().clamp(1.0, MOST_PIECES),
            None => 1.0,
        };
        let at = |k: f64| first + (last - first) * k / count;
        let (mut begun, mut looks) = (0.0, factor(at(0.5)));
        let mut piece = |from: f64, to: f64, looks: f32| {
            let color = style.color.gamma_multiply(looks);
            if color.a() > 0 {
                let ends = [from, to].map(|k| self.on_screen(place(at(k))));
                shapes.push(Shape::line_segment(ends, Stroke::new(style.width, color)));
            }
        };
        for k in 1..count as u32 {
            let (k, next) = (f64::from(k), factor(at(f64::from(k) + 0.5)));
            if next != looks {
                piece(begun, k, looks);
                (begun, looks) = (k, next);
            }
        }
        piece(begun, count, looks);
    }

    fn on_screen(&self, place: DVec2) -> Pos2 {
        self.rect.min + Vec2::new(place.x as f32, place.y as f32)
    }
}

/// The part of a line in camera coordinates that lies at least `nearest` before the eye.
fn before_eye([a, b]: [DVec3; 2], nearest: f64) -> Option<[DVec3; 2]> {
    let cut = || a + (nearest - a.z) / (b.z - a.z) * (b - a);
    match (a.z >= nearest, b.z >= nearest) {
        (true, true) => Some([a, b]),
        (true, false) => Some([a, cut()]),
        (false, true) => Some([cut(), b]),
        (false, false) => None,
    }
}

/// The shares of a line on the picture, 0 to 1, between which it lies in a picture of this size.
fn within(from: DVec2, way: DVec2, size: DVec2) -> Option<(f64, f64)> {
    let (mut first, mut last) = (0.0_f64, 1.0_f64);
    for (at, by, most) in [(from.x, way.x, size.x), (from.y, way.y, size.y)] {
        if by == 0.0 {
            if !(0.0..=most).contains(&at) {
                return None;
            }
            continue;
        }
        let (a, b) = (-at / by, (most - at) / by);
        (first, last) = (first.max(a.min(b)), last.min(a.max(b)));
    }
    (first < last).then_some((first, last))
}

#[cfg(test)]
mod tests {
    use sg_scene::view::View;

    use super::*;

    const STYLE: LineStyle = LineStyle { color: Color32::WHITE, width: 1.0, hidden: 0.0, unknown: 1.0 };

    /// Ends of the drawn parts of a line, in a picture of 200 × 100 points at (10, 20), from the origin along +y.
    fn drawn(ends: [DVec3; 2]) -> Vec<[Pos2; 2]> {
        let view = View { eye: DVec3::ZERO, target: DVec3::Y, up: DVec3::Z, fov_y_degrees: 90.0 };
        let rect = Rect::from_min_size(Pos2::new(10.0, 20.0), Vec2::new(200.0, 100.0));
        let lines = SceneLines { camera: view.camera(200, 100), rect, nearest: 1e-3, front: None };
        let mut shapes = Vec::new();
        lines.add(ends, STYLE, &mut shapes);
        let ends =
            |shape: Shape| if let Shape::LineSegment { points, .. } = shape { points } else { panic!("{shape:?}") };
        shapes.into_iter().map(ends).collect()
    }

    #[test]
    fn a_line_is_where_the_camera_sees_it() {
        let found = drawn([DVec3::new(-0.5, 1.0, 0.0), DVec3::new(1.0, 2.0, 1.0)]);
        assert_eq!(found, [[Pos2::new(85.0, 70.0), Pos2::new(135.0, 45.0)]]);
    }

    #[test]
    fn a_line_through_the_eye_s_plane_ends_at_the_picture_s_edge() {
        // On the floor, from far ahead to behind the eye: it leaves the picture at the lower edge.
        let found = drawn([DVec3::new(0.0, 10.0, -1.0), DVec3::new(0.0, -10.0, -1.0)]);
        let [[a, b]] = found.as_slice() else { panic!("{found:?}") };
        assert!(
            (*a - Pos2::new(110.0, 75.0)).length() < 1e-3 && (*b - Pos2::new(110.0, 120.0)).length() < 1e-3,
            "{found:?}"
        );
        for nowhere in [
            [DVec3::new(0.0, -1.0, 0.0), DVec3::new(1.0, -2.0, 0.0)],
            [DVec3::new(5.0, 1.0, 0.0), DVec3::new(5.0, 1.0, 1.0)],
            [DVec3::new(0.0, f64::NAN, 0.0), DVec3::ONE],
        ] {
            assert_eq!(drawn(nowhere), Vec::<[Pos2; 2]>::new(), "{nowhere:?}");
        }
    }
}
