//! Where to look from: framing, orbiting and zooming. Pure functions of cameras.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use sg_scene::camera::Camera;
use sg_scene::model::{Scene, SceneBox};

/// Share of the picture's half width and height that a framed box leaves free.
pub const MARGIN: f64 = 0.05;

/// Vertical field of view of the default view, in degrees.
pub const FIELD_OF_VIEW: f64 = 40.0;

/// The nearest camera that looks along `direction` (from the eye to the box) at the middle of `bounds` and has all of the
/// box in the picture with [`MARGIN`] to spare.
///
/// `up` is the scene direction that points up in the picture; the vertical field of view is in degrees and is taken between
/// 1 and 170; a box without extent is framed as a unit cube, a direction of no length as +z.
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

/// A first look at a scene.
///
/// Scenes with editable shading come from volumes: the view is oblique with z up. Plain 3DGS scenes have y down and
/// z forward like their cameras: the view is from the front.
#[must_use]
pub fn default_view(scene: &Scene, width: u32, height: u32) -> Camera {
    let from_volume = scene.units.iter().any(|u| u.gaussians.shading.is_some());
    let (direction, up) = if from_volume { (DVec3::new(-0.5, 0.8, -0.35), DVec3::Z) } else { (DVec3::Z, DVec3::NEG_Y) };
    frame(visible_box(scene), direction, up, FIELD_OF_VIEW, width, height)
}

/// The box of the finite centers with unit transforms, without the outermost half percent on each side of each
/// axis. Trained scenes have outliers that would make everything else tiny.
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

/// The camera carried around `target` by the turn `rotation` of the scene frame.
fn carried(camera: &Camera, target: DVec3, rotation: DQuat) -> Camera {
    let turn =
        DMat4::from_translation(target) * DMat4::from_quat(rotation.inverse()) * DMat4::from_translation(-target);
    with_view(camera, camera.view() * turn)
}

fn with_view(camera: &Camera, view: DMat4) -> Camera {
    Camera { world_to_camera: view.transpose().to_cols_array(), ..camera.clone() }
}

/// The camera moved on a sphere around `target`, in degrees: to its right by `right`, to its top by `up`, as seen in the
/// picture. The distance stays, and so does where the target appears.
#[must_use]
pub fn orbit(camera: &Camera, target: DVec3, right: f64, up: f64) -> Camera {
    let axes = DMat3::from_mat4(camera.view()).transpose();
    let (down, to_the_right) = (axes.y_axis.normalize_or_zero(), axes.x_axis.normalize_or_zero());
    let rotation =
        DQuat::from_scaled_axis(-right.to_radians() * down) * DQuat::from_scaled_axis(-up.to_radians() * to_the_right);
    carried(camera, target, rotation)
}

/// The camera rolled about its viewing axis: the picture turns clockwise by `degrees`.
#[must_use]
pub fn roll(camera: &Camera, degrees: f64) -> Camera {
    with_view(camera, DMat4::from_rotation_z(degrees.to_radians()) * camera.view())
}

/// The camera moved towards `target` (`factor` above 1) or away from it, to 1/`factor` of the distance. A factor that is
/// not above 0 changes nothing.
#[must_use]
pub fn dolly(camera: &Camera, target: DVec3, factor: f64) -> Camera {
    if !(factor > 0.0 && factor.is_finite()) {
        return camera.clone();
    }
    let shift = (camera.eye() - target) * (1.0 / factor - 1.0);
    with_view(camera, camera.view() * DMat4::from_translation(-shift))
}

/// The camera with everything `factor` times larger in the picture, seen from the same place (a longer lens). A factor that
/// is not above 0 changes nothing.
#[must_use]
pub fn zoom(camera: &Camera, factor: f64) -> Camera {
    if !(factor > 0.0 && factor.is_finite()) {
        return camera.clone();
    }
    Camera { fx: camera.fx * factor, fy: camera.fy * factor, ..camera.clone() }
}

/// The camera with another picture size: the same vertical field of view, the principal point at the same share of the
/// picture, square pixels staying square.
#[must_use]
pub fn resized(camera: &Camera, width: u32, height: u32) -> Camera {
    let scale = f64::from(height) / f64::from(camera.height.max(1));
    Camera {
        width,
        height,
        fx: camera.fx * scale,
        fy: camera.fy * scale,
        cx: camera.cx / f64::from(camera.width.max(1)) * f64::from(width),
        cy: camera.cy * scale,
        ..camera.clone()
    }
}

/// The camera with `scale` times as many pixels each way, rounded, at least one. Unlike [`resized`] it keeps the
/// rays at all four edges, so rounding may change the shape of the pixels.
#[must_use]
pub fn scaled(camera: &Camera, scale: f64) -> Camera {
    let edge = |pixels: u32| ((f64::from(pixels) * scale).round() as u32).max(1);
    let (width, height) = (edge(camera.width), edge(camera.height));
    let (sx, sy) = (f64::from(width) / f64::from(camera.width), f64::from(height) / f64::from(camera.height));
    let Camera { fx, fy, cx, cy, .. } = *camera;
    Camera { width, height, fx: fx * sx, fy: fy * sy, cx: cx * sx, cy: cy * sy, ..camera.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
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

        #[test]
        fn orbiting_keeps_the_distance_and_comes_back(right in -170.0..170.0_f64, up in -80.0..80.0_f64) {
            let target = DVec3::new(1.0, 2.0, 3.0);
            let camera = Camera::look_at(DVec3::new(4.0, 2.0, 0.0), target, DVec3::Y, 50.0, 64, 64);
            let moved = orbit(&camera, target, right, up);
            prop_assert!((moved.eye().distance(target) - camera.eye().distance(target)).abs() < 1e-9);
            prop_assert!((seen(&moved, target) - seen(&camera, target)).length() < 1e-9);
            let there = orbit(&orbit(&camera, target, right, 0.0), target, -right, 0.0);
            prop_assert!(there.eye().distance(camera.eye()) < 1e-9);
        }
    }

    #[test]
    fn orbit_goes_where_it_says() {
        // Looking along +z with y down: right is +x, up is −y.
        let camera = Camera::look_at(DVec3::new(0.0, 0.0, -2.0), DVec3::ZERO, DVec3::NEG_Y, 50.0, 64, 64);
        assert!(orbit(&camera, DVec3::ZERO, 90.0, 0.0).eye().distance(DVec3::new(2.0, 0.0, 0.0)) < 1e-12);
        assert!(orbit(&camera, DVec3::ZERO, 0.0, 90.0).eye().distance(DVec3::new(0.0, -2.0, 0.0)) < 1e-12);
    }

    #[test]
    fn zoom_dolly_roll_and_resize() {
        let camera = Camera::look_at(DVec3::new(0.0, 0.0, -4.0), DVec3::ZERO, DVec3::NEG_Y, 50.0, 64, 48);
        let p = DVec3::new(0.5, 0.25, 0.0);
        let middle = DVec2::new(32.0, 24.0);
        let off = seen(&camera, p) - middle;
        assert!((seen(&zoom(&camera, 2.0), p) - middle - 2.0 * off).length() < 1e-9);
        let near = dolly(&camera, DVec3::ZERO, 2.0);
        assert!(near.eye().distance(DVec3::new(0.0, 0.0, -2.0)) < 1e-12);
        assert!((seen(&near, p) - middle - 2.0 * off).length() < 1e-9);
        let rolled = seen(&roll(&camera, 90.0), p) - middle;
        assert!((rolled - DVec2::new(-off.y, off.x)).length() < 1e-9, "clockwise: right goes down");
        let large = resized(&camera, 200, 96);
        assert!((seen(&large, p) - DVec2::new(100.0, 48.0) - 2.0 * off).length() < 1e-9);
        for nothing in [0.0, -1.0, f64::NAN] {
            assert_eq!(dolly(&camera, DVec3::ZERO, nothing), camera);
            assert_eq!(zoom(&camera, nothing), camera);
        }
    }
}
