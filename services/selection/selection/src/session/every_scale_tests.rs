//! One stroke at every scale: the first answer, its neighbours, and what the steps keep of a choice.

use super::tests::{made, stroke};
use super::*;
use crate::answers::{AnswerChange, LEAKS, NoAnswer, Scale};
use crate::operations::Operation;
use crate::preview::Preview;
use crate::selection_index::{Background, WalkOptions};
use glam::Vec3;
use sg_scene::synthetic::{normalized, vessel_and_sac};

fn at_every_scale() -> (SelectionSession, Stroke, Stroke) {
    let (scene, _) = vessel_and_sac(6000, 3);
    let (space, _) = made(&scene, 300, WalkOptions::every_scale());
    let place = |p: [f32; 3]| normalized(&scene, &[Vec3::from_array(p)]);
    let green = stroke(Mode::Walk, Kind::Foreground, 0.03, place([0.0, 0.0, 0.66]));
    let red = stroke(Mode::Walk, Kind::Background, 0.03, place([1.0, 0.0, -0.12]));
    (SelectionSession::new(space), green, red)
}

#[test]
fn the_first_answer_is_one_of_nested_masks_and_equals_the_walk_with_its_leak() {
    let (mut session, green, red) = at_every_scale();
    assert_eq!(session.answers(), Ok(None));
    for stroke in [green, red] {
        session.add_stroke(stroke).unwrap();
        let answers = session.answers().unwrap().unwrap().clone();
        assert_eq!((answers.family.len(), session.tuning().leak), (LEAKS, answers.first().leak));
        assert_eq!(answers.first().gaussians, session.mask().count());
        let first = session.clone();
        let mut narrower: Option<Mask> = None;
        for answer in &answers.family {
            session.tune(Tuning { leak: answer.leak, ..session.tuning() }).unwrap();
            assert_eq!(session.mask().count(), answer.gaussians);
            assert!(narrower.is_none_or(|mask| mask.is_subset_of(session.mask())));
            narrower = Some(session.mask().clone());
            assert_eq!(session.answers().unwrap(), Some(&answers), "a tuning leaves the answers as they are");
        }
        session.tune(first.tuning()).unwrap();
        assert_eq!(
            (session.mask(), &session.walk().unwrap().solution),
            (first.mask(), &first.walk().unwrap().solution)
        );
        // Uncertainty and proposals are those of the walk that is shown.
        assert_eq!(session.uncertainty(), first.uncertainty());
        assert!(!first.proposals(3).is_empty() && session.proposals(3) == first.proposals(3));
        session = first;
    }
}

#[test]
fn later_strokes_leave_out_the_scales_that_they_disagree_with() {
    let (session, green, _) = at_every_scale();
    // The masks of the first stroke at each leak, by ordinary walks.
    let mut alone = session.clone();
    alone.add_stroke(green.clone()).unwrap();
    let before = alone.answers().unwrap().unwrap().clone();
    let masks: Vec<Mask> = before
        .family
        .iter()
        .map(|answer| {
            alone.tune(Tuning { leak: answer.leak, ..alone.tuning() }).unwrap();
            alone.mask().clone()
        })
        .collect();
    let share = |stroke: &Stroke, mask: &Mask| {
        let index = session.index();
        let clusters: std::collections::BTreeSet<usize> =
            index.hits(stroke).iter().filter_map(|g| index.cluster_of(*g)).collect();
        let members: Vec<u32> = clusters.iter().flat_map(|c| index.members(*c)).copied().collect();
        members.iter().filter(|g| mask.get(**g as usize)).count() as f64 / members.len() as f64
    };
    // A place that the narrowest mask does not hold, and that one does which does not take nearly everything.
    let (scene, _) = vessel_and_sac(6000, 3);
    let held = masks.iter().find(|m| m.count() > masks[0].count() && m.count() < 4800).unwrap();
    let place = held.ones().find(|g| !masks[0].get(*g)).and_then(|g| scene.position(g)).unwrap();
    let points = normalized(&scene, &[place.as_vec3()]);
    let near = stroke(Mode::Walk, Kind::Foreground, 1e-6, points.clone());
    let red = stroke(Mode::Walk, Kind::Background, 1e-6, points);
    for (second, agrees) in [
        (red.clone(), Box::new(|mask: &Mask| share(&red, mask) < 1.0) as Box<dyn Fn(&Mask) -> bool>),
        (near.clone(), Box::new(|mask: &Mask| share(&near, mask) > 0.0)),
    ] {
        let consistent: Vec<usize> = (0..LEAKS).filter(|i| agrees(&masks[*i])).collect();
        assert!(!consistent.is_empty() && consistent.len() < LEAKS, "{:?}: {consistent:?}", second.kind);
        let mut drawn = session.clone();
        drawn.add_stroke(green.clone()).unwrap();
        let one = drawn.clone();
        drawn.add_stroke(second.clone()).unwrap();
        let after = drawn.answers().unwrap().unwrap().clone();
        assert!(after.steps.iter().all(|i| consistent.contains(i)), "{:?}: {after:?}", second.kind);
        assert_eq!(drawn.tuning().leak, after.first().leak);
        // The same from the list of steps, in a preview, and after an undo.
        let steps: Vec<Step> = drawn.steps().cloned().collect();
        let mut again = SelectionSession::of_steps(session.index(), &steps).unwrap();
        assert_eq!((again.mask(), again.tuning()), (drawn.mask(), drawn.tuning()));
        assert_eq!(again.answers().unwrap(), Some(&after));
        assert_eq!(&one.preview(second).unwrap(), drawn.mask());
        drawn.undo().unwrap();
        assert_eq!(drawn.answers().unwrap(), Some(&before));
        assert_eq!((drawn.mask(), drawn.tuning()), (one.mask(), one.tuning()));
    }
}

#[test]
fn other_answers_are_tunings_or_are_refused() {
    let (mut session, green, _) = at_every_scale();
    assert_eq!(session.other_answer(AnswerChange::Wider), Err(SelectionError::NoWalk));
    session.add_stroke(green.clone()).unwrap();
    let answers = session.answers().unwrap().unwrap().clone();
    assert!(answers.steps.len() > 1, "{answers:?}");
    let mut counts = Vec::new();
    if let Ok(narrowest) = session.other_answer(AnswerChange::Narrowest) {
        session.add_step(narrowest.into()).unwrap();
    }
    loop {
        counts.push(session.mask().count());
        match session.other_answer(AnswerChange::Wider) {
            Ok(wider) => session.add_step(wider.into()).unwrap(),
            Err(error) => {
                assert_eq!(error, SelectionError::NoAnswer(NoAnswer::Widest));
                break;
            }
        };
    }
    let of_steps: Vec<usize> = answers.steps.iter().map(|i| answers.family[*i].gaussians).collect();
    assert_eq!(counts, of_steps);
    let (scene, _) = vessel_and_sac(6000, 3);
    let mut fixed = SelectionSession::new(made(&scene, 300, WalkOptions::default()).0);
    fixed.add_stroke(green).unwrap();
    assert_eq!(fixed.other_answer(AnswerChange::Wider), Err(SelectionError::NoAnswer(NoAnswer::OneScale)));
}

#[test]
fn a_choice_is_a_step_that_replays_and_is_undone() {
    let (mut session, green, red) = at_every_scale();
    session.add_stroke(green).unwrap();
    session.add_step(Operation::Invert.into()).unwrap();
    let first = session.clone();
    let answers = session.answers().unwrap().unwrap().clone();
    let chosen = answers.at(Scale::Wider).or(answers.at(Scale::Narrower)).unwrap();
    session.add_step(Tuning { leak: chosen.leak, ..session.tuning() }.into()).unwrap();
    assert_ne!(session.mask(), first.mask());
    // The choice holds for later strokes.
    session.add_stroke(red).unwrap();
    assert_eq!(session.tuning().leak, chosen.leak);
    let steps: Vec<Step> = session.steps().cloned().collect();
    let mut again = SelectionSession::of_steps(session.index(), &steps).unwrap();
    assert_eq!((again.mask(), again.tuning()), (session.mask(), session.tuning()));
    assert_eq!(again.answers(), session.answers());
    session.undo().unwrap();
    session.undo().unwrap();
    assert_eq!((session.mask(), session.tuning()), (first.mask(), first.tuning()));
}

#[test]
fn a_preview_ends_at_the_committed_answer() {
    let (session, green, _) = at_every_scale();
    let mut preview = Preview::begin(&session, &green).unwrap();
    for x in [-0.1_f64, 0.0, 0.05, 0.1] {
        let at = green.points[0];
        preview.extend(&[[at[0] + 0.3 * x, at[1], at[2]]], &[]).unwrap();
    }
    let mut drawn = session.clone();
    drawn.add_stroke(preview.stroke().clone()).unwrap();
    assert_eq!(preview.mask(), drawn.mask());
}

#[test]
fn deleted_gaussians_and_other_rules_keep_to_their_own() {
    let (mut session, green, _) = at_every_scale();
    let deleted = Arc::new(Mask::from_fn(6000, |g| g % 3 == 0));
    let mut without = SelectionSession::new(Arc::new(session.index().without(&deleted)));
    without.add_stroke(green.clone()).unwrap();
    let answers = without.answers().unwrap().unwrap().clone();
    assert!(answers.family.iter().all(|a| a.gaussians <= 4000));
    assert_eq!(answers.first().gaussians, without.mask().count());
    assert!(without.mask().ones().all(|g| !deleted.get(g)));
    session.add_stroke(green.clone()).unwrap();
    let (scene, _) = vessel_and_sac(6000, 3);
    for options in [
        WalkOptions { background: Background::Farthest, ..WalkOptions::every_scale() },
        WalkOptions { solver: sg_walk::Solver::Cholesky, ..WalkOptions::every_scale() },
        WalkOptions::default(),
    ] {
        let mut session = SelectionSession::new(made(&scene, 300, options).0);
        session.add_stroke(green.clone()).unwrap();
        assert!(session.answers().unwrap().is_none() && session.tuning().leak == 0.03 && !session.mask().is_none());
    }
}
