//! Gaussians that edits put elsewhere.

use std::sync::Arc;

use glam::{DQuat, DVec3};
use sg_proto::scene::{MeasureRequest, Redo, SetView, Undo, set_view};
use sg_scene::model::{Gaussians, Scene};
use sg_scene::orientation::{LengthUnit, Orientation};
use sg_scene::similarity::Similarity;
use sg_scene::synthetic::samples;

use super::*;
use crate::{Part, PlacedScene, Replica};
use sg_proto::replica::Replica as _;

fn undo() -> Action {
    Action::Undo(Undo { steps: 1 })
}

fn transform(target: Target, (pivot, axis, degrees, factor): ([f64; 3], [f64; 3], f64, f64)) -> Action {
    Action::TransformGaussians(TransformGaussians {
        target: Some(target),
        pivot: vector(pivot),
        axis: vector(axis),
        degrees,
        factor: Some(factor),
        ..TransformGaussians::default()
    })
}

/// Two units with every kind of column; the second has a transform of its own.
fn rich() -> (Arc<Scene>, Editor) {
    let scene = Arc::new(samples::two_units(40));
    let editor = Editor::new(Arc::clone(&scene), EditState::of_scene(&scene, "scene.toml", ""));
    (scene, editor)
}

fn place(editor: &Editor, i: usize) -> DVec3 {
    editor.scene().position(i).unwrap()
}

#[test]
fn a_moved_unit_is_elsewhere_and_everything_else_keeps_its_bits() {
    let mut editor = editor();
    let file = editor.scene();
    let applied = run(&mut editor, [shift(units(&["skin"]), [1.0, -2.0, 0.5])]).unwrap();
    assert_eq!(applied.result.summary, "moved skin by (1, -2, 0.5)");
    let moved = editor.scene();
    for i in 0..60 {
        let by = if (20..35).contains(&i) { DVec3::new(1.0, -2.0, 0.5) } else { DVec3::ZERO };
        let off = moved.position(i).unwrap() - file.position(i).unwrap() - by;
        assert!(off.length() < 1e-6, "{i}: {off}");
    }
    assert_eq!((&moved.units[0], &moved.units[2]), (&file.units[0], &file.units[2]));
    assert_eq!(moved.bounds, file.bounds, "strokes keep their box");
    assert_eq!((editor.state().count(), editor.state().moved_count()), (60, 15));
    run(&mut editor, [undo()]);
    assert!(editor.state().placements().is_empty() && Arc::ptr_eq(&editor.scene(), &file));
    run(&mut editor, [Action::Redo(Redo { steps: 1 })]);
    assert_eq!(*editor.scene(), *moved, "bit for bit");
}

#[test]
fn a_scene_in_its_place_costs_nothing() {
    let (file, mut editor) = rich();
    assert!(Arc::ptr_eq(&editor.scene(), &file));
    assert_eq!(editor.message(true).placements, None);
    let by = [0.1, 0.7, -0.3];
    run(&mut editor, [shift(everything(), by), shift(everything(), by.map(|x| -x))]);
    assert!(Arc::ptr_eq(&editor.scene(), &file), "a shift and its opposite leave nothing behind");
    run(&mut editor, [shift(everything(), by)]);
    let placed = PlacedScene::new(Arc::clone(&file));
    let (first, second) = (placed.of(editor.state()), placed.clone().of(&editor.state().clone()));
    assert!(Arc::ptr_eq(&first, &second), "one copy for one state");
}

#[test]
fn a_turn_about_a_place_turns_scales_and_places_alike() {
    let (file, mut editor) = rich();
    let (pivot, axis, factor) = (DVec3::new(0.2, 0.3, 0.1), DVec3::new(1.0, 2.0, -1.0), 2.5);
    let applied =
        run(&mut editor, [transform(everything(), (pivot.to_array(), axis.to_array(), 70.0, factor))]).unwrap();
    assert_eq!(applied.result.summary, "turned and scaled everything");
    let turn = DQuat::from_axis_angle(axis.normalize(), 70.0_f64.to_radians());
    let placed = editor.scene();
    let linear = glam::DMat3::from_quat(turn) * factor;
    for i in 0..file.len() {
        let want = pivot + factor * (turn * (file.position(i).unwrap() - pivot));
        let size = want.length().max(1.0);
        assert!((placed.position(i).unwrap() - want).length() < 1e-5 * size, "{i}");
        let covariance = |scene: &Scene| {
            let (unit, k) = scene.locate(i).unwrap();
            let own = glam::DMat3::from_mat4(unit.transform);
            own * unit.gaussians.covariance(k) * own.transpose()
        };
        let want = linear * covariance(&file) * linear.transpose();
        let size = want.to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let off = (covariance(&placed) - want).to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        assert!(off < 1e-5 * size, "covariance {i}");
    }
}

/// The greatest difference of all columns that a move changes.
fn difference(a: &Scene, b: &Scene) -> f64 {
    let floats = |g: &Gaussians| -> Vec<f32> {
        let normals = g.shading.iter().flat_map(|s| s.normal.iter().flat_map(Vec3::to_array));
        let harmonics = g.harmonics.iter().flat_map(|h| h.rest.iter().flatten().copied());
        let places = g.position.iter().chain(&g.log_scale).flat_map(Vec3::to_array);
        places.chain(normals).chain(harmonics).collect()
    };
    let units = a.units.iter().zip(&b.units);
    let all = units.flat_map(|(a, b)| floats(&a.gaussians).into_iter().zip(floats(&b.gaussians)).collect::<Vec<_>>());
    all.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
}

#[test]
fn a_map_and_its_inverse_give_the_columns_back() {
    let (file, mut editor) = rich();
    let (pivot, axis) = ([3.0, -1.0, 0.5], [0.3, 1.0, 0.2]);
    run(&mut editor, [transform(everything(), (pivot, axis, 123.0, 3.0))]);
    assert!(difference(&file, &editor.scene()) > 0.5);
    run(&mut editor, [transform(everything(), (pivot, axis, -123.0, 1.0 / 3.0))]);
    // Composed in f64, so that only the last step to f32 rounds: half a unit in the last place of numbers up to 4.
    let off = difference(&file, &editor.scene());
    assert!(off < 5e-7, "{off}");
    run(&mut editor, [undo(), undo()]);
    assert_eq!(*editor.scene(), *file, "undo is exact");
}

#[test]
fn a_thousand_small_moves_do_not_drift() {
    let (file, mut editor) = rich();
    let (pivot, axis) = (DVec3::new(0.5, 0.2, 0.1), DVec3::new(0.1, 1.0, 0.4).normalize());
    let step = |k: i32| (0.36 + 0.001 * f64::from(k % 7), 1.0 + 1e-4 * f64::from(k % 5 - 2));
    // The same steps on the columns themselves, as a program would that stores what it has moved.
    let mut naive = (*file).clone();
    let mut exact = Similarity::IDENTITY;
    for k in 0..1000 {
        let (degrees, factor) = step(k);
        run(&mut editor, [transform(everything(), (pivot.to_array(), axis.to_array(), degrees, factor))]);
        let turn = DQuat::from_axis_angle(axis, degrees.to_radians());
        let map = Similarity::about(pivot, turn, factor, DVec3::ZERO);
        exact = exact.then(&map);
        for unit in &mut naive.units {
            let rows: Vec<usize> = (0..unit.gaussians.len()).collect();
            unit.gaussians.transform(&rows, &(unit.transform.inverse() * map.matrix() * unit.transform));
        }
    }
    let worst = |scene: &Scene| {
        let off = |i| scene.position(i).unwrap().distance(exact.apply(file.position(i).unwrap()));
        (0..file.len()).map(off).fold(0.0, f64::max)
    };
    let (ours, naive) = (worst(&editor.scene()), worst(&naive));
    // The bound is that of one rounding to f32, in a unit with a transform of its own.
    assert!(ours < 2e-6 && naive > 5.0 * ours, "{ours} {naive}");
}

#[test]
fn parts_are_moved_on_from_where_they_are_and_go_back() {
    let mut editor = editor();
    let at = |editor: &Editor, i| place(editor, i).x;
    let x: Vec<f64> = (0..60).map(|i| at(&editor, i)).collect();
    run(&mut editor, [shift(units(&["bone"]), [1.0, 0.0, 0.0]), commit(|i| (10..30).contains(&i))]);
    run(&mut editor, [shift(selection(), [2.0, 0.0, 0.0])]);
    for (i, by) in [(5, 1.0), (15, 3.0), (25, 2.0), (40, 0.0)] {
        assert!((at(&editor, i) - x[i] - by).abs() < 1e-5, "{i}");
    }
    assert_eq!((editor.state().placements().len(), editor.state().moved_count()), (3, 30));
    let back = |target| {
        let target = Some(target);
        Action::TransformGaussians(TransformGaussians { target, restore: true, ..TransformGaussians::default() })
    };
    let applied = run(&mut editor, [back(units(&["bone"]))]).unwrap();
    assert_eq!(applied.result.summary, "put bone back");
    for (i, by) in [(5, 0.0), (15, 0.0), (25, 2.0)] {
        assert!((at(&editor, i) - x[i] - by).abs() < 1e-5, "{i}");
    }
    run(&mut editor, [back(everything())]);
    assert!(editor.state().placements().is_empty());
}

#[test]
fn deleted_gaussians_of_a_moved_unit_come_back_to_it() {
    let mut editor = editor();
    let before = place(&editor, 25);
    let half = [commit(|i| (10..30).contains(&i)), save("sac"), commit(|i| (20..30).contains(&i)), delete(selection())];
    run(&mut editor, half);
    run(&mut editor, [shift(units(&["sac"]), [0.0, 4.0, 0.0]), restore()]);
    assert!((place(&editor, 25) - before - DVec3::new(0.0, 4.0, 0.0)).length() < 1e-5);
}

#[test]
fn a_selection_keeps_its_gaussians_and_loses_its_strokes() {
    use sg_proto::scene::{Stroke, StrokeKind, StrokeMode};
    let mut editor = editor();
    let stroke = Stroke {
        mode: StrokeMode::Point.into(),
        kind: StrokeKind::Foreground.into(),
        radius: 0.1,
        points: vec![0.5; 3],
        ..Stroke::default()
    };
    let mask = Some(encode_mask(&Mask::from_fn(60, |i| i < 7)));
    let drawn = CommitSelection { mask, strokes: vec![stroke], ..CommitSelection::default() };
    run(&mut editor, [Action::CommitSelection(drawn)]);
    let before = editor.state().selection().clone();
    run(&mut editor, [shift(selection(), [1.0, 0.0, 0.0])]);
    let after = editor.state().selection();
    assert_eq!((after.hash(), after.steps().len()), (before.hash(), 0));
    run(&mut editor, [undo()]);
    assert_eq!(*editor.state().selection(), before);
}

#[test]
fn framing_measures_and_files_follow() {
    let mut editor = editor();
    let size = |editor: &Editor| {
        let target = Some(units(&["Vessel"]));
        editor.measure(&MeasureRequest { target }).unwrap().edges.unwrap().x
    };
    let focus = || Action::SetView(SetView { change: Some(set_view::Change::Focus(units(&["Vessel"]))) });
    run(&mut editor, [focus()]);
    let (edge, target) = (size(&editor), editor.state().view().target);
    run(&mut editor, [shift(units(&["Vessel"]), [30.0, 0.0, 0.0]), focus()]);
    assert!((editor.state().view().target - target - DVec3::new(30.0, 0.0, 0.0)).length() < 1e-3);
    assert!((size(&editor) - edge).abs() < 1e-3 * edge);
    let middle = editor.state().view().target.to_array();
    run(&mut editor, [transform(units(&["Vessel"]), (middle, [0.0, 0.0, 1.0], 0.0, 2.0))]);
    assert!((size(&editor) / edge - 2.0).abs() < 1e-3);
    let scene = test_scene(&[("bone", 20), ("skin", 15), ("Vessel", 25)]);
    let written = editor.state().edited(&scene, &editor.state().part(Part::Unit("Vessel")).unwrap()).unwrap();
    assert_eq!(written.units[0].gaussians.position, editor.scene().units[2].gaussians.position);
    assert!((0.5 * (written.bounds.min + written.bounds.max)).x > 20.0, "{:?}", written.bounds);
}

#[test]
fn readers_follow_by_events_and_by_a_snapshot() {
    let mut editor = editor();
    let mut replica = Replica::new(editor.state().clone());
    for action in [shift(units(&["bone"]), [1.0, 0.0, 0.0]), shift(units(&["skin"]), [0.0, 1.0, 0.0]), undo()] {
        replica.apply(&run(&mut editor, [action]).unwrap().event).unwrap();
        assert_eq!(**replica.state(), *editor.state());
        let snapshot = Replica::from_snapshot(&editor.state().state(true)).unwrap();
        assert_eq!(**snapshot.state(), *editor.state());
    }
}

#[test]
fn millimetres_are_those_of_the_file() {
    let orientation = Orientation { unit: Some(LengthUnit::Metre), ..Orientation::default() };
    let scene = Arc::new(Scene { orientation, ..test_scene(&[("bone", 5)]) });
    let mut editor = Editor::new(Arc::clone(&scene), EditState::of_scene(&scene, "", ""));
    let by = |millimetres| {
        let (target, shift) = (Some(everything()), vector([5.0, 0.0, 0.0]));
        Action::TransformGaussians(TransformGaussians { target, shift, millimetres, ..TransformGaussians::default() })
    };
    let applied = run(&mut editor, [by(true)]).unwrap();
    assert_eq!(applied.result.summary, "moved everything by (5, 0, 0) mm");
    assert_eq!(editor.state().placements()[0].map.translation, DVec3::new(0.005, 0.0, 0.0));
    let mut plain = super::editor();
    assert!(refused(&mut plain, by(true)).to_string().contains("no length unit"));
}

#[test]
fn what_cannot_be_meant_is_refused() {
    let mut editor = editor();
    run(&mut editor, [lock(units(&["skin"]), true)]);
    assert_eq!(refused(&mut editor, shift(units(&["skin"]), [1.0; 3])), EditError::Locked("skin".to_owned()));
    assert_eq!(refused(&mut editor, shift(everything(), [1.0; 3])), EditError::Locked("skin".to_owned()));
    assert_eq!(refused(&mut editor, shift(selection(), [1.0; 3])), EditError::NothingSelected);
    let bone = || Some(units(&["bone"]));
    let plain = || TransformGaussians { target: bone(), ..TransformGaussians::default() };
    for (wrong, reason) in [
        (plain(), "nothing is set"),
        (TransformGaussians { degrees: 5.0, factor: Some(2.0), ..plain() }, "degrees need an axis"),
        (TransformGaussians { restore: true, factor: Some(2.0), ..plain() }, "no other field"),
        (TransformGaussians { axis: vector([0.0; 3]), degrees: 5.0, ..plain() }, "of some length"),
        (TransformGaussians { axis: vector([1.0; 3]), degrees: f64::NAN, ..plain() }, "finite"),
        (TransformGaussians { factor: Some(0.0), ..plain() }, "millionth"),
        (TransformGaussians { factor: Some(-1.0), ..plain() }, "millionth"),
        (TransformGaussians { factor: Some(f64::NAN), ..plain() }, "millionth"),
        (TransformGaussians { shift: vector([f64::INFINITY, 0.0, 0.0]), ..plain() }, "finite"),
        (TransformGaussians { shift: vector([1e12, 0.0, 0.0]), ..plain() }, "a million lengths"),
        (TransformGaussians { shift: vector([1.0; 3]), pivot: vector([f64::NAN; 3]), ..plain() }, "finite"),
    ] {
        let error = refused(&mut editor, Action::TransformGaussians(wrong)).to_string();
        assert!(error.contains(reason), "{error}");
    }
    // Each small step is allowed, and all of them together are not.
    for _ in 0..2 {
        run(&mut editor, [transform(units(&["bone"]), ([5.0; 3], [0.0, 0.0, 1.0], 0.0, 900.0))]);
    }
    let more = transform(units(&["bone"]), ([5.0; 3], [0.0, 0.0, 1.0], 0.0, 900.0));
    assert!(refused(&mut editor, more).to_string().contains("of the size in the file"));
}

#[test]
fn the_number_of_parts_has_a_limit() {
    let scene = Arc::new(test_scene(&[("all", 100)]));
    let mut editor = Editor::new(Arc::clone(&scene), EditState::of_scene(&scene, "", ""));
    let step = |k: usize| {
        let mask = Some(encode_mask(&Mask::from_fn(100, |i| i == k)));
        let chosen = CommitSelection { mask, ..CommitSelection::default() };
        [Action::CommitSelection(chosen), shift(selection(), [k as f64 + 1.0, 0.0, 0.0])]
    };
    for k in 0..64 {
        run(&mut editor, step(k));
    }
    let [choose, push] = step(64);
    run(&mut editor, [choose]);
    assert!(matches!(refused(&mut editor, push), EditError::TooMany { limit: 64, .. }));
    // Parts that exist may move on.
    let mask = Some(encode_mask(&Mask::from_fn(100, |i| i < 64)));
    let all = CommitSelection { mask, ..CommitSelection::default() };
    run(&mut editor, [Action::CommitSelection(all), shift(selection(), [0.5, 0.0, 0.0])]);
    assert_eq!(editor.state().placements().len(), 64);
}
