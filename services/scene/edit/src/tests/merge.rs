//! Merged units.

use sg_proto::scene::{MergeUnits, Undo};

use super::*;

fn merge(units: &[&str], name: &str) -> Action {
    let units = units.iter().map(|n| (*n).to_owned()).collect();
    Action::MergeUnits(MergeUnits { units, name: name.to_owned() })
}

fn members(editor: &Editor, name: &str) -> Vec<usize> {
    let state = editor.state();
    state.members(state.find(name).unwrap()).ones().collect()
}

fn names(editor: &Editor) -> Vec<String> {
    editor.state().units().map(|unit| unit.name.clone()).collect()
}

/// `sac` has 5..10 and is red, `dome` has 8..25 and is faded, `neck` has 40..45.
fn three() -> Editor {
    let mut editor = editor();
    for (name, range) in [("sac", 5..10), ("dome", 8..25), ("neck", 40..45)] {
        run(&mut editor, [commit(|i| range.contains(&i)), save(name)]);
    }
    run(&mut editor, [color(units(&["sac"]), RED), opacity(units(&["dome"]), 0.5)]);
    editor
}

#[test]
fn a_merge_is_the_union_with_the_look_of_the_first_and_one_step_back() {
    let mut editor = three();
    let before = editor.message(true);
    let applied = run(&mut editor, [merge(&["sac", "DOME"], "")]).unwrap();
    assert_eq!(applied.result.summary, "merged sac and dome as sac: 20 Gaussians");
    assert_eq!((names(&editor), members(&editor, "sac")), (vec!["sac".into(), "neck".into()], (5..25).collect()));
    let look = drawn(editor.state(), 20);
    assert_eq!((look.color, look.opacity), (Some(Vec3::X), 1.0));
    assert_eq!(editor.state().focus(), ["sac"]);
    run(&mut editor, [Action::Undo(Undo { steps: 1 })]);
    let after = editor.message(true);
    assert_eq!((after.units, after.base_units), (before.units, before.base_units));
    // Deleted Gaussians come back to the merged unit.
    run(&mut editor, [commit(|i| i < 12), delete(selection()), merge(&["dome", "sac", "neck"], "aneurysm")]);
    assert_eq!(names(&editor), ["aneurysm"]);
    run(&mut editor, [restore()]);
    assert_eq!(members(&editor, "aneurysm"), (5..25).chain(40..45).collect::<Vec<_>>());
    assert_eq!(drawn(editor.state(), 6).opacity, 0.5);
}

#[test]
fn a_base_unit_stays_and_needs_a_name_for_the_union() {
    let mut editor = three();
    let refusal = refused(&mut editor, merge(&["skin", "sac"], ""));
    assert!(matches!(refusal, EditError::BaseUnit { ref name, .. } if name == "skin"), "{refusal}");
    assert_eq!(refused(&mut editor, merge(&["skin", "sac"], "Skin")), EditError::NameTaken("Skin".into()));
    run(&mut editor, [merge(&["skin", "sac"], "both")]);
    assert_eq!(members(&editor, "both"), (5..10).chain(20..35).collect::<Vec<_>>());
    assert_eq!(members(&editor, "skin"), (20..35).collect::<Vec<_>>());
    assert_eq!(drawn(editor.state(), 6).color, None, "a base unit has no colour for others");
    // The first one keeps its look, and a base unit after it needs no name.
    run(&mut editor, [color(units(&["neck"]), BLUE), merge(&["neck", "skin"], "")]);
    assert_eq!(drawn(editor.state(), 22).color, Some(Vec3::Z));
}

#[test]
fn what_cannot_be_merged_is_refused() {
    let mut editor = three();
    assert!(matches!(refused(&mut editor, merge(&["sac"], "")), EditError::Malformed { .. }));
    assert!(matches!(refused(&mut editor, merge(&["sac", "SAC"], "x")), EditError::Malformed { .. }));
    assert!(matches!(refused(&mut editor, merge(&["sac", "sack"], "")), EditError::UnknownUnit { .. }));
    assert_eq!(refused(&mut editor, merge(&["sac", "dome"], "neck")), EditError::NameTaken("neck".into()));
    run(&mut editor, [lock(units(&["dome"]), true)]);
    assert_eq!(refused(&mut editor, merge(&["sac", "dome"], "")), EditError::Locked("dome".into()));
    // Its Gaussians are in another unit too.
    assert_eq!(refused(&mut editor, merge(&["sac", "neck"], "")), EditError::Locked("dome".into()));
    run(&mut editor, [lock(units(&["dome"]), false), merge(&["sac", "dome"], "Dome")]);
    assert_eq!(names(&editor), ["Dome", "neck"]);
}
