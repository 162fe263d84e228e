//! The journal under restarts, full disks, wrong files and damage.

use std::path::Path;
use std::sync::Arc;

use sg_proto::bus::Code;
use sg_proto::replica::Replica as _;
use sg_proto::scene::command::Action;
use sg_proto::scene::{ChangesRequest, Color, Command, Redo, SaveUnit, Select, SetBackground, SetColor, Target, Undo};

use super::{CHECKPOINT_EVERY, JournalError};
use crate::project::{Project, ProjectError};
use sg_edit::{EditState, Replica, ReplicaError};
use sg_scene::model::Scene;
use sg_scene::synthetic::test_scene;

fn scene() -> Arc<Scene> {
    Arc::new(test_scene(&[("bone", 700), ("skin", 300)]))
}

fn open(path: &Path) -> Project {
    Project::open(path, scene(), "scene.toml").unwrap()
}

fn background(n: u32) -> Command {
    let color = Some(Color { red: (n % 256) as f32 / 255.0, green: 0.5, blue: 0.25 });
    let action = Some(Action::SetBackground(SetBackground { color }));
    Command { id: format!("command-{n}"), expected_revision: 0, action }
}

fn act(id: &str, action: Action) -> Command {
    Command { id: id.to_owned(), expected_revision: 0, action: Some(action) }
}

fn select(id: &str, unit: &str) -> Command {
    let target = Some(Target { units: vec![unit.to_owned()], ..Target::default() });
    act(id, Action::Select(Select { target, operation: 0 }))
}

#[test]
fn a_restart_keeps_scene_history_and_ids() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    let mut project = open(&path);
    let target = Some(Target { selection: true, ..Target::default() });
    let red = Some(Color { red: 1.0, green: 0.0, blue: 0.0 });
    let commands = [
        select("one", "skin"),
        act("two", Action::SaveUnit(SaveUnit { name: "mine".into(), replace: false })),
        act("three", Action::SetColor(SetColor { target, color: red })),
        act("four", Action::Undo(Undo { steps: 1 })),
    ];
    let results: Vec<_> = commands.iter().map(|c| project.apply(c).unwrap().result).collect();
    let before = project.editor().message(true);
    drop(project);

    let mut project = open(&path);
    assert_eq!(project.editor().message(true), before);
    for (command, result) in commands.iter().zip(&results) {
        let again = project.apply(command).unwrap();
        assert!(again.event.is_none() && again.result.repeated);
        assert_eq!((&again.result.summary, again.result.revision), (&result.summary, result.revision));
    }
    assert_eq!(project.editor().message(true), before, "a repeated command changes nothing");
    assert_eq!(project.last_event().unwrap().map(|e| e.revision), Some(4));
    // Redo works across a restart, and ids continue.
    project.apply(&act("five", Action::Redo(Redo { steps: 1 }))).unwrap();
    assert_eq!(
        project.editor().state().units().map(|u| (u.id, u.derived)).collect::<Vec<_>>(),
        [(1, false), (2, true)]
    );
    assert_eq!(project.editor().state().revision(), 5);
}

#[test]
fn a_long_history_starts_from_a_checkpoint_and_is_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    let mut project = open(&path);
    let n = 3 * u32::try_from(CHECKPOINT_EVERY).unwrap() + 10;
    for i in 0..n {
        let command = match i % 5 {
            0 => select(&format!("select-{i}"), if i % 2 == 0 { "bone" } else { "skin" }),
            3 => act(&format!("undo-{i}"), Action::Undo(Undo { steps: 2 })),
            _ => background(i),
        };
        project.apply(&command).unwrap();
        project.checkpoint_if_due().unwrap();
    }
    let before = project.editor().clone();
    let snapshots: i64 =
        project.journal().connection.query_row("SELECT count(*) FROM snapshots", [], |r| r.get(0)).unwrap();
    assert_eq!(snapshots, 2, "the first and the newest");
    drop(project);
    let mut project = open(&path);
    assert_eq!(project.editor().message(true), before.message(true));
    assert_eq!(project.editor().history(), before.history());
    // All the way back, and the first look.
    while project
        .apply(&act(&format!("back-{}", project.editor().state().revision()), Action::Undo(Undo { steps: 9 })))
        .is_ok()
    {}
    assert_eq!(project.editor().state().background(), project.editor().initial().background());
}

#[test]
fn readers_get_events_or_a_snapshot() {
    let folder = tempfile::tempdir().unwrap();
    let mut project = open(&folder.path().join("a.sgproj"));
    let start = project.editor().state().clone();
    for i in 0..300 {
        project.apply(&background(i)).unwrap();
    }
    let changes = |from, snapshot| project.changes(&ChangesRequest { from, snapshot }).unwrap();
    let near = changes(290, false);
    assert_eq!((near.events.len(), near.revision, near.snapshot.is_none()), (10, 300, true));
    assert_eq!(changes(300, false).events.len(), 0);
    assert_eq!(changes(900, false).revision, 300, "a reader from another life sees that");
    let far = changes(1, false);
    assert!(far.events.is_empty() && far.snapshot.is_some());
    let mut replica = Replica::new(start);
    assert_eq!(replica.apply(&near.events[0]), Err(ReplicaError::Gap { have: 0, got: 291 }));
    let replica = Replica::from_snapshot(&changes(0, true).snapshot.unwrap()).unwrap();
    assert_eq!(&**replica.state(), project.editor().state());
}

#[test]
fn a_full_disk_refuses_and_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    let mut project = open(&path);
    project.apply(&background(0)).unwrap();
    project.journal().limit_growth(16 << 10);
    let before;
    let mut n = 1;
    loop {
        let state = project.editor().message(true);
        match project.apply(&background(n)) {
            Ok(_) => n += 1,
            Err(error) => {
                assert_eq!(error.code(), Code::ResourceExhausted, "{error}");
                assert!(matches!(error, ProjectError::Journal(JournalError::Full { .. })));
                assert_eq!(project.editor().message(true), state, "a command that was not kept changed something");
                before = state;
                break;
            }
        }
        assert!(n < 10_000);
    }
    // With room again the same id is carried out.
    project.journal().limit_growth(1 << 20);
    assert!(!project.apply(&background(n)).unwrap().result.repeated);
    let after = project.editor().message(true);
    assert_eq!(after.revision, before.revision + 1);
    drop(project);
    assert_eq!(open(&path).editor().message(true), after);
}

#[test]
fn files_that_are_no_project_of_this_scene_are_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    let mut project = open(&path);
    project.apply(&background(1)).unwrap();
    let locked = Project::open(&path, scene(), "").unwrap_err();
    assert!(matches!(locked, JournalError::InUse { .. }), "{locked}");
    drop(project);

    let refused = |path: &Path, scene: Arc<Scene>| {
        let before = std::fs::read(path).unwrap();
        let error = Project::open(path, scene, "").unwrap_err();
        assert_eq!(std::fs::read(path).unwrap(), before, "{error}");
        assert!(error.is_input() && !error.to_string().contains('\n'), "{error}");
        error
    };
    let other = refused(&path, Arc::new(test_scene(&[("bone", 701), ("skin", 300)])));
    assert!(matches!(other, JournalError::OtherScene { .. }), "{other}");
    let renamed = refused(&path, Arc::new(test_scene(&[("bone", 700), ("fat", 300)])));
    assert!(renamed.to_string().contains("names"), "{renamed}");

    let text = folder.path().join("text.sgproj");
    std::fs::write(&text, "these are notes, not a project, and somebody may want to keep them\n".repeat(50)).unwrap();
    assert!(matches!(refused(&text, scene()), JournalError::NotAProject { .. }));

    let foreign = folder.path().join("foreign.db");
    rusqlite::Connection::open(&foreign).unwrap().execute_batch("CREATE TABLE mine (x)").unwrap();
    assert!(matches!(refused(&foreign, scene()), JournalError::NotAProject { .. }));

    let newer = folder.path().join("newer.sgproj");
    std::fs::copy(&path, &newer).unwrap();
    rusqlite::Connection::open(&newer).unwrap().pragma_update(None, "user_version", 7).unwrap();
    assert!(matches!(refused(&newer, scene()), JournalError::Newer { found: 7, .. }));

    for missing in [folder.path().join("none/a.sgproj"), folder.path().to_path_buf()] {
        let error = Project::open(&missing, scene(), "").unwrap_err();
        assert!(error.is_input(), "{error}");
    }
}

#[test]
fn damage_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    let mut project = open(&path);
    for i in 0..40 {
        project.apply(&background(i)).unwrap();
    }
    drop(project);
    let good = std::fs::read(&path).unwrap();
    let torn = folder.path().join("torn.sgproj");
    let reopened = |bytes: &[u8]| {
        std::fs::write(&torn, bytes).unwrap();
        let _ = std::fs::remove_file(folder.path().join("torn.sgproj-wal"));
        Project::open(&torn, scene(), "").map(|p| p.editor().state().revision())
    };
    assert_eq!(reopened(&good).unwrap(), 40);
    // Cut off at any page, or in the middle of one.
    for keep in [good.len() / 2, good.len() - 4096, 5000, 4096, 100] {
        let error = reopened(&good[..keep]).unwrap_err();
        assert!(error.is_input(), "{keep}: {error}");
    }
    // A bit that flips inside a command's summary leaves the tables whole; the checksum detects it.
    let line = b"set the background to (0";
    let mut flipped = good.clone();
    for place in (0..good.len() - line.len()).filter(|&i| good[i..].starts_with(line)) {
        flipped[place] ^= 1;
    }
    let error = reopened(&flipped).unwrap_err();
    assert!(matches!(error, JournalError::Damaged { .. }) && error.to_string().contains("checksum"), "{error}");
    // A missing row.
    std::fs::write(&torn, &good).unwrap();
    rusqlite::Connection::open(&torn).unwrap().execute("DELETE FROM commands WHERE revision = 20", []).unwrap();
    let error = Project::open(&torn, scene(), "").unwrap_err();
    assert!(error.to_string().contains("revision 20 is missing"), "{error}");
}

#[test]
fn an_empty_file_becomes_a_project_and_the_path_of_the_scene_may_change() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    std::fs::write(&path, "").unwrap();
    open(&path).apply(&background(1)).unwrap();
    let moved = Project::open(&path, scene(), "elsewhere.toml").unwrap();
    let state: &EditState = moved.editor().state();
    assert_eq!((state.geometry().path.as_str(), state.revision()), ("elsewhere.toml", 1));
}
