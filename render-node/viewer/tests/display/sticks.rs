//! The effects of sticks in the room, before and after a walk.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use sg_proto::scene::{StrokeMode, selection_step::Step};
use sg_proto::selection::AnswerStep;
use sg_proto::speech::{self, Control, Trigger};
use sg_scene::model::Scene;
use sg_viewer::display::{BrushMode, Locomotion, Request, Tools, TurnStyle, ViewState, WalkParameter};
use sg_viewer::hands::locomotion::{FLY_SPEED, arc};
use sg_viewer::hands::{HandInput, Origin, Placement, Pose, Side, Stance};
use sg_viewer::vr::{Interaction, InteractionOutput, PanelCapture};

use crate::brush::row_of_gaussians;
use crate::parameter_drag::{FIRST, after_steps, stroke, with_answers};

struct Room {
    acts: Interaction,
    tools: Tools,
    shown: ViewState,
}

impl Room {
    fn new(scene: &Arc<Scene>, shown: ViewState) -> Self {
        let home = Placement::fit(scene.bounds, DVec3::Z, DVec3::Y, Stance::Standing, Origin::Floor);
        Self { acts: Interaction::new(scene, home), tools: Tools::default(), shown }
    }

    /// A frame of a hundredth of a second with these sticks, left and right.
    fn frame(&mut self, left: DVec2, right: DVec2, taken: PanelCapture) -> InteractionOutput {
        self.act([left, right].map(|stick| HandInput { stick, ..HandInput::default() }), taken)
    }

    fn act(&mut self, hands: [HandInput; 2], taken: PanelCapture) -> InteractionOutput {
        self.acts.step(&hands, taken, (DVec3::ZERO, 0.01), &mut self.tools, &self.shown)
    }

    fn legend(&self, side: Side) -> String {
        Interaction::legend(side, &self.tools, &self.shown)
            .iter()
            .map(|(what, does)| format!("{what}: {does}\n"))
            .collect()
    }
}

const UP: DVec2 = DVec2::Y;

#[test]
fn a_stick_turns_at_once_evenly_or_not_at_all() {
    let scene = Arc::new(row_of_gaussians(6));
    for (turns, degrees, jumps) in [(TurnStyle::Snap, 30.0, 1), (TurnStyle::Smooth, 45.0, 0), (TurnStyle::Off, 0.0, 0)]
    {
        let mut room = Room::new(&scene, after_steps(&scene, vec![stroke(StrokeMode::Point)]));
        room.tools.turn_style = turns;
        let before = room.acts.placement();
        // A second at the end, and back.
        let jumped = (0..100).filter(|_| room.frame(DVec2::ZERO, DVec2::X, PanelCapture::default()).jumped).count();
        room.frame(DVec2::ZERO, DVec2::ZERO, PanelCapture::default());
        let turned = before.rotation.angle_between(room.acts.placement().rotation).to_degrees();
        assert!((turned - degrees).abs() < 1e-6 && jumped == jumps, "{turns:?}: {turned}°, {jumped} jumps");
        assert_eq!(room.legend(Side::Right).contains("turns"), turns != TurnStyle::Off);
    }
}

#[test]
fn before_a_walk_sticks_say_how_wide_the_brush_is() {
    let scene = Arc::new(row_of_gaussians(6));
    let mut room = Room::new(&scene, after_steps(&scene, vec![stroke(StrokeMode::Point)]));
    let radius = room.tools.radius;
    assert_eq!(room.frame(DVec2::ZERO, UP, PanelCapture::default()).requests, []);
    let wider = room.tools.radius;
    assert!(wider > radius);
    assert_eq!(room.frame(UP, DVec2::ZERO, PanelCapture::default()).requests, []);
    assert!(room.tools.radius > wider);
    assert!(room.legend(Side::Right).contains("up and down: width") && !room.legend(Side::Left).contains("Reach"));
}

#[test]
fn after_a_walk_the_stick_of_the_hand_that_adds_scrubs_it() {
    let scene = Arc::new(row_of_gaussians(6));
    let mut room = Room::new(&scene, after_steps(&scene, vec![stroke(StrokeMode::Walk)]));
    let radius = room.tools.radius;
    let mut newest = FIRST;
    for _ in 0..10 {
        let did = room.frame(DVec2::ZERO, UP, PanelCapture::default());
        let [Request::Tune(tuning)] = did.requests.as_slice() else { panic!("{:?}", did.requests) };
        assert!(tuning.leak < newest.leak && tuning.threshold == FIRST.threshold);
        newest = *tuning;
    }
    assert!((newest.leak / FIRST.leak).log10() < -0.13, "a tenth of a second at the end: {newest:?}");
    assert_eq!(room.tools.radius, radius);
    // At rest again, it is one step.
    let did = room.frame(DVec2::ZERO, DVec2::ZERO, PanelCapture::default());
    let [Request::Select(asked)] = did.requests.as_slice() else { panic!("{:?}", did.requests) };
    assert_eq!(asked.steps.first().and_then(|s| s.step.clone()), Some(Step::Tuning(newest)));
    assert_eq!(room.frame(DVec2::ZERO, DVec2::ZERO, PanelCapture::default()).requests, []);
    // The other hand has the width, and a sideways push chooses one of the two numbers.
    room.frame(UP, DVec2::ZERO, PanelCapture::default());
    assert!(room.tools.radius > radius);
    room.frame(DVec2::X, DVec2::ZERO, PanelCapture::default());
    assert_eq!(room.tools.walk_parameter, WalkParameter::Threshold);
    assert!(room.legend(Side::Right).contains("up and down: Strictness 0"), "{}", room.legend(Side::Right));
    assert!(room.legend(Side::Left).contains("left: Reach"), "{}", room.legend(Side::Left));
    let did = room.frame(DVec2::ZERO, -UP, PanelCapture::default());
    assert!(
        matches!(did.requests.as_slice(), [Request::Tune(t)] if t.threshold > FIRST.threshold && t.leak == newest.leak)
    );
    room.frame(-DVec2::X, DVec2::ZERO, PanelCapture::default());
    assert_eq!(room.tools.walk_parameter, WalkParameter::Leak);
}

#[test]
fn with_several_answers_each_push_of_the_stick_takes_the_next_one() {
    let scene = Arc::new(row_of_gaussians(6));
    let walked = after_steps(&scene, vec![stroke(StrokeMode::Walk)]);
    let mut room = Room::new(&scene, with_answers(&walked, 1));
    let radius = room.tools.radius;
    let asked = |did: InteractionOutput| -> Vec<AnswerStep> {
        let of = |request: &Request| if let Request::Select(s) = request { s.answer() } else { panic!("{request:?}") };
        did.requests.iter().map(of).collect()
    };
    let none = PanelCapture::default();
    assert!(room.legend(Side::Right).contains("up and down: Size 2 of 3"), "{}", room.legend(Side::Right));
    // On the way to a push, nothing happens; held, it counts once.
    assert_eq!(asked(room.frame(DVec2::ZERO, 0.5 * UP, none)), []);
    let did = room.frame(DVec2::ZERO, UP, none);
    assert!(!did.felt.is_empty());
    assert_eq!(asked(did), [AnswerStep::Wider]);
    assert_eq!(asked(room.frame(DVec2::ZERO, UP, none)), []);
    assert_eq!(asked(room.frame(DVec2::ZERO, DVec2::ZERO, none)), []);
    assert_eq!(asked(room.frame(DVec2::ZERO, -UP, none)), [AnswerStep::Narrower]);
    room.frame(DVec2::ZERO, DVec2::ZERO, none);
    // At the last answer a push does nothing, and says so by not being felt.
    room.shown = with_answers(&walked, 2);
    let did = room.frame(DVec2::ZERO, UP, none);
    assert!(did.requests.is_empty() && did.felt.is_empty());
    assert_eq!(room.tools.radius, radius);
    // The other stick aside chooses a number, which a held stick moves.
    room.frame(DVec2::X, DVec2::ZERO, none);
    assert_eq!(room.tools.walk_parameter, WalkParameter::Leak);
    assert!(room.legend(Side::Left).contains("left: Size, right: Strictness"), "{}", room.legend(Side::Left));
    assert!(matches!(room.frame(DVec2::ZERO, UP, none).requests.as_slice(), [Request::Tune(_)]));
}

#[test]
fn a_stick_that_belongs_to_a_panel_or_to_another_mode_scrubs_nothing() {
    let scene = Arc::new(row_of_gaussians(6));
    let mut room = Room::new(&scene, after_steps(&scene, vec![stroke(StrokeMode::Walk)]));
    let radius = room.tools.radius;
    for taken in [
        PanelCapture { triggers: [false, true], ..PanelCapture::default() },
        PanelCapture { grips: [false, true], ..PanelCapture::default() },
    ] {
        assert_eq!(room.frame(DVec2::ZERO, UP, taken).requests, []);
    }
    assert_eq!(room.tools.radius, radius);
    room.tools.mode = BrushMode::Point;
    assert_eq!(room.frame(DVec2::ZERO, UP, PanelCapture::default()).requests, []);
    assert!(room.tools.radius > radius);
    // With the hands changed, the left one scrubs.
    room.tools = Tools { left_handed: true, ..Tools::default() };
    let did = room.frame(UP, DVec2::ZERO, PanelCapture::default());
    assert!(matches!(did.requests.as_slice(), [Request::Tune(_)]));
}

/// A left hand at `pose` with this stick.
fn left(pose: Pose, stick: DVec2) -> [HandInput; 2] {
    [HandInput { grip: Some(pose), aim: Some(pose), stick, ..HandInput::default() }, HandInput::default()]
}

const LEVEL: Pose = Pose { position: DVec3::new(-0.2, 1.2, -0.4), ..Pose::IDENTITY };

#[test]
fn the_other_stick_flies_where_its_hand_points_and_sizes_nothing() {
    let scene = Arc::new(row_of_gaussians(6));
    let mut room = Room::new(&scene, after_steps(&scene, vec![stroke(StrokeMode::Walk)]));
    room.tools.locomotion = Locomotion::Fly;
    let (before, radius) = (room.acts.placement(), room.tools.radius);
    for _ in 0..100 {
        let did = room.act(left(LEVEL, UP), PanelCapture::default());
        assert!(did.requests.is_empty() && !did.jumped);
    }
    let moved = room.acts.placement().translation - before.translation;
    assert!(moved.distance(DVec3::new(0.0, 0.0, FLY_SPEED)) < 1e-6, "the scene comes nearer: {moved}");
    assert_eq!((room.tools.radius, room.tools.walk_parameter), (radius, WalkParameter::default()));
    room.act(left(LEVEL, DVec2::X), PanelCapture::default());
    assert_eq!(room.tools.walk_parameter, WalkParameter::default(), "it chooses nothing");
    // A stick that scrolls a panel, and a held scene, do not fly.
    let before = room.acts.placement();
    room.act(left(LEVEL, UP), PanelCapture { triggers: [true, false], ..PanelCapture::default() });
    let mut hands = left(LEVEL, UP);
    hands[0].squeeze = 1.0;
    room.act(hands, PanelCapture::default());
    assert_eq!(room.acts.placement(), before);
    assert!(room.legend(Side::Left).contains("flies"), "{}", room.legend(Side::Left));
}

#[test]
fn the_other_stick_aims_at_the_floor_and_jumps_there_when_it_is_let_go() {
    let scene = Arc::new(row_of_gaussians(6));
    let mut room = Room::new(&scene, after_steps(&scene, vec![stroke(StrokeMode::Point)]));
    room.tools.locomotion = Locomotion::Teleport;
    let before = room.acts.placement();
    room.act(left(LEVEL, UP), PanelCapture::default());
    let aimed = room.acts.aimed().cloned().unwrap();
    assert_eq!(aimed, arc(&LEVEL, DVec3::ZERO, 0.0));
    assert_eq!(room.acts.placement(), before, "not yet");
    let did = room.act(left(LEVEL, DVec2::ZERO), PanelCapture::default());
    let (after, landing) = (room.acts.placement(), aimed.landing.unwrap());
    assert!(did.jumped && room.acts.aimed().is_none());
    assert!((after.translation - before.translation).distance(-landing.with_y(0.0)) < 1e-9);
    assert_eq!((after.rotation, after.scale), (before.rotation, before.scale));
    // Another floor, such as that of a person without a stage.
    room.acts.floor = -1.6;
    room.act(left(LEVEL, UP), PanelCapture::default());
    assert_eq!(room.acts.aimed().and_then(|a| a.landing).map(|l| l.y), Some(-1.6));
    assert!(room.legend(Side::Left).contains("let go to jump"));
}

#[test]
fn a_pressed_stick_goes_home_or_keeps_a_picture() {
    let scene = Arc::new(row_of_gaussians(6));
    let mut room = Room::new(&scene, after_steps(&scene, vec![stroke(StrokeMode::Point)]));
    let pressed = HandInput { stick_click: true, ..HandInput::default() };
    let did = room.act([pressed, HandInput::default()], PanelCapture::default());
    assert!(did.screenshot && !did.jumped);
    let did = room.act([pressed, HandInput::default()], PanelCapture::default());
    assert!(!did.screenshot, "once for a press");
    let did = room.act([HandInput::default(), pressed], PanelCapture::default());
    assert!(did.jumped && !did.screenshot);
}

#[test]
fn the_other_hand_s_second_button_talks_while_a_microphone_waits_for_it() {
    let scene = Arc::new(row_of_gaussians(6));
    let mut room = Room::new(&scene, after_steps(&scene, vec![stroke(StrokeMode::Point)]));
    let held = |room: &mut Room, frames: usize| {
        let hand = |secondary| HandInput { secondary, ..HandInput::default() };
        let down = (0..frames).map(|_| true).chain([false]);
        let frames: Vec<InteractionOutput> =
            down.map(|down| room.act([hand(down), HandInput::default()], PanelCapture::default())).collect();
        let requests: Vec<Request> = frames.iter().flat_map(|frame| frame.requests.clone()).collect();
        (requests, frames.iter().any(|frame| frame.panels))
    };
    assert_eq!(held(&mut room, 100), (vec![], true));
    assert!(!room.legend(Side::Left).contains("talk"));
    let speech = speech::State {
        input: "device".to_owned(),
        recognizer: "whisper".to_owned(),
        trigger: Trigger::Held.into(),
        ..speech::State::default()
    };
    room.shown.speech = Some(Arc::new(speech.clone()));
    let talks = vec![Request::Speech(Control::Press), Request::Speech(Control::Release)];
    assert_eq!(held(&mut room, 100), (talks.clone(), false));
    assert_eq!(held(&mut room, 10), (talks, true), "a tap shows the panels");
    assert!(room.legend(Side::Left).contains("Y, menu: panels\nY held: talk\n"));
    for other in [
        speech::State { muted: true, ..speech.clone() },
        speech::State { trigger: Trigger::Voice.into(), ..speech.clone() },
        speech::State { input: String::new(), ..speech },
    ] {
        room.shown.speech = Some(Arc::new(other));
        assert_eq!(held(&mut room, 100), (vec![], true));
    }
}
