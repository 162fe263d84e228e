//! Button bindings of each controller.

/// OpenXR actions; each exists for both hands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum HandAction {
    Grip,
    Aim,
    Squeeze,
    Trigger,
    Click,
    Stick,
    StickClick,
    Primary,
    Secondary,
    Menu,
    Pulse,
}

/// Hands with this binding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum HandSet {
    Both,
    Left,
    Right,
}

/// An interaction profile: its path and its bindings.
pub(super) struct Profile {
    pub(super) path: &'static str,
    pub(super) inputs: &'static [(HandAction, HandSet, &'static str)],
}

use HandAction::{Aim, Click, Grip, Menu, Primary, Pulse, Secondary, Squeeze, Stick, StickClick, Trigger};
use HandSet::{Both, Left, Right};

const TOUCH: &[(HandAction, HandSet, &str)] = &[
    (Grip, Both, "input/grip/pose"),
    (Aim, Both, "input/aim/pose"),
    (Squeeze, Both, "input/squeeze/value"),
    (Trigger, Both, "input/trigger/value"),
    (Click, Both, "input/trigger/value"),
    (Stick, Both, "input/thumbstick"),
    (StickClick, Both, "input/thumbstick/click"),
    (Primary, Left, "input/x/click"),
    (Secondary, Left, "input/y/click"),
    (Primary, Right, "input/a/click"),
    (Secondary, Right, "input/b/click"),
    (Menu, Left, "input/menu/click"),
    (Pulse, Both, "output/haptic"),
];

/// All that is suggested. Right menu buttons of Touch and the Index's system buttons belong to the runtime.
pub(super) const PROFILES: &[Profile] = &[
    // Every runtime knows this one. It has neither grip nor stick.
    Profile {
        path: "/interaction_profiles/khr/simple_controller",
        inputs: &[
            (Grip, Both, "input/grip/pose"),
            (Aim, Both, "input/aim/pose"),
            (Trigger, Both, "input/select/click"),
            (Click, Both, "input/select/click"),
            (Menu, Both, "input/menu/click"),
            (Pulse, Both, "output/haptic"),
        ],
    },
    Profile { path: "/interaction_profiles/oculus/touch_controller", inputs: TOUCH },
    Profile { path: "/interaction_profiles/meta/touch_controller_plus", inputs: TOUCH },
    Profile {
        path: "/interaction_profiles/valve/index_controller",
        inputs: &[
            (Grip, Both, "input/grip/pose"),
            (Aim, Both, "input/aim/pose"),
            (Squeeze, Both, "input/squeeze/value"),
            (Trigger, Both, "input/trigger/value"),
            (Click, Both, "input/trigger/click"),
            (Stick, Both, "input/thumbstick"),
            (StickClick, Both, "input/thumbstick/click"),
            (Primary, Both, "input/a/click"),
            (Secondary, Both, "input/b/click"),
            (Menu, Both, "input/trackpad/force"),
            (Pulse, Both, "output/haptic"),
        ],
    },
    Profile {
        path: "/interaction_profiles/microsoft/motion_controller",
        inputs: &[
            (Grip, Both, "input/grip/pose"),
            (Aim, Both, "input/aim/pose"),
            (Squeeze, Both, "input/squeeze/click"),
            (Trigger, Both, "input/trigger/value"),
            (Click, Both, "input/trigger/value"),
            (Stick, Both, "input/thumbstick"),
            (StickClick, Both, "input/thumbstick/click"),
            (Primary, Both, "input/trackpad/click"),
            (Menu, Both, "input/menu/click"),
            (Pulse, Both, "output/haptic"),
        ],
    },
    Profile {
        path: "/interaction_profiles/htc/vive_controller",
        inputs: &[
            (Grip, Both, "input/grip/pose"),
            (Aim, Both, "input/aim/pose"),
            (Squeeze, Both, "input/squeeze/click"),
            (Trigger, Both, "input/trigger/value"),
            (Click, Both, "input/trigger/click"),
            (Stick, Both, "input/trackpad"),
            (StickClick, Both, "input/trackpad/click"),
            (Menu, Both, "input/menu/click"),
            (Pulse, Both, "output/haptic"),
        ],
    },
    // Bare hands: a fist holds, pointing with pinched fingers presses.
    Profile {
        path: "/interaction_profiles/ext/hand_interaction_ext",
        inputs: &[
            (Grip, Both, "input/grip/pose"),
            (Aim, Both, "input/aim/pose"),
            (Squeeze, Both, "input/grasp_ext/value"),
            (Trigger, Both, "input/aim_activate_ext/value"),
            (Click, Both, "input/aim_activate_ext/value"),
        ],
    },
];
