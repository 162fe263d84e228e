//! Grabbing, scaling and turning a scene.

use glam::{DQuat, DVec3};

use super::input::{HandInput, Side, Switch};
use super::locomotion::{passed, twist};
use super::placement::{Placement, Pose};

/// Turn style of a thumbstick.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TurnMode {
    /// Evenly about the upright axis through the scene's middle, degrees in a second at full tilt.
    Smooth(f64),
    /// In steps of this many degrees about the upright axis through the head, as if the person turned.
    Snap(f64),
    /// Not at all.
    Off,
}

impl Default for TurnMode {
    fn default() -> Self {
        Self::Snap(30.0)
    }
}

/// Hands nearer to one another than this many metres do not scale.
pub const MIN_APART: f64 = 0.03;

/// Least and greatest scale, as factors on that of the fitted scene.
pub const SCALES: [f64; 2] = [0.02, 50.0];

/// A thumbstick at rest is within this of its middle.
const REST: f64 = 0.15;

/// Longest step, in seconds, that a smooth turn takes at once.
const LONGEST_STEP: f64 = 0.1;

#[derive(Debug, Clone, Copy, PartialEq)]
enum GrabState {
    Nothing,
    /// By one hand: where it was, and where the scene was then.
    One(Side, Pose, Placement),
    /// By two: the scene's points under them.
    Two([DVec3; 2]),
}

/// A scene held by hands.
///
/// A grabbing hand holds the scene's point under it. One hand moves and turns the scene; two scale and turn it about the
/// point between them. A hand without tracking lets go, and grabs anew at its next tracked pose. So the scene never jumps.
#[derive(Debug, Clone, PartialEq)]
pub struct Grab {
    placement: Placement,
    home: Placement,
    middle: DVec3,
    held: GrabState,
    squeezed: [Switch; 2],
    tilted: [bool; 2],
    upright: bool,
}

impl Grab {
    /// The scene stands at `home`; [`Self::reset`] restores it. `middle` is the scene point that turns stay about.
    #[must_use]
    pub fn new(home: Placement, middle: DVec3) -> Self {
        let home = home.checked().unwrap_or(Placement::IDENTITY);
        Self {
            placement: home,
            home,
            middle: if middle.is_finite() { middle } else { DVec3::ZERO },
            held: GrabState::Nothing,
            squeezed: [Switch::default(); 2],
            tilted: [false; 2],
            upright: false,
        }
    }

    /// Lets hands turn the scene about the vertical only, or freely again. At the lock the scene comes upright about its
    /// middle, by the least change of the direction that it faces. Hands that hold it grab it anew.
    pub fn lock_upright(&mut self, lock: bool) {
        if std::mem::replace(&mut self.upright, lock) == lock || !lock {
            return;
        }
        let at = self.placement;
        let faces = twist(at.rotation * self.home.rotation.inverse(), DVec3::Y);
        let rotation = (faces * self.home.rotation).normalize();
        let pivot = at.to_room(self.middle);
        self.go(Placement { rotation, translation: pivot - at.scale * (rotation * self.middle), ..at });
    }

    /// Has the person move by this many metres of the room, unless a hand holds the scene. Returns whether it moved.
    pub fn travel(&mut self, by: DVec3) -> bool {
        let moved = passed(&self.placement, by).checked().filter(|_| !self.is_held() && by != DVec3::ZERO);
        self.placement = moved.unwrap_or(self.placement);
        moved.is_some()
    }

    /// Placement of the scene.
    #[must_use]
    pub fn placement(&self) -> Placement {
        self.placement
    }

    /// Whether a hand holds it.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.held != GrabState::Nothing
    }

    /// Whether that hand's grip is closed.
    #[must_use]
    pub fn is_squeezed(&self, side: Side) -> bool {
        self.squeezed[side.index()].is_on()
    }

    /// Restores the scene's fitted placement. Hands that hold it grab it anew.
    pub fn reset(&mut self) {
        self.go(self.home);
    }

    /// Moves the scene to another placement, such as a bookmark. An invalid placement changes nothing. A scale beyond the
    /// limits becomes the nearest within them, about the scene's middle.
    pub fn go(&mut self, placement: Placement) {
        let Some(placement) = placement.checked() else { return };
        let scale = self.limited(placement.scale);
        self.placement = placement.scaled(placement.to_room(self.middle), scale);
        self.held = GrabState::Nothing;
    }

    /// Gives another fit, as when the scene changed or the person sat down, and brings the scene there.
    pub fn refit(&mut self, home: Placement, middle: DVec3) {
        let Some(home) = home.checked() else { return };
        self.home = home;
        if middle.is_finite() {
            self.middle = middle;
        }
        self.reset();
    }

    /// Takes in both hands after `seconds`. `may_grab` holds per hand whether its squeeze is meant for the scene (and not,
    /// say, for a panel). Snap turns go about `head`. The stick of a hand in `turn_with` turns.
    pub fn step(
        &mut self,
        hands: &[HandInput; 2],
        may_grab: [bool; 2],
        (head, turning, turn_with): (DVec3, TurnMode, Side),
        seconds: f64,
    ) {
        let mut grips = [None; 2];
        for side in Side::BOTH {
            let k = side.index();
            let on = self.squeezed[k].press(hands[k].squeeze);
            grips[k] = hands[k].grip.and_then(Pose::checked).filter(|_| on && may_grab[k]);
        }
        self.hold(grips);
        self.turn(&hands[turn_with.index()], (head, turning, turn_with), seconds);
    }

    fn limited(&self, scale: f64) -> f64 {
        scale.clamp(self.home.scale * SCALES[0], self.home.scale * SCALES[1])
    }

    /// Moves the scene with the hands that hold it.
    fn hold(&mut self, [left, right]: [Option<Pose>; 2]) {
        match (left, right) {
            (None, None) => self.held = GrabState::Nothing,
            (Some(hand), None) => self.hold_one(Side::Left, hand),
            (None, Some(hand)) => self.hold_one(Side::Right, hand),
            (Some(left), Some(right)) => self.hold_two(left, right),
        }
    }

    fn hold_one(&mut self, side: Side, hand: Pose) {
        let (then, at) = match self.held {
            GrabState::One(held, then, at) if held == side => (then, at),
            _ => (hand, self.placement),
        };
        self.held = GrabState::One(side, then, at);
        let turn = (hand.orientation * then.orientation.inverse()).normalize();
        let turn = if self.upright { twist(turn, DVec3::Y) } else { turn };
        self.placement = Placement {
            rotation: (turn * at.rotation).normalize(),
            translation: hand.position + turn * (at.translation - then.position),
            ..at
        };
    }

    fn hold_two(&mut self, left: Pose, right: Pose) {
        let [a, b] = [left.position, right.position];
        let apart = b - a;
        let GrabState::Two([p, q]) = self.held else {
            if apart.length() < MIN_APART {
                let (side, hand) = if matches!(self.held, GrabState::One(Side::Right, ..)) {
                    (Side::Right, right)
                } else {
                    (Side::Left, left)
                };
                self.hold_one(side, hand);
            } else {
                self.held = GrabState::Two([a, b].map(|hand| self.placement.to_scene(hand)));
            }
            return;
        };
        let before = self.placement;
        let (rotation, scale) = if apart.length() < MIN_APART {
            (before.rotation, before.scale)
        } else {
            // The least turn from the newest placement: over many steps it follows the hands all the way around.
            let from = (before.rotation * (q - p)).normalize_or(apart.normalize());
            let turn = match self.upright {
                true => turn_from_above(from, apart.normalize()),
                false => DQuat::from_rotation_arc(from, apart.normalize()),
            };
            ((turn * before.rotation).normalize(), self.limited(apart.length() / p.distance(q)))
        };
        let translation = 0.5 * (a + b) - scale * (rotation * (0.5 * (p + q)));
        self.placement = Placement { scale, rotation, translation }.checked().unwrap_or(before);
    }

    fn turn(&mut self, hand: &HandInput, (head, turning, side): (DVec3, TurnMode, Side), seconds: f64) {
        let tilt = hand.stick.x;
        let tilted = &mut self.tilted[side.index()];
        let was_tilted = *tilted;
        if tilt.abs() > 0.7 {
            *tilted = true;
        } else if tilt.abs() < 0.4 {
            *tilted = false;
        }
        if !tilt.is_finite() || self.is_held() {
            return;
        }
        let (pivot, degrees) = match turning {
            TurnMode::Smooth(rate) if tilt.abs() > REST => {
                let seconds = if seconds.is_finite() { seconds.clamp(0.0, LONGEST_STEP) } else { 0.0 };
                (self.placement.to_room(self.middle), tilt.clamp(-1.0, 1.0) * rate * seconds)
            }
            TurnMode::Snap(by) if tilt.abs() > 0.7 && !was_tilted => (head, tilt.signum() * by),
            _ => return,
        };
        // A turn of the person to the right moves the scene to the left: counter-clockwise from above.
        let turned = self.placement.turned(pivot, DVec3::Y, degrees.to_radians());
        self.placement = turned.checked().unwrap_or(self.placement);
    }
}

/// The turn about the vertical from one direction to another, both of unit length. Directions close to the vertical give none.
fn turn_from_above(from: DVec3, to: DVec3) -> DQuat {
    let (from, to) = (from.with_y(0.0), to.with_y(0.0));
    if from.length().min(to.length()) < 0.05 {
        return DQuat::IDENTITY;
    }
    DQuat::from_rotation_y(from.cross(to).y.atan2(from.dot(to)))
}
