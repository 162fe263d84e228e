//! State of the hands, independent of its source.

use glam::{DVec2, DVec3};

use super::placement::Pose;

/// Which hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

impl Side {
    /// Both, in the order that pairs of hands have.
    pub const BOTH: [Self; 2] = [Self::Left, Self::Right];

    /// Its place in a pair of hands.
    #[must_use]
    pub fn index(self) -> usize {
        match self {
            Self::Left => 0,
            Self::Right => 1,
        }
    }

    /// The other one.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
        }
    }
}

/// One hand at one time. Inputs missing on a controller keep their defaults.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct HandInput {
    /// The palm, in the room; `None` while it is not tracked.
    pub grip: Option<Pose>,
    /// Direction of the open palm, a unit vector in the room.
    pub palm: Option<DVec3>,
    /// Pointing pose: the ray goes along −z.
    pub aim: Option<Pose>,
    /// Squeeze of the grip, 0 to 1.
    pub squeeze: f64,
    /// Pull of the trigger, 0 to 1.
    pub trigger: f64,
    /// Whether the trigger reaches the controller's click.
    pub click: bool,
    /// Thumbstick or trackpad: right and up, each −1 to 1.
    pub stick: DVec2,
    /// Whether the thumbstick or trackpad is pressed.
    pub stick_click: bool,
    /// A or X, or the controller's equivalent.
    pub primary: bool,
    /// B or Y.
    pub secondary: bool,
    /// The menu button.
    pub menu: bool,
}

/// A button from a pressure: on above 0.6, off below 0.4, so that it does not flicker.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Switch {
    on: bool,
}

impl Switch {
    /// Takes in the pressure and returns whether the button is on. A NaN changes nothing.
    pub fn press(&mut self, value: f64) -> bool {
        if value > 0.6 {
            self.on = true;
        } else if value < 0.4 {
            self.on = false;
        }
        self.on
    }

    /// Whether it is on.
    #[must_use]
    pub fn is_on(&self) -> bool {
        self.on
    }
}
