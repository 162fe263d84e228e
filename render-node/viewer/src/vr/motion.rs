//! Whether what a person sees moves: the head, or the scene around it.

use glam::{DQuat, DVec3};

use crate::hands::{Placement, Pose};

/// Metres of the room, radians and share of the scale within which a view counts as still. Tracking trembles by less.
const TREMBLE: (f64, f64, f64) = (2e-3, 4e-3, 5e-3);

/// Seconds within [`TREMBLE`] after which the view is still.
const STILL: f64 = 0.15;

/// A view of the scene: the head in the scene's axes, in metres of the room.
#[derive(Debug, Clone, Copy)]
struct View {
    position: DVec3,
    orientation: DQuat,
    scale: f64,
}

impl View {
    fn of(head: &Pose, placement: &Placement) -> Self {
        let back = placement.rotation.inverse();
        Self {
            position: back * (head.position - placement.translation),
            orientation: back * head.orientation,
            scale: placement.scale,
        }
    }

    fn is_near(&self, other: &Self) -> bool {
        let (metres, radians, share) = TREMBLE;
        // A larger scene moves all of its parts.
        (self.position - other.position).length() <= metres
            && self.orientation.angle_between(other.orientation) <= radians
            && (self.scale / other.scale - 1.0).abs() <= share
    }
}

/// Follows a view from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Motion {
    /// The view when it last left the neighbourhood of the one before, and the seconds since.
    anchor: Option<(View, f64)>,
}

impl Motion {
    /// Takes in the view of a frame, `period` seconds after the one before. Returns whether it moves.
    pub(super) fn step(&mut self, head: &Pose, placement: &Placement, period: f64) -> bool {
        let view = View::of(head, placement);
        let still = match &self.anchor {
            Some((anchor, still)) if view.is_near(anchor) => still + period.max(0.0),
            _ => 0.0,
        };
        let anchor = match self.anchor {
            Some((anchor, _)) if still > 0.0 => anchor,
            _ => view,
        };
        self.anchor = Some((anchor, still));
        still < STILL
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 1.0 / 90.0;

    /// A movement by its name: head and scene at a time.
    type Movement<'a> = (&'a str, &'a dyn Fn(f64) -> (Pose, Placement));

    /// Whether each frame of a second moves.
    fn moves(motion: &mut Motion, view: impl Fn(f64) -> (Pose, Placement)) -> Vec<bool> {
        let frames = (0..90).map(|k| view(f64::from(k) * PERIOD));
        frames.map(|(head, placement)| motion.step(&head, &placement, PERIOD)).collect()
    }

    #[test]
    fn a_head_that_moves_or_a_scene_that_is_carried_moves_and_trembling_does_not() {
        let still = (Pose::IDENTITY, Placement::IDENTITY);
        let mut motion = Motion::default();
        let frames = moves(&mut motion, |_| still);
        assert!(frames[0] && frames.iter().skip(15).all(|moves| !moves), "{frames:?}");
        let trembling = moves(&mut motion, |t| {
            let position = 5e-4 * DVec3::new((71.0 * t).sin(), (53.0 * t).cos(), 0.0);
            (Pose { position, orientation: DQuat::from_rotation_x(1e-3 * (61.0 * t).sin()) }, still.1)
        });
        assert!(trembling.iter().all(|moves| !moves), "{trembling:?}");
        let kinds: [Movement<'_>; 4] = [
            ("walk", &|t| (Pose { position: DVec3::X * (1.0 + 0.1 * t), ..Pose::IDENTITY }, still.1)),
            ("look", &|t| (Pose { orientation: DQuat::from_rotation_y(1.0 + 0.2 * t), ..Pose::IDENTITY }, still.1)),
            ("carry", &|t| (still.0, Placement { translation: DVec3::Z * (2.0 + 0.1 * t), ..still.1 })),
            ("scale", &|t| (still.0, Placement { scale: 2.0 + 0.2 * t, ..still.1 })),
        ];
        for (name, kind) in kinds {
            let frames = moves(&mut motion, kind);
            assert!(frames.iter().all(|moves| *moves), "{name}: {frames:?}");
            let after = moves(&mut motion, |_| kind(1.0));
            let last = after.iter().position(|moves| !moves).unwrap();
            assert!(last <= 17 && after.iter().skip(last).all(|moves| !moves), "{name}: {after:?}");
        }
        // A head that goes with the scene sees the same.
        let together = moves(&mut motion, |t| {
            let turn = DQuat::from_rotation_y(0.5 * t);
            let placement = Placement { rotation: turn, translation: turn * DVec3::X, scale: 2.0 };
            (Pose { position: turn * DVec3::Y, orientation: turn }, placement)
        });
        assert!(together.iter().skip(17).all(|moves| !moves), "{together:?}");
    }
}
