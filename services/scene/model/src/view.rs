//! The viewpoint of a scene: frame, orbit, zoom. Scene coordinates, angles in degrees.

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::camera::Camera;
use crate::model::SceneBox;

/// Vertical field of view of the first views, degrees.
pub const FIELD_OF_VIEW: f64 = 40.0;
/// Share of the picture's half width and height that a framed box leaves free.
pub const MARGIN: f64 = 0.05;
/// Greatest near distance, as a share of the way to the target: what a person looks at closely does not fade.
const NEAR_SHARE: f64 = 0.1;
/// Smallest angle between an orbit and the poles of the up direction, degrees.
const POLE_GAP: f64 = 1.0;

/// The viewpoint of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Position of the eye, scene coordinates.
    pub eye: DVec3,
    /// The middle of the picture and the centre of orbits.
    pub target: DVec3,
    /// The scene direction that is up in the picture, of any length.
    pub up: DVec3,
    /// Vertical field of view, degrees.
    pub fov_y_degrees: f64,
}

/// An invalid viewpoint.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ViewError {
    /// A number is NaN or infinite.
    #[error("a view's numbers must be finite")]
    NotFinite,
    /// The eye is at the target.
    #[error("the eye and its target coincide; put them apart")]
    NoDirection,
    /// The up direction is zero or along the line of sight.
    #[error("the up direction is zero or along the line of sight; give another")]
    NoUp,
    /// The field of view is too small or too large.
    #[error("the vertical field of view is {0} degrees; it must be 1 to 170")]
    FieldOfView(f64),
    /// The zoom factor is not usable.
    #[error("the zoom factor is {0}; it must be finite and above 0")]
    Zoom(f64),
    /// The eye would come too near or go too far.
    #[error("the eye would be {0:e} scene lengths from its target; it stays between 1e-6 and 1e6")]
    Distance(f64),
}

impl View {
    /// The nearest view along `direction` (from the eye to the scene) that shows all of a box in a square picture. The
    /// picture has [`MARGIN`] to spare; the view targets the middle of the box. A box without extent is framed as a
    /// unit cube.
    #[must_use]
    pub fn framing(bounds: SceneBox, direction: DVec3, up: DVec3, fov_y_degrees: f64) -> Self {
        let middle = 0.5 * (bounds.min + bounds.max);
        let half = 0.5 * bounds.size();
        let half = if half.max_element() > 0.0 { half } else { DVec3::splat(0.5) };
        let forward = direction.try_normalize().unwrap_or(DVec3::Y);
        let right = forward.cross(up).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
        let above = right.cross(forward);
        let tangent = (1.0 - MARGIN) * (0.5 * fov_y_degrees.to_radians()).tan();
        // A corner c from the middle is inside from the distance |c in the picture plane| / tan − (c along the view) on.
        let distance = (0..8)
            .map(|k| {
                let sign = |bit: u32| if k >> bit & 1 == 0 { 1.0 } else { -1.0 };
                let corner = half * DVec3::new(sign(0), sign(1), sign(2));
                DVec2::new(corner.dot(right), corner.dot(above)).abs().max_element() / tangent - corner.dot(forward)
            })
            .fold(0.0, f64::max);
        Self { eye: middle - distance * forward, target: middle, up, fov_y_degrees }
    }

    /// The eye rotated about the target. `azimuth` turns about the up direction, positive to the eye's right.
    /// `elevation` turns upwards and stops a degree short of the poles.
    #[must_use]
    pub fn orbited(&self, azimuth: f64, elevation: f64) -> Self {
        let offset = self.eye - self.target;
        let distance = offset.length();
        let up = self.up.normalize_or(DVec3::Z);
        let height = (offset.dot(up) / distance).clamp(-1.0, 1.0).asin();
        let level = offset - offset.dot(up) * up;
        let level = level.try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
        let level = DQuat::from_axis_angle(up, azimuth.to_radians()) * level;
        let limit = (90.0 - POLE_GAP).to_radians();
        let height = (height + elevation.to_radians()).clamp(-limit, limit);
        let offset = distance * (height.cos() * level + height.sin() * up);
        Self { eye: self.target + offset, ..*self }
    }

    /// The eye moved so that things at the target appear `factor` times as large. `length` is the scene's own length, the
    /// longest edge of its box.
    ///
    /// # Errors
    /// [`ViewError::Zoom`], [`ViewError::Distance`].
    pub fn zoomed(&self, factor: f64, length: f64) -> Result<Self, ViewError> {
        if !(factor > 0.0 && factor.is_finite()) {
            return Err(ViewError::Zoom(factor));
        }
        let length = if length > 0.0 { length } else { 1.0 };
        let offset = (self.eye - self.target) / factor;
        let distance = offset.length() / length;
        if !(1e-6..=1e6).contains(&distance) {
            return Err(ViewError::Distance(distance));
        }
        let zoomed = Self { eye: self.target + offset, ..*self };
        zoomed.check().map(|()| zoomed)
    }

    /// A view on the way to another one; `share` is 0 here and 1 there. The eye goes about the target, which moves along a line. So
    /// the scene stays in sight, and turns evenly (Shoemake 1985, "Animating rotation with quaternion curves"). Distances grow by
    /// even factors.
    #[must_use]
    pub fn towards(&self, other: &Self, share: f64) -> Self {
        let share = share.clamp(0.0, 1.0);
        let frames = (self.turn(), other.turn());
        let lengths = [self, other].map(|view| (view.eye - view.target).length());
        let (Some(from), Some(to), true) = (frames.0, frames.1, lengths.iter().all(|l| *l > 0.0)) else {
            return if share < 1.0 { *self } else { *other };
        };
        if share >= 1.0 {
            return *other;
        }
        let turn = from.slerp(to, share);
        let target = self.target.lerp(other.target, share);
        let distance = (lengths[0].ln() * (1.0 - share) + lengths[1].ln() * share).exp();
        let fov_y_degrees = self.fov_y_degrees + (other.fov_y_degrees - self.fov_y_degrees) * share;
        Self { eye: target + turn * (distance * DVec3::Z), target, up: turn * DVec3::Y, fov_y_degrees }
    }

    /// The turn from x to the right, y up and z towards the eye. `None` for a view without a direction.
    fn turn(&self) -> Option<DQuat> {
        let back = (self.eye - self.target).try_normalize()?;
        let right = self.up.cross(back).try_normalize()?;
        Some(DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back)).normalize())
    }

    /// A box framed from the present direction.
    #[must_use]
    pub fn focused(&self, bounds: SceneBox) -> Self {
        Self::framing(bounds, self.target - self.eye, self.up, self.fov_y_degrees)
    }

    /// Whether the view shows something.
    ///
    /// # Errors
    /// [`ViewError`] names the problem.
    pub fn check(&self) -> Result<(), ViewError> {
        if !(self.eye.is_finite() && self.target.is_finite() && self.up.is_finite() && self.fov_y_degrees.is_finite()) {
            return Err(ViewError::NotFinite);
        }
        if !(1.0..=170.0).contains(&self.fov_y_degrees) {
            return Err(ViewError::FieldOfView(self.fov_y_degrees));
        }
        let forward = (self.target - self.eye).try_normalize().ok_or(ViewError::NoDirection)?;
        let up = self.up.try_normalize().ok_or(ViewError::NoUp)?;
        if forward.cross(up).length() < 1e-6 {
            return Err(ViewError::NoUp);
        }
        Ok(())
    }

    /// The near distance of this view's camera, where `most` is that of a view from afar: at most a tenth of the way to the
    /// target.
    #[must_use]
    pub fn near_distance(&self, most: f64) -> f64 {
        most.min(NEAR_SHARE * self.eye.distance(self.target))
    }

    /// The pinhole camera of this view for a picture size, with the default background and light.
    #[must_use]
    pub fn camera(&self, width: u32, height: u32) -> Camera {
        Camera::look_at(self.eye, self.target, self.up, self.fov_y_degrees, width, height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::Side;
    use proptest::prelude::*;

    /// A box as seen from one of its sides.
    fn from_side(bounds: SceneBox, side: Side, fov_y_degrees: f64) -> View {
        let (direction, up) = side.direction_and_up();
        View::framing(bounds, direction, up, fov_y_degrees)
    }

    fn corners(b: SceneBox) -> impl Iterator<Item = DVec3> {
        (0..8).map(move |k| {
            let pick = |bit: u32, low: f64, high: f64| if k >> bit & 1 == 0 { low } else { high };
            DVec3::new(pick(0, b.min.x, b.max.x), pick(1, b.min.y, b.max.y), pick(2, b.min.z, b.max.z))
        })
    }

    #[test]
    fn a_view_on_the_way_keeps_its_target_in_the_middle() {
        let from = View { eye: DVec3::new(0.0, -8.0, 0.0), target: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
        let to = View { eye: DVec3::new(3.0, 2.0, 1.0), target: DVec3::new(1.0, 2.0, 1.0), ..from };
        assert_eq!(from.towards(&to, 1.0), to);
        let start = from.towards(&to, 0.0);
        assert!(start.eye.distance(from.eye) < 1e-12 && start.up.distance(from.up) < 1e-12);
        let middle = from.towards(&to, 0.5);
        assert_eq!(middle.target, DVec3::new(0.5, 1.0, 0.5));
        // Distances 8 and 2 have the mean factor 4, and the eye goes about the up direction.
        assert!((middle.eye.distance(middle.target) - 4.0).abs() < 1e-12);
        assert!(middle.up.distance(DVec3::Z) < 1e-12 && middle.check().is_ok());
        let back = (middle.eye - middle.target).normalize();
        let angles = [(from.eye - from.target), (to.eye - to.target)].map(|offset| offset.angle_between(back));
        assert!((angles[0] - angles[1]).abs() < 1e-12, "{angles:?}");
        let broken = View { eye: DVec3::ZERO, ..from };
        assert_eq!((broken.towards(&to, 0.5), broken.towards(&to, 1.0)), (broken, to));
    }

    proptest! {
        #[test]
        fn a_framed_box_fills_a_square_picture(
            d in proptest::array::uniform3(-1.0..1.0_f64), s in proptest::array::uniform3(0.01..50.0_f64),
            c in proptest::array::uniform3(-1e4..1e4_f64), fov in 10.0..110.0_f64,
        ) {
            prop_assume!(DVec3::from_array(d).length() > 0.01);
            let bounds = SceneBox { min: DVec3::from_array(c) - DVec3::from_array(s), max: DVec3::from_array(c) + DVec3::from_array(s) };
            let view = View::framing(bounds, DVec3::from_array(d), DVec3::Z, fov);
            let camera = view.camera(100, 100);
            let reach = corners(bounds)
                .map(|p| camera.view().transform_point3(p))
                .map(|p| (camera.fx * p.x / p.z).abs().max((camera.fy * p.y / p.z).abs()) / 50.0)
                .fold(0.0, f64::max);
            prop_assert!((reach - (1.0 - MARGIN)).abs() < 1e-6, "{}", reach);
        }

        #[test]
        fn an_orbit_keeps_the_distance_and_stays_off_the_poles(
            azimuth in -720.0..720.0_f64, elevation in -400.0..400.0_f64, side in 0_usize..6,
        ) {
            let side = [Side::Front, Side::Back, Side::Left, Side::Right, Side::Top, Side::Bottom][side];
            let view = from_side(SceneBox { min: DVec3::ZERO, max: DVec3::new(1.0, 2.0, 3.0) }, side, 40.0);
            let moved = view.orbited(azimuth, elevation);
            prop_assert!((moved.eye.distance(moved.target) - view.eye.distance(view.target)).abs() < 1e-9);
            prop_assert_eq!(moved.check(), Ok(()));
            let back = view.orbited(azimuth, 0.0).orbited(-azimuth, 0.0);
            prop_assert!(back.eye.distance(view.eye) < 1e-9);
        }
    }

    #[test]
    fn side_views_look_along_their_axes() {
        let bounds = SceneBox { min: DVec3::ZERO, max: DVec3::ONE };
        for (side, from, right) in [
            (Side::Front, DVec3::NEG_Y, DVec3::X),
            (Side::Back, DVec3::Y, DVec3::NEG_X),
            (Side::Left, DVec3::NEG_X, DVec3::NEG_Y),
            (Side::Right, DVec3::X, DVec3::Y),
            (Side::Top, DVec3::Z, DVec3::X),
            (Side::Bottom, DVec3::NEG_Z, DVec3::X),
        ] {
            let view = from_side(bounds, side, 40.0);
            assert!(((view.eye - view.target).normalize() - from).length() < 1e-12, "{side:?}");
            assert!(((view.target - view.eye).cross(view.up).normalize() - right).length() < 1e-12, "{side:?}");
        }
    }

    #[test]
    fn a_positive_azimuth_goes_right_and_a_positive_elevation_up() {
        let bounds = SceneBox { min: DVec3::splat(-1.0), max: DVec3::ONE };
        let view = from_side(bounds, Side::Front, 40.0);
        assert!((view.orbited(90.0, 0.0).eye.normalize() - DVec3::X).length() < 1e-12);
        assert!(view.orbited(0.0, 30.0).eye.z > 0.1);
    }

    #[test]
    fn zoom_halves_the_distance_and_invalid_views_are_refused() {
        let view = View { eye: DVec3::new(0.0, -4.0, 0.0), target: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
        assert_eq!(view.zoomed(2.0, 1.0).unwrap().eye, DVec3::new(0.0, -2.0, 0.0));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e300, 1e-300] {
            assert!(view.zoomed(bad, 1.0).is_err(), "{bad}");
        }
        assert_eq!(View { eye: DVec3::ZERO, ..view }.check(), Err(ViewError::NoDirection));
        assert_eq!(View { up: DVec3::Y, ..view }.check(), Err(ViewError::NoUp));
        assert_eq!(View { fov_y_degrees: 0.5, ..view }.check(), Err(ViewError::FieldOfView(0.5)));
        assert_eq!(View { up: DVec3::NAN, ..view }.check(), Err(ViewError::NotFinite));
    }
}
