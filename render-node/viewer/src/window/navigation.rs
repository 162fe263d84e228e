//! How a mouse and keys move the eye of a window: orbit, trackball, fly. Scene coordinates, f64.

use glam::{DQuat, DVec2, DVec3};
use sg_scene::camera::Camera;
use sg_scene::model::SceneBox;
use sg_scene::view::View;

/// Effect of a drag.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NavigationMode {
    /// The eye goes about the target; up stays up.
    #[default]
    Orbit,
    /// The eye goes about the target in any direction; up turns with it.
    Trackball,
    /// The eye stays and looks elsewhere; keys move it.
    Fly,
}

impl NavigationMode {
    /// All, in the order of a cycling key.
    pub const ALL: [Self; 3] = [Self::Orbit, Self::Trackball, Self::Fly];

    /// Name in the window.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Orbit => "orbit",
            Self::Trackball => "trackball",
            Self::Fly => "fly",
        }
    }

    /// One line on the effect of a drag, with its key.
    #[must_use]
    pub fn hint(self) -> &'static str {
        match self {
            Self::Orbit => "Turns about the target; up stays up. (M)",
            Self::Trackball => "Turns about the target in any direction. (M)",
            Self::Fly => "The eye looks elsewhere; W A S D, Q and E move it. (M)",
        }
    }

    /// The next one.
    #[must_use]
    pub fn next(self) -> Self {
        match self {
            Self::Orbit => Self::Trackball,
            Self::Trackball => Self::Fly,
            Self::Fly => Self::Orbit,
        }
    }
}

/// Degrees of a drag over the whole height of the picture.
const TURN: f64 = 180.0;

/// Nearest that a flying eye looks to straight up or down, degrees.
const POLE_GAP: f64 = 1.0;

/// The eye of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Navigator {
    /// Where it is.
    pub view: View,
    /// Effect of a drag.
    pub navigation_mode: NavigationMode,
    /// Distance from the eye, in the scene's unit, within which Gaussians fade; less where the target is near.
    pub near: f64,
    /// The scene's length, the longest edge of its box.
    length: f64,
}

impl Navigator {
    /// An eye before a scene, without a near distance.
    #[must_use]
    pub fn new(view: View, bounds: SceneBox) -> Self {
        let length = bounds.longest_edge().max(f64::MIN_POSITIVE);
        Self { view, navigation_mode: NavigationMode::default(), near: 0.0, length }
    }

    /// The same eye elsewhere.
    #[must_use]
    pub fn at(self, view: View) -> Self {
        Self { view, ..self }
    }

    /// The camera of a picture of this size.
    #[must_use]
    pub fn camera(&self, width: u32, height: u32) -> Camera {
        Camera { near: self.view.near_distance(self.near), ..self.view.camera(width, height) }
    }

    /// A drag by `delta`, in heights of the picture, x to the right and y down: the visible scene follows the hand. A hand that holds
    /// still changes no bit, so that the picture comes to rest.
    pub fn turn(&mut self, delta: DVec2) {
        if !delta.is_finite() || delta == DVec2::ZERO {
            return;
        }
        let view = self.view;
        let after = match self.navigation_mode {
            NavigationMode::Orbit => view.orbited(-TURN * delta.x, TURN * delta.y),
            NavigationMode::Trackball => {
                let Some((right, up, forward)) = axes(&view) else { return };
                let axis = up * -delta.x + right * -delta.y;
                let Some(axis) = axis.try_normalize() else { return };
                let turn = DQuat::from_axis_angle(axis, TURN.to_radians() * delta.length());
                let distance = view.eye.distance(view.target);
                View { eye: view.target - turn * forward * distance, up: turn * up, ..view }
            }
            NavigationMode::Fly => {
                let Some((right, _, forward)) = axes(&view) else { return };
                let up = view.up.normalize_or(DVec3::Z);
                let from_up = forward.angle_between(up).to_degrees();
                // A drag over the height turns by the field of view, so that the visible scene follows the hand.
                let pitch = (view.fov_y_degrees * delta.y).clamp(POLE_GAP - (180.0 - from_up), from_up - POLE_GAP);
                let yaw = DQuat::from_axis_angle(up, (view.fov_y_degrees * delta.x).to_radians());
                let turn = yaw * DQuat::from_axis_angle(right, pitch.to_radians());
                View { target: view.eye + turn * (view.target - view.eye), ..view }
            }
        };
        self.put(after);
    }

    /// Slides eye and target in the plane of the picture, so that points at the target's depth follow the hand. `delta` is
    /// in heights of the picture.
    pub fn slide(&mut self, delta: DVec2) {
        let view = self.view;
        let Some((right, up, _)) = axes(&view) else { return };
        let height = 2.0 * view.eye.distance(view.target) * (0.5 * view.fov_y_degrees.to_radians()).tan();
        let way = height * (up * delta.y - right * delta.x);
        self.put(View { eye: view.eye + way, target: view.target + way, ..view });
    }

    /// Makes things at the target `factor` times as large; a flying eye goes ahead instead, by a share of the scene's length.
    pub fn approach(&mut self, factor: f64) {
        if !(factor.is_finite() && factor > 0.0) || factor == 1.0 {
            return;
        }
        match self.navigation_mode {
            NavigationMode::Fly => self.fly(DVec3::new(0.0, 0.0, 0.25 * self.length * factor.ln())),
            _ => {
                if let Ok(view) = self.view.zoomed(factor, self.length) {
                    self.put(view);
                }
            }
        }
    }

    /// Moves eye and target by a way in the eye's axes (right, up, forward), scene length unit.
    pub fn fly(&mut self, way: DVec3) {
        let view = self.view;
        let Some((right, up, forward)) = axes(&view) else { return };
        let way = right * way.x + up * way.y + forward * way.z;
        self.put(View { eye: view.eye + way, target: view.target + way, ..view });
    }

    /// Looks from another view. One from which nothing can be seen is ignored.
    pub fn look_from(&mut self, view: View) {
        self.put(view);
    }

    /// The scene's length: keys fly a share of it per second.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Takes a view that can be looked from; another one is left.
    fn put(&mut self, view: View) {
        if view.check().is_ok() {
            self.view = view;
        }
    }
}

/// Right, up and forward of a view, of unit length; `None` for one that looks nowhere.
fn axes(view: &View) -> Option<(DVec3, DVec3, DVec3)> {
    let forward = (view.target - view.eye).try_normalize()?;
    let right = forward.cross(view.up).try_normalize()?;
    Some((right, right.cross(forward), forward))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bounds() -> SceneBox {
        SceneBox { min: DVec3::new(-1.0, -2.0, 0.0), max: DVec3::new(3.0, 2.0, 1.0) }
    }

    fn navigator(navigation_mode: NavigationMode) -> Navigator {
        let view = View::framing(bounds(), DVec3::new(0.2, 1.0, -0.3), DVec3::Z, 40.0);
        Navigator { navigation_mode, ..Navigator::new(view, bounds()) }
    }

    /// Projects a scene point into the picture, heights from its middle, x right, y down.
    fn seen(view: &View, point: DVec3) -> DVec2 {
        let (right, up, forward) = axes(view).unwrap();
        let d = point - view.eye;
        let scale = 2.0 * (0.5 * view.fov_y_degrees.to_radians()).tan() * d.dot(forward);
        DVec2::new(d.dot(right), -d.dot(up)) / scale
    }

    #[test]
    fn the_near_distance_is_less_where_the_target_is_near() {
        let mut n = Navigator { near: 0.02, ..navigator(NavigationMode::Orbit) };
        assert_eq!(n.camera(40, 30).near, 0.02);
        n.view.eye = n.view.target + DVec3::new(0.0, 0.0, 0.01);
        assert!((n.camera(40, 30).near - 0.001).abs() < 1e-12);
    }

    #[test]
    fn a_hand_that_holds_still_changes_no_bit() {
        for navigation_mode in NavigationMode::ALL {
            let mut n = navigator(navigation_mode);
            for k in 0..100 {
                n.turn(DVec2::new(0.013, 0.007));
                n.slide(DVec2::new(0.003, -0.002));
                let before = n.view;
                n.turn(DVec2::ZERO);
                n.slide(DVec2::ZERO);
                n.approach(1.0);
                n.fly(DVec3::ZERO);
                assert_eq!(n.view, before, "{navigation_mode:?}, {k}");
            }
        }
    }

    #[test]
    fn what_is_at_the_target_goes_with_the_hand() {
        for navigation_mode in NavigationMode::ALL {
            let mut n = navigator(navigation_mode);
            let before = n.view;
            let delta = DVec2::new(0.1, -0.05);
            n.slide(delta);
            assert!((seen(&n.view, before.target) - delta).length() < 1e-12, "{navigation_mode:?}");
        }
        let mut n = navigator(NavigationMode::Fly);
        let before = n.view;
        n.turn(DVec2::new(0.02, 0.0));
        assert!((seen(&n.view, before.target) - DVec2::new(0.02, 0.0)).length() < 2e-3);
        n = navigator(NavigationMode::Fly);
        n.turn(DVec2::new(0.0, 0.02));
        assert!((seen(&n.view, before.target) - DVec2::new(0.0, 0.02)).length() < 2e-3);
    }

    #[test]
    fn what_is_before_the_target_goes_with_the_hand_that_turns() {
        for navigation_mode in [NavigationMode::Orbit, NavigationMode::Trackball] {
            for delta in [DVec2::new(0.02, 0.0), DVec2::new(0.0, 0.02)] {
                let mut n = navigator(navigation_mode);
                let (right, up, forward) = axes(&n.view).unwrap();
                let near = n.view.target - 0.3 * forward;
                assert!(seen(&n.view, near).length() < 1e-12);
                n.turn(delta);
                assert!(seen(&n.view, near).dot(delta) > 0.0, "{navigation_mode:?} {delta} {right} {up}");
            }
        }
    }

    #[test]
    fn an_orbit_keeps_up_and_a_trackball_goes_over_the_pole() {
        let mut orbit = navigator(NavigationMode::Orbit);
        let mut ball = navigator(NavigationMode::Trackball);
        for _ in 0..30 {
            orbit.turn(DVec2::new(0.0, 0.1));
            ball.turn(DVec2::new(0.0, 0.1));
        }
        assert_eq!(orbit.view.up, DVec3::Z);
        // Thirty times 18° are one and a half turns.
        let before = navigator(NavigationMode::Trackball).view;
        let turned = (ball.view.eye - ball.view.target).dot(before.eye - before.target);
        assert!(turned < 0.0, "half a turn further");
    }

    proptest! {
        #[test]
        fn no_drag_leaves_a_view_that_nobody_can_look_from(
            moves in prop::collection::vec((0_u8..4, -3.0_f64..3.0, -3.0_f64..3.0), 1..60),
            navigation_mode in 0_usize..3,
        ) {
            let mut n = navigator(NavigationMode::ALL[navigation_mode]);
            let distance = n.view.eye.distance(n.view.target);
            for (what, x, y) in moves {
                match what {
                    0 => n.turn(DVec2::new(x, y)),
                    1 => n.slide(DVec2::new(x, y)),
                    2 => n.fly(DVec3::new(x, y, x - y)),
                    _ => n.turn(DVec2::new(f64::NAN, y)),
                }
                prop_assert!(n.view.check().is_ok());
                prop_assert!((n.view.eye.distance(n.view.target) / distance - 1.0).abs() < 1e-6);
            }
        }

        #[test]
        fn an_approach_and_its_inverse_cancel(factor in 0.2_f64..5.0) {
            let mut n = navigator(NavigationMode::Orbit);
            let before = n.view;
            n.approach(factor);
            n.approach(1.0 / factor);
            prop_assert!(n.view.eye.distance(before.eye) < 1e-9);
            n.approach(f64::INFINITY);
            n.approach(-1.0);
            prop_assert!(n.view.eye.distance(before.eye) < 1e-9);
        }
    }
}
