//! A gizmo: arrows along the scene's axes that move, rings about them that turn, a square that scales. Pure functions of the camera
//! and the mouse.

use egui::{Color32, Painter, Pos2, Rect, Shape, Stroke, Vec2};
use glam::{DQuat, DVec2, DVec3};
use sg_scene::camera::Camera;

/// Points from the pivot to the tip of an arrow, at the usual size of text.
const ARM: f64 = 92.0;

/// The beginning of an arrow, and the radius of a ring, in arms.
const ARROW: f64 = 0.28;
const RING: f64 = 0.72;

/// Half the edge of the square, points.
const SQUARE: f64 = 8.0;

/// Points from a handle within which the mouse is on it.
const NEAR: f64 = 8.0;

/// Lines of a ring.
const PIECES: u32 = 64;

/// Points of the mouse, to the right and up, that double the size.
const DOUBLES: f64 = 120.0;

/// Cosine of the angle between a ring's axis and the line of sight below which the ring is seen from its edge.
const EDGE_ON: f64 = 0.15;

/// Degrees of a step of a turn with Ctrl.
const STEP: f64 = 15.0;

/// The scene's axes, with their colours: vermilion, bluish green and blue of Okabe and Ito, told apart with every kind of colour
/// vision.
pub(super) const AXES: [(DVec3, Color32, &str); 3] = [
    (DVec3::X, Color32::from_rgb(0xd5, 0x5e, 0x00), "x"),
    (DVec3::Y, Color32::from_rgb(0x00, 0x9e, 0x73), "y"),
    (DVec3::Z, Color32::from_rgb(0x56, 0xb4, 0xe9), "z"),
];

/// A part of the gizmo that a mouse takes hold of; numbers are those of [`AXES`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Handle {
    /// Moves along an axis.
    Arrow(usize),
    /// Turns about an axis.
    Ring(usize),
    /// Scales.
    Square,
}

/// A change of the selection about a pivot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Change {
    /// Scene coordinates.
    pub(super) shift: DVec3,
    /// Number of the axis of the turn.
    pub(super) axis: usize,
    /// Right-handed about the axis.
    pub(super) degrees: f64,
    /// Factor on lengths.
    pub(super) factor: f64,
}

impl Default for Change {
    fn default() -> Self {
        Self { shift: DVec3::ZERO, axis: 2, degrees: 0.0, factor: 1.0 }
    }
}

impl Change {
    /// Whether it leaves everything where it is.
    pub(super) fn is_none(&self) -> bool {
        self.shift == DVec3::ZERO && self.degrees == 0.0 && self.factor == 1.0
    }
}

/// A gizmo as a camera sees it.
pub(super) struct Gizmo<'a> {
    /// The camera of a picture that fills `rect`, one pixel a point.
    pub(super) camera: &'a Camera,
    pub(super) rect: Rect,
    /// Its middle, scene coordinates.
    pub(super) pivot: DVec3,
    /// Length of an arm, scene coordinates.
    arm: f64,
    scale: f64,
}

/// A handle under the mouse.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drag {
    pub(super) handle: Handle,
    /// The middle at the press.
    pub(super) pivot: DVec3,
    press: DVec2,
    last: DVec2,
    /// Degrees so far, which may be more than a whole turn.
    degrees: f64,
}

impl<'a> Gizmo<'a> {
    /// The gizmo at a place, as large as text of this scale. `None` for a place behind the eye.
    pub(super) fn new(camera: &'a Camera, rect: Rect, pivot: DVec3, scale: f64) -> Option<Self> {
        let depth = camera.view().transform_point3(pivot).z;
        let arm = ARM * scale * depth / camera.fy;
        (arm > 0.0 && arm.is_finite()).then_some(Self { camera, rect, pivot, arm, scale })
    }

    /// The place of a scene point in the picture.
    fn place(&self, point: DVec3) -> Option<DVec2> {
        let p = self.camera.view().transform_point3(point);
        let place = DVec2::new(self.camera.fx * p.x, self.camera.fy * p.y) / p.z;
        (p.z > 0.0 && place.is_finite()).then_some(place + DVec2::new(self.camera.cx, self.camera.cy))
    }

    /// The line of sight through a place of the picture: the eye and a direction.
    fn sight(&self, place: DVec2) -> (DVec3, DVec3) {
        let back = self.camera.view().inverse();
        let Camera { fx, fy, cx, cy, .. } = self.camera;
        let ray = DVec3::new((place.x - cx) / fx, (place.y - cy) / fy, 1.0);
        (back.transform_point3(DVec3::ZERO), back.transform_vector3(ray).normalize())
    }

    /// The corners of a ring.
    fn ring(&self, axis: DVec3) -> impl Iterator<Item = DVec3> {
        let (a, b) = axis.any_orthonormal_pair();
        let (pivot, radius) = (self.pivot, RING * self.arm);
        (0..=PIECES).map(move |k| {
            let (sine, cosine) = (std::f64::consts::TAU * f64::from(k) / f64::from(PIECES)).sin_cos();
            pivot + radius * (cosine * a + sine * b)
        })
    }

    /// Both ends of an arrow in the picture; `None` for one that points at the eye.
    fn arrow(&self, axis: DVec3) -> Option<[DVec2; 2]> {
        let ends = [ARROW, 1.0].map(|share| self.place(self.pivot + share * self.arm * axis));
        let [Some(from), Some(to)] = ends else { return None };
        (from.distance(to) > NEAR).then_some([from, to])
    }

    /// The handle at a place of the picture.
    pub(super) fn handle_at(&self, place: DVec2) -> Option<Handle> {
        let middle = self.place(self.pivot)?;
        if (place - middle).abs().max_element() <= self.scale * SQUARE + 2.0 {
            return Some(Handle::Square);
        }
        let near = NEAR * self.scale;
        let arrows = (0..).zip(&AXES).filter_map(|(k, (axis, ..))| {
            let [from, to] = self.arrow(*axis)?;
            Some((Handle::Arrow(k), from_segment(place, from, to)))
        });
        let rings = (0..).zip(&AXES).map(|(k, (axis, ..))| {
            let corners: Vec<DVec2> = self.ring(*axis).filter_map(|p| self.place(p)).collect();
            let pieces = corners.windows(2).map(|ends| from_segment(place, ends[0], ends[1]));
            (Handle::Ring(k), pieces.fold(f64::INFINITY, f64::min))
        });
        // An arrow that crosses a ring is on top.
        let nearest = |handles: &mut dyn Iterator<Item = (Handle, f64)>| {
            handles.filter(|(_, off)| *off <= near).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(handle, _)| handle)
        };
        nearest(&mut arrows.into_iter()).or_else(|| nearest(&mut rings.into_iter()))
    }

    /// Takes hold of a handle.
    pub(super) fn press(&self, handle: Handle, place: DVec2) -> Drag {
        Drag { handle, pivot: self.pivot, press: place, last: place, degrees: 0.0 }
    }

    /// The change by a drag to a place. The gizmo is the one of the press: its pivot does not move with the mouse.
    pub(super) fn drag(&self, drag: &mut Drag, place: DVec2, in_steps: bool) -> Change {
        let change = match drag.handle {
            Handle::Arrow(k) => {
                let axis = AXES[k].0;
                let along = |place| self.along(axis, place);
                let way = along(place).zip(along(drag.press)).map_or(0.0, |(to, from)| to - from);
                Change { shift: way * axis, ..Change::default() }
            }
            Handle::Ring(k) => {
                drag.degrees += self.turn(AXES[k].0, drag.last, place, drag.press);
                let degrees = if in_steps { (drag.degrees / STEP).round() * STEP } else { drag.degrees };
                Change { axis: k, degrees, ..Change::default() }
            }
            Handle::Square => {
                let way = place - drag.press;
                let factor = 2.0_f64.powf((way.x - way.y) / (DOUBLES * self.scale));
                Change { factor: factor.clamp(1e-3, 1e3), ..Change::default() }
            }
        };
        drag.last = place;
        change
    }

    /// How far along an axis through the pivot a place of the picture is: where the axis comes nearest to the line of sight. `None`
    /// for an axis that points at the eye.
    fn along(&self, axis: DVec3, place: DVec2) -> Option<f64> {
        let (eye, sight) = self.sight(place);
        let (across, to) = (axis.dot(sight), eye - self.pivot);
        let apart = 1.0 - across * across;
        (apart > 1e-4).then(|| (axis.dot(to) - across * sight.dot(to)) / apart)
    }

    /// Degrees about an axis from one place of the picture to another.
    fn turn(&self, axis: DVec3, from: DVec2, to: DVec2, press: DVec2) -> f64 {
        let (_, sight) = self.sight(press);
        if axis.dot(sight).abs() < EDGE_ON {
            // The plane of the ring is a line in the picture: the mouse rolls along it.
            let Some(middle) = self.place(self.pivot) else { return 0.0 };
            let (eye, _) = self.sight(middle);
            let front = self.pivot + RING * self.arm * (eye - self.pivot).reject_from(axis).normalize_or_zero();
            let ahead = DQuat::from_axis_angle(axis, 1e-3) * (front - self.pivot) + self.pivot;
            let (Some(at), Some(next)) = (self.place(front), self.place(ahead)) else { return 0.0 };
            let per_radian = (next - at) / 1e-3;
            let length = per_radian.length_squared();
            return if length > 0.0 { ((to - from).dot(per_radian) / length).to_degrees() } else { 0.0 };
        }
        let on_plane = |place| {
            let (eye, sight) = self.sight(place);
            let way = (self.pivot - eye).dot(axis) / sight.dot(axis);
            (way > 0.0 && way.is_finite()).then(|| eye + way * sight - self.pivot)
        };
        let (Some(a), Some(b)) = (on_plane(from), on_plane(to)) else { return 0.0 };
        axis.dot(a.cross(b)).atan2(a.dot(b)).to_degrees()
    }

    /// Draws it, with a handle marked.
    pub(super) fn show(&self, painter: &Painter, marked: Option<Handle>) {
        let at = |place: DVec2| self.rect.min + Vec2::new(place.x as f32, place.y as f32);
        let mut shapes: Vec<Shape> = Vec::new();
        let mut lines = |points: Vec<Pos2>, color: Color32, is_marked: bool| {
            let width = if is_marked { 4.5 } else { 2.5 };
            // A dark edge below makes lines visible on every picture.
            shapes.push(Shape::line(points.clone(), Stroke::new(width + 2.0, Color32::from_black_alpha(140))));
            shapes.push(Shape::line(points, Stroke::new(width, color)));
        };
        for (k, (axis, color, _)) in AXES.into_iter().enumerate() {
            let ring = self.ring(axis).filter_map(|p| self.place(p)).map(at).collect();
            lines(ring, color.gamma_multiply(0.9), marked == Some(Handle::Ring(k)));
        }
        for (k, (axis, color, _)) in AXES.into_iter().enumerate() {
            let Some([from, to]) = self.arrow(axis) else { continue };
            let is_marked = marked == Some(Handle::Arrow(k));
            lines(vec![at(from), at(to)], color, is_marked);
            let way = (to - from).normalize_or_zero();
            let size = self.scale * if is_marked { 11.0 } else { 9.0 };
            let tip = [to + size * way, to + 0.6 * size * way.perp(), to - 0.6 * size * way.perp()];
            lines(vec![at(tip[1]), at(tip[0]), at(tip[2]), at(tip[1])], color, false);
        }
        if let Some(middle) = self.place(self.pivot) {
            let half = self.scale * if marked == Some(Handle::Square) { 1.3 * SQUARE } else { SQUARE };
            let square = Rect::from_center_size(at(middle), Vec2::splat(2.0 * half as f32));
            shapes.push(Shape::rect_filled(square, 2.0, Color32::from_white_alpha(210)));
            shapes.push(Shape::rect_stroke(square, 2.0, Stroke::new(1.5, Color32::BLACK), egui::StrokeKind::Outside));
        }
        painter.extend(shapes);
    }

    /// The middle of a handle in the picture, for tests and for hints.
    #[cfg(test)]
    fn place_of(&self, handle: Handle) -> Option<DVec2> {
        match handle {
            Handle::Square => self.place(self.pivot),
            Handle::Arrow(k) => self.place(self.pivot + 0.8 * self.arm * AXES[k].0),
            Handle::Ring(k) => self.place(self.ring(AXES[k].0).nth(9)?),
        }
    }
}

/// Distance of a place from a line between two others.
fn from_segment(place: DVec2, from: DVec2, to: DVec2) -> f64 {
    let way = to - from;
    let along = ((place - from).dot(way) / way.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    place.distance(from + along * way)
}

#[cfg(test)]
mod tests {
    use sg_scene::view::View;

    use super::*;

    const PIVOT: DVec3 = DVec3::new(0.4, -0.2, 0.3);

    fn camera(eye: DVec3) -> Camera {
        View { eye, target: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 }.camera(600, 400)
    }

    fn gizmo(camera: &Camera) -> Gizmo<'_> {
        Gizmo::new(camera, Rect::from_min_size(Pos2::ZERO, Vec2::new(600.0, 400.0)), PIVOT, 1.0).unwrap()
    }

    const EYE: DVec3 = DVec3::new(3.0, -5.0, 2.5);

    #[test]
    fn every_handle_is_found_where_it_is_drawn() {
        let camera = camera(EYE);
        let gizmo = gizmo(&camera);
        for k in 0..3 {
            for handle in [Handle::Arrow(k), Handle::Ring(k), Handle::Square] {
                assert_eq!(gizmo.handle_at(gizmo.place_of(handle).unwrap()), Some(handle), "{handle:?}");
            }
        }
        assert_eq!(gizmo.handle_at(DVec2::new(3.0, 3.0)), None);
        let tip = gizmo.arrow(DVec3::X).unwrap()[1];
        assert!((tip.distance(gizmo.place(PIVOT).unwrap()) - ARM).abs() < 0.6 * ARM, "as large as the text says");
    }

    #[test]
    fn a_place_behind_the_eye_has_no_gizmo() {
        let camera = camera(EYE);
        let behind = EYE + (EYE - PIVOT);
        assert!(Gizmo::new(&camera, Rect::NOTHING, behind, 1.0).is_none());
    }

    #[test]
    fn an_arrow_follows_the_mouse_along_its_axis() {
        let camera = camera(EYE);
        let gizmo = gizmo(&camera);
        for (k, (axis, ..)) in AXES.into_iter().enumerate() {
            let press = gizmo.place_of(Handle::Arrow(k)).unwrap();
            let mut drag = gizmo.press(Handle::Arrow(k), press);
            let to = gizmo.place(PIVOT + (0.8 * gizmo.arm + 0.7) * axis).unwrap();
            let change = gizmo.drag(&mut drag, to, false);
            assert!((change.shift - 0.7 * axis).length() < 1e-9, "{k}: {}", change.shift);
            // Back at the press nothing has happened.
            assert!(gizmo.drag(&mut drag, press, false).shift.length() < 1e-12);
        }
    }

    #[test]
    fn a_ring_turns_with_the_mouse_and_more_than_once() {
        let camera = camera(EYE);
        let gizmo = gizmo(&camera);
        for (k, (axis, ..)) in AXES.into_iter().enumerate() {
            let corners: Vec<DVec2> = gizmo.ring(axis).filter_map(|p| gizmo.place(p)).collect();
            let mut drag = gizmo.press(Handle::Ring(k), corners[0]);
            let mut change = Change::default();
            for round in 0..2 {
                for corner in &corners[1..] {
                    change = gizmo.drag(&mut drag, *corner, false);
                }
                assert!((change.degrees.abs() - 360.0 * f64::from(round + 1)).abs() < 1e-6, "{k}: {}", change.degrees);
            }
            // The pair of a ring is right-handed about its axis or not: the turn has the sign of the corners' own.
            let [first, second] = [0, 1].map(|n| gizmo.ring(axis).nth(n).unwrap() - PIVOT);
            assert_eq!(change.degrees > 0.0, axis.dot(first.cross(second)) > 0.0);
            let stepped = gizmo.drag(&mut drag, corners[3], true).degrees;
            assert!((stepped / STEP).fract().abs() < 1e-9 && stepped != 0.0, "{stepped}");
        }
    }

    #[test]
    fn a_ring_seen_from_its_edge_rolls_with_the_mouse() {
        // The eye is in the plane of the ring about z.
        let eye = DVec3::new(0.4, -6.0, 0.3);
        let camera = View { eye, target: PIVOT, up: DVec3::Z, fov_y_degrees: 40.0 }.camera(600, 400);
        let gizmo = gizmo(&camera);
        let middle = gizmo.place(PIVOT).unwrap();
        let press = middle + DVec2::new(20.0, 0.0);
        let mut drag = gizmo.press(Handle::Ring(2), press);
        // The side before the eye goes along: to the right, counterclockwise from above.
        let change = gizmo.drag(&mut drag, press + DVec2::new(30.0, 0.0), false);
        assert!(change.degrees > 10.0 && change.degrees < 60.0, "{}", change.degrees);
        assert!(gizmo.arrow(DVec3::Y).is_none(), "the arrow along the line of sight is not drawn");
        let mut drag = gizmo.press(Handle::Arrow(1), middle);
        assert_eq!(gizmo.drag(&mut drag, middle + DVec2::X, false).shift, DVec3::ZERO);
    }

    #[test]
    fn the_square_doubles_to_the_right_and_halves_to_the_left() {
        let camera = camera(EYE);
        let gizmo = gizmo(&camera);
        let press = gizmo.place_of(Handle::Square).unwrap();
        let mut drag = gizmo.press(Handle::Square, press);
        for (way, factor) in [(DVec2::X * DOUBLES, 2.0), (-DVec2::X * DOUBLES, 0.5), (-DVec2::Y * DOUBLES, 2.0)] {
            assert!((gizmo.drag(&mut drag, press + way, false).factor - factor).abs() < 1e-12);
        }
        assert!(gizmo.drag(&mut drag, press, false).is_none());
    }
}
