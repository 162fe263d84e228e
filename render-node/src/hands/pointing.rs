//! Pointing at rectangles that stand in the room: panels.

use glam::{DVec2, DVec3};

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
    /// Where a ray from `hand` along its −z meets the front of the rectangle: 0 to 1 from the left and from the top, and the
    /// distance in metres. `None` where it passes by, comes from behind, or runs along.
    #[must_use]
    pub fn hit(&self, hand: &Pose) -> Option<(DVec2, f64)> {
        let back = self.pose.orientation.inverse();
        let from = back * (hand.position - self.pose.position);
        let along = back * hand.forward();
        if !(from.z > 0.0 && along.z < -1e-9) {
            return None;
        }
        let distance = -from.z / along.z;
        let at = (from + distance * along).truncate() / self.size;
        let at = DVec2::new(0.5 + at.x, 0.5 - at.y);
        let inside = at.x >= 0.0 && at.x <= 1.0 && at.y >= 0.0 && at.y <= 1.0;
        (inside && distance.is_finite()).then_some((at, distance))
    }

    /// Where on the rectangle a share from the left and from the top is, in the room.
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
