//! Motions of a pinhole camera: orbit, roll, dolly, zoom and other picture sizes. Pure functions; angles in degrees.

use glam::{DMat3, DMat4, DQuat, DVec3};

use crate::camera::Camera;

/// The camera carried around `target` by the turn `rotation` of the scene frame.
fn carried(camera: &Camera, target: DVec3, rotation: DQuat) -> Camera {
    let turn =
        DMat4::from_translation(target) * DMat4::from_quat(rotation.inverse()) * DMat4::from_translation(-target);
    with_view(camera, camera.view() * turn)
}

fn with_view(camera: &Camera, view: DMat4) -> Camera {
    Camera { world_to_camera: view.transpose().to_cols_array(), ..camera.clone() }
}

/// The camera moved on a sphere around `target`, in degrees: `right` and `up` as seen in the picture. The distance and
/// the target's place in the picture stay.
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

/// The camera with another picture size. It keeps the vertical field of view, the relative principal point and square
/// pixels.
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

/// The camera with `scale` times as many pixels each way, rounded, at least one. Unlike [`resized`], it keeps the rays
/// at all four edges; pixels may become slightly oblong.
#[must_use]
pub fn scaled(camera: &Camera, scale: f64) -> Camera {
    let edge = |pixels: u32| ((f64::from(pixels) * scale).round() as u32).max(1);
    let (width, height) = (edge(camera.width), edge(camera.height));
    let (sx, sy) = (f64::from(width) / f64::from(camera.width), f64::from(height) / f64::from(camera.height));
    let Camera { fx, fy, cx, cy, .. } = *camera;
    Camera { width, height, fx: fx * sx, fy: fy * sy, cx: cx * sx, cy: cy * sy, ..camera.clone() }
}

/// As [`scaled`], of a picture that stands for the larger one for a while: see [`Camera::preview_scale`].
#[must_use]
pub fn preview(camera: &Camera, scale: f64) -> Camera {
    previewing([camera.width, camera.height], &scaled(camera, scale))
}

/// A camera whose picture stands for one of this width and height for a while: see [`Camera::preview_scale`].
#[must_use]
pub fn previewing([width, height]: [u32; 2], camera: &Camera) -> Camera {
    let share = |pixels: u32, whole: u32| f64::from(pixels) / f64::from(whole.max(1));
    let edge = share(camera.width, width).min(share(camera.height, height)).clamp(1e-6, 1.0);
    Camera { preview_scale: camera.preview_scale * edge, ..camera.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use proptest::prelude::*;

    /// Pixel coordinates of a scene point.
    fn seen(camera: &Camera, p: DVec3) -> DVec2 {
        let p = camera.view().transform_point3(p);
        assert!(p.z > 0.0);
        DVec2::new(camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy)
    }

    proptest! {
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
    fn an_orbit_turns_by_its_angles() {
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
