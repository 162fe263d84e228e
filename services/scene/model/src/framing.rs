//! Framing: the boxes and first views that put a scene into a picture. Scene coordinates, angles in degrees.
//!
//! [`framed`] makes every first view: of the command `render`, of windows, captures and named views. It fills the picture with
//! what is visible ([`Subject`]). Two directions exist, for two purposes:
//!
//! - [`initial_view`]: a scene as it is opened, from the front, in a square picture. Agents mean this direction by "front",
//!   "reset the view" returns to it, and stored scenes contain it. Displays and captures of another shape show
//!   [`initial_view_of`] their shape instead.
//! - [`default_camera`]: one picture of a file, without a camera. It looks obliquely, so that a single picture shows depth.
//!   Plain 3DGS scenes are seen from the side of their cameras. Committed pictures and measurements show it.

use glam::{DMat3, DVec3};

use crate::appearance::Appearance;
use crate::camera::Camera;
use crate::mask::Mask;
use crate::model::{Scene, SceneBox};
use crate::orientation::{Orientation, Side};
use crate::subject::Subject;
use crate::view::{FIELD_OF_VIEW, View};

/// Share of the weight that is taken for strays at either end of each axis when members are framed.
const STRAYS: f64 = 0.01;

/// The nearest view along `direction` (from the eye to the scene) that shows all that `appearance` draws in a picture of this
/// aspect, width over height. Without anything visible it shows [`framed_box`]. See [`Subject::view`].
#[must_use]
pub fn framed(
    scene: &Scene,
    appearance: &Appearance,
    (direction, up): (DVec3, DVec3),
    fov_y_degrees: f64,
    aspect: f64,
) -> View {
    let look = |subject: Subject| subject.view(direction, up, fov_y_degrees, aspect);
    look(Subject::of(scene, appearance))
        .or_else(|| look(Subject::of_box(framed_box(scene))))
        .unwrap_or_else(|| View::framing(scene.bounds, direction, up, fov_y_degrees))
}

/// The camera of a picture of a file for which nobody gives a camera.
///
/// Scenes with editable shading come from volumes and are seen obliquely, z up. Plain 3DGS scenes have y down and z
/// forward like their cameras, and are seen from the front. A file that gives its [`crate::orientation::Orientation`] outweighs
/// both. The background is black.
#[must_use]
pub fn default_camera(scene: &Scene, width: u32, height: u32) -> Camera {
    default_camera_of(scene, &Appearance::of(scene), width, height)
}

/// As [`default_camera`], of what `appearance` draws.
#[must_use]
pub fn default_camera_of(scene: &Scene, appearance: &Appearance, width: u32, height: u32) -> Camera {
    let aspect = f64::from(width.max(1)) / f64::from(height.max(1));
    framed(scene, appearance, default_sight(scene), FIELD_OF_VIEW, aspect).camera(width, height)
}

/// The direction of [`default_camera`] from the eye to the scene, and the scene direction that points up in the picture.
#[must_use]
pub fn default_sight(scene: &Scene) -> (DVec3, DVec3) {
    let from_volume = scene.has_shading();
    let frame = scene.orientation.front_frame();
    let says_up = scene.orientation.patient.is_some() || scene.orientation.up.is_some();
    match (from_volume, says_up) {
        (true, _) => (frame * DVec3::new(-0.5, 0.8, -0.35), frame.z_axis),
        (false, true) => scene.orientation.direction_and_up(Side::Front),
        (false, false) => Orientation::OF_TRAINED.direction_and_up(Side::Front),
    }
}

/// Near distance of a scene that is not placed in a room, as a share of its longest edge: 5 cm where that is 10 m.
const NEAR: f64 = 0.005;

/// The distance from an eye within which Gaussians fade where nothing else sets it: a two-hundredth of the longest edge of
/// [`framed_box`], in the scene's unit.
#[must_use]
pub fn near_distance(scene: &Scene) -> f64 {
    let edge = framed_box(scene).size().max_element();
    if edge.is_finite() { NEAR * edge.max(0.0) } else { 0.0 }
}

/// The box of the finite centres with unit transforms, without the outermost half percent on each side of each axis.
/// Trained scenes have strays that would make all else tiny.
#[must_use]
pub fn visible_box(scene: &Scene) -> SceneBox {
    let centers: Vec<DVec3> = (0..scene.len()).filter_map(|i| scene.position(i)).filter(|p| p.is_finite()).collect();
    let axis = |k: usize| {
        let mut values: Vec<f64> = centers.iter().map(|p| p.to_array()[k]).collect();
        values.sort_unstable_by(f64::total_cmp);
        let stray = values.len() / 200;
        Some((*values.get(stray)?, *values.iter().rev().nth(stray)?))
    };
    match (axis(0), axis(1), axis(2)) {
        (Some(x), Some(y), Some(z)) => SceneBox { min: DVec3::new(x.0, y.0, z.0), max: DVec3::new(x.1, y.1, z.1) },
        _ => scene.bounds,
    }
}

/// The first view of a scene, before any edit: all of it from the front, in a square picture, with a vertical field of view of
/// [`FIELD_OF_VIEW`].
#[must_use]
pub fn initial_view(scene: &Scene) -> View {
    initial_view_of(scene, 1.0)
}

/// [`initial_view`] for pictures of another aspect, width over height.
#[must_use]
pub fn initial_view_of(scene: &Scene, aspect: f64) -> View {
    framed(scene, &Appearance::of(scene), scene.orientation.direction_and_up(Side::Front), FIELD_OF_VIEW, aspect)
}

/// The first view as pictures of a shape show it: [`initial_view`] stands for [`initial_view_of`] the picture's aspect. Every
/// other view stays.
#[derive(Debug, Clone, Copy)]
pub struct FirstView {
    square: View,
    /// The last aspect and its view.
    shaped: (f64, View),
}

impl FirstView {
    /// That of a scene.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        let square = initial_view(scene);
        Self { square, shaped: (1.0, square) }
    }

    /// `view` as a picture of this aspect shows it, width over height.
    pub fn shown(&mut self, scene: &Scene, view: View, aspect: f64) -> View {
        if view != self.square {
            return view;
        }
        if self.shaped.0 != aspect {
            self.shaped = (aspect, initial_view_of(scene, aspect));
        }
        self.shaped.1
    }
}

/// The box that is framed for a view of the whole scene.
///
/// A scene from a volume is framed by its stored box. Trained scenes have strays, and stored boxes ignore unit
/// transforms: for these it is [`robust_bounds`] of everything.
#[must_use]
pub fn framed_box(scene: &Scene) -> SceneBox {
    let placed = scene.units.iter().any(|u| u.transform != glam::DMat4::IDENTITY);
    let from_volume = scene.has_shading();
    if from_volume && !placed {
        scene.bounds
    } else {
        robust_bounds(scene, &Mask::full(scene.len())).unwrap_or(scene.bounds)
    }
}

/// The box of the members without the outermost `STRAYS` of their visible weight on either side of each axis. The
/// weight is opacity × squared mean scale. The box is widened by twice the weighted mean scale. Scene coordinates, with
/// unit transforms; `None` where no member is visible anywhere.
#[must_use]
pub fn robust_bounds(scene: &Scene, members: &Mask) -> Option<SceneBox> {
    struct Weighted {
        position: DVec3,
        weight: f64,
    }
    let mut weighted = Vec::new();
    let (mut total, mut spread) = (0.0, 0.0);
    for unit in &scene.units {
        let stretch = DMat3::from_mat4(unit.transform).determinant().abs().cbrt();
        for local in (0..unit.gaussians.len()).filter(|local| members.get(unit.first + local)) {
            let position = unit.transform.transform_point3(unit.gaussians.position[local].as_dvec3());
            let scale = stretch * unit.gaussians.scale(local).as_dvec3().element_sum() / 3.0;
            let weight = f64::from(unit.gaussians.opacity(local)) * scale * scale;
            if position.is_finite() && weight.is_finite() && weight > 0.0 {
                total += weight;
                spread += weight * scale;
                weighted.push(Weighted { position, weight });
            }
        }
    }
    if total <= 0.0 {
        return None;
    }
    let mut bounds = SceneBox { min: DVec3::ZERO, max: DVec3::ZERO };
    for axis in 0..3 {
        // A stable sort: equal coordinates keep the order of the scene, so that sums are the same everywhere.
        weighted.sort_by(|a, b| a.position[axis].total_cmp(&b.position[axis]));
        let reach = |order: &mut dyn Iterator<Item = &Weighted>| {
            let mut passed = 0.0;
            let mut at = 0.0;
            for w in order {
                at = w.position[axis];
                passed += w.weight;
                if passed >= STRAYS * total {
                    break;
                }
            }
            at
        };
        bounds.min[axis] = reach(&mut weighted.iter());
        bounds.max[axis] = reach(&mut weighted.iter().rev());
    }
    let pad = DVec3::splat(2.0 * spread / total);
    // With one heavy member the ends can cross; its own place is then the box.
    let (min, max) = (bounds.min.min(bounds.max) - pad, bounds.min.max(bounds.max) + pad);
    (min.is_finite() && max.is_finite()).then_some(SceneBox { min, max })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::test_scene;

    #[test]
    fn pictures_of_every_shape_show_the_whole_scene() {
        let scene = test_scene(&[("cloud", 300)]);
        for (width, height) in [(320, 240), (240, 320), (900, 60), (64, 64)] {
            let aspect = f64::from(width) / f64::from(height);
            let cameras =
                [default_camera(&scene, width, height), initial_view_of(&scene, aspect).camera(width, height)];
            for camera in cameras {
                let mut reach = 0.0_f64;
                for p in (0..scene.len()).filter_map(|i| scene.position(i)) {
                    let p = camera.view().transform_point3(p);
                    let across = (camera.fx * p.x / p.z).abs() / (0.5 * f64::from(width));
                    let upright = (camera.fy * p.y / p.z).abs() / (0.5 * f64::from(height));
                    assert!(p.z > 0.0 && across.max(upright) < 1.0, "{width} x {height}: {across} {upright}");
                    reach = reach.max(across.max(upright));
                }
                assert!(reach > 0.85, "{width} x {height} is filled to {reach}");
            }
        }
        let mut first = FirstView::of(&scene);
        let square = initial_view(&scene);
        assert_eq!(first.shown(&scene, square, 1.0), square);
        assert_eq!(first.shown(&scene, square, 0.5), initial_view_of(&scene, 0.5));
        let moved = square.orbited(10.0, 0.0);
        assert_eq!(first.shown(&scene, moved, 0.5), moved);
    }

    #[test]
    fn outliers_do_not_change_the_framing() {
        let mut scene = test_scene(&[("cloud", 400)]);
        let all = Mask::full(scene.len());
        let before = robust_bounds(&scene, &all).unwrap();
        scene.units[0].gaussians.position[7] = glam::Vec3::splat(1e6);
        scene.units[0].gaussians.position[8] = glam::Vec3::splat(f32::NAN);
        let after = robust_bounds(&scene, &all).unwrap();
        assert!((after.max - before.max).length() < 0.2 * before.size().length(), "{before:?} {after:?}");
        assert_eq!(robust_bounds(&scene, &Mask::empty(400)), None);
    }

    #[test]
    fn one_member_is_framed_by_its_own_size() {
        let scene = test_scene(&[("cloud", 10)]);
        let bounds = robust_bounds(&scene, &Mask::from_fn(10, |i| i == 3)).unwrap();
        let middle = 0.5 * (bounds.min + bounds.max);
        assert!((middle - scene.position(3).unwrap()).length() < 1e-9);
        assert!(bounds.longest_edge() > 0.0);
    }
}
