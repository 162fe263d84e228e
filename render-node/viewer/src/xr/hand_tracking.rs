//! Hands without controllers, where the runtime's cameras see their joints.

use openxr as xr;

use super::space;
use crate::hands::{JOINTS, Joints};

/// Hand trackers, left and right.
pub(super) struct HandTrackers([xr::HandTracker; 2]);

impl HandTrackers {
    /// Follows both hands; `None` where this system sees none.
    pub(super) fn follow(
        instance: &xr::Instance,
        system: xr::SystemId,
        session: &xr::Session<xr::Vulkan>,
    ) -> Option<Self> {
        if !instance.supports_hand_tracking(system).unwrap_or(false) {
            return None;
        }
        let follow = |hand| {
            session
                .create_hand_tracker(hand)
                .inspect_err(|error| tracing::info!(%error, "hands without controllers are not followed"))
                .ok()
        };
        Some(Self([follow(xr::Hand::LEFT)?, follow(xr::Hand::RIGHT)?]))
    }

    /// The joints of one hand at `time` in `room`; `None` while it is not seen.
    pub(super) fn joints(&self, room: &xr::Space, hand: usize, time: xr::Time) -> xr::Result<Option<Joints>> {
        let Some(tracker) = self.0.get(hand) else { return Ok(None) };
        let located = room.locate_hand_joints(tracker, time)?;
        Ok(located.map(|all| {
            let mut joints: Joints = [None; JOINTS];
            for (joint, location) in joints.iter_mut().zip(&all) {
                let xr::HandJointLocation { location_flags, pose, .. } = *location;
                *joint = space::pose(&xr::SpaceLocation { location_flags, pose });
            }
            joints
        }))
    }
}
