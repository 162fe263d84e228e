//! Eases scene motion for a person in it: the edge of the view darkens while the surroundings move.

use super::placement::{Placement, Pose};

/// Seconds of a full change of the vignette, in or out.
const EASE: f64 = 0.3;

/// Speeds of the scene at arm's length from the head, metres per second. At the first the vignette begins; at the second it
/// is full.
const SPEEDS: [f64; 2] = [0.15, 1.0];

/// A vignette that comes with the motion of the scene and goes with it.
///
/// It follows the scene's speed around the head, not the hand's grip. A scene carried at arm's length hardly moves around
/// the head; a scene turned about the head does. A full change takes at least 0.3 s, so the vignette does not flash.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ComfortVignette {
    strength: f64,
    before: Option<Placement>,
}

impl ComfortVignette {
    /// Takes in the scene's placement after `seconds` and returns the vignette's strength, 0 to 1. A jump (`jumped`: a
    /// reset, a bookmark, a snap turn) does not count as motion. Non-finite input changes nothing.
    pub fn step(&mut self, placement: &Placement, head: &Pose, jumped: bool, seconds: f64) -> f64 {
        let sound = placement.checked().zip(head.checked());
        let (Some((now, head)), true) = (sound, seconds.is_finite() && seconds > 0.0) else { return self.strength };
        let before = self.before.replace(now);
        let wanted = match before {
            Some(before) if !jumped => {
                let moved = |away| {
                    let at = head.to_room(away);
                    now.to_room(before.to_scene(at)).distance(at)
                };
                let arm = 0.7;
                let around = [glam::DVec3::NEG_Z, glam::DVec3::X, glam::DVec3::NEG_X, glam::DVec3::Y];
                let speed = around.iter().map(|d| moved(arm * *d)).fold(0.0, f64::max) / seconds;
                ((speed - SPEEDS[0]) / (SPEEDS[1] - SPEEDS[0])).clamp(0.0, 1.0)
            }
            _ => 0.0,
        };
        let most = seconds / EASE;
        self.strength = (self.strength + (wanted - self.strength).clamp(-most, most)).clamp(0.0, 1.0);
        self.strength
    }
}
