//! Gaussians that edits copied.

use glam::DVec3;
use sg_proto::scene::{Duplicate as DuplicateMessage, Mask as MaskMessage, Redo, RenameUnit, Reset, Undo};
use sg_scene::synthetic::samples;

use super::*;
use crate::wire::WireError;
use crate::{Part, PlacedScene};

fn undo(steps: u32) -> Action {
    Action::Undo(Undo { steps })
}

fn redo(steps: u32) -> Action {
    Action::Redo(Redo { steps })
}

fn rename(name: &str, new: &str) -> Action {
    Action::RenameUnit(RenameUnit { name: name.to_owned(), new_name: new.to_owned() })
}

fn base_names(editor: &Editor) -> Vec<&str> {
    editor.state().base_units().iter().map(|base| base.name.as_str()).collect()
}

/// `sac` has 22..30 of `skin` and is red.
fn with_sac() -> Editor {
    let mut editor = editor();
    run(&mut editor, [commit(|i| (22..30).contains(&i)), save("sac"), color(units(&["sac"]), RED)]);
    editor
}

#[test]
fn a_copy_is_a_base_unit_of_its_own_that_looks_the_same_and_is_selected() {
    let mut editor = with_sac();
    let applied = run(&mut editor, [duplicate(units(&["sac"]), "")]).unwrap();
    assert_eq!(applied.result.summary, "duplicated sac as sac copy: 8 Gaussians");
    let state = editor.state();
    assert_eq!((state.count(), state.geometry().count, state.existing_count()), (68, 60, 68));
    assert_eq!(base_names(&editor), ["bone", "skin", "Vessel", "sac copy"]);
    assert_eq!(state.selection().mask().ones().collect::<Vec<_>>(), (60..68).collect::<Vec<_>>());
    assert_eq!((state.focus(), drawn(state, 61)), (["sac copy".to_owned()].as_slice(), drawn(state, 23)));
    let (scene, file) = (editor.scene(), with_sac().scene());
    assert_eq!((scene.len(), scene.units[3].range(), &scene.units[3].name[..]), (68, 60..68, "sac copy"));
    assert_eq!(scene.units[3].gaussians, file.units[1].gaussians.rows(&(2..10).collect::<Vec<_>>()));
    assert_eq!(scene.units[..3], file.units[..]);
    // The copy has a colour of its own from now on.
    run(&mut editor, [color(units(&["sac copy"]), BLUE)]);
    let (copy, original) = (drawn(editor.state(), 61), drawn(editor.state(), 23));
    assert_eq!((copy.color.unwrap_or(copy.palette), original.color), (Vec3::Z, Some(Vec3::X)));
}

#[test]
fn undo_takes_the_copies_away_and_redo_brings_them_back() {
    let mut editor = with_sac();
    let before = editor.message(true);
    let file = editor.scene();
    run(&mut editor, [duplicate(units(&["sac"]), ""), shift(selection(), [1.0, 0.0, 0.0]), delete(units(&["skin"]))]);
    let after = editor.message(true);
    assert_eq!(editor.state().deleted().len(), 68);
    run(&mut editor, [undo(3)]);
    let undone = editor.message(true);
    assert_eq!((undone.count, &undone.units, &undone.base_units), (60, &before.units, &before.base_units));
    assert_eq!((undone.selection, undone.duplicates), (before.selection, None));
    assert!(Arc::ptr_eq(&editor.scene(), &file));
    run(&mut editor, [redo(3)]);
    let redone = editor.message(true);
    assert_eq!((&redone.units, &redone.base_units), (&after.units, &after.base_units));
    assert_eq!((&redone.duplicates, &redone.placements), (&after.duplicates, &after.placements));
}

#[test]
fn copies_lie_where_their_originals_are_and_move_alone() {
    let mut editor = editor();
    run(&mut editor, [shift(units(&["skin"]), [0.0, 3.0, 0.0]), duplicate(units(&["skin"]), "twin")]);
    let place = |editor: &Editor, i: usize| editor.scene().position(i).unwrap();
    assert_eq!(place(&editor, 62), place(&editor, 22));
    run(&mut editor, [shift(units(&["twin"]), [5.0, 0.0, 0.0])]);
    let apart = place(&editor, 62) - place(&editor, 22) - DVec3::new(5.0, 0.0, 0.0);
    assert!(apart.length() < 1e-5, "{apart}");
    // Where one of them is put back, it is where the file has its original.
    let restore = TransformGaussians { target: Some(units(&["twin"])), restore: true, ..TransformGaussians::default() };
    run(&mut editor, [Action::TransformGaussians(restore)]);
    let file = super::editor().scene();
    assert_eq!(place(&editor, 62), file.position(22).unwrap());
}

#[test]
fn copies_can_be_copied_deleted_and_restored() {
    let mut editor = editor();
    run(&mut editor, [duplicate(units(&["skin"]), ""), duplicate(selection(), "")]);
    assert_eq!(base_names(&editor), ["bone", "skin", "Vessel", "skin copy", "skin copy 2"]);
    let scene = editor.scene();
    assert_eq!(scene.units[4].gaussians, scene.units[1].gaussians);
    run(&mut editor, [delete(units(&["skin copy"]))]);
    assert_eq!((editor.state().existing_count(), editor.state().count()), (75, 90));
    run(&mut editor, [delete(units(&["skin copy 2"])), restore()]);
    assert_eq!(editor.state().existing_count(), 90);
}

#[test]
fn each_base_unit_of_a_target_has_a_copy_of_its_own() {
    let mut editor = editor();
    let applied = run(&mut editor, [duplicate(everything(), "")]).unwrap();
    assert_eq!(applied.result.summary, "duplicated everything as bone copy, skin copy and Vessel copy: 60 Gaussians");
    assert_eq!(base_names(&editor)[3..], ["bone copy", "skin copy", "Vessel copy"]);
    run(&mut editor, [commit_of(120, |i| (15..25).contains(&i)), duplicate(selection(), "part")]);
    assert_eq!(base_names(&editor)[6..], ["part", "part 2"]);
    let state = editor.state();
    assert_eq!(state.duplicates().iter().map(|d| d.range().len()).collect::<Vec<_>>(), [20, 15, 25, 5, 5]);
}

fn commit_of(count: usize, members: impl Fn(usize) -> bool) -> Action {
    let mask = Some(encode_mask(&Mask::from_fn(count, members)));
    Action::CommitSelection(CommitSelection { mask, ..CommitSelection::default() })
}

#[test]
fn a_copy_can_be_renamed_and_reset_and_a_base_unit_of_the_file_keeps_its_name() {
    let mut editor = editor();
    let palette = editor.state().base_units()[1].palette;
    run(&mut editor, [color(units(&["skin"]), RED), duplicate(units(&["skin"]), ""), rename("skin copy", "flap")]);
    assert_eq!(base_names(&editor), ["bone", "skin", "Vessel", "flap"]);
    assert!(matches!(refused(&mut editor, rename("skin", "hide")), EditError::BaseUnit { .. }));
    run(&mut editor, [own_color(units(&["flap"]))]);
    assert_eq!(drawn(editor.state(), 60).palette, palette);
    run(&mut editor, [opacity(units(&["flap"]), 0.5), Action::Reset(Reset {})]);
    let flap = &editor.state().base_units()[3];
    assert_eq!((flap.name.as_str(), flap.opacity, flap.palette, flap.range()), ("flap", 1.0, palette, 60..75));
}

#[test]
fn what_cannot_be_copied_is_refused() {
    let mut editor = editor();
    assert_eq!(refused(&mut editor, duplicate(selection(), "")), EditError::NothingSelected);
    assert_eq!(refused(&mut editor, duplicate(units(&["skin"]), "bone")), EditError::NameTaken("bone".into()));
    assert!(matches!(refused(&mut editor, duplicate(units(&["skin"]), "a\nb")), EditError::Malformed { .. }));
    // A locked unit stays as it is; its copy is not locked.
    run(&mut editor, [lock(units(&["skin"]), true), duplicate(units(&["skin"]), "")]);
    assert!(!editor.state().base_units()[3].locked);
    for _ in 1..64 {
        run(&mut editor, [duplicate(units(&["skin"]), "")]);
    }
    let error = refused(&mut editor, duplicate(units(&["skin"]), ""));
    assert!(matches!(error, EditError::TooMany { limit: 64, .. }), "{error}");
}

#[test]
fn an_export_has_the_copies_where_they_are() {
    let scene = Arc::new(samples::two_units(40));
    let mut editor = Editor::new(Arc::clone(&scene), EditState::of_scene(&scene, "scene.toml", ""));
    let name = editor.state().base_units()[1].name.clone();
    run(&mut editor, [duplicate(units(&[&name]), "twin"), shift(units(&["twin"]), [2.0, 0.0, 0.0])]);
    let state = editor.state();
    let all = state.edited(&scene, &state.part(Part::Everything).unwrap()).unwrap();
    assert_eq!((all.len(), all.units.len(), all.units[2].name.as_str()), (state.count(), 3, "twin"));
    let alone = state.edited(&scene, &state.part(Part::Unit("twin")).unwrap()).unwrap();
    assert_eq!(alone.len(), scene.units[1].gaussians.len());
    let placed = PlacedScene::new(Arc::clone(&scene)).of(state);
    assert_eq!(alone.position(3), placed.position(scene.len() + 3));
}

#[test]
fn a_snapshot_with_copies_of_another_scene_is_refused() {
    let mut editor = with_sac();
    run(&mut editor, [duplicate(units(&["sac"]), "")]);
    let sound = editor.message(true);
    assert_eq!(EditState::from_snapshot(&sound).as_ref(), Ok(editor.state()));
    let wrong = Err(WireError::Duplicates("duplicates.originals"));
    let spoiled = |spoil: &dyn Fn(&mut DuplicateMessage)| {
        let mut message = sound.clone();
        spoil(&mut message.duplicates.as_mut().unwrap().parts[0]);
        EditState::from_snapshot(&message)
    };
    let of = |mask: &Mask| Some(encode_mask(mask));
    assert_eq!(spoiled(&|part| part.originals = of(&Mask::from_fn(60, |i| i < 7))), wrong, "of other number");
    assert_eq!(
        spoiled(&|part| part.originals = of(&Mask::from_fn(60, |i| (16..24).contains(&i)))),
        wrong,
        "of two units"
    );
    assert_eq!(spoiled(&|part| part.originals = of(&Mask::from_fn(59, |i| i < 8))), wrong, "elsewhere");
    assert_eq!(spoiled(&|part| part.originals = None), Err(WireError::Missing("duplicates.originals")));
    let torn = MaskMessage { length: 60, bits: vec![0] };
    assert!(matches!(spoiled(&|part| part.originals = Some(torn.clone())), Err(WireError::Bits { .. })));
    let without =
        sg_proto::scene::State { duplicates: None, base_units: sound.base_units[..3].to_vec(), ..sound.clone() };
    assert!(EditState::from_snapshot(&sg_proto::scene::State { count: 60, ..without }).is_err(), "masks are too long");
}
