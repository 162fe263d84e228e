//! The way of the eye to another view of the scene: it goes there within a moment, so that a person sees where it went.

use sg_scene::view::View;

/// Seconds of a flight.
const SECONDS: f64 = 0.6;

/// A flight of the eye.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ViewFlight {
    from: View,
    to: View,
    /// When it began, seconds of the window's clock.
    begun: f64,
    /// Where it was last.
    last: View,
}

impl ViewFlight {
    /// A flight between two views that begins now.
    pub(super) fn new(from: View, to: View, now: f64) -> Self {
        Self { from, to, begun: now, last: from }
    }

    /// Where the eye is now, and whether it has arrived. `None` if somebody has moved it from where the flight had it.
    pub(super) fn at(&mut self, eye: View, now: f64) -> Option<(View, bool)> {
        if eye != self.last {
            return None;
        }
        let share = ((now - self.begun) / SECONDS).clamp(0.0, 1.0);
        // Slow at both ends.
        self.last = self.from.towards(&self.to, share * share * (3.0 - 2.0 * share));
        Some((self.last, share >= 1.0))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn view(eye: DVec3) -> View {
        View { eye, target: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 }
    }

    #[test]
    fn a_flight_arrives_and_gives_way_to_a_hand() {
        let (from, to) = (view(DVec3::new(0.0, -4.0, 1.0)), view(DVec3::new(3.0, 0.0, 0.5)));
        let mut flight = ViewFlight::new(from, to, 10.0);
        let (first, arrived) = flight.at(from, 10.0).unwrap();
        assert!((first.eye - from.eye).length() < 1e-12 && !arrived);
        let (middle, _) = flight.at(first, 10.0 + 0.5 * SECONDS).unwrap();
        assert!(middle.eye.distance(from.eye) > 1.0 && middle.eye.distance(to.eye) > 1.0);
        assert_eq!(flight.at(middle, 10.0 + 1.1 * SECONDS), Some((to, true)));
        let mut held = ViewFlight::new(from, to, 10.0);
        assert_eq!(held.at(to, 10.1), None, "a hand has moved the eye");
    }
}
