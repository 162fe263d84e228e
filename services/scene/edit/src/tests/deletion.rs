//! Deleted Gaussians are nowhere, and come back.

use std::sync::Arc;

use sg_proto::scene::{Mask as MaskMessage, Redo, Reset, Select, Undo};
use sg_scene::synthetic::test_scene;

use super::*;
use crate::{Part, UnitRef};

fn undo() -> Action {
    Action::Undo(Undo { steps: 1 })
}

fn select(target: Target) -> Action {
    Action::Select(Select { target: Some(target), operation: 0 })
}

fn selected(editor: &Editor) -> Vec<usize> {
    editor.state().selection().mask().ones().collect()
}

/// `sac` has 10..30: ten of `bone`, ten of `skin`. Its second half is deleted.
fn half_deleted() -> Editor {
    let mut editor = editor();
    let half = [commit(|i| (10..30).contains(&i)), save("sac"), commit(|i| (20..30).contains(&i)), delete(selection())];
    run(&mut editor, half);
    editor
}

#[test]
fn deleted_gaussians_are_neither_drawn_nor_counted_nor_selected_nor_written() {
    let mut editor = half_deleted();
    let state = editor.state();
    assert_eq!(shown(state), (0..20).chain(30..60).collect::<Vec<_>>());
    assert_eq!((state.count(), state.existing_count(), state.deleted().count()), (60, 50, 10));
    assert_eq!(state.base_units().iter().map(crate::BaseUnitState::existing).collect::<Vec<_>>(), [20, 5, 25]);
    assert_eq!(state.members(UnitRef::Base(1)).ones().collect::<Vec<_>>(), (30..35).collect::<Vec<_>>());
    let sac = state.find("sac").unwrap();
    assert_eq!(state.members(sac).ones().collect::<Vec<_>>(), (10..20).collect::<Vec<_>>());
    assert!(state.selection().mask().is_none() && state.selection().steps().is_empty());
    for part in [Part::Everything, Part::Visible, Part::Unit("skin"), Part::Unit("sac")] {
        assert!(!state.part(part).unwrap().intersects(state.deleted()), "{part:?}");
    }
    let scene = test_scene(&[("bone", 20), ("skin", 15), ("Vessel", 25)]);
    let written = state.edited(&scene, &state.part(Part::Everything).unwrap()).unwrap();
    assert_eq!(written.len(), 50);
    // Neither a selection by name nor one from elsewhere contains them.
    run(&mut editor, [select(everything())]);
    assert_eq!(selected(&editor), (0..20).chain(30..60).collect::<Vec<_>>());
    run(&mut editor, [commit(|i| (15..32).contains(&i))]);
    assert_eq!(selected(&editor), [15, 16, 17, 18, 19, 30, 31]);
    run(&mut editor, [select(all_but(&["bone"]))]);
    assert_eq!(selected(&editor), (30..60).collect::<Vec<_>>());
}

#[test]
fn undo_and_redo_move_deleted_gaussians_back_and_forth() {
    let mut editor = half_deleted();
    let deleted = editor.state().clone();
    run(&mut editor, [undo()]);
    let state = editor.state();
    assert_eq!((shown(state).len(), state.existing_count(), state.deleted().count()), (60, 60, 0));
    assert_eq!(selected(&editor), (20..30).collect::<Vec<_>>());
    assert_eq!(state.members(state.find("sac").unwrap()).count(), 20);
    run(&mut editor, [Action::Redo(Redo { steps: 1 })]);
    assert_eq!((shown(editor.state()), editor.state().deleted()), (shown(&deleted), deleted.deleted()));
    assert_eq!(editor.message(false).undo[0], "deleted the selection: 10 Gaussians");
}

#[test]
fn cropping_keeps_the_selection_alone_and_restoring_brings_the_rest_back() {
    let mut editor = editor();
    let rest_of_selection = Target { complement: true, ..selection() };
    run(
        &mut editor,
        [commit(|i| (10..30).contains(&i)), save("sac"), only(units(&["sac"])), delete(rest_of_selection)],
    );
    let state = editor.state();
    assert_eq!((shown(state), selected(&editor)), ((10..30).collect(), (10..30).collect::<Vec<_>>()));
    // "Everything but sac" has nothing left to hide.
    assert_eq!(state.units().map(|u| u.name.as_str()).collect::<Vec<_>>(), ["sac"]);
    let summary = run(&mut editor, [restore()]).unwrap().result.summary;
    assert_eq!(summary, "restored all deleted Gaussians: 40 Gaussians");
    assert_eq!((shown(editor.state()).len(), selected(&editor).len()), (60, 20));
    assert_eq!(refused(&mut editor, restore()), EditError::NothingDeleted);
}

#[test]
fn restored_gaussians_return_to_the_saved_units_that_they_belonged_to() {
    let mut editor = half_deleted();
    run(&mut editor, [commit(|i| (12..14).contains(&i)), delete(selection()), color(units(&["sac"]), RED), restore()]);
    let state = editor.state();
    assert_eq!(state.members(state.find("sac").unwrap()).ones().collect::<Vec<_>>(), (10..30).collect::<Vec<_>>());
    assert_eq!(drawn(state, 25).color, Some(crate::wire::decode_color(&RED)));
    assert!(state.units().all(|u| u.deleted.is_none()));
}

#[test]
fn a_unit_is_deleted_by_name_and_its_name_stays() {
    let mut editor = editor();
    run(&mut editor, [commit(|i| i < 5), delete(units(&["Vessel"]))]);
    assert_eq!((selected(&editor), editor.state().existing_count()), ((0..5).collect::<Vec<_>>(), 35));
    assert!(
        matches!(refused(&mut editor, delete(units(&["Vessel"]))), EditError::EmptyTarget(what) if what == "Vessel")
    );
    assert_eq!(editor.state().part(Part::Unit("Vessel")), Err(EditError::EmptyTarget("Vessel".to_owned())));
    // A reset concerns the look.
    run(&mut editor, [Action::Reset(Reset {})]);
    assert_eq!((editor.state().existing_count(), shown(editor.state()).len()), (35, 35));
}

#[test]
fn deletion_without_a_target_is_refused() {
    let mut editor = editor();
    assert_eq!(refused(&mut editor, delete(selection())), EditError::NothingSelected);
    assert_eq!(refused(&mut editor, delete(Target::default())), EditError::NoTarget);
    assert_eq!(refused(&mut editor, Action::DeleteGaussians(DeleteGaussians { target: None })), EditError::NoTarget);
}

#[test]
fn a_snapshot_tells_which_gaussians_are_deleted_and_an_outline_how_many() {
    let editor = half_deleted();
    let whole = editor.message(true);
    assert_eq!(EditState::from_snapshot(&whole).as_ref(), Ok(editor.state()));
    let outline = editor.message(false);
    assert!(outline.deleted.is_none() && outline.units.iter().all(|u| u.deleted.is_none()));
    assert_eq!(outline.base_units.iter().map(|b| b.deleted).collect::<Vec<_>>(), [0, 10, 0]);
    assert_eq!(outline.units[0].count, 10);
    let short = Some(MaskMessage { length: 59, bits: vec![0; 8] });
    assert!(EditState::from_snapshot(&sg_proto::scene::State { deleted: short, ..whole }).is_err());
}

#[test]
fn a_picture_of_everything_deleted_is_empty_and_undo_brings_it_back() {
    let scene = Arc::new(test_scene(&[("bone", 20)]));
    let mut editor = Editor::new(Arc::clone(&scene), EditState::of_scene(&scene, "scene.toml", "hash"));
    run(&mut editor, [delete(everything())]);
    assert_eq!((shown(editor.state()).len(), editor.state().existing_count()), (0, 0));
    assert!(editor.state().part(Part::Everything).is_err());
    run(&mut editor, [undo()]);
    assert_eq!(shown(editor.state()).len(), 20);
}
