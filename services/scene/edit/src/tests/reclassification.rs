//! Transfer functions over a scene of a volume.

use std::sync::Arc;

use glam::Vec3;
use sg_proto::scene::command::Action;
use sg_proto::scene::{Reset, SetTransferFunction, Undo};
use sg_reclassify::ReclassifyError;
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
    let state = EditState::of_scene(&scene, "scene.toml", "hash");
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
