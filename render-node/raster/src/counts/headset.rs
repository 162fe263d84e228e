//! The two cameras of a usual headset.

use glam::{DMat4, DVec3};
use sg_scene::camera::Camera;

/// Metres between the eyes.
pub const EYES_APART: f64 = 0.063;

/// Width and height of one eye's picture in pixels: what a Quest 3 recommends.
pub const HEADSET_SIZE: [u32; 2] = [2064, 2208];

/// Vertical field of view of one eye in degrees. Pixels are square.
pub const FIELD_OF_VIEW: f64 = 96.0;

/// Metres of the room from an eye within which Gaussians fade.
const NEAR: f64 = 0.05;

/// The parallel eyes of a headset whose middle is at the pose of `camera`, left eye first. `metre` is the length of a metre of the
/// room in the scene's unit, `size` that of one picture in pixels.
#[must_use]
pub fn headset(camera: &Camera, metre: f64, [width, height]: [u32; 2]) -> [Camera; 2] {
    let focal = 0.5 * f64::from(height) / (0.5 * FIELD_OF_VIEW.to_radians()).tan();
    [-0.5, 0.5].map(|side| {
        let moved = DMat4::from_translation(DVec3::new(-side * EYES_APART * metre, 0.0, 0.0)) * camera.view();
        Camera {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: 0.5 * f64::from(width),
            cy: 0.5 * f64::from(height),
            world_to_camera: moved.transpose().to_cols_array(),
            near: NEAR * metre,
            ..camera.clone()
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_eyes_are_63_millimetres_apart_and_parallel() {
        let middle = Camera::look_at(DVec3::new(3.0, -4.0, 2.0), DVec3::ZERO, DVec3::Z, 60.0, 8, 8);
        let [left, right] = headset(&middle, 100.0, HEADSET_SIZE);
        assert!(((right.eye() - left.eye()).length() - 6.3).abs() < 1e-9);
        assert!((0.5 * (left.eye() + right.eye()) - middle.eye()).length() < 1e-9);
        let x = middle.view().inverse().transform_vector3(DVec3::X);
        assert!((right.eye() - left.eye()).dot(x) > 0.0 && left.check("left").is_ok());
        assert_eq!((left.width, left.height, left.near), (2064, 2208, 5.0));
    }
}
