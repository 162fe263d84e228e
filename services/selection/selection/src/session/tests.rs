//! Sequences of steps: their total effect, undo and replay.

use super::*;
use crate::operation_context::OperationContext;
use crate::operations::{Combine, Operation};
use crate::selection_index::WalkOptions;
use proptest::prelude::*;
use sg_clusters::cluster_graph::{ClusterGraph, GraphForm};
use sg_clusters::clustering::{Clustering, ClusteringOptions, cluster};
use sg_clusters::geometry::{Geometry, GeometryOptions};
use sg_clusters::progress::Silent;
use sg_scene::model::Scene;
use sg_scene::synthetic::{normalized, point_scene, random_points, random_unit, vessel_and_sac};

pub(super) fn made(scene: &Scene, most: usize, options: WalkOptions) -> (Arc<SelectionIndex>, Clustering) {
    let geometry = Geometry::of_scene(scene, GeometryOptions::default(), &Silent).unwrap();
    let clustering_options = ClusteringOptions { max_clusters: most, ..ClusteringOptions::default() };
    let (clustering, _) = cluster(&geometry, &clustering_options, &Silent).unwrap();
    let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact).unwrap();
    let space = SelectionIndex::of_clusters(scene, &clustering, &graph, options);
    let operation_context = OperationContext::with_geometry(Arc::new(scene.clone()), geometry);
    (Arc::new(space.with_operation_context(operation_context)), clustering)
}

pub(super) fn stroke(mode: Mode, kind: Kind, radius: f64, points: Vec<[f64; 3]>) -> Stroke {
    Stroke { mode, kind, radius, points, pressure: Vec::new(), depth: None }
}

#[test]
fn accumulation_follows_the_drawing_order() {
    let scene = point_scene(&random_points(4000, 1));
    let (space, _) = made(&scene, 80, WalkOptions::default());
    let at = |x: f64| vec![[x, 0.5, 0.5]];
    let mut session = SelectionSession::new(Arc::clone(&space));
    session.add_stroke(stroke(Mode::Point, Kind::Foreground, 0.1, at(0.9))).unwrap();
    let points = session.mask().clone();
    assert!(points.count() > 5);
    session.add_stroke(stroke(Mode::Walk, Kind::Foreground, 0.1, at(0.1))).unwrap();
    let walked = session.mask().clone();
    assert!(points.ones().all(|g| walked.get(g)), "the point stroke lies over the new walk layer");
    session.add_stroke(stroke(Mode::Cluster, Kind::Background, 0.05, at(0.1))).unwrap();
    let removed = session.mask().clone();
    assert!(removed.count() < walked.count());
    // A further walk changes the layer below; the correction stays.
    session.add_stroke(stroke(Mode::Walk, Kind::Background, 0.1, at(0.6))).unwrap();
    let hits = space.hits(&stroke(Mode::Cluster, Kind::Background, 0.05, at(0.1)));
    assert!(hits.iter().all(|&g| !session.mask().get(g as usize)));
    // Undo goes back step by step.
    session.undo().unwrap();
    assert_eq!(session.mask(), &removed);
    session.undo().unwrap();
    assert_eq!(session.mask(), &walked);
    session.undo().unwrap();
    session.undo().unwrap();
    assert!(session.mask().is_none() && session.undo().unwrap().is_none());
}

#[test]
fn operations_count_in_their_order_and_a_walk_counts_before_them() {
    let scene = point_scene(&random_points(4000, 4));
    let (space, _) = made(&scene, 80, WalkOptions::default());
    let walk = |x: f64| stroke(Mode::Walk, Kind::Foreground, 0.1, vec![[x, 0.5, 0.5]]);
    let cut = Operation::Plane { point: [0.5; 3], normal: [0.0, 0.0, 1.0], combine: Combine::Intersect };
    let grow = Operation::Grow { distance: 0.05 };
    let of = |steps: &[Step]| SelectionSession::of_steps(&space, steps).unwrap().mask().clone();
    let steps = |list: [Step; 3]| list;
    let grown_then_cut = of(&steps([walk(0.3).into(), grow.clone().into(), cut.clone().into()]));
    let cut_then_grown = of(&steps([walk(0.3).into(), cut.clone().into(), grow.clone().into()]));
    assert!(grown_then_cut.is_subset_of(&cut_then_grown) && grown_then_cut != cut_then_grown);
    // A walk stroke counts as if it had come first, wherever it stands among the others.
    assert_eq!(of(&steps([grow.clone().into(), walk(0.3).into(), cut.clone().into()])), grown_then_cut);
    assert_eq!(of(&steps([grow.into(), cut.into(), walk(0.3).into()])), grown_then_cut);
    // A fixed mask is added at its place among the steps.
    let mut given = Mask::empty(scene.len());
    given.set(7, true);
    let with = of(&[walk(0.3).into(), Step::FixedMask(given.clone())]);
    let mut wanted = of(&[walk(0.3).into()]);
    wanted.union_with(&given);
    assert_eq!(with, wanted);
    // One that is excluded is taken away there, whatever the walk selects.
    let excluded = with.clone();
    assert!(!of(&[walk(0.3).into(), Step::Exclude(excluded.clone())]).intersects(&excluded));
    assert!(!of(&[Step::Exclude(excluded.clone()), walk(0.3).into()]).intersects(&excluded), "walks count as first");
    assert_eq!(of(&[Step::Exclude(excluded), Step::FixedMask(given.clone())]), given);
}

#[test]
fn without_the_scene_an_operation_is_refused_and_nothing_is_lost() {
    let scene = point_scene(&random_points(500, 5));
    let geometry = Geometry::of_scene(&scene, GeometryOptions::default(), &Silent).unwrap();
    let (clustering, _) = cluster(&geometry, &ClusteringOptions::default(), &Silent).unwrap();
    let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact).unwrap();
    let space = Arc::new(SelectionIndex::of_clusters(&scene, &clustering, &graph, WalkOptions::default()));
    let mut session = SelectionSession::new(space);
    session.add_stroke(stroke(Mode::Point, Kind::Foreground, 0.2, vec![[0.5; 3]])).unwrap();
    let before = session.mask().clone();
    assert_eq!(session.add_step(Operation::Invert.into()), Err(SelectionError::NoOperationContext));
    let bad = Operation::Grow { distance: -1.0 };
    assert!(matches!(session.add_step(bad.into()), Err(SelectionError::Step(_))));
    assert_eq!((session.mask(), session.steps().len()), (&before, 1));
}

#[test]
fn toggling_a_cluster_twice_changes_nothing() {
    let scene = point_scene(&random_points(1000, 2));
    let (space, clustering) = made(&scene, 30, WalkOptions::default());
    let mut session = SelectionSession::new(Arc::clone(&space));
    let toggle = || {
        stroke(Mode::Cluster, Kind::Toggle, 0.01, vec![normalized(&scene, &[scene.units[0].gaussians.position[5]])[0]])
    };
    session.add_stroke(toggle()).unwrap();
    let own = clustering.labels[5];
    assert_eq!(
        session.mask().ones().collect::<Vec<_>>(),
        (0..1000).filter(|&g| clustering.labels[g] == own).collect::<Vec<_>>()
    );
    session.add_stroke(toggle()).unwrap();
    assert!(session.mask().is_none());
}

#[test]
fn a_walk_stays_inside_the_units_it_hits_and_misses_seed_the_nearest() {
    let mut a = random_unit(800, 3);
    let mut b = random_unit(800, 4);
    a.name = "a".into();
    b.name = "b".into();
    b.gaussians.position.iter_mut().for_each(|p| p.x += 2.5);
    let scene = Scene::compose(vec![a, b], None);
    let (space, _) = made(&scene, 40, WalkOptions { leak: 0.0, ..WalkOptions::default() });
    let mut session = SelectionSession::new(space);
    // Far outside the box on the side of unit a, with radius zero.
    let hits = session.add_stroke(stroke(Mode::Walk, Kind::Foreground, 0.0, vec![[-3.0, 0.5, 0.5]])).unwrap();
    assert_eq!(hits, 1);
    // Without leak or background everything that is connected belongs to the foreground.
    assert_eq!(session.mask().ones().collect::<Vec<_>>(), (0..800).collect::<Vec<_>>());
    let walk = session.walk().unwrap();
    assert_eq!(walk.units, [true, false]);
    assert!(walk.solution.p.iter().skip(40).all(|p| *p == 0.0));
    // A cluster stroke that misses hits nothing.
    assert_eq!(session.add_stroke(stroke(Mode::Cluster, Kind::Background, 0.0, vec![[-3.0, 0.5, 0.5]])).unwrap(), 0);
}

#[test]
fn leak_and_threshold_are_scrubbed_after_a_stroke() {
    let (scene, _) = vessel_and_sac(6000, 3);
    let (space, clustering) = made(&scene, 300, WalkOptions::default());
    let mut session = SelectionSession::new(Arc::clone(&space));
    let start = normalized(&scene, &[glam::Vec3::new(0.0, 0.0, 0.66)]);
    let first = session.tuning();
    assert_eq!(first, Tuning { leak: 0.03, threshold: THRESHOLD });
    assert_eq!(session.tune(first), Err(SelectionError::NoWalk));
    assert_eq!(session.add_step(first.into()), Err(SelectionError::NoWalk));
    assert!(session.mask().is_none() && session.uncertainty().is_none() && session.proposals(3).is_empty());
    session.add_stroke(stroke(Mode::Walk, Kind::Foreground, 0.03, start)).unwrap();
    session.add_stroke(stroke(Mode::Point, Kind::Background, 0.02, vec![[0.5, 0.5, 0.9]])).unwrap();
    // Another leak gives the result of a space with that leak for the strokes; a larger one selects less.
    let mut last = scene.len();
    for leak in [0.0003, 0.003, 0.03, 0.3, 0.03] {
        session.tune(Tuning { leak, ..first }).unwrap();
        let (other, _) = made(&scene, 300, WalkOptions { leak, ..WalkOptions::default() });
        let strokes: Vec<Stroke> = session.steps().filter_map(|s| s.stroke().cloned()).collect();
        let anew = SelectionSession::of_strokes(&other, &strokes).unwrap();
        assert_eq!(anew.mask(), session.mask());
        assert_eq!(anew.walk().unwrap().solution, session.walk().unwrap().solution);
        if leak != 0.03 || last == scene.len() {
            assert!(session.mask().count() <= last);
            last = session.mask().count();
        }
    }
    let mask = session.mask().clone();
    let p = session.walk().unwrap().solution.clone();
    let mut last = scene.len();
    for threshold in [-0.9, -0.5, 0.0, 0.5, 0.9] {
        session.tune(Tuning { threshold, ..first }).unwrap();
        for g in 0..scene.len() {
            let c = clustering.labels[g] as usize;
            if session.mask().get(g) {
                assert!(p.p[c] - p.q[c] > threshold);
            }
        }
        assert!(session.mask().count() <= last);
        last = session.mask().count();
    }
    session.tune(first).unwrap();
    assert_eq!(session.mask(), &mask);
    for bad in [f64::NAN, 1.0, -1.5] {
        assert!(session.tune(Tuning { threshold: bad, ..first }).is_err());
    }
    for bad in [f64::NAN, -1.0, 1e4] {
        assert!(session.tune(Tuning { leak: bad, ..first }).is_err());
    }
    assert_eq!((session.mask(), session.tuning()), (&mask, first));
}

#[test]
fn a_tuning_is_a_step_that_undo_takes_back() {
    let (scene, _) = vessel_and_sac(6000, 3);
    let (space, _) = made(&scene, 300, WalkOptions::default());
    let mut session = SelectionSession::new(Arc::clone(&space));
    let start = normalized(&scene, &[glam::Vec3::new(0.0, 0.0, 0.66)]);
    session.add_stroke(stroke(Mode::Walk, Kind::Foreground, 0.03, start)).unwrap();
    let (first, walked) = (session.tuning(), session.mask().clone());
    let wider = Tuning { leak: 0.001, threshold: -0.2 };
    session.add_step(wider.into()).unwrap();
    let widened = session.mask().clone();
    assert!(walked.is_subset_of(&widened) && walked != widened);
    // It stays for walk strokes that follow, and the last one counts.
    session.add_stroke(stroke(Mode::Walk, Kind::Background, 0.03, vec![[0.5, 0.5, 0.1]])).unwrap();
    assert_eq!(session.tuning(), wider);
    session.add_step(first.into()).unwrap();
    assert_eq!(session.tuning(), first);
    let steps: Vec<Step> = session.steps().cloned().collect();
    let replayed = SelectionSession::of_steps(&space, &steps).unwrap();
    assert_eq!((replayed.mask(), replayed.tuning()), (session.mask(), first));
    session.undo().unwrap();
    assert_eq!(session.tuning(), wider);
    session.undo().unwrap();
    assert_eq!((session.mask(), session.tuning()), (&widened, wider));
    session.undo().unwrap();
    assert_eq!((session.mask(), session.tuning()), (&walked, first));
}

#[test]
fn degenerate_scenes_and_strokes_are_no_trouble() {
    let nan = [f32::NAN; 3];
    let scenes: Vec<Vec<[f32; 3]>> = vec![
        vec![],
        vec![[1.0, 2.0, 3.0]],
        vec![nan],
        vec![nan, [0.0; 3], [f32::INFINITY, 0.0, 0.0], [1.0; 3], nan],
        vec![[5.0; 3]; 100],
        random_points(3, 1),
        random_points(500, 2).iter().map(|p| [p[0], 0.0, 0.0]).collect(),
        random_points(500, 3).iter().map(|p| [p[0], p[1], 7.0]).collect(),
    ];
    for points in scenes {
        let finite = points.iter().filter(|p| p.iter().all(|x| x.is_finite())).count();
        let scene = point_scene(&points);
        let (space, clustering) = made(&scene, 50, WalkOptions::default());
        assert_eq!(clustering.labels.iter().filter(|l| **l >= 0).count(), finite);
        let mut session = SelectionSession::new(space);
        for mode in [Mode::Walk, Mode::Cluster, Mode::Point] {
            for kind in [Kind::Foreground, Kind::Background] {
                for (radius, points) in [
                    (0.0, vec![[0.5; 3]]),
                    (0.3, vec![[0.5; 3]; 7]),
                    (1e9, vec![[-1e6; 3], [1e6; 3]]),
                    (0.1, vec![[0.0; 3], [1.0; 3], [0.0; 3]]),
                ] {
                    session.add_stroke(stroke(mode, kind, radius, points)).unwrap();
                }
            }
        }
        assert!(session.mask().count() <= finite);
    }
}

#[test]
fn a_refused_stroke_changes_nothing() {
    let scene = point_scene(&random_points(200, 5));
    let (space, _) = made(&scene, 20, WalkOptions::default());
    let mut session = SelectionSession::new(space);
    session.add_stroke(stroke(Mode::Point, Kind::Foreground, 0.3, vec![[0.5; 3]])).unwrap();
    let before = session.mask().clone();
    for bad in [
        stroke(Mode::Walk, Kind::Toggle, 0.1, vec![[0.5; 3]]),
        stroke(Mode::Point, Kind::Foreground, f64::NAN, vec![[0.5; 3]]),
        stroke(Mode::Point, Kind::Foreground, 0.1, vec![]),
        stroke(Mode::Point, Kind::Foreground, 0.1, vec![[f64::INFINITY; 3]]),
    ] {
        assert!(session.add_stroke(bad).is_err());
        assert_eq!((session.mask(), session.steps().len()), (&before, 1));
    }
}

#[test]
fn walks_on_single_gaussians() {
    // More unknowns than are eliminated, so conjugate gradients at work.
    let (scene, sac) = vessel_and_sac(6000, 7);
    let geometry = Geometry::of_scene(&scene, GeometryOptions::default(), &Silent).unwrap();
    let (clustering, _) = cluster(&geometry, &ClusteringOptions::default(), &Silent).unwrap();
    let options = WalkOptions { leak: 0.0, ..WalkOptions::default() };
    let space = Arc::new(SelectionIndex::of_gaussians(&scene, &geometry, &clustering, options));
    // Dots, not lines: strokes of one sample each.
    let mut strokes = Vec::new();
    for (g, p) in scene.units[0].gaussians.position.iter().enumerate().step_by(20) {
        let kind = if sac[g] { Kind::Foreground } else { Kind::Background };
        strokes.push(stroke(Mode::Walk, kind, 1e-3, normalized(&scene, &[*p])));
    }
    let session = SelectionSession::of_strokes(&space, &strokes).unwrap();
    let walk = session.walk().unwrap();
    let worst = walk.solution.p.iter().zip(&walk.solution.q).map(|(p, q)| (p + q - 1.0).abs()).fold(0.0, f64::max);
    println!("largest |p + q − 1| {worst:.1e}");
    assert!(worst < 1e-6, "{worst}");
    let agreement = crate::mask_agreement::Agreement::of((0..scene.len()).map(|g| (session.mask().get(g), sac[g])));
    println!("walk on Gaussians: IoU {:.3}", agreement.iou);
    assert!(agreement.iou > 0.9);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(30))]
    #[test]
    fn any_list_of_steps_replays_to_the_same_mask(
        plan in prop::collection::vec((0..9_u8, 0.0..0.15_f64, prop::array::uniform3(0.0..1.0_f64)), 0..8)
    ) {
        let scene = point_scene(&random_points(500, 9));
        let (space, _) = made(&scene, 40, WalkOptions::default());
        let step = |(what, size, at): (u8, f64, [f64; 3])| -> Step {
            match what {
                0 => stroke(Mode::Walk, Kind::Foreground, size, vec![at]).into(),
                1 => stroke(Mode::Walk, Kind::Background, size, vec![at]).into(),
                2 => stroke(Mode::Cluster, Kind::Toggle, size, vec![at]).into(),
                3 => stroke(Mode::Point, Kind::Background, size, vec![at]).into(),
                4 => Operation::Grow { distance: size }.into(),
                5 => Operation::Invert.into(),
                6 => Operation::PieceAt { at }.into(),
                7 => Operation::Sphere { centre: at, radius: 2.0 * size, combine: Combine::Add }.into(),
                _ => Operation::Similar { threshold: 10.0 * size, combine: Combine::Intersect }.into(),
            }
        };
        let steps: Vec<Step> = plan.into_iter().map(step).collect();
        let mut session = SelectionSession::new(Arc::clone(&space));
        let mut masks = vec![session.mask().clone()];
        for step in &steps {
            session.add_step(step.clone()).unwrap();
            masks.push(session.mask().clone());
        }
        let replayed = SelectionSession::of_steps(&space, &steps).unwrap();
        prop_assert_eq!(replayed.mask(), session.mask());
        for (mask, step) in masks.iter().rev().skip(1).zip(steps.iter().rev()) {
            let undone = session.undo().unwrap();
            prop_assert_eq!(undone.as_ref(), Some(step));
            prop_assert_eq!(session.mask(), mask);
        }
    }

    #[test]
    fn any_list_of_strokes_replays_to_the_same_mask(
        plan in proptest::collection::vec((0..3_u8, 0..3_u8, 0.0..0.3_f64, proptest::collection::vec([0.0..1.0_f64, 0.0..1.0, 0.0..1.0], 1..4)), 0..8)
    ) {
        let scene = point_scene(&random_points(600, 9));
        let (space, _) = made(&scene, 40, WalkOptions::default());
        let strokes: Vec<Stroke> = plan
            .into_iter()
            .map(|(mode, kind, radius, points)| {
                let mode = [Mode::Walk, Mode::Cluster, Mode::Point][mode as usize];
                let kind = [Kind::Foreground, Kind::Background, Kind::Toggle][kind as usize];
                let kind = if mode == Mode::Cluster || kind != Kind::Toggle { kind } else { Kind::Background };
                stroke(mode, kind, radius, points)
            })
            .collect();
        let mut session = SelectionSession::new(Arc::clone(&space));
        let mut masks = vec![session.mask().clone()];
        for s in &strokes {
            prop_assert_eq!(&session.preview(s.clone()).unwrap(), {
                session.add_stroke(s.clone()).unwrap();
                session.mask()
            });
            masks.push(session.mask().clone());
        }
        let replayed = SelectionSession::of_strokes(&space, &strokes).unwrap();
        prop_assert_eq!(replayed.mask(), session.mask());
        for (mask, stroke) in masks.iter().rev().skip(1).zip(strokes.iter().rev()) {
            let undone = session.undo().unwrap();
            prop_assert_eq!(undone.as_ref().and_then(Step::stroke), Some(stroke));
            prop_assert_eq!(session.mask(), mask);
            let strokes: Vec<Stroke> = session.steps().filter_map(|s| s.stroke().cloned()).collect();
            let anew = SelectionSession::of_strokes(&space, &strokes).unwrap();
            prop_assert_eq!(session.walk().map(|w| &w.solution), anew.walk().map(|w| &w.solution));
        }
    }
}

/// A row of points along x: its middle is deleted, so that two ends remain.
fn cut_row() -> (Scene, Arc<SelectionIndex>, Arc<Mask>) {
    let points: Vec<_> = (0..600_u16).map(|k| [f32::from(k), f32::from(k % 3), f32::from(k % 2)]).collect();
    let scene = point_scene(&points);
    let (space, _) = made(&scene, 60, WalkOptions { leak: 0.0, ..WalkOptions::default() });
    (scene, space, Arc::new(Mask::from_fn(600, |g| (200..400).contains(&g))))
}

#[test]
fn no_walk_crosses_deleted_gaussians_and_nothing_selects_them() {
    let (_, space, deleted) = cut_row();
    let walk = |space: &Arc<SelectionIndex>| {
        let mut session = SelectionSession::new(Arc::clone(space));
        session.add_stroke(stroke(Mode::Walk, Kind::Foreground, 0.01, vec![[0.05, 0.5, 0.5]])).unwrap();
        session
    };
    assert_eq!(walk(&space).mask().count(), 600, "without a leak the whole row belongs to the stroke");
    let cut = Arc::new(space.without(&deleted));
    let mut session = walk(&cut);
    assert_eq!(session.mask().ones().collect::<Vec<_>>(), (0..200).collect::<Vec<_>>());
    // Neither strokes nor operations nor masks find what is deleted.
    let middle = vec![[0.3, 0.5, 0.5], [0.7, 0.5, 0.5]];
    for mode in [Mode::Point, Mode::Cluster, Mode::Walk] {
        session.add_stroke(stroke(mode, Kind::Foreground, 0.1, middle.clone())).unwrap();
        assert!(!session.mask().intersects(&deleted), "{mode:?}");
    }
    assert_eq!(session.mask().count(), 400, "the strokes reach both ends");
    session.add_step(Operation::Invert.into()).unwrap();
    assert!(session.mask().is_none());
    session.add_step(Step::FixedMask(Mask::full(600))).unwrap();
    assert_eq!(session.mask().count(), 400);
    session.add_step(Operation::Grow { distance: 0.5 }.into()).unwrap();
    assert!(!session.mask().intersects(&deleted));
    // The list of steps makes the same selection at once, and the index of the whole scene is as it was.
    let steps: Vec<Step> = session.steps().cloned().collect();
    assert_eq!(SelectionSession::of_steps(&cut, &steps).unwrap().mask(), session.mask());
    assert_eq!(walk(&space).mask().count(), 600);
}

#[test]
fn a_preview_over_deleted_gaussians_is_what_the_stroke_selects() {
    let (_, space, deleted) = cut_row();
    let cut = Arc::new(space.without(&deleted));
    for mode in [Mode::Point, Mode::Cluster, Mode::Walk] {
        let session = SelectionSession::new(Arc::clone(&cut));
        let drawn = stroke(mode, Kind::Foreground, 0.1, Vec::new());
        let mut preview = crate::preview::Preview::begin(&session, &drawn).unwrap();
        preview.extend(&[[0.3, 0.5, 0.5]], &[]).unwrap();
        preview.extend(&[[0.5, 0.5, 0.5]], &[]).unwrap();
        assert_eq!(preview.mask(), &session.preview(preview.stroke().clone()).unwrap(), "{mode:?}");
        assert!(preview.hits() > 0 && !preview.mask().intersects(&deleted), "{mode:?}");
    }
}

#[test]
fn an_index_without_deletions_is_that_of_the_scene() {
    let scene = point_scene(&random_points(1500, 9));
    let (space, _) = made(&scene, 60, WalkOptions::default());
    let same = Arc::new(space.without(&Arc::new(Mask::empty(1500))));
    let walk = |space: &Arc<SelectionIndex>| {
        let mut session = SelectionSession::new(Arc::clone(space));
        session.add_stroke(stroke(Mode::Walk, Kind::Foreground, 0.1, vec![[0.2; 3]])).unwrap();
        session.add_stroke(stroke(Mode::Walk, Kind::Background, 0.1, vec![[0.8; 3]])).unwrap();
        (session.mask().clone(), session.proposals(3))
    };
    assert_eq!(walk(&same), walk(&space));
}
