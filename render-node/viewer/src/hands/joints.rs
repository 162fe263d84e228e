//! A hand without a controller: its fingers produce the same input as a controller.

use glam::{DMat3, DQuat, DVec3};

use super::input::{HandInput, Switch};
use super::placement::Pose;

/// Joints of a hand in the order of OpenXR's `XrHandJointEXT`.
pub const JOINTS: usize = 26;

/// Places in that order. A finger's knuckle bends against the palm.
const PALM: usize = 0;
const WRIST: usize = 1;
const THUMB_TIP: usize = 5;
const INDEX_KNUCKLE: usize = 7;
const INDEX_TIP: usize = 10;

/// Knuckles of the middle, ring and little fingers. Three joints follow each, up to the tip.
const CLOSING: [usize; 3] = [12, 17, 22];

/// Metres between the tips of thumb and index finger: touching, and apart.
const TOUCH: f64 = 0.010;
const APART: f64 = 0.045;

/// A finger's reach from knuckle to tip, as a share of its length: closed in a fist, and straight.
const CLOSED: f64 = 0.58;
const STRAIGHT: f64 = 0.92;

/// The joints of one hand; `None` for one that is not seen.
pub type Joints = [Option<Pose>; JOINTS];

/// One hand without a controller.
#[derive(Debug, Clone, Copy, Default)]
pub struct BareHand {
    pinch: Switch,
    fist: Switch,
}

impl BareHand {
    /// Converts the hand's pose to input. A pinch of index finger and thumb is the trigger; a fist is the grip. The hand
    /// points from the wrist along its index finger's knuckle, since a pinch does not move it. The pointer begins at that
    /// knuckle.
    ///
    /// The first of pinch and fist counts until it ends. An untracked hand has no input and no pose.
    pub fn read(&mut self, joints: Option<&Joints>) -> HandInput {
        let Some(joints) = joints else {
            *self = Self::default();
            return HandInput::default();
        };
        let (pinched, closed) = (pinched(joints).unwrap_or(0.0), closed(joints).unwrap_or(0.0));
        let (trigger, squeeze) = match (self.pinch.is_on(), self.fist.is_on()) {
            (true, _) => (pinched, 0.0),
            (_, true) => (0.0, closed),
            // Fingers that close on the palm take the index finger to the thumb on the way.
            _ if closed > 0.5 => (0.0, closed),
            _ => (pinched, 0.0),
        };
        self.fist.press(squeeze);
        let click = self.pinch.press(trigger);
        // The joint's y comes out of the back of the hand.
        let palm = joints[PALM].map(|pose| pose.orientation * DVec3::NEG_Y);
        HandInput { grip: joints[PALM], palm, aim: aim(joints), squeeze, trigger, click, ..HandInput::default() }
    }
}

/// Closeness of thumb and index finger, 0 to 1.
fn pinched(joints: &Joints) -> Option<f64> {
    let apart = joints[THUMB_TIP]?.position.distance(joints[INDEX_TIP]?.position);
    Some(((APART - apart) / (APART - TOUCH)).clamp(0.0, 1.0))
}

/// Closure of the three other fingers, 0 to 1: that of the least closed one.
fn closed(joints: &Joints) -> Option<f64> {
    let mut least = 1.0_f64;
    for knuckle in CLOSING {
        let mut finger = [DVec3::ZERO; 4];
        for (at, joint) in finger.iter_mut().zip(joints.get(knuckle..)?) {
            *at = joint.as_ref()?.position;
        }
        let length: f64 = finger.windows(2).map(|bone| bone[0].distance(bone[1])).sum();
        let reach = finger[0].distance(finger[3]) / length;
        // A finger without length is no finger.
        let bent = ((STRAIGHT - reach) / (STRAIGHT - CLOSED)).clamp(0.0, 1.0);
        least = if bent.is_finite() { least.min(bent) } else { 0.0 };
    }
    Some(least)
}

/// Pointing direction of the hand.
fn aim(joints: &Joints) -> Option<Pose> {
    let (wrist, knuckle) = (joints[WRIST]?, joints[INDEX_KNUCKLE]?.position);
    let forward = (knuckle - wrist.position).try_normalize()?;
    // The back of the hand is up.
    let right = forward.cross(wrist.orientation * DVec3::Y).try_normalize()?;
    let orientation = DQuat::from_mat3(&DMat3::from_cols(right, right.cross(forward), -forward));
    Pose { position: knuckle, orientation }.checked()
}
