//! The journal under restarts, full disks, wrong files and damage.

use std::path::Path;
use std::sync::Arc;

use sg_proto::bus::Code;
use sg_proto::replica::Replica as _;
use sg_proto::scene::adjust_transfer_function::Change;
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    AdjustTransferFunction, ChangesRequest, Color, Command, DeleteGaussians, DuplicateGaussians, Redo,
    RestoreGaussians, SaveUnit, Select, SetBackground, SetColor, Target, TransformGaussians, Undo, ValueWindow, Vector,
};

use super::retention::{RECENT_CHANGES, RESULTS_KEPT};
use super::{CHECKPOINT_EVERY, JournalError, copy, describe, is_in_use};
use crate::project::{Project, ProjectError};
use sg_edit::{EditError, EditState, Replica, ReplicaError};
use sg_reclassify::sources::{Source, store};
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

    // A copy has another journal mode, and its refusal leaves that too.
    let backup = folder.path().join("backup.sgproj");
    copy(&path, &backup).unwrap();
    refused(&backup, Arc::new(test_scene(&[("bone", 701), ("skin", 300)])));

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
    // A bit that flips inside a row leaves the tables whole; the checksum detects it.
    let flip = |table: &str, column: &str| {
        std::fs::write(&torn, &good).unwrap();
        let connection = rusqlite::Connection::open(&torn).unwrap();
        let select = format!("SELECT {column} FROM {table} WHERE revision = 20");
        let mut blob: Vec<u8> = connection.query_row(&select, [], |row| row.get(0)).unwrap();
        *blob.last_mut().unwrap() ^= 1;
        let update = format!("UPDATE {table} SET {column} = ?1 WHERE revision = 20");
        connection.execute(&update, [blob]).unwrap();
    };
    flip("changes", "change");
    let error = Project::open(&torn, scene(), "").unwrap_err();
    assert!(matches!(error, JournalError::Damaged { .. }) && error.to_string().contains("checksum"), "{error}");
    for column in ["digest", "result"] {
        flip("results", column);
        let error = Project::open(&torn, scene(), "").unwrap().apply(&background(19)).unwrap_err();
        assert!(error.code() == Code::DataLoss && error.to_string().contains("checksum"), "{error}");
    }
    // A missing row.
    std::fs::write(&torn, &good).unwrap();
    rusqlite::Connection::open(&torn).unwrap().execute("DELETE FROM changes WHERE revision = 20", []).unwrap();
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
    assert_eq!(describe(&path).unwrap().scene, Path::new("elsewhere.toml"));
}

#[test]
fn an_id_with_another_command_is_refused_and_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    let mut project = open(&path);
    let first = project.apply(&background(1)).unwrap().result;
    for _ in 0..2 {
        let before = project.editor().message(true);
        let later = Command { expected_revision: 1, ..background(1) };
        for other in [Command { id: background(1).id, ..background(2) }, select("command-1", "skin"), later] {
            let error = project.apply(&other).unwrap_err();
            assert!(matches!(&error, ProjectError::Edit(EditError::IdTaken(id)) if id == "command-1"), "{error}");
            assert_eq!((error.code(), error.details()), (Code::AlreadyExists, vec!["command-1".to_owned()]));
        }
        assert_eq!(project.editor().message(true), before);
        // The same command, and a question for the result, are answered as before.
        for again in [background(1), Command { id: background(1).id, ..Command::default() }] {
            let outcome = project.apply(&again).unwrap();
            assert!(outcome.event.is_none() && outcome.result.repeated);
            assert_eq!((outcome.result.revision, &outcome.result.summary), (first.revision, &first.summary));
        }
        drop(project);
        project = open(&path);
    }
    // A refused command has not taken its id.
    assert!(project.apply(&select("free", "hair")).is_err());
    assert!(!project.apply(&select("free", "skin")).unwrap().result.repeated);
}

fn rows(project: &Project, table: &str) -> u64 {
    let sql = format!("SELECT count(*) FROM {table}");
    project.journal().connection.query_row(&sql, [], |row| row.get::<_, i64>(0)).unwrap().unsigned_abs()
}

#[test]
fn the_size_does_not_grow_with_the_number_of_commands() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    let mut project = open(&path);
    // Without undo entries, so that only readers and repeated ids need rows.
    project.apply(&background(0)).unwrap();
    let mut sizes = Vec::new();
    let n = u32::try_from(RESULTS_KEPT).unwrap() + 2500;
    project.journal().connection.pragma_update(None, "synchronous", "OFF").unwrap();
    for i in 1..=n {
        let same = Command { id: format!("command-{i}"), ..background(0) };
        project.apply(&same).unwrap();
        project.checkpoint_if_due().unwrap();
        if i > n - 2000 && i % 500 == 0 {
            sizes.push(std::fs::metadata(&path).unwrap().len());
        }
    }
    assert!(rows(&project, "changes") <= RECENT_CHANGES + CHECKPOINT_EVERY + 1, "{}", rows(&project, "changes"));
    assert!(rows(&project, "results") <= RESULTS_KEPT + CHECKPOINT_EVERY, "{}", rows(&project, "results"));
    assert!(sizes.iter().all(|size| *size <= sizes[0] + (256 << 10)), "{sizes:?}");
    // The oldest ids are forgotten, as documented; the others are not.
    let kept = Command { id: format!("command-{}", n - u32::try_from(RESULTS_KEPT).unwrap() + 1), ..background(0) };
    assert!(project.apply(&kept).unwrap().result.repeated);
    assert!(project.apply(&Command { id: "command-1".to_owned(), ..Command::default() }).is_err());
    let before = project.editor().clone();
    drop(project);
    let project = open(&path);
    assert_eq!((project.editor().message(true), project.editor().history()), (before.message(true), before.history()));
}

#[test]
fn undo_reaches_as_far_after_a_checkpoint_and_readers_get_the_whole_state() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    let mut project = open(&path);
    for i in 0..1500 {
        project.apply(&background(i)).unwrap();
        project.checkpoint_if_due().unwrap();
    }
    project.checkpoint().unwrap();
    assert!(rows(&project, "changes") <= 1000, "{}", rows(&project, "changes"));
    // Revisions in the middle belong to undo, but the ones after them need not all be there.
    project.apply(&act("back", Action::Undo(Undo { steps: 900 }))).unwrap();
    project.apply(&select("forward", "skin")).unwrap();
    project.checkpoint().unwrap();
    let changes = |from| project.changes(&ChangesRequest { from, snapshot: false }).unwrap();
    for from in [0, 400, 550, 700, 1000] {
        let far = changes(from);
        assert!(far.events.is_empty() && far.snapshot.is_some_and(|s| s.revision == 1502), "{from}");
    }
    assert_eq!(changes(1500).events.len(), 2);
    let before = project.editor().clone();
    drop(project);
    let mut project = open(&path);
    assert_eq!(project.editor().history(), before.history());
    project.apply(&act("all", Action::Undo(Undo { steps: 1000 }))).unwrap();
    assert_eq!(project.editor().history().undoable(1).count(), 0);
}

#[test]
fn pages_of_a_long_history_are_given_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    let scene = Arc::new(test_scene(&[("bone", 200_000)]));
    let mut project = Project::open(&path, Arc::clone(&scene), "").unwrap();
    let mut bits = 1_u64;
    for i in 0..200 {
        let mask = sg_scene::mask::Mask::from_fn(scene.len(), |_| {
            bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            bits >> 63 == 1
        });
        let mask = Some(sg_edit::wire::encode_mask(&mask));
        let commit = sg_proto::scene::CommitSelection { mask, ..Default::default() };
        project.apply(&act(&format!("stroke-{i}"), Action::CommitSelection(commit))).unwrap();
        project.checkpoint_if_due().unwrap();
    }
    project.checkpoint().unwrap();
    let long = std::fs::metadata(&path).unwrap().len();
    assert!(long > 8 << 20, "{long}");
    project.apply(&act("back", Action::Undo(Undo { steps: 200 }))).unwrap();
    for i in 0..300 {
        project.apply(&background(i)).unwrap();
    }
    project.checkpoint().unwrap();
    drop(project);
    let short = std::fs::metadata(&path).unwrap().len();
    assert!(short < long / 2, "{long} bytes, then {short}");
    Project::open(&path, scene, "").unwrap();
}

/// The scene of the golden project.
fn golden_scene() -> Arc<Scene> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/spiral.ply");
    Arc::new(sg_formats::load(&file, &sg_formats::LoadOptions::default()).unwrap().scene)
}

#[test]
fn a_restart_keeps_what_is_deleted_and_its_way_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    let mut project = open(&path);
    let target = Some(Target { selection: true, ..Target::default() });
    let replica = Replica::from_snapshot(&project.editor().message(true)).unwrap();
    for command in [
        select("one", "skin"),
        act("two", Action::SaveUnit(SaveUnit { name: "mine".into(), replace: false })),
        act("three", Action::DeleteGaussians(DeleteGaussians { target })),
    ] {
        project.apply(&command).unwrap();
    }
    let deleted = project.editor().message(true);
    assert_eq!(project.editor().state().existing_count(), 700);
    drop(project);
    // From single commands.
    let mut project = open(&path);
    assert_eq!(project.editor().message(true), deleted);
    // A reader that was away gets there by the events.
    let missed = project.changes(&ChangesRequest { from: 0, snapshot: false }).unwrap();
    let mut reader = replica;
    missed.events.iter().for_each(|event| reader.apply(event).unwrap());
    assert_eq!(reader.state().as_ref(), project.editor().state());
    // From a checkpoint.
    for n in 0..2 * CHECKPOINT_EVERY as u32 {
        project.apply(&background(n)).unwrap();
    }
    let before = project.editor().message(true);
    drop(project);
    let mut project = open(&path);
    assert_eq!(project.editor().message(true), before);
    assert_eq!(project.editor().state().existing_count(), 700);
    project.apply(&act("four", Action::RestoreGaussians(RestoreGaussians {}))).unwrap();
    let state = project.editor().state();
    let mine = state.units().find(|u| u.name == "mine").map(|u| u.mask.count());
    assert_eq!((state.existing_count(), mine), (1000, Some(300)));
    // Undo reaches the deletion itself.
    let steps = 2 * CHECKPOINT_EVERY as u32 + 2;
    project.apply(&act("five", Action::Undo(Undo { steps }))).unwrap();
    let state = project.editor().state();
    assert_eq!((state.existing_count(), state.selection().mask().count()), (1000, 300));
}

#[test]
fn a_project_of_schema_1_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("old.sgproj");
    // Made by version 0.1.0 with schema 1: 65 commands, a checkpoint at 64.
    let packed = include_bytes!("../../tests/golden/schema-1.sgproj.zst");
    let old = zstd::stream::decode_all(&packed[..]).unwrap();
    std::fs::write(&path, &old).unwrap();
    assert_eq!(describe(&path).unwrap().revision, 65);
    let refused = Project::open(&path, scene(), "").unwrap_err();
    assert!(matches!(refused, JournalError::OtherScene { .. }), "{refused}");
    assert_eq!(std::fs::read(&path).unwrap(), old, "a refused project keeps its schema");

    let mut project = Project::open(&path, golden_scene(), "spiral.ply").unwrap();
    let editor = project.editor();
    assert_eq!(editor.state().revision(), 65);
    assert_eq!(editor.state().base_units()[0].opacity, 0.2);
    assert_eq!(editor.state().units().map(|u| (u.name.as_str(), u.mask.count())).collect::<Vec<_>>(), [("core", 8)]);
    let labels: Vec<_> = editor.history().undoable(9).map(|e| e.label.as_str()).collect();
    assert_eq!(
        (labels[0], labels[1], labels[2]),
        ("set the opacity of spiral to 20 %", "coloured spiral #ffff00", "coloured spiral #0000ff"),
        "{labels:?}"
    );
    assert_eq!(editor.history().redoable(9).map(|e| e.label.as_str()).collect::<Vec<_>>(), ["coloured core #0000ff"]);
    assert_eq!(project.last_event().unwrap().unwrap().summary, "undid: coloured core #0000ff");
    let whole = project.changes(&ChangesRequest { from: 0, snapshot: false }).unwrap();
    assert_eq!(whole.events.len(), 65, "readers find all recent events");
    let size = std::fs::metadata(&path).unwrap().len();
    assert!(size <= old.len() as u64, "{size} bytes instead of {}", old.len());

    // Ids of schema 1 are known with their commands.
    let id = whole.events[0].command_id.clone();
    let target = Some(Target { units: vec!["spiral".to_owned()], ..Target::default() });
    let operation = sg_proto::scene::SetOperation::Replace.into();
    let first = project.apply(&act(&id, Action::Select(Select { target, operation }))).unwrap();
    assert!(first.event.is_none() && first.result.revision == 1, "{first:?}");
    let other = project.apply(&Command { id: id.clone(), ..background(1) }).unwrap_err();
    assert!(matches!(other, ProjectError::Edit(EditError::IdTaken(taken)) if taken == id));

    project.apply(&act("redo", Action::Redo(Redo { steps: 1 }))).unwrap();
    project.checkpoint().unwrap();
    let before = project.editor().clone();
    drop(project);
    let project = Project::open(&path, golden_scene(), "spiral.ply").unwrap();
    assert_eq!((project.editor().message(true), project.editor().history()), (before.message(true), before.history()));
}

#[test]
fn a_damaged_project_of_schema_1_keeps_its_schema() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("old.sgproj");
    let packed = include_bytes!("../../tests/golden/schema-1.sgproj.zst");
    std::fs::write(&path, zstd::stream::decode_all(&packed[..]).unwrap()).unwrap();
    let tear = "UPDATE commands SET event = x'00' WHERE revision = 40";
    rusqlite::Connection::open(&path).unwrap().execute(tear, []).unwrap();
    let error = Project::open(&path, golden_scene(), "").unwrap_err();
    assert!(matches!(error, JournalError::Damaged { .. }) && error.to_string().contains("revision 40"), "{error}");
    let connection = rusqlite::Connection::open(&path).unwrap();
    let schema: i64 = connection.pragma_query_value(None, "user_version", |row| row.get(0)).unwrap();
    let commands: i64 = connection.query_row("SELECT count(*) FROM commands", [], |row| row.get(0)).unwrap();
    assert_eq!((schema, commands), (1, 65));
}

#[test]
fn a_copy_of_an_open_project_is_a_project() {
    let folder = tempfile::tempdir().unwrap();
    let (path, backup) = (folder.path().join("a.sgproj"), folder.path().join("backup.sgproj"));
    let mut project = open(&path);
    for i in 0..100 {
        project.apply(&background(i)).unwrap();
        project.checkpoint_if_due().unwrap();
    }
    assert!(is_in_use(&path));
    copy(&path, &backup).unwrap();
    let then = project.editor().message(true);
    project.apply(&background(100)).unwrap();
    let before = std::fs::read(&backup).unwrap();
    for (from, to) in [(&path, &backup), (&backup, &path)] {
        assert!(matches!(copy(from, to).unwrap_err(), JournalError::Exists { .. }));
    }
    assert_eq!(std::fs::read(&backup).unwrap(), before);
    assert_eq!(open(&backup).editor().message(true), then);
    assert_eq!(project.editor().state().revision(), 101, "the copied project goes on");
    drop(project);
    assert!(!is_in_use(&path));
    assert_eq!(open(&path).editor().state().revision(), 101);

    let text = folder.path().join("text.sgproj");
    std::fs::write(
        &text,
        "notes
"
        .repeat(500),
    )
    .unwrap();
    let none = folder.path().join("none");
    for (from, to) in [(&text, &none), (&none, &folder.path().join("other")), (&path, &none.join("a"))] {
        let error = copy(from, to).unwrap_err();
        assert!(error.is_input() && !to.exists(), "{error}");
    }
    let mut left: Vec<_> =
        std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    left.sort();
    assert_eq!(left, ["a.sgproj", "backup.sgproj", "text.sgproj"]);
}

#[test]
fn a_restart_keeps_what_is_moved() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    let mut project = open(&path);
    let shift = |id: &str, unit: &str, x: f64| {
        let target = Some(Target { units: vec![unit.to_owned()], ..Target::default() });
        let (shift, axis) = (Some(Vector { x, y: 0.5, z: 0.0 }), Some(Vector { x: 1.0, y: x, z: 0.0 }));
        let moved = TransformGaussians { target, shift, axis, degrees: 20.0, ..TransformGaussians::default() };
        act(id, Action::TransformGaussians(moved))
    };
    for command in [shift("one", "skin", 0.1), shift("two", "bone", 0.2), shift("three", "skin", 0.3)] {
        project.apply(&command).unwrap();
    }
    let moved = project.editor().message(true);
    assert_eq!(project.editor().state().placements().len(), 2);
    drop(project);
    // From single commands, then from a checkpoint.
    let mut project = open(&path);
    assert_eq!(project.editor().message(true), moved);
    project.checkpoint().unwrap();
    drop(project);
    let mut project = open(&path);
    assert_eq!(project.editor().message(true), moved);
    project.apply(&act("four", Action::Undo(Undo { steps: 3 }))).unwrap();
    assert!(project.editor().state().placements().is_empty());
    project.apply(&act("five", Action::Redo(Redo { steps: 3 }))).unwrap();
    assert_eq!(project.editor().message(true).placements, moved.placements);
}

#[test]
fn a_restart_keeps_duplicates_and_their_undo() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sgproj");
    let mut project = open(&path);
    let opened = project.editor().message(true);
    let of = |name: &str| Some(Target { units: vec![name.to_owned()], ..Target::default() });
    let duplicate = |id: &str, name: &str| {
        act(id, Action::DuplicateGaussians(DuplicateGaussians { target: of(name), name: String::new() }))
    };
    let shift = Some(Vector { x: 0.5, y: 0.0, z: 0.0 });
    let moved = TransformGaussians { target: of("skin copy"), shift, ..TransformGaussians::default() };
    let delete = DeleteGaussians { target: of("bone") };
    for command in [
        duplicate("one", "skin"),
        act("two", Action::TransformGaussians(moved)),
        duplicate("three", "skin copy"),
        act("four", Action::DeleteGaussians(delete)),
    ] {
        project.apply(&command).unwrap();
    }
    let edited = project.editor().message(true);
    drop(project);
    // From single commands, then from a checkpoint: its history has masks of three lengths.
    let mut project = open(&path);
    assert_eq!(project.editor().message(true), edited);
    project.checkpoint().unwrap();
    drop(project);
    let mut project = open(&path);
    assert_eq!(project.editor().message(true), edited);
    project.apply(&act("five", Action::Undo(Undo { steps: 4 }))).unwrap();
    let undone = project.editor().message(true);
    assert_eq!((undone.count, undone.base_units, undone.duplicates), (opened.count, opened.base_units, None));
    project.checkpoint().unwrap();
    drop(project);
    let mut project = open(&path);
    project.apply(&act("six", Action::Redo(Redo { steps: 4 }))).unwrap();
    let redone = project.editor().message(true);
    assert_eq!((redone.count, &redone.base_units), (edited.count, &edited.base_units));
    assert_eq!((redone.duplicates, redone.placements), (edited.duplicates, edited.placements));
}

/// The function of the scene's file is read anew at each opening; changes of it are kept.
#[test]
fn the_transfer_function_of_the_file_is_where_adjustments_start() {
    let folder = tempfile::tempdir().unwrap();
    let mut units = test_scene(&[("bone", 20)]).units;
    let source = |i: usize| Source { value: 10.0 * i as f64, depth: 1.0, ..Source::default() };
    store(&(0..20).map(source).collect::<Vec<_>>(), &mut units[0].gaussians);
    units[0].values = Some([0.0, 190.0]);
    units[0].transfer_function = Some("tf.json".into());
    let scene = Arc::new(Scene::compose(units, None));
    let place = folder.path().join("scene.toml").display().to_string();
    let function = r#"{"domain":[0,190],"points":[{"value":0,"color":[1,1,1],"opacity":0},{"value":100,"color":[1,1,1],"opacity":1}]}"#;
    std::fs::write(folder.path().join("tf.json"), function).unwrap();
    let path = folder.path().join("p.sgproj");
    let window = ValueWindow { level: Some(150.0), ..ValueWindow::default() };
    let change = Some(Change::Window(window));
    let adjust = |id: &str| act(id, Action::AdjustTransferFunction(AdjustTransferFunction { change }));

    let mut project = Project::open(&path, Arc::clone(&scene), &place).unwrap();
    let volume = project.editor().message(false).volume.unwrap();
    assert_eq!((volume.least, volume.greatest, volume.function.unwrap().points.len()), (0.0, 190.0, 2));
    assert_eq!(project.apply(&adjust("a")).unwrap().result.summary, "level 150, window 100");
    drop(project);

    std::fs::remove_file(folder.path().join("tf.json")).unwrap();
    let mut project = Project::open(&path, scene, &place).unwrap();
    assert!(project.editor().message(false).volume.unwrap().function.is_none());
    assert_eq!(project.editor().state().transfer_function().unwrap().level_and_window(), (150.0, 100.0));
    project.apply(&act("b", Action::Undo(Undo { steps: 1 }))).unwrap();
    let refused = project.apply(&adjust("c")).unwrap_err();
    assert!(refused.to_string().contains("unknown"), "{refused}");
}
