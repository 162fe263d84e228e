//! What eases a moving scene for who stands in it: the edge of the view darkens while all around moves.

use super::placement::{Placement, Pose};

/// Seconds from nothing to the whole vignette, and back.
const EASE: f64 = 0.3;

/// Metres in a second, at an arm's length from the head, from which on a moving scene is felt, and at which the vignette is
/// whole.
const SPEEDS: [f64; 2] = [0.15, 1.0];

/// A vignette that comes with the motion of the scene and goes with it.
///
/// It follows how fast the scene moves around the head, not how it is held: a scene that is carried at arm's length hardly
/// moves there, one that is turned about the head does. It never changes faster than from nothing to whole in 0.3 s, so it
/// does not flash.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ComfortVignette {
    strength: f64,
    before: Option<Placement>,
}

impl ComfortVignette {
    /// Takes in where the scene is after `seconds` and tells how strong the vignette is, 0 to 1. A scene that was put
    /// somewhere at once (`jumped`: a reset, a bookmark, a snap turn) has not moved. What is no number changes nothing.
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
