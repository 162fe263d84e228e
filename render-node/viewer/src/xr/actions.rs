//! Hand actions of the runtime: one set of actions for every controller.

use glam::{DVec2, DVec3};
use openxr as xr;

use super::bindings::{HandAction, HandSet, PROFILES};
use super::error::XrError;
use super::space::pose;
use crate::hands::{HandInput, Side};

/// The actions, made once for an instance and attached to its session.
pub(super) struct Actions {
    set: xr::ActionSet,
    grip: xr::Action<xr::Posef>,
    aim: xr::Action<xr::Posef>,
    squeeze: xr::Action<f32>,
    trigger: xr::Action<f32>,
    click: xr::Action<bool>,
    stick: xr::Action<xr::Vector2f>,
    stick_click: xr::Action<bool>,
    primary: xr::Action<bool>,
    secondary: xr::Action<bool>,
    menu: xr::Action<bool>,
    pulse: xr::Action<xr::Haptic>,
    hands: [xr::Path; 2],
    /// Grip and aim of each hand.
    spaces: [[xr::Space; 2]; 2],
    /// Profiles that the runtime does not know.
    pub(super) unknown: Vec<&'static str>,
}

impl Actions {
    /// Makes the actions, suggests bindings for each known controller, and attaches them to the session. A controller
    /// unknown to the runtime is skipped with a logged line.
    pub(super) fn attach(instance: &xr::Instance, session: &xr::Session<xr::Vulkan>) -> Result<Self, XrError> {
        Self::make(instance, session).map_err(|e| XrError::call("actions", e))
    }

    fn make(instance: &xr::Instance, session: &xr::Session<xr::Vulkan>) -> xr::Result<Self> {
        let hands = [instance.string_to_path("/user/hand/left")?, instance.string_to_path("/user/hand/right")?];
        let set = instance.create_action_set("hands", "Hands", 0)?;
        let grip = set.create_action("grip", "Hand", &hands)?;
        let aim = set.create_action("aim", "Pointer", &hands)?;
        let squeeze = set.create_action("squeeze", "Hold the scene", &hands)?;
        let trigger = set.create_action("trigger", "Brush", &hands)?;
        let click = set.create_action("click", "Press", &hands)?;
        let stick = set.create_action("stick", "Turn and adjust", &hands)?;
        let stick_click = set.create_action("stick_click", "Reset", &hands)?;
        let primary = set.create_action("primary", "First button", &hands)?;
        let secondary = set.create_action("secondary", "Second button", &hands)?;
        let menu = set.create_action("menu", "Menu", &hands)?;
        let pulse = set.create_action("pulse", "Pulse", &hands)?;
        let space =
            |action: &xr::Action<xr::Posef>, hand: xr::Path| action.create_space(session, hand, xr::Posef::IDENTITY);
        let spaces =
            [[space(&grip, hands[0])?, space(&aim, hands[0])?], [space(&grip, hands[1])?, space(&aim, hands[1])?]];
        let mut actions = Self {
            set,
            grip,
            aim,
            squeeze,
            trigger,
            click,
            stick,
            stick_click,
            primary,
            secondary,
            menu,
            pulse,
            hands,
            spaces,
            unknown: Vec::new(),
        };
        actions.unknown = actions.suggest(instance)?;
        session.attach_action_sets(&[&actions.set])?;
        Ok(actions)
    }

    fn suggest(&self, instance: &xr::Instance) -> xr::Result<Vec<&'static str>> {
        let mut unknown = Vec::new();
        for profile in PROFILES {
            let mut bindings = Vec::new();
            for (action, of, input) in profile.inputs {
                let hands: &[&str] = match of {
                    HandSet::Both => &["left", "right"],
                    HandSet::Left => &["left"],
                    HandSet::Right => &["right"],
                };
                for hand in hands {
                    let path = instance.string_to_path(&format!("/user/hand/{hand}/{input}"))?;
                    bindings.push(self.binding(*action, path));
                }
            }
            let path = instance.string_to_path(profile.path)?;
            if let Err(error) = instance.suggest_interaction_profile_bindings(path, &bindings) {
                tracing::info!(profile = profile.path, %error, "the runtime does not know this controller");
                unknown.push(profile.path);
            }
        }
        Ok(unknown)
    }

    fn binding(&self, action: HandAction, path: xr::Path) -> xr::Binding<'_> {
        match action {
            HandAction::Grip => xr::Binding::new(&self.grip, path),
            HandAction::Aim => xr::Binding::new(&self.aim, path),
            HandAction::Squeeze => xr::Binding::new(&self.squeeze, path),
            HandAction::Trigger => xr::Binding::new(&self.trigger, path),
            HandAction::Click => xr::Binding::new(&self.click, path),
            HandAction::Stick => xr::Binding::new(&self.stick, path),
            HandAction::StickClick => xr::Binding::new(&self.stick_click, path),
            HandAction::Primary => xr::Binding::new(&self.primary, path),
            HandAction::Secondary => xr::Binding::new(&self.secondary, path),
            HandAction::Menu => xr::Binding::new(&self.menu, path),
            HandAction::Pulse => xr::Binding::new(&self.pulse, path),
        }
    }

    /// Both hands at `time` in `room`. Without the session's input focus they have no input and no pose.
    pub(super) fn read(
        &self,
        session: &xr::Session<xr::Vulkan>,
        room: &xr::Space,
        time: xr::Time,
        focused: bool,
    ) -> xr::Result<[HandInput; 2]> {
        if !focused {
            return Ok([HandInput::default(); 2]);
        }
        session.sync_actions(&[(&self.set).into()])?;
        let mut read = [HandInput::default(); 2];
        for side in Side::BOTH {
            let k = side.index();
            let hand = self.hands[k];
            let pressed = |action: &xr::Action<bool>| Ok(action.state(session, hand)?.current_state);
            let far = |action: &xr::Action<f32>| xr::Result::Ok(f64::from(action.state(session, hand)?.current_state));
            let stick = self.stick.state(session, hand)?.current_state;
            let [grip, aim] = &self.spaces[k];
            let grip = pose(&grip.locate(room, time)?);
            // The grip's x comes out of a left palm and goes into a right one.
            let out = if side == Side::Left { DVec3::X } else { DVec3::NEG_X };
            read[k] = HandInput {
                grip,
                palm: grip.map(|grip| grip.orientation * out),
                aim: pose(&aim.locate(room, time)?),
                squeeze: far(&self.squeeze)?,
                trigger: far(&self.trigger)?,
                click: pressed(&self.click)?,
                stick: DVec2::new(stick.x.into(), stick.y.into()),
                stick_click: pressed(&self.stick_click)?,
                primary: pressed(&self.primary)?,
                secondary: pressed(&self.secondary)?,
                menu: pressed(&self.menu)?,
            };
        }
        Ok(read)
    }

    /// Vibrates a controller: strength 0 to 1. A controller without haptics ignores it.
    pub(super) fn pulse(
        &self,
        session: &xr::Session<xr::Vulkan>,
        side: Side,
        strength: f32,
        length: std::time::Duration,
    ) -> xr::Result<()> {
        let nanoseconds = i64::try_from(length.as_nanos()).unwrap_or(i64::MAX);
        let vibration = xr::HapticVibration::new()
            .amplitude(strength.clamp(0.0, 1.0))
            .duration(if nanoseconds == 0 { xr::Duration::MIN_HAPTIC } else { xr::Duration::from_nanos(nanoseconds) })
            .frequency(xr::FREQUENCY_UNSPECIFIED);
        self.pulse.apply_feedback(session, self.hands[side.index()], &vibration)
    }

    /// The controllers in use, by the paths of their profiles; `None` for a hand without.
    pub(super) fn controllers(
        &self,
        instance: &xr::Instance,
        session: &xr::Session<xr::Vulkan>,
    ) -> [Option<String>; 2] {
        self.hands.map(|hand| {
            let profile = session.current_interaction_profile(hand).ok().filter(|p| *p != xr::Path::NULL)?;
            instance.path_to_string(profile).ok()
        })
    }
}
