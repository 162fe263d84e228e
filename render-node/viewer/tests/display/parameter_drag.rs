//! The leak and the threshold of the last walk under a hand.

use std::sync::Arc;

use sg_edit::EditState;
use sg_edit::wire::encode_mask;
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::{CommitSelection, SelectionStep, Stroke, StrokeKind, StrokeMode, WalkTuning, command::Action};
use sg_proto::selection::{Answer, AnswerStep, Answers, Proposal, ProposalsReply};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_viewer::display::{
    LEAK_RANGE, ParameterDrag, Request, RequestQueue, ServiceAvailability, THRESHOLD_RANGE, ViewPort, ViewState,
    WalkCapabilities, WalkParameter, answer_place, beside_answer, other_answer,
};

use crate::brush::row_of_gaussians;

pub(crate) const FIRST: WalkTuning = WalkTuning { leak: 0.03, threshold: 1e-12 };

/// A scene in which these steps were taken, as reported by a service that does walks with `FIRST`.
pub(crate) fn after_steps(scene: &Arc<Scene>, steps: Vec<Step>) -> ViewState {
    let steps = steps.into_iter().map(|step| SelectionStep { step: Some(step) }).collect();
    let mask = Some(encode_mask(&Mask::from_fn(scene.len(), |i| i < 2)));
    let commit = Action::CommitSelection(CommitSelection { mask, steps, ..CommitSelection::default() });
    let state = EditState::of_scene(scene, "scene.ply", "hash").after(scene, commit).unwrap();
    ViewState {
        services: ServiceAvailability { scene: true, selection: true, agents: false, labeling: false },
        walk_capabilities: Some(WalkCapabilities { tuning: Some(FIRST), most_proposals: 16 }),
        ..ViewState::of(Arc::new(state))
    }
}

pub(crate) fn stroke(mode: StrokeMode) -> Step {
    let points = vec![0.5; 3];
    let (mode, kind) = (mode.into(), StrokeKind::Foreground.into());
    Step::Stroke(Stroke { mode, kind, radius: 0.1, points, pressure: Vec::new(), depth: None })
}

#[test]
fn only_walk_steps_are_solved_again_where_a_solver_exists() {
    let scene = Arc::new(row_of_gaussians(6));
    assert_eq!(after_steps(&scene, vec![stroke(StrokeMode::Point)]).tuning(), None);
    let walked = after_steps(&scene, vec![stroke(StrokeMode::Walk), stroke(StrokeMode::Point)]);
    assert_eq!((walked.tuning(), walked.most_proposals()), (Some(FIRST), 16));
    let second = WalkTuning { leak: 0.2, threshold: 0.5 };
    let tuned = after_steps(&scene, vec![stroke(StrokeMode::Walk), Step::Tuning(FIRST), Step::Tuning(second)]);
    assert_eq!(tuned.tuning(), Some(second));
    assert_eq!(ViewState { walk_capabilities: None, ..tuned.clone() }.tuning(), None);
    assert_eq!(
        ViewState { walk_capabilities: Some(WalkCapabilities { tuning: None, most_proposals: 0 }), ..tuned.clone() }
            .tuning(),
        None
    );
    assert_eq!(ViewState { services: ServiceAvailability::default(), ..tuned }.tuning(), None);
}

#[test]
fn a_hand_gesture_is_previewed_and_becomes_one_step() {
    let scene = Arc::new(row_of_gaussians(6));
    let shown = after_steps(&scene, vec![stroke(StrokeMode::Walk)]);
    let mut drag = ParameterDrag::default();
    assert!(drag.release(shown.scene.revision()).is_none(), "nothing was held");
    let Some(Request::Tune(less)) = drag.turn(WalkParameter::Leak, -0.25, &shown) else { panic!("nothing is tried") };
    assert!((less.leak / 0.003 - 1.0).abs() < 1e-9 && less.threshold == FIRST.threshold, "{less:?}");
    let Some(Request::Tune(both)) = drag.turn(WalkParameter::Threshold, 0.25, &shown) else {
        panic!("nothing is tried")
    };
    assert!(both.leak == less.leak && (both.threshold - 0.475).abs() < 1e-9, "{both:?}");
    assert_eq!(drag.set(both, &shown), None, "no news");
    let Some(Request::Select(asked)) = drag.release(shown.scene.revision()) else { panic!("nothing is taken") };
    assert_eq!(asked.steps, [SelectionStep { step: Some(Step::Tuning(both)) }]);
    assert!(!asked.restart && asked.strokes.is_empty());
    // It shows until the scene reports a change.
    assert_eq!(drag.tuning(&shown), Some(both));
    let newer = shown
        .scene
        .after(&scene, Action::SetBackground(sg_proto::scene::SetBackground { color: Some(Default::default()) }));
    let newer = ViewState { scene: Arc::new(newer.unwrap()), ..shown.clone() };
    assert!(newer.scene.revision() > shown.scene.revision() && drag.tuning(&newer) == Some(FIRST));
    assert_eq!(drag.turn(WalkParameter::Leak, 0.1, &newer).map(|_| drag.abandon()), Some(Some(Request::Forget)));
    assert_eq!(drag.abandon(), None);
}

#[test]
fn a_hand_stays_within_the_range() {
    for way in [-5.0, 5.0, f64::NAN, f64::INFINITY] {
        for which in WalkParameter::ALL {
            let moved = which.moved(WalkTuning { leak: 0.0, threshold: -1.0 }, way);
            assert!(moved.leak >= 0.0 && moved.leak <= LEAK_RANGE.1, "{moved:?}");
            assert!(moved.threshold >= -1.0 && moved.threshold <= THRESHOLD_RANGE.1, "{moved:?}");
        }
    }
}

/// The same with three answers, of which this one is taken.
pub(crate) fn with_answers(shown: &ViewState, taken: u32) -> ViewState {
    let steps =
        [(0.4, 10), (0.05, 30), (0.002, 70)].map(|(leak, gaussians)| Answer { leak, gaussians, conductance: 0.1 });
    let tuning = Some(WalkTuning { leak: steps[taken as usize].leak, ..FIRST });
    let answers = Answers { steps: steps.to_vec(), first: 1, taken, tuning };
    ViewState { answers: Some(Arc::new(answers)), ..shown.clone() }
}

#[test]
fn a_walk_has_its_first_answers_leak_until_a_step_sets_another() {
    let scene = Arc::new(row_of_gaussians(6));
    let walked = after_steps(&scene, vec![stroke(StrokeMode::Walk)]);
    assert_eq!(with_answers(&walked, 2).tuning().map(|t| t.leak), Some(0.002));
    let tuned = after_steps(&scene, vec![stroke(StrokeMode::Walk), Step::Tuning(FIRST)]);
    assert_eq!(with_answers(&tuned, 2).tuning(), Some(FIRST));
    // Without a walk, and without a service that can repeat it, there are none.
    let points = after_steps(&scene, vec![stroke(StrokeMode::Point)]);
    assert!(with_answers(&points, 1).answers().is_none());
    assert!(ViewState { walk_capabilities: None, ..with_answers(&walked, 1) }.answers().is_none());
    let mut single = with_answers(&walked, 0);
    Arc::make_mut(single.answers.as_mut().unwrap()).steps.truncate(1);
    assert!(single.answers().is_none());
}

#[test]
fn less_and_more_are_requests_up_to_the_last_answer() {
    let scene = Arc::new(row_of_gaussians(6));
    let walked = after_steps(&scene, vec![stroke(StrokeMode::Walk)]);
    let asked = |wider, taken| match other_answer(wider, true, &with_answers(&walked, taken)) {
        Some(Request::Select(request)) => Some((request.answer(), request.include_hidden, request.steps.len())),
        Some(other) => panic!("{other:?}"),
        None => None,
    };
    assert_eq!(asked(true, 1), Some((AnswerStep::Wider, true, 0)));
    assert_eq!(asked(false, 1), Some((AnswerStep::Narrower, true, 0)));
    assert_eq!((asked(false, 0), asked(true, 2)), (None, None));
    assert_eq!(other_answer(true, false, &walked), None);
    assert_eq!(beside_answer(true, &with_answers(&walked, 1)).map(|a| a.gaussians), Some(70));
    assert_eq!(answer_place(with_answers(&walked, 1).answers().unwrap()), "2 of 3");
}

#[test]
fn size_is_there_only_with_several_answers() {
    let scene = Arc::new(row_of_gaussians(6));
    let one = after_steps(&scene, vec![stroke(StrokeMode::Walk)]);
    let several = with_answers(&one, 1);
    assert_eq!(WalkParameter::default().in_state(&one), WalkParameter::Leak);
    assert_eq!(WalkParameter::default().in_state(&several), WalkParameter::Size);
    let round = |state: &ViewState| {
        let mut which = WalkParameter::default();
        [(); 4].map(|()| {
            which = which.next(state);
            which
        })
    };
    let (size, leak, threshold) = (WalkParameter::Size, WalkParameter::Leak, WalkParameter::Threshold);
    assert_eq!(round(&several), [leak, threshold, size, leak]);
    assert_eq!(round(&one), [threshold, leak, threshold, leak]);
    assert_eq!([size.beside(false, &several), threshold.beside(true, &several)], [size, threshold]);
}

#[test]
fn superseded_values_are_never_processed() {
    let scene = Arc::new(row_of_gaussians(6));
    let shown = after_steps(&scene, vec![stroke(StrokeMode::Walk)]);
    let (mut view_port, service) = ViewPort::new(shown.clone());
    let mut drag = ParameterDrag::default();
    let mut asked = RequestQueue::new(service.requests);
    for _ in 0..10 {
        view_port.send(drag.turn(WalkParameter::Leak, -0.01, &shown).unwrap());
    }
    let newest = drag.tuning(&shown).unwrap();
    assert_eq!(asked.next(), Some(Request::Tune(newest)));
    view_port.send(drag.turn(WalkParameter::Leak, -0.01, &shown).unwrap());
    let step = drag.release(shown.scene.revision()).unwrap();
    view_port.send(step.clone());
    view_port.send(Request::Say("on".to_owned()));
    assert_eq!(asked.next(), Some(step), "what is taken needs no trying");
    assert_eq!((asked.next(), asked.superseded()), (Some(Request::Say("on".to_owned())), 10));
    drop(view_port);
    assert_eq!(asked.next(), None);
}

#[test]
fn proposals_are_about_the_selection_that_is_there() {
    let scene = Arc::new(row_of_gaussians(6));
    let mut shown = after_steps(&scene, vec![stroke(StrokeMode::Walk)]);
    let selection_hash = shown.scene.selection().hash().to_owned();
    let place = Proposal { point: vec![0.5; 3], ..Proposal::default() };
    let told = |selection_hash| ProposalsReply { proposals: vec![place.clone()], selection_hash, proposals_ms: 1.0 };
    shown.proposals = Some(Arc::new(told(selection_hash)));
    assert_eq!(shown.proposals(), std::slice::from_ref(&place));
    shown.proposals = Some(Arc::new(told("another".to_owned())));
    assert_eq!(shown.proposals(), []);
}
