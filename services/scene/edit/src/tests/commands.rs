//! Effects and refusals of each command.

use sg_proto::bus::Code;
use sg_proto::limits::{MAX_NAME_BYTES, MAX_UNITS};
use sg_proto::scene::command::Action;
use sg_proto::scene::set_view::Change as ViewChange;
use sg_proto::scene::{
    CommitSelection, DeleteUnit, LightMode, NamedView, Orbit, Redo, RenameUnit, Reset, Select, SetBackground, SetLight,
    SetOperation, SetTerm, SetView, ShadingTerm, Stroke, StrokeKind, StrokeMode, Undo, Vector, View,
};

use super::*;
use crate::change::Change;
use crate::{HistoryMove, UnitRef};
use sg_scene::orientation::{Axis, PatientFrame};

fn names(editor: &Editor) -> Vec<&str> {
    editor.state().units().map(|u| u.name.as_str()).collect()
}

fn sac(editor: &mut Editor) {
    run(editor, [commit(|i| (40..50).contains(&i)), save("sac")]);
}

fn view(change: ViewChange) -> Action {
    Action::SetView(SetView { change: Some(change) })
}

fn select(target: Target, operation: SetOperation) -> Action {
    Action::Select(Select { target: Some(target), operation: operation.into() })
}

fn undo(steps: u32) -> Action {
    Action::Undo(Undo { steps })
}

fn redo(steps: u32) -> Action {
    Action::Redo(Redo { steps })
}

#[test]
fn a_base_unit_takes_colour_opacity_and_visibility_itself() {
    let mut editor = editor();
    let applied = run(&mut editor, [color(units(&["BONE"]), RED)]).unwrap();
    assert_eq!((applied.result.units.as_slice(), applied.event.changes.len()), (["bone".to_owned()].as_slice(), 2));
    assert_eq!(applied.result.summary, "coloured bone #ff0000");
    run(&mut editor, [opacity(units(&["bone", "skin"]), 0.25), visible(units(&["vessel"]), false)]);
    assert_eq!(names(&editor), [""; 0]);
    let state = editor.state();
    assert_eq!(
        drawn(state, 0),
        Drawn { visible: true, opacity: 0.25, palette: Vec3::X, color: None, tone: Tone::NEUTRAL }
    );
    assert_eq!((drawn(state, 20).opacity, drawn(state, 59).visible), (0.25, false));
    assert_eq!(state.focus(), ["Vessel"]);
    let relative = SetOpacity { target: Some(units(&["bone"])), factor: 2.0, relative: true };
    run(&mut editor, [Action::SetOpacity(relative), own_color(units(&["bone"]))]);
    let bone = &editor.state().base_units()[0];
    assert_eq!((bone.opacity, bone.palette), (0.5, editor.initial().base_units()[0].palette));
}

#[test]
fn a_saved_unit_carries_its_own_look_and_lies_over_older_ones() {
    let mut editor = editor();
    sac(&mut editor);
    run(&mut editor, [commit(|i| (45..55).contains(&i)), save("neck")]);
    run(
        &mut editor,
        [color(units(&["neck"]), BLUE), color(units(&["sac"]), RED), opacity(units(&["sac", "neck"]), 0.5)],
    );
    let state = editor.state();
    assert_eq!(drawn(state, 44).color, Some(Vec3::X));
    assert_eq!((drawn(state, 47).color, drawn(state, 47).opacity), (Some(Vec3::Z), 0.25));
    run(&mut editor, [own_color(units(&["neck"]))]);
    assert_eq!(drawn(editor.state(), 47).color, Some(Vec3::X));
    assert_eq!(editor.state().focus(), ["neck"]);
}

#[test]
fn the_selection_and_everything_else_get_derived_units() {
    let mut editor = editor();
    run(&mut editor, [commit(|i| i < 5), color(selection(), RED)]);
    assert_eq!((names(&editor), editor.state().focus()), (vec!["selection 1"], ["selection 1".to_owned()].as_slice()));
    assert!(editor.state().units().all(|u| u.derived));
    // The same members again: the same unit. Other members: another one.
    run(&mut editor, [color(selection(), BLUE), opacity(selection(), 0.5)]);
    assert_eq!(names(&editor), ["selection 1"]);
    run(&mut editor, [commit(|i| (3..8).contains(&i)), color(selection(), RED)]);
    assert_eq!(names(&editor), ["selection 1", "selection 2"]);
    let state = editor.state();
    assert_eq!((drawn(state, 1).color, drawn(state, 4).color), (Some(Vec3::Z), Some(Vec3::X)));
    assert_eq!((drawn(state, 1).opacity, drawn(state, 4).opacity, drawn(state, 6).opacity), (0.5, 0.5, 1.0));

    sac(&mut editor);
    run(&mut editor, [opacity(all_but(&["sac"]), 0.2), opacity(all_but(&["SAC"]), 0.4)]);
    let state = editor.state();
    assert_eq!((drawn(state, 45).opacity, drawn(state, 1).opacity, drawn(state, 59).opacity), (1.0, 0.4, 0.4));
    assert_eq!(state.focus(), ["sac"], "what was excepted is what the talk is about");
    run(&mut editor, [opacity(all_but(&["sac"]), 1.0)]);
    assert!(!names(&editor).contains(&"everything but sac"), "{:?}", names(&editor));
}

#[test]
fn a_value_for_everything_or_for_the_rest_holds_in_their_units_too() {
    let mut editor = editor();
    sac(&mut editor);
    run(&mut editor, [color(units(&["sac"]), BLUE), opacity(units(&["sac"]), 0.5), opacity(units(&["bone"]), 0.4)]);
    // "Everything at 60 %, and red": the sac has no look of its own any more.
    run(&mut editor, [opacity(everything(), 0.6), color(everything(), RED)]);
    let state = editor.state();
    assert_eq!((drawn(state, 45).opacity, drawn(state, 1).opacity), (0.6, 0.6));
    assert_eq!((drawn(state, 45).color, drawn(state, 45).palette), (None, Vec3::X));
    // "All but the skin at 20 %": the factors of the bone and of the sac do not multiply it.
    run(&mut editor, [opacity(units(&["bone"]), 0.4), opacity(all_but(&["skin"]), 0.2)]);
    let state = editor.state();
    assert_eq!((drawn(state, 1).opacity, drawn(state, 25).opacity), (0.2, 0.6));
    // "The original colours of all but the skin".
    run(&mut editor, [color(units(&["sac"]), BLUE), own_color(all_but(&["skin"]))]);
    let state = editor.state();
    assert_eq!((drawn(state, 45).color, drawn(state, 25).palette), (None, Vec3::X));
    assert_ne!(drawn(state, 1).palette, Vec3::X);
}

#[test]
fn the_last_word_on_an_attribute_wins_over_derived_units() {
    let mut editor = editor();
    sac(&mut editor);
    // Hidden by "show only", shown by name.
    run(&mut editor, [only(units(&["sac"])), visible(units(&["bone"]), true)]);
    assert_eq!(shown(editor.state()), (0..20).chain(40..50).collect::<Vec<_>>());
    // Grey by "everything else", red by name.
    run(&mut editor, [color(all_but(&["sac"]), BLUE), color(units(&["skin"]), RED)]);
    assert_eq!((drawn(editor.state(), 0).color, drawn(editor.state(), 25).color), (Some(Vec3::Z), None));
    assert_eq!(drawn(editor.state(), 25).palette, Vec3::X);
    // Faded by "everything else", full by name; the hiding and the colour of the others stay.
    run(&mut editor, [opacity(all_but(&["sac"]), 0.2), opacity(units(&["bone"]), 1.0)]);
    let state = editor.state();
    assert_eq!((drawn(state, 0).opacity, drawn(state, 55).opacity), (1.0, 0.2));
    assert_eq!((drawn(state, 0).color, drawn(state, 55).visible), (Some(Vec3::Z), false));
    // Showing everything undoes all hiding, and nothing else.
    run(&mut editor, [visible(everything(), true)]);
    let state = editor.state();
    assert_eq!(shown(state).len(), 60);
    assert_eq!((drawn(state, 55).opacity, drawn(state, 0).color), (0.2, Some(Vec3::Z)));
    run(&mut editor, [opacity(everything(), 1.0), color(everything(), RED)]);
    assert_eq!(names(&editor), ["sac"]);
}

#[test]
fn a_split_look_keeps_the_order_of_colours() {
    let mut editor = editor();
    run(&mut editor, [commit(|i| i < 10), color(selection(), RED), opacity(selection(), 0.5)]);
    run(&mut editor, [commit(|i| (5..8).contains(&i)), color(selection(), BLUE), save("patch")]);
    // Part of the derived unit gets another opacity. The remainder of its factor moves to a unit of its own; its colour stays
    // under the patch.
    run(&mut editor, [commit(|i| (4..7).contains(&i)), opacity(selection(), 0.25)]);
    let state = editor.state();
    assert_eq!((drawn(state, 0).color, drawn(state, 0).opacity), (Some(Vec3::X), 0.5));
    assert_eq!((drawn(state, 4).color, drawn(state, 4).opacity), (Some(Vec3::X), 0.25));
    assert_eq!((drawn(state, 6).color, drawn(state, 6).opacity), (Some(Vec3::Z), 0.25));
    assert_eq!((drawn(state, 7).color, drawn(state, 7).opacity), (Some(Vec3::Z), 0.5));
    assert!(names(&editor).contains(&"selection 1 (opacity)"), "{:?}", names(&editor));
}

#[test]
fn show_only_hides_all_else_after_any_earlier_hiding() {
    let mut editor = editor();
    sac(&mut editor);
    run(&mut editor, [visible(units(&["vessel", "bone"]), false)]);
    // The sac lies in the hidden vessel.
    run(&mut editor, [visible(units(&["sac"]), true)]);
    assert_eq!(shown(editor.state()), (20..35).chain(40..50).collect::<Vec<_>>());
    assert!(names(&editor).contains(&"Rest of Vessel"));
    run(&mut editor, [only(units(&["sac"]))]);
    assert_eq!(shown(editor.state()), (40..50).collect::<Vec<_>>());
    run(&mut editor, [only(units(&["skin"]))]);
    assert_eq!(shown(editor.state()), (20..35).collect::<Vec<_>>());
    run(&mut editor, [only(all_but(&["skin"]))]);
    assert_eq!(shown(editor.state()), (0..20).chain(35..60).collect::<Vec<_>>());
    run(&mut editor, [visible(units(&["sac"]), false), commit(|i| i >= 40), only(selection())]);
    assert_eq!(
        shown(editor.state()),
        (40..60).collect::<Vec<_>>(),
        "a hidden unit inside the selection is shown with it"
    );
    run(&mut editor, [only(everything())]);
    assert_eq!(shown(editor.state()).len(), 60);
    assert_eq!(names(&editor), ["sac"]);
    run(&mut editor, [visible(everything(), false)]);
    assert_eq!(shown(editor.state()).len(), 0);
    // A saved unit that a person hid stays hidden when something around it is shown by name.
    run(&mut editor, [visible(everything(), true), visible(units(&["sac"]), false), only(units(&["vessel"]))]);
    assert_eq!(shown(editor.state()), (35..40).chain(50..60).collect::<Vec<_>>());
}

#[test]
fn saving_takes_the_look_of_the_selection_over() {
    let mut editor = editor();
    run(&mut editor, [commit(|i| i < 5), color(selection(), RED), opacity(selection(), 0.5), save("  cap ")]);
    let unit = editor.state().units().next().unwrap().clone();
    assert_eq!((unit.name.as_str(), unit.color, unit.opacity, unit.derived), ("cap", Some(Vec3::X), 0.5, false));
    assert_eq!((names(&editor), editor.state().focus()), (vec!["cap"], ["cap".to_owned()].as_slice()));
    run(&mut editor, [opacity(units(&["cap"]), 1.0)]);
    assert_eq!(drawn(editor.state(), 0).opacity, 1.0);

    // Names: unique in any capitals, replaced only on request, look kept then.
    run(&mut editor, [commit(|i| i < 9)]);
    assert_eq!(refused(&mut editor, save("CAP")).code(), Code::AlreadyExists);
    assert_eq!(refused(&mut editor, save("Bone")).code(), Code::FailedPrecondition);
    let replace = |name: &str| Action::SaveUnit(SaveUnit { name: name.to_owned(), replace: true });
    assert_eq!(refused(&mut editor, replace("bone")).code(), Code::FailedPrecondition);
    let id = unit.id;
    run(&mut editor, [replace("CAP")]);
    let unit = editor.state().units().next().unwrap();
    assert_eq!((unit.id, unit.name.as_str(), unit.mask.count(), unit.color), (id, "cap", 9, Some(Vec3::X)));
    for bad in ["", " ", "a\tb", &"x".repeat(MAX_NAME_BYTES + 1)] {
        assert_eq!(refused(&mut editor, save(bad)).code(), Code::InvalidArgument);
    }
    run(&mut editor, [Action::Select(Select::default())]);
    assert_eq!(refused(&mut editor, save("none")), EditError::NothingSelected);
}

#[test]
fn a_derived_unit_gives_its_name_up_for_one_that_is_given() {
    let mut editor = editor();
    run(&mut editor, [commit(|i| i < 5), color(selection(), RED), commit(|i| i > 50), save("Selection 1")]);
    assert_eq!(names(&editor), ["Selection 1 (unsaved)", "Selection 1"]);
    // Naming a derived unit saves it.
    let rename =
        |name: &str, new: &str| Action::RenameUnit(RenameUnit { name: name.to_owned(), new_name: new.to_owned() });
    run(&mut editor, [rename("selection 1 (UNSAVED)", "cap")]);
    assert_eq!((names(&editor)[0], editor.state().units().next().unwrap().derived), ("cap", false));
    run(&mut editor, [rename("cap", "Cap")]);
    assert_eq!(editor.state().focus(), ["Cap"]);
    assert_eq!(refused(&mut editor, rename("cap", "skin")).code(), Code::AlreadyExists);
    assert_eq!(refused(&mut editor, rename("bone", "b")).code(), Code::FailedPrecondition);
    assert_eq!(refused(&mut editor, rename("kap", "b")).details(), ["Cap"]);
    let delete = |name: &str| Action::DeleteUnit(DeleteUnit { name: name.to_owned() });
    assert_eq!(refused(&mut editor, delete("bone")).code(), Code::FailedPrecondition);
    assert_eq!(refused(&mut editor, delete("nothing")).code(), Code::NotFound);
    let applied = run(&mut editor, [delete("cap")]).unwrap();
    assert_eq!((applied.result.units, editor.state().focus().len()), (vec!["Cap".to_owned()], 0));
    // Ids are never given twice, not even after undo.
    let before = editor.state().units().map(|u| u.id).max();
    run(&mut editor, [commit(|i| i < 3), save("new"), undo(1), save("other")]);
    assert!(editor.state().units().map(|u| u.id).max() > before.map(|id| id + 1));
}

#[test]
fn selecting_combines_sets_and_forgets_strokes() {
    let mut editor = editor();
    sac(&mut editor);
    let selected = |editor: &Editor| editor.state().selection().mask().ones().collect::<Vec<_>>();
    run(&mut editor, [select(units(&["vessel"]), SetOperation::Unspecified)]);
    assert_eq!(selected(&editor), (35..60).collect::<Vec<_>>());
    run(&mut editor, [select(units(&["sac"]), SetOperation::Remove), select(units(&["skin"]), SetOperation::Add)]);
    assert_eq!(selected(&editor), (20..40).chain(50..60).collect::<Vec<_>>());
    run(&mut editor, [select(all_but(&["skin"]), SetOperation::Intersect)]);
    assert_eq!(selected(&editor), (35..40).chain(50..60).collect::<Vec<_>>());
    run(&mut editor, [select(Target { complement: true, ..selection() }, SetOperation::Replace)]);
    assert_eq!(editor.state().selection().mask().count(), 45);
    assert_eq!(refused(&mut editor, select(Target::default(), SetOperation::Add)), EditError::NoTarget);
    assert_eq!(
        refused(&mut editor, Action::Select(Select { target: None, operation: 77 })).code(),
        Code::InvalidArgument
    );
    let applied = run(&mut editor, [select(Target::default(), SetOperation::Replace)]).unwrap();
    assert_eq!(applied.result.selection_hash, editor.initial().selection().hash());
    assert_eq!(refused(&mut editor, color(selection(), RED)), EditError::NothingSelected);
}

#[test]
fn a_committed_selection_must_match_the_scene_and_its_base_selection() {
    let mut editor = editor();
    let stroke = Stroke {
        mode: StrokeMode::Walk.into(),
        kind: StrokeKind::Foreground.into(),
        radius: 0.05,
        points: vec![0.5; 6],
        pressure: vec![],
        depth: None,
    };
    let mask = Some(encode_mask(&Mask::from_fn(60, |i| i == 7)));
    let with = |mask, expected: &str, strokes| {
        Action::CommitSelection(CommitSelection {
            mask,
            strokes,
            expected_hash: expected.to_owned(),
            steps: Vec::new(),
        })
    };
    let empty = editor.state().selection().hash().to_owned();
    let applied = run(&mut editor, [with(mask.clone(), &empty, vec![stroke.clone()])]).unwrap();
    assert_eq!(applied.result.selection_hash, editor.state().selection().hash());
    assert_eq!(editor.state().selection().steps().len(), 1);
    let moved = refused(&mut editor, with(mask.clone(), &empty, vec![]));
    assert_eq!((moved.code(), moved.details()), (Code::FailedPrecondition, vec![applied.result.selection_hash]));
    let other = Some(encode_mask(&Mask::empty(61)));
    let torn = Some(sg_proto::scene::Mask { length: 60, bits: vec![0xff; 8] });
    for bad in [None, other, torn] {
        assert_eq!(refused(&mut editor, with(bad, "", vec![])).code(), Code::InvalidArgument);
    }
    let dot = Stroke { points: vec![], ..stroke };
    assert_eq!(refused(&mut editor, with(mask, "", vec![dot])).code(), Code::InvalidArgument);
    // Undo takes strokes back as well.
    run(&mut editor, [undo(1)]);
    assert_eq!((editor.state().selection().hash(), editor.state().selection().steps().len()), (empty.as_str(), 0));
}

#[test]
fn light_background_and_term() {
    let mut editor = editor();
    let light = SetLight { ambient: Some(2.0), shininess: Some(0.5), ..SetLight::default() };
    run(&mut editor, [Action::SetLight(light)]);
    run(&mut editor, [Action::SetLight(SetLight { relative: true, ..light })]);
    let direction = Some(Vector { x: 0.0, y: -2.0, z: 1.0 });
    let mode = LightMode::Direction.into();
    run(&mut editor, [Action::SetLight(SetLight { mode, direction, ..SetLight::default() })]);
    let now = editor.state().light();
    assert_eq!((now.ka, now.kd, now.shininess, now.direction), (4.0, 1.0, 0.25, [0.0, -2.0, 1.0]));
    assert_eq!(now.mode, sg_scene::camera::LightMode::Direction);
    for bad in [
        SetLight::default(),
        SetLight { ambient: Some(-1.0), ..SetLight::default() },
        SetLight { diffuse: Some(f32::NAN), ..SetLight::default() },
        SetLight { direction: Some(Vector::default()), ..SetLight::default() },
        SetLight { mode: 9, ..light },
    ] {
        let code = refused(&mut editor, Action::SetLight(bad)).code();
        assert!(matches!(code, Code::InvalidArgument | Code::OutOfRange), "{code:?}");
    }
    run(&mut editor, [Action::SetBackground(SetBackground { color: Some(BLUE) })]);
    run(&mut editor, [Action::SetTerm(SetTerm { term: ShadingTerm::Normal.into() })]);
    let appearance = editor.state().appearance();
    assert_eq!((appearance.background, appearance.term), (Vec3::Z, sg_scene::appearance::ShadingTerm::Normal));
    assert_eq!(refused(&mut editor, Action::SetTerm(SetTerm { term: 0 })).code(), Code::InvalidArgument);
    assert_eq!(
        refused(&mut editor, Action::SetBackground(SetBackground { color: None })).code(),
        Code::InvalidArgument
    );
}

#[test]
fn numbers_that_make_no_sense_are_refused() {
    let mut editor = editor();
    for bad in [f32::NAN, f32::INFINITY] {
        assert_eq!(refused(&mut editor, opacity(everything(), bad)).code(), Code::InvalidArgument);
        let odd = Color { green: bad, ..RED };
        assert_eq!(refused(&mut editor, color(everything(), odd)).code(), Code::InvalidArgument);
    }
    assert_eq!(refused(&mut editor, opacity(everything(), -0.1)).code(), Code::OutOfRange);
    assert_eq!(refused(&mut editor, color(everything(), Color { red: 1.5, ..BLUE })).code(), Code::OutOfRange);
    run(&mut editor, [opacity(everything(), 1e6)]);
    let more = SetOpacity { target: Some(everything()), factor: 1e6, relative: true };
    assert_eq!(refused(&mut editor, Action::SetOpacity(more)).code(), Code::OutOfRange);
}

#[test]
fn views() {
    let mut editor = editor();
    let first = editor.state().view();
    run(&mut editor, [view(ViewChange::Named(NamedView::Top.into()))]);
    assert!(editor.state().view().eye.z > 10.0);
    run(&mut editor, [view(ViewChange::Orbit(Orbit { azimuth_degrees: 30.0, elevation_degrees: 10.0 }))]);
    run(&mut editor, [view(ViewChange::Named(NamedView::Initial.into()))]);
    assert_eq!(editor.state().view(), first);
    run(&mut editor, [view(ViewChange::Zoom(2.0))]);
    let near = editor.state().view();
    assert!((2.0 * near.eye.distance(near.target) - first.eye.distance(first.target)).abs() < 1e-9);
    run(&mut editor, [view(ViewChange::Focus(units(&["skin"])))]);
    assert_eq!(editor.state().focus(), ["skin"]);
    let exact = crate::wire::encode_view(&first);
    run(&mut editor, [view(ViewChange::View(exact)), undo(1)]);
    assert_ne!(editor.state().view(), first);
    for bad in [
        ViewChange::Zoom(0.0),
        ViewChange::Zoom(f64::NAN),
        ViewChange::Named(0),
        ViewChange::Orbit(Orbit { azimuth_degrees: f64::NAN, elevation_degrees: 0.0 }),
        ViewChange::View(View { eye: None, ..exact }),
        ViewChange::View(View { target: exact.eye, ..exact }),
        ViewChange::View(View { fov_y_degrees: 0.0, ..exact }),
        ViewChange::Focus(Target::default()),
    ] {
        let code = refused(&mut editor, view(bad)).code();
        assert!(matches!(code, Code::InvalidArgument | Code::OutOfRange), "{code:?}");
    }
}

#[test]
fn targets_are_resolved_and_unknown_ones_are_named() {
    let mut editor = editor();
    assert_eq!(refused(&mut editor, color(Target::default(), RED)), EditError::NoTarget);
    let missing = Action::SetColor(SetColor { target: None, color: Some(RED) });
    assert_eq!(refused(&mut editor, missing), EditError::NoTarget);
    let error = refused(&mut editor, color(units(&["skim"]), RED));
    assert_eq!((error.code(), error.details()), (Code::NotFound, vec!["skin".to_owned()]));
    let nothing_left = Target { complement: true, ..everything() };
    assert_eq!(refused(&mut editor, color(nothing_left, RED)).code(), Code::FailedPrecondition);
    let all = all_but(&["bone", "skin", "vessel"]);
    assert_eq!(refused(&mut editor, color(all, RED)).code(), Code::FailedPrecondition);
    // "All that is not named", with nothing named, is everything.
    run(&mut editor, [color(all_but(&[]), RED)]);
    assert!(editor.state().base_units().iter().all(|b| b.palette == Vec3::X));
    // A name twice counts once.
    let halved = SetOpacity { target: Some(units(&["bone", "Bone"])), factor: 0.5, relative: true };
    run(&mut editor, [Action::SetOpacity(halved)]);
    assert_eq!(editor.state().base_units()[0].opacity, 0.5);
}

#[test]
fn undo_and_redo_walk_through_everything() {
    let mut editor = editor();
    assert_eq!(refused(&mut editor, undo(1)), EditError::NothingToUndo);
    assert_eq!(refused(&mut editor, redo(1)), EditError::NothingToRedo);
    sac(&mut editor);
    let applied = run(&mut editor, [color(units(&["sac"]), RED)]).unwrap();
    assert_eq!(applied.history, HistoryMove::Push);
    let red = editor.message(true);
    assert_eq!(red.undo, ["coloured sac #ff0000", "saved the selection as sac: 10 Gaussians", "selected 10 Gaussians"]);
    let back = run(&mut editor, [undo(0)]).unwrap();
    assert_eq!(back.result.summary, "undid: coloured sac #ff0000");
    assert_eq!(editor.message(true).redo, ["coloured sac #ff0000"]);
    run(&mut editor, [undo(99)]);
    assert_eq!((names(&editor).len(), editor.state().selection().mask().count()), (0, 0));
    run(&mut editor, [redo(3)]);
    let again = editor.message(true);
    assert_eq!((again.units, again.selection, again.undo), (red.units, red.selection, red.undo));
    // A command that changes nothing leaves the history alone; any other clears the redo stack.
    run(&mut editor, [undo(1), visible(everything(), true)]);
    assert_eq!(editor.message(false).redo.len(), 1);
    run(&mut editor, [opacity(everything(), 0.5)]);
    assert_eq!(editor.message(false).redo.len(), 0);
    assert_eq!(editor.state().revision(), 9);
}

#[test]
fn reset_gives_the_first_look_back_and_keeps_units_and_selection() {
    let mut editor = editor();
    sac(&mut editor);
    run(
        &mut editor,
        [
            color(units(&["sac"]), RED),
            opacity(all_but(&["sac"]), 0.2),
            color(units(&["bone"]), BLUE),
            visible(units(&["skin"]), false),
            view(ViewChange::Zoom(3.0)),
            Action::SetTerm(SetTerm { term: ShadingTerm::Normal.into() }),
            Action::SetBackground(SetBackground { color: Some(RED) }),
            Action::Reset(Reset {}),
        ],
    );
    let (state, initial) = (editor.state(), editor.initial());
    assert_eq!(state.appearance(), initial.appearance());
    assert_eq!((state.view(), names(&editor), state.selection().mask().count()), (initial.view(), vec!["sac"], 10));
    run(&mut editor, [undo(1)]);
    assert_eq!(drawn(editor.state(), 45).color, Some(Vec3::X));
}

#[test]
fn ids_revisions_and_actions_are_checked_first() {
    let mut editor = editor();
    let action = color(everything(), RED);
    for id in ["", &"x".repeat(MAX_NAME_BYTES + 1)] {
        let bad = Command { id: id.to_owned(), ..command(action.clone()) };
        assert_eq!(editor.apply(&bad).unwrap_err().code(), Code::InvalidArgument);
    }
    let nothing = Command { action: None, ..command(action.clone()) };
    assert_eq!(editor.apply(&nothing).unwrap_err().code(), Code::InvalidArgument);
    run(&mut editor, [action.clone()]);
    let late = Command { expected_revision: 7, ..command(action.clone()) };
    assert_eq!(editor.apply(&late).unwrap_err(), EditError::RevisionConflict { expected: 7, found: 1 });
    let fresh = Command { expected_revision: 1, ..command(action) };
    assert_eq!(editor.apply(&fresh).unwrap().result.revision, 2);
}

#[test]
fn there_are_only_so_many_units() {
    let mut editor = editor();
    run(&mut editor, [commit(|i| i < 5)]);
    run(&mut editor, (0..MAX_UNITS).map(|n| save(&format!("unit {n}"))));
    assert_eq!(refused(&mut editor, save("one more")).code(), Code::ResourceExhausted);
    assert_eq!(refused(&mut editor, color(selection(), RED)).code(), Code::ResourceExhausted);
    run(&mut editor, [Action::DeleteUnit(DeleteUnit { name: "unit 7".into() }), color(selection(), RED)]);
}

#[test]
fn redo_keeps_no_deleted_name_in_focus() {
    let mut editor = editor();
    // Making everything visible changes the focus alone, so undo and redo do not know of it.
    run(&mut editor, [commit(|i| i == 0), color(selection(), RED), visible(everything(), true)]);
    run(&mut editor, [Action::Reset(Reset {}), undo(1), undo(1), Action::Redo(Redo { steps: 1 })]);
    assert_eq!(editor.state().focus(), ["selection 1"]);
    run(&mut editor, [Action::Redo(Redo { steps: 1 })]);
    assert_eq!((editor.state().focus(), editor.state().units().count()), ([].as_slice(), 0));
}

#[test]
fn masks_that_no_reader_could_be_sent_are_refused() {
    let n = 9_000_000;
    let scene = Arc::new(Scene::compose(
        test_scene(&[("bone", 1)])
            .units
            .into_iter()
            .map(|mut unit| {
                unit.gaussians.position = vec![Vec3::ZERO; n];
                unit
            })
            .collect(),
        None,
    ));
    let state = EditState { view: editor().state().view(), ..EditState::of_scene(&test_scene(&[("bone", 1)]), "", "") };
    let geometry = crate::Geometry { count: n, ..state.geometry().clone() };
    let mut state = EditState { geometry: Arc::new(geometry), ..state };
    state.base[0].count = n;
    state.selection = crate::Selection::new(Arc::new(Mask::full(n)), Arc::new([]));
    let mut editor = Editor::new(scene, state);
    run(&mut editor, [save("one"), save("two")]);
    let error = refused(&mut editor, save("three"));
    assert_eq!(error.code(), Code::ResourceExhausted);
    run(&mut editor, [Action::DeleteUnit(DeleteUnit { name: "one".into() }), save("three")]);
    assert_eq!(editor.state().find("three").map(|u| matches!(u, UnitRef::Editable(_))), Ok(true));
}

#[test]
fn the_side_that_is_up_is_chosen_kept_and_undone() {
    let scene = Arc::new(test_scene(&[("bone", 40)]));
    let opened = EditState::of_scene(&scene, "scene.toml", "hash");
    let up = |axis: sg_proto::scene::Axis| view(ViewChange::Up(axis.into()));
    let turned = opened.after(&scene, up(sg_proto::scene::Axis::MinusY)).unwrap();
    assert_eq!(turned.up(), Some(Axis::MinusY));
    assert_eq!(turned.view().up, glam::DVec3::NEG_Y);
    // Other sides keep it, and it survives the way through messages.
    let top = turned.after(&scene, view(ViewChange::Named(NamedView::Top.into()))).unwrap();
    assert!((top.view().eye - top.view().target).normalize().dot(glam::DVec3::NEG_Y) > 0.999);
    assert_eq!(EditState::from_snapshot(&top.state(true)).unwrap(), top);
    let changes = opened.changes_to(&turned);
    assert!(changes.contains(&Change::Up(Some(Axis::MinusY))), "{changes:?}");
    // An exported scene keeps it in its file.
    assert_eq!(turned.edited(&scene, &Mask::full(40)).unwrap().orientation.up, Some(Axis::MinusY));
    // The first view is the file's own.
    for action in [view(ViewChange::Named(NamedView::Initial.into())), up(sg_proto::scene::Axis::Unspecified)] {
        let mut editor = Editor::new(Arc::clone(&scene), opened.clone());
        run(&mut editor, [up(sg_proto::scene::Axis::MinusY), action]);
        assert_eq!((editor.state().up(), editor.state().view().up), (None, glam::DVec3::Z));
        run(&mut editor, [Action::Undo(Undo { steps: 1 })]);
        assert_eq!(editor.state().up(), Some(Axis::MinusY));
    }
    assert!(opened.after(&scene, view(ViewChange::Up(99))).is_err());
}

#[test]
fn the_front_of_a_patient_is_anterior() {
    for (patient, anterior) in [(PatientFrame::Lps, glam::DVec3::NEG_Y), (PatientFrame::Ras, glam::DVec3::Y)] {
        let mut scene = test_scene(&[("bone", 40)]);
        scene.orientation.patient = Some(patient);
        let scene = Arc::new(scene);
        let opened = EditState::of_scene(&scene, "scene.toml", "hash");
        let from = |state: &EditState| (state.view().eye - state.view().target).normalize();
        assert!(from(&opened).dot(anterior) > 0.999, "{patient:?}");
        let front = opened.after(&scene, view(ViewChange::Named(NamedView::Front.into()))).unwrap();
        assert!(from(&front).dot(anterior) > 0.999 && front.view().up == glam::DVec3::Z, "{patient:?}");
    }
}
