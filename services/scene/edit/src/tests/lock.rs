//! A lock binds.

use sg_proto::scene::{DeleteUnit, RenameUnit, Reset, Select, SetOperation, Undo};

use super::*;

fn select(target: Target, operation: SetOperation) -> Action {
    Action::Select(Select { target: Some(target), operation: operation.into() })
}

fn selected(editor: &Editor) -> Vec<usize> {
    editor.state().selection().mask().ones().collect()
}

/// `sac` has 10..30 and is locked.
fn locked() -> Editor {
    let mut editor = editor();
    run(&mut editor, [commit(|i| (10..30).contains(&i)), save("sac"), lock(units(&["sac"]), true)]);
    editor
}

#[test]
fn nothing_changes_what_is_locked_and_each_refusal_names_it() {
    let mut editor = locked();
    let rename = Action::RenameUnit(RenameUnit { name: "sac".into(), new_name: "dome".into() });
    let sac = || units(&["sac"]);
    for action in [
        color(sac(), RED),
        color(everything(), RED),
        color(units(&["skin"]), RED),
        opacity(sac(), 0.5),
        opacity(all_but(&["Vessel"]), 0.5),
        visible(sac(), false),
        visible(all_but(&["Vessel"]), false),
        delete(sac()),
        delete(units(&["bone"])),
        delete(everything()),
        select(sac(), SetOperation::Replace),
        select(sac(), SetOperation::Add),
        rename,
        Action::DeleteUnit(DeleteUnit { name: "sac".into() }),
    ] {
        let refusal = refused(&mut editor, action.clone());
        assert_eq!(refusal, EditError::Locked("sac".to_owned()), "{action:?}");
    }
    assert_eq!(refused(&mut editor, delete(sac())).to_string(), "`sac` is locked; unlock it first");
    run(&mut editor, [commit(|i| i < 5)]);
    let replace = Action::SaveUnit(SaveUnit { name: "sac".into(), replace: true });
    assert_eq!(refused(&mut editor, replace), EditError::Locked("sac".to_owned()));
    // What has nothing of it can be changed, and it can be seen alone.
    run(&mut editor, [color(units(&["Vessel"]), RED), only(units(&["Vessel"])), visible(everything(), true)]);
    run(&mut editor, [lock(units(&["sac"]), false), delete(units(&["sac"]))]);
    assert_eq!(editor.state().existing_count(), 40);
}

#[test]
fn nothing_locked_is_selected() {
    let mut editor = locked();
    assert_eq!(selected(&editor), [0; 0], "the lock takes its Gaussians out of the selection");
    run(&mut editor, [commit(|i| (5..35).contains(&i))]);
    assert_eq!(selected(&editor), (5..10).chain(30..35).collect::<Vec<_>>());
    run(&mut editor, [select(everything(), SetOperation::Replace)]);
    assert_eq!(selected(&editor), (0..10).chain(30..60).collect::<Vec<_>>());
    run(&mut editor, [select(units(&["bone"]), SetOperation::Replace)]);
    assert_eq!(selected(&editor), (0..10).collect::<Vec<_>>());
    run(&mut editor, [delete(selection())]);
    assert_eq!(editor.state().existing_count(), 50);
}

#[test]
fn a_lock_is_a_change_like_any_other() {
    let mut editor = locked();
    let sac = editor.state().find("sac").unwrap();
    assert_eq!(editor.message(false).undo[0], "locked sac");
    assert!(editor.state().is_locked(sac) && editor.message(false).units[0].locked);
    run(&mut editor, [Action::Undo(Undo { steps: 1 })]);
    assert!(!editor.state().is_locked(sac));
    assert_eq!(selected(&editor), (10..30).collect::<Vec<_>>());
    run(&mut editor, [color(units(&["sac"]), RED), lock(everything(), true), Action::Reset(Reset {})]);
    assert_eq!(drawn(editor.state(), 15).color, Some(crate::wire::decode_color(&RED)), "a locked look is not reset");
    assert!(editor.state().base_units().iter().all(|base| base.locked));
    run(&mut editor, [lock(everything(), false), Action::Reset(Reset {})]);
    assert_eq!(drawn(editor.state(), 15).color, None);
    assert!(matches!(refused(&mut editor, lock(all_but(&["sac"]), true)), EditError::Malformed { .. }));
    assert_eq!(refused(&mut editor, Action::SetLock(SetLock { target: None, locked: true })), EditError::NoTarget);
}
