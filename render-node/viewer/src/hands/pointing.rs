//! Pointing at rectangles that stand in the room: panels.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::input::{HandInput, Side, Switch};
use super::placement::Pose;

/// A rectangle in the room, seen from its +z side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    /// Its middle; x to its right, y up.
    pub pose: Pose,
    /// Width and height in metres.
    pub size: DVec2,
}

impl Rectangle {
    /// Intersection of a ray from `hand` along its −z with the front of the rectangle. Returns shares 0 to 1 from the left
    /// and from the top, and the distance in metres. `None` for a ray that misses, comes from behind, or runs parallel.
    #[must_use]
    pub fn hit(&self, hand: &Pose) -> Option<(DVec2, f64)> {
        let (at, distance) = self.meets(hand)?;
        let inside = at.x >= 0.0 && at.x <= 1.0 && at.y >= 0.0 && at.y <= 1.0;
        inside.then_some((at, distance))
    }

    /// As [`Self::hit`], of the plane that the rectangle lies in.
    fn meets(&self, hand: &Pose) -> Option<(DVec2, f64)> {
        let back = self.pose.orientation.inverse();
        let from = back * (hand.position - self.pose.position);
        let along = back * hand.forward();
        if !(from.z > 0.0 && along.z < -1e-9) {
            return None;
        }
        let distance = -from.z / along.z;
        let at = (from + distance * along).truncate() / self.size;
        let at = DVec2::new(0.5 + at.x, 0.5 - at.y);
        (at.is_finite() && distance.is_finite()).then_some((at, distance))
    }

    /// Room position of a share from the left and from the top of the rectangle.
    #[must_use]
    pub fn point(&self, at: DVec2) -> DVec3 {
        self.pose.to_room(((at - 0.5) * DVec2::new(1.0, -1.0) * self.size).extend(0.0))
    }
}

/// The rectangle that a hand points at: its place in the list, where on it, and how far away. Of several the nearest.
#[must_use]
pub fn nearest(rectangles: &[Rectangle], hand: &Pose) -> Option<(usize, DVec2, f64)> {
    let hits = rectangles.iter().enumerate().filter_map(|(k, r)| r.hit(hand).map(|(at, distance)| (k, at, distance)));
    hits.min_by(|a, b| a.2.total_cmp(&b.2))
}

/// Orientation that faces `eye` from `at`, upright.
#[must_use]
pub fn facing(at: DVec3, eye: DVec3) -> DQuat {
    let back = (eye - at).normalize_or(DVec3::Z);
    let right = DVec3::Y.cross(back).normalize_or(DVec3::X);
    DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back))
}

/// The pointed place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pointed {
    /// Which hand.
    pub side: Side,
    /// Place of the rectangle in the list.
    pub rectangle: usize,
    /// From the left and from the top, 0 to 1; beyond that while something is dragged over the edge.
    pub at: DVec2,
    /// Metres from the hand.
    pub distance: f64,
    /// Whether the trigger is pulled, and was when it came there.
    pub pressed: bool,
}

/// The one pointer that two hands share.
///
/// The pointer belongs to the hand that pulled its trigger last, or to the other if that hand points nowhere. A pressed
/// rectangle keeps the pointer until release. A trigger pulled beside all rectangles presses none of them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pointer {
    triggers: [Switch; 2],
    last: Option<Side>,
    /// The pressed rectangle, and the pressing hand.
    caught: Option<(Side, usize)>,
    /// Whether a trigger was pulled beside all rectangles and is still held.
    elsewhere: [bool; 2],
}

impl Pointer {
    /// Takes in the hands' rays and trigger pressures.
    pub fn step(&mut self, rectangles: &[Rectangle], hands: &[HandInput; 2]) -> Option<Pointed> {
        let aims = [0, 1].map(|k: usize| hands[k].aim.and_then(Pose::checked));
        let at = [0, 1].map(|k: usize| aims[k].and_then(|aim| nearest(rectangles, &aim)));
        for side in Side::BOTH {
            let k = side.index();
            let was = self.triggers[k].is_on();
            let is = self.triggers[k].press(hands[k].trigger);
            self.elsewhere[k] &= is;
            if is && !was {
                match at[k] {
                    Some((rectangle, ..)) if self.caught.is_none() => {
                        self.caught = Some((side, rectangle));
                        self.last = Some(side);
                    }
                    _ => self.elsewhere[k] = true,
                }
            }
        }
        if let Some((side, rectangle)) = self.caught {
            let k = side.index();
            let held = self.triggers[k].is_on();
            if !held {
                self.caught = None;
            }
            let met = rectangles.get(rectangle).zip(aims[k]).and_then(|(r, aim)| r.meets(&aim));
            if let Some((at, distance)) = met {
                return Some(Pointed { side, rectangle, at, distance, pressed: held });
            }
            self.caught = None;
            self.elsewhere[k] = held;
        }
        let first = self.last.unwrap_or(Side::Right);
        [first, first.other()].into_iter().filter(|side| !self.elsewhere[side.index()]).find_map(|side| {
            let (rectangle, at, distance) = at[side.index()]?;
            Some(Pointed { side, rectangle, at, distance, pressed: false })
        })
    }

    /// Whether a hand's trigger is the panels': it presses one, or would if it were pulled now.
    #[must_use]
    pub fn has(&self, side: Side, pointed: Option<&Pointed>) -> bool {
        self.caught.is_some_and(|(by, _)| by == side) || pointed.is_some_and(|p| p.side == side)
    }
}
