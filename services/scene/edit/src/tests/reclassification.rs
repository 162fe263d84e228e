//! Transfer functions over a scene of a volume.

use std::sync::Arc;

use glam::Vec3;
use sg_proto::scene::adjust_transfer_function::Change;
use sg_proto::scene::command::Action;
use sg_proto::scene::{AdjustTransferFunction, Reset, SetTransferFunction, Undo, ValueColor, ValueRange, ValueWindow};
use sg_reclassify::{ReclassifyError, VolumeOfScene};
use sg_scene::model::Scene;
use sg_volume::TransferFunction;
use sg_volume::transfer::{ControlPoint, Scale, Units};

use super::{BLUE, color, commit_of, duplicate, editor, lock, refused, run, save, shift, units, volume_of};
use crate::wire::encode_transfer_function;
use crate::{EditError, EditState, Editor, PlacedScene};

/// Base units `bone` (0..20), with the value 100 times its index, and `label` (20..30) without values.
fn volume() -> Arc<Scene> {
    volume_of(&[("bone", 20), ("label", 10)])
}

fn of_volume() -> Editor {
    let scene = volume();
    let state = EditState::of_scene(&scene, "scene.toml", "hash").with_volume(Some(super::volume()));
    Editor::new(scene, state)
}

/// Shows values from `low` on, in one grey.
fn from(low: f64, gray: f32) -> TransferFunction {
    let point = |opacity| ControlPoint { value: low, color: [gray; 3], opacity };
    TransferFunction {
        domain: [0.0, 2000.0],
        units: Units::Raw,
        scale: Scale::Linear,
        variable: None,
        points: vec![point(0.0), point(0.5)],
        base_units: Vec::new(),
    }
}

fn set(function: Option<&TransferFunction>) -> Action {
    Action::SetTransferFunction(SetTransferFunction { function: function.map(encode_transfer_function) })
}

#[test]
fn a_function_shows_and_colours_by_value() {
    let scene = volume();
    let mut editor = of_volume();
    let placed = PlacedScene::new(Arc::clone(&scene));
    let applied = run(&mut editor, [set(Some(&from(1000.0, 0.25)))]).unwrap();
    assert_eq!(applied.result.summary, "transfer function of 2 points, 1,000 to 1,000");
    let shown = placed.of(editor.state());
    let bone = &shown.units[0];
    let visible: Vec<usize> = (0..20).filter(|i| bone.gaussians.opacity(*i) > 0.1).collect();
    assert_eq!(visible, (10..20).collect::<Vec<_>>());
    let gray = bone.palette + bone.gaussians.shading.as_ref().unwrap().offset_color[15];
    assert!((gray - 0.25).length() < 1e-6, "{gray}");
    assert_eq!(shown.units[1], scene.units[1], "a unit without values stays");
    assert_eq!(editor.state().visible_in(&shown).ones().collect::<Vec<_>>(), (10..30).collect::<Vec<_>>());
    assert!(Arc::ptr_eq(&placed.of(editor.state()), &shown), "made once");
    // The colour of a person lies over it.
    run(&mut editor, [color(units(&["bone"]), BLUE)]);
    assert_eq!(editor.state().base_units()[0].palette, Vec3::Z);
    run(&mut editor, [Action::Undo(Undo { steps: 2 })]);
    assert!(Arc::ptr_eq(&placed.of(editor.state()), &scene), "undone: the file's own scene");
    run(&mut editor, [set(Some(&from(500.0, 0.25))), set(None)]);
    assert!(editor.state().transfer_function().is_none());
    run(&mut editor, [set(Some(&from(500.0, 0.25))), Action::Reset(Reset {})]);
    assert!(editor.state().transfer_function().is_none());
}

#[test]
fn copies_and_moved_gaussians_follow_the_function() {
    let mut editor = of_volume();
    run(&mut editor, [duplicate(units(&["bone"]), "twin"), shift(units(&["twin"]), [5.0, 0.0, 0.0])]);
    run(&mut editor, [set(Some(&from(1000.0, 0.25)))]);
    let shown = PlacedScene::new(volume()).of(editor.state());
    let twin = shown.units.iter().find(|unit| unit.name == "twin").unwrap();
    let opacities = |unit: &sg_scene::model::BaseUnit| unit.gaussians.opacity_logit.clone();
    assert_eq!(opacities(twin), opacities(&shown.units[0]));
    assert!(twin.gaussians.opacity(2) < 1e-6 && twin.gaussians.opacity(12) > 0.1);
}

#[test]
fn functions_that_do_not_fit_are_refused() {
    let plain = refused(&mut editor(), set(Some(&from(10.0, 0.5))));
    assert_eq!(plain, EditError::Reclassify(ReclassifyError::NoValues("bone".to_owned())));
    assert_eq!(plain.code(), sg_proto::bus::Code::FailedPrecondition);
    let mut editor = of_volume();
    let wrong = TransferFunction { points: Vec::new(), ..from(10.0, 0.5) };
    assert!(refused(&mut editor, set(Some(&wrong))).to_string().contains("control point"));
    run(&mut editor, [lock(units(&["bone"]), true)]);
    assert_eq!(refused(&mut editor, set(Some(&from(10.0, 0.5)))), EditError::Locked("bone".to_owned()));
}

#[test]
fn exports_keep_the_function_and_the_colours_of_people() {
    let scene = volume();
    let mut editor = of_volume();
    run(&mut editor, [set(Some(&from(1000.0, 0.25)))]);
    let all = sg_scene::mask::Mask::full(30);
    let plain = editor.state().edited(&scene, &all).unwrap();
    assert!(plain.units[0].gaussians.opacity(3) < 1e-6 && plain.units[0].gaussians.opacity(13) > 0.1);
    // A later function applies to the export too, from its own values.
    let mut again = plain.clone();
    sg_reclassify::reclassify_scene(&mut again, &from(0.0, 0.75)).unwrap();
    assert!(again.units[0].gaussians.opacity(3) > 0.1);
    // Half of the bone is painted: that half keeps its look.
    run(&mut editor, [commit_of(30, |i| i < 10), save("half"), color(units(&["half"]), BLUE)]);
    let mut painted = editor.state().edited(&scene, &all).unwrap();
    let before = painted.units.iter().find(|unit| unit.name == "half").cloned().unwrap();
    sg_reclassify::reclassify_scene(&mut painted, &from(0.0, 0.75)).unwrap();
    assert_eq!(painted.units.iter().find(|unit| unit.name == "half"), Some(&before));
}

fn adjust(change: Change) -> Action {
    Action::AdjustTransferFunction(AdjustTransferFunction { change: Some(change) })
}

fn window(level: f64, window: f64) -> Change {
    Change::Window(ValueWindow { level: Some(level), window: Some(window), ..ValueWindow::default() })
}

fn range(low: f64, high: f64) -> ValueRange {
    ValueRange { low: Some(low), high: Some(high) }
}

/// Indices of the visible Gaussians of `bone`: index i has the value 100 i.
fn visible_bone(editor: &Editor) -> Vec<usize> {
    let shown = PlacedScene::new(volume()).of(editor.state());
    (0..20).filter(|i| shown.units[0].gaussians.opacity(*i) > 0.01).collect()
}

#[test]
fn a_function_is_adjusted_from_that_of_the_file() {
    let mut editor = of_volume();
    let applied = run(&mut editor, [adjust(window(1500.0, 400.0))]).unwrap();
    assert_eq!(applied.result.summary, "level 1,500, window 400");
    assert_eq!(visible_bone(&editor), (14..20).collect::<Vec<_>>());
    // Relative to the present one, and taken back in one step.
    let wider = ValueWindow { window_factor: Some(2.0), level_change: -100.0, ..ValueWindow::default() };
    let applied = run(&mut editor, [adjust(Change::Window(wider))]).unwrap();
    assert_eq!(applied.result.summary, "level 1,400, window 800");
    let shifted = ValueWindow { level_shift: 0.25, window_change: -900.0, ..ValueWindow::default() };
    let applied = run(&mut editor, [adjust(Change::Window(shifted))]).unwrap();
    assert_eq!(applied.result.summary, "level 1,600, window 0");
    run(&mut editor, [Action::Undo(Undo { steps: 3 })]);
    assert!(editor.state().transfer_function().is_none());
    let applied = run(&mut editor, [adjust(Change::ShowOnly(range(500.0, 950.0)))]).unwrap();
    assert_eq!(applied.result.summary, "show only values from 500 to 950");
    assert_eq!(visible_bone(&editor), [5, 6, 7, 8, 9]);
    run(&mut editor, [adjust(Change::Hide(range(550.0, 750.0)))]);
    assert_eq!(visible_bone(&editor), [5, 8, 9]);
    let red = Some(sg_proto::scene::Color { red: 1.0, green: 0.0, blue: 0.0 });
    let above = ValueRange { low: Some(850.0), high: None };
    let applied = run(&mut editor, [adjust(Change::Color(ValueColor { range: Some(above), color: red }))]).unwrap();
    assert_eq!(applied.result.summary, "colour values above 850");
    let shown = PlacedScene::new(volume()).of(editor.state());
    let color = |i: usize| shown.units[0].palette + shown.units[0].gaussians.shading.as_ref().unwrap().offset_color[i];
    assert!(color(9).abs_diff_eq(Vec3::X, 1e-5) && color(8).abs_diff_eq(Vec3::splat(0.5), 1e-5));
}

#[test]
fn adjustments_that_do_not_fit_are_refused() {
    let mut editor = of_volume();
    let beyond = refused(&mut editor, adjust(Change::Hide(range(3000.0, 4000.0))));
    assert_eq!(beyond.to_string(), "no value lies from 3000 to 4000: the transfer function goes from 0 to 2000");
    assert_eq!(beyond.code(), sg_proto::bus::Code::OutOfRange);
    let logarithm = refused(&mut editor, adjust(Change::Scale(sg_proto::scene::ValueScale::Log10.into())));
    assert!(logarithm.to_string().contains("symlog"), "{logarithm}");
    let none = Action::AdjustTransferFunction(AdjustTransferFunction::default());
    assert!(matches!(refused(&mut editor, none), EditError::Malformed { field: "change", .. }));
    let negative = ValueWindow { window_factor: Some(-1.0), ..ValueWindow::default() };
    assert!(matches!(refused(&mut editor, adjust(Change::Window(negative))), EditError::OutOfRange { .. }));
    run(&mut editor, [lock(units(&["bone"]), true)]);
    assert_eq!(refused(&mut editor, adjust(window(10.0, 10.0))), EditError::Locked("bone".to_owned()));

    let plain = refused(&mut super::editor(), adjust(window(10.0, 10.0)));
    assert_eq!(plain, EditError::Reclassify(ReclassifyError::NoValues("bone".to_owned())));
    // The function's file is gone: one that was set can be adjusted.
    let scene = volume();
    let unknown = Some(VolumeOfScene { function: None, range: [0.0, 2000.0] });
    let mut editor = Editor::new(Arc::clone(&scene), EditState::of_scene(&scene, "", "").with_volume(unknown));
    assert_eq!(refused(&mut editor, adjust(window(10.0, 10.0))), EditError::NoFunction);
    run(&mut editor, [set(Some(&from(1000.0, 0.25))), adjust(window(500.0, 0.0))]);
    assert_eq!(visible_bone(&editor), (5..20).collect::<Vec<_>>());
}

#[test]
fn a_snapshot_has_the_volume_of_the_file() {
    let editor = of_volume();
    let state = editor.state();
    assert_eq!(EditState::from_snapshot(&state.state(true)).as_ref(), Ok(state));
    assert_eq!(state.state(false).volume.unwrap().greatest, 2000.0);
    // A function with more points than a message may have is left out.
    let many = TransferFunction { points: vec![from(1.0, 0.5).points[0]; 1025], ..from(1.0, 0.5) };
    let volume = VolumeOfScene { function: Some(Arc::new(many)), range: [0.0, 1.0] };
    let message = state.clone().with_volume(Some(volume)).state(true);
    assert!(message.volume.as_ref().unwrap().function.is_none() && EditState::from_snapshot(&message).is_ok());
}
