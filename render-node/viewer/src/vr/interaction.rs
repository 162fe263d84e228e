//! Effects of both hands on a scene in the room, frame by frame: grabbing, brushing, buttons.

use std::sync::Arc;

use glam::DVec3;
use sg_proto::scene::{Redo, Undo, command::Action};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_selection::brush::Brush;

use crate::display::{
    BrushController, BrushMode, BrushSample, BrushSign, Locomotion, ParameterDrag, Request, Tools, TurnStyle,
    ViewState, WalkParameter, other_answer,
};
use crate::hands::locomotion::{Arc as ThrownArc, Teleport, flight, jump};
use crate::hands::{Grab, HandInput, Placement, Side, Switch, TurnMode};

use super::push_to_talk::PushToTalk;

/// How far before the controller its tip is, metres.
const REACH: f64 = 0.08;

/// Factor on the brush's radius in a second of a stick at its end.
const WIDTH_SPEED: f64 = 3.0;

/// Share of the range of a walk's leak or threshold that a stick at its end goes through in a second.
const PARAMETER_SPEED: f64 = 0.35;

/// A stick is pushed aside beyond this.
const PUSHED: f64 = 0.7;

/// A stick at rest is within this of its middle.
const REST: f64 = 0.3;

/// Degrees that a scene turns evenly in a second of a stick at its end.
const SMOOTH_TURN: f64 = 45.0;

/// Strength of the haptic pulse for a new hit.
const TICK: f32 = 0.3;

/// Output of both hands in one frame.
#[derive(Debug, Default)]
pub struct InteractionOutput {
    /// Requests to send, in this order.
    pub requests: Vec<Request>,
    /// Haptic strength of each hand.
    pub felt: Vec<(Side, f32)>,
    /// Whether to swap hidden and shown panels.
    pub panels: bool,
    /// Whether the scene jumped: by a snap turn, by a jump of the person, or back to its fitted placement.
    pub jumped: bool,
    /// Whether to keep a picture of the view.
    pub screenshot: bool,
}

/// A brush in the room.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrushMarker {
    /// Its middle, in the room.
    pub at: DVec3,
    /// Its radius in metres.
    pub radius: f64,
    /// Its sign.
    pub sign: BrushSign,
}

/// Inputs that panels have captured in this frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PanelCapture {
    /// Triggers, left and right.
    pub triggers: [bool; 2],
    /// Grips, left and right.
    pub grips: [bool; 2],
}

/// Buttons of a hand as they were.
#[derive(Debug, Clone, Copy, Default)]
struct Buttons {
    primary: bool,
    secondary: bool,
    stick: bool,
    menu: bool,
}

/// Both hands over one scene.
#[derive(Debug)]
pub struct Interaction {
    grab: Grab,
    brushes: [BrushController; 2],
    triggers: [Switch; 2],
    buttons: [Buttons; 2],
    /// The second button of the hand that takes away.
    push_to_talk: PushToTalk,
    samples: [Option<BrushSample>; 2],
    hits: [usize; 2],
    /// The last walk under the stick of the hand that adds.
    drag: ParameterDrag,
    /// Whether the other hand's stick is pushed aside.
    pushed: bool,
    /// Whether the stick of the hand that adds has taken another answer and is not back at rest.
    stepped: bool,
    teleport: Teleport,
    /// Height of the floor in the room, metres.
    pub floor: f64,
    search_tree: Arc<Brush>,
}

impl Interaction {
    /// Hands over a scene placed at `home`.
    #[must_use]
    pub fn new(scene: &Scene, home: Placement) -> Self {
        let brush = Arc::new(Brush::of_scene(scene));
        let pid = std::process::id();
        let hand = |name: &str| BrushController::new(scene, Arc::clone(&brush), format!("{name}-{pid}"));
        Self {
            grab: Grab::new(home, 0.5 * (scene.bounds.min + scene.bounds.max)),
            brushes: [hand("left"), hand("right")],
            triggers: [Switch::default(); 2],
            buttons: [Buttons::default(); 2],
            push_to_talk: PushToTalk::default(),
            samples: [None; 2],
            hits: [0; 2],
            drag: ParameterDrag::default(),
            pushed: false,
            stepped: false,
            teleport: Teleport::default(),
            floor: 0.0,
            search_tree: brush,
        }
    }

    /// Placement of the scene.
    #[must_use]
    pub fn placement(&self) -> Placement {
        self.grab.placement()
    }

    /// Brings the scene back to where it was fitted, or elsewhere.
    pub fn go(&mut self, to: Option<Placement>) {
        match to {
            Some(placement) => self.grab.go(placement),
            None => self.grab.reset(),
        }
    }

    /// Gives the scene another first place, and brings it there.
    pub fn refit(&mut self, home: Placement, middle: DVec3) {
        self.grab.refit(home, middle);
    }

    /// The hand that adds; the other one takes away.
    #[must_use]
    pub fn adds(tools: &Tools) -> Side {
        if tools.left_handed { Side::Left } else { Side::Right }
    }

    /// The search tree of the brushes.
    /// Brushes over the same Gaussians, some of them elsewhere.
    pub(super) fn set_brush(&mut self, brush: &Arc<Brush>) {
        self.search_tree = Arc::clone(brush);
        for hand in &mut self.brushes {
            hand.set_brush(Arc::clone(brush));
        }
    }

    pub(super) fn search_tree(&self) -> Arc<Brush> {
        Arc::clone(&self.search_tree)
    }

    pub(super) fn sign(side: Side, tools: &Tools) -> BrushSign {
        if side == Self::adds(tools) { BrushSign::Add } else { BrushSign::Remove }
    }

    /// Takes in both hands after `seconds`; `head` is its pose in the room.
    pub fn step(
        &mut self,
        hands: &[HandInput; 2],
        captured: PanelCapture,
        (head, seconds): (DVec3, f64),
        tools: &mut Tools,
        state: &ViewState,
    ) -> InteractionOutput {
        let adds = Self::adds(tools);
        let mut output = InteractionOutput::default();
        let may_grab = captured.grips.map(|captured| !captured);
        let before = self.placement();
        let turning = match tools.turn_style {
            TurnStyle::Snap => TurnMode::default(),
            TurnStyle::Smooth => TurnMode::Smooth(SMOOTH_TURN),
            TurnStyle::Off => TurnMode::Off,
        };
        self.grab.lock_upright(tools.upright);
        self.grab.step(hands, may_grab, (head, turning, adds), seconds);
        // A scene that no hand holds moves by the stick alone.
        output.jumped = tools.turn_style == TurnStyle::Snap && !self.grab.is_held() && before != self.placement();
        if seconds.is_finite() {
            self.sticks(hands, captured, seconds.clamp(0.0, 0.1), tools, state, &mut output);
        }
        let k = adds.other().index();
        output.jumped |= self.travel(&hands[k], captured.triggers[k] || captured.grips[k], (head, seconds), tools);
        let button = self.push_to_talk.step(hands[k].secondary, state.waits_to_talk(), seconds);
        output.requests.extend(button.control.map(Request::Speech));
        output.panels |= button.tapped;
        for side in Side::BOTH {
            self.press(side, &hands[side.index()], tools, state, &mut output);
            self.brush(side, &hands[side.index()], captured, tools, state, &mut output);
        }
        output
    }

    /// Ends talking by a held button, where hands give no input any more.
    pub(super) fn stop_talking(&mut self) -> Option<Request> {
        self.push_to_talk.interrupt().map(Request::Speech)
    }

    /// Has the person fly or jump by the stick of the hand that takes away. Returns whether they jumped.
    fn travel(&mut self, hand: &HandInput, captured: bool, (head, seconds): (DVec3, f64), tools: &Tools) -> bool {
        let pointing = hand.aim.or(hand.grip);
        let busy = captured || self.grab.is_held() || tools.locomotion != Locomotion::Teleport;
        let landing = self.teleport.step(pointing, hand.stick, (head, self.floor), busy);
        if tools.locomotion == Locomotion::Fly && !captured {
            let by = pointing.map_or(DVec3::ZERO, |pointing| flight(&pointing, hand.stick, seconds));
            self.grab.travel(by);
        }
        landing.is_some_and(|landing| self.grab.travel(jump(head, landing)))
    }

    /// The arc to where the person would jump, while a stick aims.
    #[must_use]
    pub fn aimed(&self) -> Option<&ThrownArc> {
        self.teleport.aimed()
    }

    /// Whether a hand draws a stroke or holds the scene.
    #[must_use]
    pub fn is_busy(&self, side: Side) -> bool {
        self.brushes[side.index()].is_drawing() || (self.grab.is_held() && self.grab.is_squeezed(side))
    }

    /// Handles the sticks' up and down. In walk mode, the adding hand's stick changes the last walk: a push takes another answer,
    /// or the number under it moves while it is held; up selects more. Otherwise both set the brush's width. The other hand's stick sideways
    /// selects what changes of the walk.
    fn sticks(
        &mut self,
        hands: &[HandInput; 2],
        captured: PanelCapture,
        seconds: f64,
        tools: &mut Tools,
        state: &ViewState,
        output: &mut InteractionOutput,
    ) {
        let adds = Self::adds(tools);
        let tunes = Self::tunes_walk(tools, state) && !self.brushes.iter().any(BrushController::is_drawing);
        let which = tools.walk_parameter.in_state(state);
        let mut goes_on = false;
        if hands[adds.index()].stick.y.abs() <= REST {
            self.stepped = false;
        }
        for side in Side::BOTH {
            let k = side.index();
            let stick = hands[k].stick.y;
            // A stick sizes the panel that its hand carries, and scrolls the one that it points at.
            if stick.abs() <= REST || captured.triggers[k] || captured.grips[k] {
                continue;
            }
            if side != adds && tools.locomotion != Locomotion::Off {
                continue;
            }
            if side == adds && tunes && which == WalkParameter::Size {
                if stick.abs() > PUSHED && !std::mem::replace(&mut self.stepped, true) {
                    let other = other_answer(stick > 0.0, tools.include_hidden, state);
                    output.felt.extend(other.is_some().then_some((side, TICK)));
                    output.requests.extend(other);
                }
            } else if side == adds && tunes {
                goes_on = true;
                output.requests.extend(self.drag.turn(which, -PARAMETER_SPEED * stick * seconds, state));
            } else {
                tools.widen(WIDTH_SPEED.powf(stick * seconds));
            }
        }
        if self.drag.is_held() && !goes_on {
            output.requests.extend(self.drag.release(state.scene.revision()));
        }
        let chooses = tools.locomotion == Locomotion::Off;
        let aside = if chooses { hands[adds.other().index()].stick.x } else { 0.0 };
        let was = std::mem::replace(&mut self.pushed, aside.abs() > PUSHED);
        if self.pushed && !was && !captured.triggers[adds.other().index()] && Self::tunes_walk(tools, state) {
            tools.walk_parameter = tools.walk_parameter.beside(aside > 0.0, state);
        }
    }

    /// Whether the stick changes the last walk rather than the brush.
    fn tunes_walk(tools: &Tools, state: &ViewState) -> bool {
        tools.mode == BrushMode::Walk && state.tuning().is_some()
    }

    fn press(
        &mut self,
        side: Side,
        hand: &HandInput,
        tools: &mut Tools,
        state: &ViewState,
        output: &mut InteractionOutput,
    ) {
        let was = std::mem::replace(
            &mut self.buttons[side.index()],
            Buttons { primary: hand.primary, secondary: hand.secondary, stick: hand.stick_click, menu: hand.menu },
        );
        let change = |action| Request::Change(Box::new(action));
        let adds = side == Self::adds(tools);
        if hand.primary && !was.primary {
            match adds {
                true => tools.mode = tools.mode.next(),
                false if state.services.scene => output.requests.push(change(Action::Redo(Redo { steps: 1 }))),
                false => (),
            }
        }
        // The other hand's second button shows panels, or talks.
        if hand.secondary && !was.secondary && adds && state.services.scene {
            output.requests.push(change(Action::Undo(Undo { steps: 1 })));
        }
        output.panels |= hand.menu && !was.menu;
        if hand.stick_click && !was.stick {
            match adds {
                true => {
                    self.grab.reset();
                    output.jumped = true;
                }
                false => output.screenshot = true,
            }
        }
    }

    fn brush(
        &mut self,
        side: Side,
        hand: &HandInput,
        captured: PanelCapture,
        tools: &Tools,
        state: &ViewState,
        output: &mut InteractionOutput,
    ) {
        let k = side.index();
        let was = self.triggers[k].is_on();
        let pulled = self.triggers[k].press(hand.trigger);
        let placement = self.placement();
        let holds = self.grab.is_held() && self.grab.is_squeezed(side);
        let free = state.services.selection && !captured.triggers[k] && !holds;
        let pressure = if tools.pressure { hand.trigger.clamp(0.0, 1.0) } else { 1.0 };
        let aim = hand.aim.or(hand.grip).filter(|_| free || self.brushes[k].is_drawing());
        self.samples[k] =
            aim.map(|aim| BrushSample { at: placement.to_scene(aim.position + REACH * aim.forward()), pressure });
        let brush = &mut self.brushes[k];
        match self.samples[k] {
            Some(sample) if pulled && brush.is_drawing() => brush.sample(sample),
            Some(sample) if pulled && !was => {
                brush.press(tools, sample, Self::sign(side, tools));
                self.hits[k] = 0;
            }
            _ => (),
        }
        output.requests.extend(brush.pending_samples());
        let hits = brush.hits();
        if brush.is_drawing() && hits > self.hits[k] {
            output.felt.push((side, TICK));
        }
        self.hits[k] = hits;
        if brush.is_drawing() && !pulled {
            output.requests.extend(brush.release());
        }
    }

    /// The highlight: the selection with strokes under way, or with the preview of a stroke begun here.
    #[must_use]
    pub fn highlighted(&self, state: &ViewState, tools: &Tools) -> Arc<Mask> {
        let clusters = state.clusters.as_deref();
        let mut selected = Arc::clone(&state.selected);
        for side in Side::BOTH {
            let (brush, sample) = (&self.brushes[side.index()], self.samples[side.index()]);
            if brush.is_drawing() {
                selected = brush.selects(&selected, clusters);
            } else if let Some(sample) = sample {
                let sign = Self::sign(side, tools);
                selected = Arc::new(brush.would_select(tools, sample, sign, &selected, clusters));
            }
        }
        selected
    }

    /// The brushes as they are seen in the room, left and right.
    #[must_use]
    pub fn brush_markers(&self, tools: &Tools) -> [Option<BrushMarker>; 2] {
        Side::BOTH.map(|side| {
            let sample = self.samples[side.index()]?;
            let placement = self.placement();
            let radius = self.brushes[side.index()].radius(tools) * sample.pressure * placement.scale;
            Some(BrushMarker { at: placement.to_room(sample.at), radius, sign: Self::sign(side, tools) })
        })
    }

    /// The present function of each control, for the legend of one hand.
    #[must_use]
    pub fn legend(side: Side, tools: &Tools, state: &ViewState) -> Vec<(&'static str, String)> {
        let adds = side == Self::adds(tools);
        let [one, two, two_or_menu, two_held] = match side {
            Side::Right => ["A", "B", "B, menu", "B held"],
            Side::Left => ["X", "Y", "Y, menu", "Y held"],
        };
        let mut lines = Vec::new();
        if state.services.selection {
            let what = if adds { "adds" } else { "takes away" };
            lines.push(("trigger", format!("{what}: {}", tools.mode.name())));
        }
        lines.push(("grip", "holds the scene; both scale it".to_owned()));
        if adds {
            let changes = match state.tuning().filter(|_| Self::tunes_walk(tools, state)) {
                Some(tuning) => {
                    let which = tools.walk_parameter.in_state(state);
                    format!("{} {}", which.name(), which.written(tuning, state))
                }
                None => "width".to_owned(),
            };
            let turns = if tools.turn_style == TurnStyle::Off { "" } else { "turns; " };
            lines.push(("stick", format!("{turns}up and down: {changes}")));
            lines.push((one, format!("next mode: {}", tools.mode.next().name())));
        }
        if state.services.scene {
            let line = |what: &str, step: Option<&String>, lines: &[String]| match step {
                Some(line) => format!("{what} {line}"),
                None if lines.is_empty() && state.knows_steps() => format!("nothing to {what}"),
                None => what.to_owned(),
            };
            lines.push(if adds {
                (two, line("undo", state.undo_step(), &state.undo))
            } else {
                (one, line("redo", state.redo_step(), &state.redo))
            });
        }
        if !adds {
            let moves = match tools.locomotion {
                Locomotion::Off => "up and down: width",
                Locomotion::Fly => "flies where the hand points",
                Locomotion::Teleport => "forward aims, let go to jump",
            };
            lines.push(("stick", moves.to_owned()));
            if Self::tunes_walk(tools, state) && tools.locomotion == Locomotion::Off {
                let [left, right] = [false, true].map(|after| tools.walk_parameter.beside(after, state).name());
                lines.push(("stick aside", format!("left: {left}, right: {right}")));
            }
            lines.push((two_or_menu, "panels".to_owned()));
            if state.waits_to_talk() {
                lines.push((two_held, "talk".to_owned()));
            }
            lines.push(("palm to the eyes", "a menu".to_owned()));
        }
        let pressed = if adds { "back to the first place" } else { "screenshot" };
        lines.push(("stick pressed", pressed.to_owned()));
        lines
    }
}
