//! A hand that a person raises to the eyes and looks at.

use glam::DVec3;

use super::placement::Pose;

/// Metres from the eyes within which a hand is raised, and beyond which it no longer is.
const NEAR: [f64; 2] = [0.38, 0.48];

/// Cosines of the angle between the gaze and the hand: above the first it is looked at, below the second it no longer is.
const LOOKED_AT: [f64; 2] = [0.9, 0.78];

/// Seconds that a hand is held there before it counts.
const WAITS: f64 = 0.5;

/// Whether a hand is raised to the eyes, looked at, and held there.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RaisedHand {
    seconds: f64,
}

impl RaisedHand {
    /// Takes in a hand's place after `seconds`. A hand that is lost or `busy` is not raised.
    pub fn step(&mut self, hand: Option<DVec3>, head: &Pose, busy: bool, seconds: f64) -> bool {
        let was = usize::from(self.is_raised());
        let looked_at = |at: DVec3| {
            let way = at - head.position;
            way.length() < NEAR[was] && way.normalize_or_zero().dot(head.forward()) > LOOKED_AT[was]
        };
        if busy || !hand.is_some_and(looked_at) {
            self.seconds = 0.0;
        } else if seconds.is_finite() {
            self.seconds += seconds.clamp(0.0, 0.1);
        }
        self.is_raised()
    }

    /// Whether it is raised.
    #[must_use]
    pub fn is_raised(&self) -> bool {
        self.seconds >= WAITS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hand_counts_after_a_moment_and_stays_until_it_leaves() {
        let head = Pose { position: DVec3::new(0.0, 1.6, 0.0), ..Pose::IDENTITY };
        let (near, edge, far) =
            (DVec3::new(0.05, 1.55, -0.3), DVec3::new(0.05, 1.5, -0.42), DVec3::new(0.0, 1.3, -0.6));
        let mut raised = RaisedHand::default();
        assert!((0..5).all(|_| !raised.step(Some(edge), &head, false, 0.1)), "too far to begin");
        assert!((0..4).all(|_| !raised.step(Some(near), &head, false, 0.1)));
        assert!(raised.step(Some(near), &head, false, 0.11), "half a second");
        assert!(raised.step(Some(edge), &head, false, 0.1), "near enough to stay");
        assert!(!raised.step(Some(far), &head, false, 0.1));
        assert!(!raised.step(Some(near), &head, false, 0.1), "it begins anew");
        (0..9).for_each(|_| {
            raised.step(Some(near), &head, false, 0.1);
        });
        assert!(raised.is_raised() && !raised.step(Some(near), &head, true, 0.1), "busy");
        assert!(!raised.step(None, &head, false, 5.0) && !raised.step(Some(near), &head, false, 60.0), "a pause");
        assert!(!raised.step(Some(DVec3::NAN), &head, false, f64::NAN));
    }
}
