//! The directions that words such as "left" and "top" mean.

use glam::{DMat3, DVec3};
use sg_scene::view::View;

/// Largest cosine between two directions of a frame that still count as perpendicular.
const PERPENDICULAR: f64 = 1e-6;

/// Three perpendicular unit vectors in scene coordinates: what a text calls right, up and front.
///
/// For words about a picture they are the picture's own: front points to the viewer. For words about a patient they are the
/// patient's, so that "left" is the patient's left wherever the camera stands. Either handedness is allowed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    right: DVec3,
    up: DVec3,
    front: DVec3,
}

/// Directions that make no frame.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FrameError {
    /// A direction is zero or not finite.
    #[error("the direction `{0}` is zero or not finite; give a finite vector of any length above 0")]
    NoDirection(&'static str),
    /// Two directions are not perpendicular.
    #[error("the directions right, up and front are not perpendicular; give three that are")]
    Oblique,
}

impl Frame {
    /// Right is x, up is y, front is z.
    pub const XYZ: Self = Self { right: DVec3::X, up: DVec3::Y, front: DVec3::Z };

    /// A frame of three perpendicular directions of any length.
    ///
    /// # Errors
    /// [`FrameError`] if a direction is zero or not finite, or if two are not perpendicular.
    pub fn new(right: DVec3, up: DVec3, front: DVec3) -> Result<Self, FrameError> {
        let unit = |v: DVec3, name| v.try_normalize().ok_or(FrameError::NoDirection(name));
        let (right, up, front) = (unit(right, "right")?, unit(up, "up")?, unit(front, "front")?);
        let oblique = [right.dot(up), right.dot(front), up.dot(front)].iter().any(|c| c.abs() > PERPENDICULAR);
        if oblique { Err(FrameError::Oblique) } else { Ok(Self { right, up, front }) }
    }

    /// The frame of a picture: front points from the target to the eye.
    ///
    /// # Errors
    /// [`FrameError::NoDirection`] if the eye is at the target, or if up is zero or along the line of sight.
    pub fn of_view(view: &View) -> Result<Self, FrameError> {
        let front = (view.eye - view.target).try_normalize().ok_or(FrameError::NoDirection("front"))?;
        let right = view.up.cross(front).try_normalize().ok_or(FrameError::NoDirection("up"))?;
        Ok(Self { right, up: front.cross(right), front })
    }

    /// The direction right.
    #[must_use]
    pub fn right(&self) -> DVec3 {
        self.right
    }

    /// The direction up.
    #[must_use]
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// The direction to the front.
    #[must_use]
    pub fn front(&self) -> DVec3 {
        self.front
    }

    /// Coordinates of a scene vector along right, up and front.
    #[must_use]
    pub fn coordinates(&self, v: DVec3) -> DVec3 {
        DVec3::new(v.dot(self.right), v.dot(self.up), v.dot(self.front))
    }

    /// From coordinates along right, up and front to the scene.
    #[must_use]
    pub fn to_scene(&self) -> DMat3 {
        DMat3::from_cols(self.right, self.up, self.front)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_perpendicular_or_refused() {
        assert_eq!(Frame::new(DVec3::X * 3.0, DVec3::Y, DVec3::Z * 0.1), Ok(Frame::XYZ));
        assert_eq!(Frame::new(DVec3::X, DVec3::ONE, DVec3::Z), Err(FrameError::Oblique));
        assert_eq!(Frame::new(DVec3::X, DVec3::ZERO, DVec3::Z), Err(FrameError::NoDirection("up")));
        assert_eq!(Frame::new(DVec3::X, DVec3::Y, DVec3::NAN), Err(FrameError::NoDirection("front")));
    }

    #[test]
    fn the_frame_of_a_view_is_that_of_its_picture() {
        let view = View { eye: DVec3::new(0.0, -5.0, 0.0), target: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
        let frame = Frame::of_view(&view).unwrap();
        assert!(frame.right().abs_diff_eq(DVec3::X, 1e-12) && frame.up().abs_diff_eq(DVec3::Z, 1e-12));
        assert!(Frame::of_view(&View { eye: DVec3::ZERO, ..view }).is_err());
        assert!(Frame::of_view(&View { up: DVec3::Y, ..view }).is_err());
    }
}
