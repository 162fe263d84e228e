//! Framing: the boxes and first views that put a scene into a picture. Scene coordinates, angles in degrees.
//!
//! Two first views exist, for two purposes:
//!
//! - [`initial_view`]: a scene as a window or headset opens it, at any aspect. It looks from the front over [`framed_box`].
//!   Agents mean this direction by "front", "reset the view" returns to it, and stored scenes contain it.
//! - [`default_camera`]: one picture of a file, without a camera. It looks obliquely over [`visible_box`], so that a single
//!   picture shows depth. Plain 3DGS scenes are seen from the side of their cameras. Committed pictures and measurements
//!   show it.

use glam::{DMat3, DVec2, DVec3};

use crate::camera::Camera;
use crate::mask::Mask;
use crate::model::{Scene, SceneBox};
use crate::view::{FIELD_OF_VIEW, MARGIN, Side, View};

/// Share of the weight that is taken for strays at either end of each axis when members are framed.
const STRAYS: f64 = 0.01;

/// The nearest camera along `direction` (from the eye to the box) that sees all of `bounds`, with [`MARGIN`] to spare.
/// The middle of the box is in the middle of the picture.
///
/// `up` is the scene direction that points up in the picture. The vertical field of view is in degrees, clamped to 1 to
/// 170. A box without extent counts as a unit cube, a direction of no length as +z.
#[must_use]
pub fn frame(bounds: SceneBox, direction: DVec3, up: DVec3, fov_y_degrees: f64, width: u32, height: u32) -> Camera {
    let middle = 0.5 * (bounds.min + bounds.max);
    let half = 0.5 * bounds.size();
    let half = if half.max_element() > 0.0 { half } else { DVec3::splat(0.5) };
    let direction = direction.try_normalize().unwrap_or(DVec3::Z);
    let fov = fov_y_degrees.clamp(1.0, 170.0);
    let at = |distance: f64| Camera::look_at(middle - distance * direction, middle, up, fov, width, height);
    let turn = DMat3::from_mat4(at(1.0).view());
    let tangent = (0.5 * fov.to_radians()).tan();
    let aspect = f64::from(width.max(1)) / f64::from(height.max(1));
    let tangent = (1.0 - MARGIN) * DVec2::new(tangent * aspect, tangent);
    // A corner at (x, y, z) from the middle, in camera axes, is inside from the distance |x|/tan − z on.
    let distance = (0..8)
        .map(|k| {
            let sign = |bit: u32| if k >> bit & 1 == 0 { 1.0 } else { -1.0 };
            let corner = turn * (half * DVec3::new(sign(0), sign(1), sign(2)));
            (corner.truncate().abs() / tangent).max_element() - corner.z
        })
        .fold(0.0, f64::max);
    at(distance)
}

/// The camera of a picture of a file for which nobody gives a camera.
///
/// Scenes with editable shading come from volumes and are seen obliquely, z up. Plain 3DGS scenes have y down and z
/// forward like their cameras, and are seen from the front. The box framed is [`visible_box`]; the background is black.
#[must_use]
pub fn default_camera(scene: &Scene, width: u32, height: u32) -> Camera {
    let from_volume = scene.units.iter().any(|u| u.gaussians.shading.is_some());
    let (direction, up) = if from_volume { (DVec3::new(-0.5, 0.8, -0.35), DVec3::Z) } else { (DVec3::Z, DVec3::NEG_Y) };
    frame(visible_box(scene), direction, up, FIELD_OF_VIEW, width, height)
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

/// The first view of an edited scene, as a display opens it: [`framed_box`] from the front, with a vertical field of view
/// of [`FIELD_OF_VIEW`].
#[must_use]
pub fn initial_view(scene: &Scene) -> View {
    View::from_side(framed_box(scene), Side::Front, FIELD_OF_VIEW)
}

/// The box that is framed for a view of the whole scene.
///
/// A scene from a volume is framed by its stored box. Trained scenes have strays, and stored boxes ignore unit
/// transforms: for these it is [`robust_bounds`] of everything.
#[must_use]
pub fn framed_box(scene: &Scene) -> SceneBox {
    let placed = scene.units.iter().any(|u| u.transform != glam::DMat4::IDENTITY);
    let from_volume = scene.units.iter().any(|u| u.gaussians.shading.is_some());
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
    use proptest::prelude::*;

    /// Pixel coordinates of a scene point.
    fn seen(camera: &Camera, p: DVec3) -> DVec2 {
        let p = camera.view().transform_point3(p);
        assert!(p.z > 0.0);
        DVec2::new(camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy)
    }

    fn corners(b: SceneBox) -> impl Iterator<Item = DVec3> {
        (0..8).map(move |k| {
            let pick = |bit: u32, low: f64, high: f64| if k >> bit & 1 == 0 { low } else { high };
            DVec3::new(pick(0, b.min.x, b.max.x), pick(1, b.min.y, b.max.y), pick(2, b.min.z, b.max.z))
        })
    }

    proptest! {
        #[test]
        fn a_framed_box_fills_the_picture_and_stays_inside(
            d in proptest::array::uniform3(-1.0..1.0_f64), s in proptest::array::uniform3(0.01..50.0_f64),
            c in proptest::array::uniform3(-1e4..1e4_f64), fov in 10.0..110.0_f64, width in 32_u32..2000, height in 32_u32..2000,
        ) {
            let middle = DVec3::from_array(c);
            let bounds = SceneBox { min: middle - DVec3::from_array(s), max: middle + DVec3::from_array(s) };
            prop_assume!(DVec3::from_array(d).length() > 0.01);
            let camera = frame(bounds, DVec3::from_array(d), DVec3::Z, fov, width, height);
            let size = DVec2::new(width.into(), height.into());
            let mut reach = 0.0_f64;
            for corner in corners(bounds) {
                let off = ((seen(&camera, corner) - 0.5 * size) / (0.5 * size)).abs().max_element();
                prop_assert!(off <= 1.0 - MARGIN + 1e-6, "{off}");
                reach = reach.max(off);
            }
            prop_assert!((reach - (1.0 - MARGIN)).abs() < 1e-6, "the box reaches to {reach}");
            prop_assert!(camera.check("framed").is_ok());
        }
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
