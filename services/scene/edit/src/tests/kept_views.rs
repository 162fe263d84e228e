//! Viewpoints that are kept under names.

use sg_proto::bus::Code;
use sg_proto::limits::MAX_KEPT_VIEWS;
use sg_proto::scene::command::Action;
use sg_proto::scene::set_view::Change;
use sg_proto::scene::{ForgetView, KeepView, Orbit, Reset, SetView, Undo};

use super::{EditState, Editor, command, editor};

fn keep(name: &str) -> Action {
    Action::KeepView(KeepView { name: name.to_owned() })
}

fn forget(name: &str) -> Action {
    Action::ForgetView(ForgetView { name: name.to_owned() })
}

fn go_to(name: &str) -> Action {
    Action::SetView(SetView { change: Some(Change::Kept(name.to_owned())) })
}

fn turn() -> Action {
    Action::SetView(SetView { change: Some(Change::Orbit(Orbit { azimuth_degrees: 30.0, elevation_degrees: 5.0 })) })
}

fn done(editor: &mut Editor, action: Action) -> String {
    let mut command = command(action);
    command.id = format!("test {}", editor.state().revision());
    editor.apply(&command).unwrap().result.summary
}

fn names(editor: &Editor) -> Vec<&str> {
    editor.state().kept_views().iter().map(|kept| kept.name.as_str()).collect()
}

#[test]
fn a_kept_view_leads_back() {
    let mut editor = editor();
    let first = editor.state().view();
    assert_eq!(done(&mut editor, keep(" entry ")), "kept the view as “entry”");
    done(&mut editor, turn());
    let turned = editor.state().view();
    assert_ne!(turned, first);
    assert_eq!(done(&mut editor, keep("")), "kept the view as “view 1”");
    assert_eq!(done(&mut editor, go_to("Entry")), "went to the view “entry”");
    assert_eq!(editor.state().view(), first);
    done(&mut editor, go_to("view 1"));
    assert_eq!(editor.state().view(), turned);
    assert_eq!(names(&editor), ["entry", "view 1"]);
    // The appearance is the file's again, and what somebody has kept stays.
    done(&mut editor, Action::Reset(Reset {}));
    assert_eq!(names(&editor), ["entry", "view 1"]);
}

#[test]
fn the_same_name_in_other_capitals_is_the_same_view() {
    let mut editor = editor();
    done(&mut editor, keep("entry"));
    done(&mut editor, turn());
    assert_eq!(done(&mut editor, keep("Entry")), "replaced the view “Entry”");
    let kept = editor.state().kept_views();
    assert_eq!((kept.len(), kept[0].name.as_str(), kept[0].view), (1, "Entry", editor.state().view()));
    done(&mut editor, Action::Undo(Undo { steps: 1 }));
    assert_eq!(names(&editor), ["entry"]);
    assert_ne!(editor.state().kept_views()[0].view, editor.state().view());
}

#[test]
fn names_that_are_chosen_here_are_free() {
    let mut editor = editor();
    done(&mut editor, keep("View 2"));
    for expected in ["view 1", "view 3", "view 4"] {
        assert_eq!(done(&mut editor, keep("")), format!("kept the view as “{expected}”"));
    }
    assert_eq!(done(&mut editor, forget("view 1")), "forgot the view “view 1”");
    assert_eq!(done(&mut editor, keep("")), "kept the view as “view 1”");
}

#[test]
fn unknown_names_are_refused_with_those_that_there_are() {
    let mut editor = editor();
    let error = editor.apply(&command(go_to("entry"))).unwrap_err();
    assert_eq!(
        (error.code(), error.to_string().as_str()),
        (Code::NotFound, "no view is kept as `entry`; keep one first")
    );
    done(&mut editor, keep("front left"));
    let error = editor.apply(&command(forget("entry"))).unwrap_err();
    assert_eq!(error.to_string(), "no view is kept as `entry`; there are `front left`");
    assert_eq!(error.details(), ["front left"]);
    let error = editor.apply(&command(keep("a\nb"))).unwrap_err();
    assert_eq!(error.code(), Code::InvalidArgument);
}

#[test]
fn the_number_of_kept_views_is_bounded() {
    let mut editor = editor();
    for _ in 0..MAX_KEPT_VIEWS {
        done(&mut editor, keep(""));
    }
    let error = editor.apply(&command(keep(""))).unwrap_err();
    assert_eq!(error.to_string(), "there would be more than 64 kept views; forget one first");
    assert_eq!(done(&mut editor, keep("view 7")), "replaced the view “view 7”");
    let snapshot = editor.state().state(true);
    assert_eq!(EditState::from_snapshot(&snapshot).unwrap().kept_views(), editor.state().kept_views());
}
