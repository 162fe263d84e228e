//! The process that owns a session's scene, on a real bus.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

#[path = "serve/random_clients.rs"]
mod random_clients;
mod support;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command as Process, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use sg_edit::{EditState, Replica};
use sg_proto::bus::{Code, StatusRequest};
use sg_proto::keys::{self, role};
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    ChangesRequest, Color, Command, CommandResult, SaveUnit, Select, SetBackground, SetColor, Target,
};
use sg_runtime::bus::{Bus, endpoint_of};
use sg_runtime::context::Context;
use sg_runtime::scene_replica::SceneReplica;
use supergaussian_scene::project::Project;
use tokio::sync::Mutex;

struct Stack {
    folder: tempfile::TempDir,
    router: Bus,
    instance: u32,
}

/// A scene process; killed when the test ends, however it ends.
struct Scene(Child);

impl Drop for Scene {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Stack {
    async fn open(gaussians: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        support::write_ply(&folder.path().join("spiral.ply"), gaussians);
        let router = Bus::open_router("test", role::SUPERVISOR, &folder.path().join("bus.sock"), None).await.unwrap();
        Self { folder, router, instance: 0 }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn process(&self, params: &str) -> Process {
        let mut process = Process::new(env!("CARGO_BIN_EXE_supergaussian-scene"));
        process
            .args(["serve", "--session", "test", "--role", role::SCENE])
            .args(["--instance", &format!("scene-{}", self.instance)])
            .args(["--connect", &endpoint_of(&self.path("bus.sock"))])
            .arg("--run-dir")
            .arg(self.folder.path())
            .args(["--params", params])
            .env("XDG_DATA_HOME", self.folder.path().join("data"))
            .stderr(Stdio::piped());
        process
    }

    /// Starts a scene process; it may take a moment until it serves.
    fn start(&mut self) -> Scene {
        self.start_with("spiral.ply")
    }

    /// As [`Stack::start`], with another scene of the stack's folder.
    fn start_with(&mut self, scene: &str) -> Scene {
        self.instance += 1;
        let params = format!(r#"{{"scene": "{}"}}"#, self.path(scene).display());
        Scene(self.process(&params).stderr(Stdio::null()).spawn().unwrap())
    }

    /// The projects that no launch file names.
    fn projects(&self) -> Vec<PathBuf> {
        let folder = self.path("data/supergaussian/projects");
        let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.retain(|file| file.extension().is_some_and(|e| e == "sgproj"));
        files.sort();
        files
    }

    async fn join(&self, role: &str) -> Bus {
        Bus::connect("test", role, &endpoint_of(&self.path("bus.sock"))).await.unwrap()
    }

    /// Exit status and last line of a process that does not come to serve.
    fn failed(&self, params: &str) -> (i32, String) {
        let output = self.process(params).output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        let errors: Vec<_> = text.lines().filter(|line| line.contains("\"ERROR\"")).collect();
        assert_eq!(errors.len(), 1, "{text}");
        (output.status.code().unwrap(), errors[0].to_owned())
    }
}

fn soon() -> Context {
    Context::root().deadline_in(Duration::from_secs(20))
}

fn everything() -> Option<Target> {
    Some(Target { everything: true, ..Target::default() })
}

fn command(id: &str, action: Action) -> Command {
    Command { id: id.to_owned(), expected_revision: 0, action: Some(action) }
}

fn background(id: &str, red: f32) -> Command {
    let color = Some(Color { red, green: 0.0, blue: 0.0 });
    command(id, Action::SetBackground(SetBackground { color }))
}

async fn snapshot(bus: &Bus) -> sg_proto::scene::State {
    let request = ChangesRequest { from: 0, snapshot: true };
    bus.ask(&keys::SCENE_CHANGES, &request, &soon()).await.unwrap().snapshot.unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_command_is_answered_published_and_retained_with_its_chain() {
    let mut stack = Stack::open(500).await;
    let cli = stack.join(role::CLI).await;
    let mut events = cli.subscribe(&keys::SCENE_EVENT, role::SCENE, 64).await.unwrap();
    let _scene = stack.start();

    let select = command("select", Action::Select(Select { target: everything(), operation: 0 }));
    let result = cli.ask(&keys::SCENE_APPLY, &select, &soon()).await.unwrap();
    assert_eq!((result.revision, result.repeated), (1, false));
    let save = command("save", Action::SaveUnit(SaveUnit { name: "all".into(), replace: false }));
    cli.ask(&keys::SCENE_APPLY, &save, &soon().at_step("talk", 3)).await.unwrap();
    let (first, _) = events.next().await.unwrap();
    let (second, context) = events.next().await.unwrap();
    assert_eq!((first.command_id.as_str(), second.command_id.as_str()), ("select", "save"));
    assert_eq!((context.conversation.as_str(), context.step, context.sender.as_str()), ("talk", 3, role::SCENE));

    let state = cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap();
    assert_eq!((state.revision, state.units.len(), state.count), (2, 1, 500));
    assert!(state.units[0].mask.is_none() && state.selection.unwrap().mask.is_none(), "an outline carries no masks");
    assert_eq!((state.undo.len(), state.focus), (2, vec!["all".to_owned()]));
    assert!(Path::new(&state.scene_path).is_absolute());
    assert_eq!(EditState::from_snapshot(&snapshot(&cli).await).unwrap().units().count(), 1);

    let unknown = Some(Target { units: vec!["al".into()], ..Target::default() });
    let red = Some(Color { red: 1.0, green: 0.0, blue: 0.0 });
    let refused = command("refused", Action::SetColor(SetColor { target: unknown, color: red }));
    let fault = cli.ask(&keys::SCENE_APPLY, &refused, &soon()).await.unwrap_err();
    assert_eq!((fault.code, fault.details), (Code::NotFound, vec!["all".to_owned()]));
    let question = Command { id: "select".to_owned(), ..Command::default() };
    for again in [&select, &question] {
        let again = cli.ask(&keys::SCENE_APPLY, again, &soon()).await.unwrap();
        assert_eq!(again, CommandResult { repeated: true, ..result.clone() });
    }
    let fault = cli.ask(&keys::SCENE_APPLY, &background("select", 0.5), &soon()).await.unwrap_err();
    assert_eq!((fault.code, fault.details), (Code::AlreadyExists, vec!["select".to_owned()]));
    assert!(fault.message.contains("`select` belongs to another command"), "{}", fault.message);

    let health = cli.ask_role(&keys::STATUS, role::SCENE, &StatusRequest {}, &soon()).await.unwrap();
    assert_eq!(health.actors[0].state, "revision 2, 1 editable units, 500 Gaussians selected");
}

/// Sets how long the files that a process writes may get.
fn limit_files(scene: &Scene, bytes: Option<u64>) {
    use rustix::process::{Pid, Resource, Rlimit, getrlimit, prlimit};
    let maximum = getrlimit(Resource::Fsize).maximum;
    let pid = Pid::from_raw(i32::try_from(scene.0.id()).unwrap());
    prlimit(pid, Resource::Fsize, Rlimit { current: bytes.or(maximum), maximum }).unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_full_disk_refuses_a_command_and_a_retry_with_space_is_kept() {
    let mut stack = Stack::open(500).await;
    let cli = stack.join(role::CLI).await;
    let mut scene = stack.start();
    cli.ask(&keys::SCENE_APPLY, &background("first", 0.1), &soon()).await.unwrap();
    let before = snapshot(&cli).await;

    limit_files(&scene, Some(0));
    for _ in 0..3 {
        let fault = cli.ask(&keys::SCENE_APPLY, &background("second", 0.2), &soon()).await.unwrap_err();
        assert_eq!(fault.code, Code::ResourceExhausted, "{fault}");
        assert!(fault.message.contains("full") && fault.message.contains("make room"), "{fault}");
    }
    assert_eq!(snapshot(&cli).await, before, "a command that was not kept changed something");
    limit_files(&scene, None);
    let result = cli.ask(&keys::SCENE_APPLY, &background("second", 0.2), &soon()).await.unwrap();
    assert_eq!((result.revision, result.repeated), (2, false));
    assert!(scene.0.try_wait().unwrap().is_none(), "the process lives on");

    let after = snapshot(&cli).await;
    drop(scene);
    let _scene = stack.start();
    assert_eq!(snapshot(&cli).await, after);
}

fn of_burst(id: &str, n: u32) -> Command {
    if n.is_multiple_of(3) {
        return command(id, Action::Select(Select { target: everything(), operation: 0 }));
    }
    background(id, (n % 100) as f32 / 100.0)
}

/// Sends commands one after another, each until it is acknowledged, and writes the results down.
async fn burst(bus: Bus, worker: u32, done: Arc<AtomicBool>, results: Arc<Mutex<BTreeMap<String, CommandResult>>>) {
    let mut n = 0_u32;
    while !done.load(Ordering::Relaxed) {
        let id = format!("{worker}-{n}");
        let command = of_burst(&id, n);
        match bus.ask(&keys::SCENE_APPLY, &command, &soon()).await {
            Ok(result) => {
                results.lock().await.insert(id, result);
                n += 1;
            }
            // Killed with the question in hand, or its queue was full: the same id again.
            Err(fault) => assert!(
                matches!(fault.code, Code::Unavailable | Code::DeadlineExceeded | Code::ResourceExhausted),
                "{fault:?}"
            ),
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_burst_survives_kill_9_and_readers_catch_up() {
    let mut stack = Stack::open(3000).await;
    let cli = stack.join(role::CLI).await;
    let mut scene = stack.start();
    let reader = SceneReplica::<Replica>::follow(&cli).await.unwrap();

    let results = Arc::new(Mutex::new(BTreeMap::new()));
    let done = Arc::new(AtomicBool::new(false));
    let workers: Vec<_> =
        (0..4).map(|w| tokio::spawn(burst(cli.clone(), w, Arc::clone(&done), Arc::clone(&results)))).collect();
    for round in 1..=3 {
        // In the middle of the burst, when this round has had some answers.
        let limit = Instant::now() + Duration::from_secs(20);
        let before = results.lock().await.len();
        while results.lock().await.len() < before + 25 {
            assert!(Instant::now() < limit, "round {round}: no progress");
            tokio::time::sleep(Duration::from_millis(3)).await;
        }
        drop(scene);
        scene = stack.start();
    }
    tokio::time::sleep(Duration::from_millis(300)).await;
    done.store(true, Ordering::Relaxed);
    for worker in workers {
        worker.await.unwrap();
    }

    let results = results.lock().await;
    let newest = snapshot(&cli).await;
    assert_eq!(newest.revision, results.len() as u64, "each acknowledged command once, and no other");
    let mut revisions: Vec<_> = results.values().map(|r| r.revision).collect();
    revisions.sort_unstable();
    assert!(revisions.iter().zip(1..).all(|(have, want)| *have == want));
    for (id, result) in results.iter() {
        let n = id.split_once('-').unwrap().1.parse().unwrap();
        let again = cli.ask(&keys::SCENE_APPLY, &of_burst(id, n), &soon()).await.unwrap();
        assert!(again.repeated, "{id}");
        assert_eq!(CommandResult { repeated: result.repeated, ..again }, *result);
    }
    assert_eq!(snapshot(&cli).await, newest, "repeated commands change nothing");

    // A reader that followed through all of this holds the same state.
    let followed = reader.at_least(newest.revision, soon().deadline).await.unwrap();
    assert_eq!(**followed.replica.state(), EditState::from_snapshot(&newest).unwrap());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_restarted_process_tells_its_last_event_again() {
    let mut stack = Stack::open(100).await;
    let cli = stack.join(role::CLI).await;
    let scene = stack.start();
    cli.ask(&keys::SCENE_APPLY, &background("one", 0.5), &soon()).await.unwrap();
    drop(scene);
    let mut events = cli.subscribe(&keys::SCENE_EVENT, role::SCENE, 16).await.unwrap();
    let _scene = stack.start();
    let (event, _) = tokio::time::timeout(Duration::from_secs(20), events.next()).await.unwrap().unwrap();
    assert_eq!((event.revision, event.command_id.as_str()), (1, "one"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_terminated_process_exits_with_0_and_frees_the_project() {
    let mut stack = Stack::open(100).await;
    let cli = stack.join(role::CLI).await;
    let mut scene = stack.start();
    cli.ask(&keys::SCENE_APPLY, &background("one", 0.5), &soon()).await.unwrap();
    let told = Process::new("kill").args(["-TERM", &scene.0.id().to_string()]).status().unwrap();
    assert!(told.success());
    let limit = Instant::now() + Duration::from_secs(10);
    let status = loop {
        match scene.0.try_wait().unwrap() {
            Some(status) => break status,
            None => assert!(Instant::now() < limit, "still running"),
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    };
    assert_eq!(status.code(), Some(0));
    let loaded = sg_formats::load(&stack.path("spiral.ply"), &sg_formats::LoadOptions::default()).unwrap();
    let project = Project::open(&stack.projects()[0], Arc::new(loaded.scene), "").unwrap();
    assert_eq!(project.editor().state().revision(), 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn each_scene_keeps_its_edits_in_the_data_folder() {
    let mut stack = Stack::open(100).await;
    support::write_ply(&stack.path("other.ply"), 101);
    let cli = stack.join(role::CLI).await;
    let mut revisions = Vec::new();
    let scenes = ["spiral.ply", "other.ply", "spiral.ply", "other.ply", "moved/spiral.ply"];
    std::fs::create_dir(stack.path("moved")).unwrap();
    for (n, scene) in scenes.into_iter().enumerate() {
        if scene.starts_with("moved") {
            std::fs::rename(stack.path("spiral.ply"), stack.path(scene)).unwrap();
        }
        let running = stack.start_with(scene);
        let result = cli.ask(&keys::SCENE_APPLY, &background(&format!("edit-{n}"), 0.5), &soon()).await.unwrap();
        revisions.push(result.revision);
        drop(running);
    }
    assert_eq!(revisions, [1, 1, 2, 2, 3]);
    let names: Vec<_> = stack.projects().iter().map(|p| p.file_stem().unwrap().to_str().unwrap().to_owned()).collect();
    assert_eq!(names.len(), 2, "{names:?}");
    assert!(names[0].starts_with("other-") && names[1].starts_with("spiral-"), "{names:?}");
    let beside: Vec<_> = std::fs::read_dir(stack.folder.path()).unwrap().map(|e| e.unwrap().path()).collect();
    assert!(beside.iter().all(|path| path.extension().is_none_or(|e| e != "sgproj")), "{beside:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_project_is_listed_and_copied_while_a_process_has_it() {
    let mut stack = Stack::open(100).await;
    let cli = stack.join(role::CLI).await;
    let scene = stack.start();
    cli.ask(&keys::SCENE_APPLY, &background("one", 0.5), &soon()).await.unwrap();
    let run = |arguments: &[&str]| {
        let mut process = Process::new(env!("CARGO_BIN_EXE_supergaussian-scene"));
        process.args(arguments).current_dir(stack.folder.path()).env("XDG_DATA_HOME", stack.path("data"));
        let output = process.output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
    };
    let (status, listed, _) = run(&["projects"]);
    let listed: serde_json::Value = serde_json::from_str(&listed).unwrap();
    assert_eq!((status, listed.as_array().unwrap().len()), (0, 1), "{listed}");
    let (entry, name) = (&listed[0], listed[0]["name"].as_str().unwrap());
    assert!(entry["in_use"] == true && entry["revision"] == 1 && entry["error"].is_null(), "{listed}");
    assert!(entry["scene"].as_str().unwrap().ends_with("spiral.ply"), "{listed}");

    assert_eq!(run(&["backup", name, "monday.sgproj"]).0, 0);
    for refused in
        [&["backup", name, "monday.sgproj"][..], &["restore", "monday.sgproj", name], &["backup", "none", "b"]]
    {
        let (status, _, words) = run(refused);
        assert_eq!((status, words.lines().count()), (2, 1), "{refused:?}: {words}");
    }
    let (status, _, words) = run(&["projects", "delete", name]);
    assert!(status == 1 && words.contains("in use"), "{words}");
    cli.ask(&keys::SCENE_APPLY, &background("two", 0.6), &soon()).await.unwrap();
    drop(scene);
    assert_eq!(run(&["projects", "delete", name]).0, 0);
    assert_eq!(stack.projects(), [] as [PathBuf; 0]);
    assert_eq!(run(&["projects", "delete", name]).0, 2);

    // Restored under the name that the scene looks for.
    assert_eq!(run(&["restore", "monday.sgproj", name]).0, 0);
    let _scene = stack.start();
    assert_eq!(snapshot(&cli).await.revision, 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn wrong_input_ends_with_one_line_and_status_2() {
    let stack = Stack::open(100).await;
    let scene = stack.path("spiral.ply").display().to_string();
    let with = |project: &str| format!(r#"{{"scene": "{scene}", "project": "{}"}}"#, stack.path(project).display());
    std::fs::write(stack.path("notes.sgproj"), "remember the milk\n".repeat(300)).unwrap();
    support::write_ply(&stack.path("other.ply"), 101);
    let other = sg_formats::load(&stack.path("other.ply"), &sg_formats::LoadOptions::default()).unwrap().scene;
    Project::open(&stack.path("other.sgproj"), Arc::new(other), "").unwrap();
    for (params, want) in [
        (r#"{"scene": "a.ply", "projct": "b"}"#.to_owned(), "unknown field `projct`"),
        ("{}".to_owned(), "missing field `scene`"),
        (r#"{"scene": "/nowhere/a.ply"}"#.to_owned(), "/nowhere/a.ply"),
        (with("notes.sgproj"), "not a Super-Gaussian project"),
        (with("other.sgproj"), "another scene"),
        (with("none/a.sgproj"), "folder that exists"),
    ] {
        let (status, line) = stack.failed(&params);
        assert_eq!(status, 2, "{params}: {line}");
        assert!(line.contains(want), "{params}: {line}");
    }
    assert_eq!(std::fs::read_to_string(stack.path("notes.sgproj")).unwrap(), "remember the milk\n".repeat(300));
    drop(stack.router);
}

/// Measures the time to readiness of a scene of 150,000 Gaussians, with a new project and after a thousand commands:
/// `cargo test --release -p sg-scene --test serve -- --ignored --nocapture start_up`.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "prints times"]
async fn start_up_times() {
    use std::io::Write as _;
    const N: usize = 150_000;
    let mut stack = Stack::open(1).await;
    let scene = support::shaded_scene(N);
    sg_formats::save(&stack.path("spiral.ply"), &scene, &sg_formats::SaveOptions::default()).unwrap();
    let cli = stack.join(role::CLI).await;
    let mut ready = cli.subscribe(&keys::READY, role::SCENE, 4).await.unwrap();
    let mut told = Vec::new();
    for life in ["new project", "same project, no commands", "same project, 1000 commands"] {
        let begun = Instant::now();
        let running = stack.start();
        let (message, _) = tokio::time::timeout(Duration::from_secs(20), ready.next()).await.unwrap().unwrap();
        told.push(format!(
            "{life}: ready {} ms after its start, {} ms after spawn",
            message.start_ms,
            begun.elapsed().as_millis()
        ));
        assert!(message.start_ms < 5000, "{told:?}");
        if told.len() == 2 {
            let begun = Instant::now();
            for n in 0..1000 {
                let command = if n % 2 == 0 {
                    command(&format!("c{n}"), Action::Select(Select { target: everything(), operation: 0 }))
                } else {
                    command(&format!("c{n}"), Action::Select(Select::default()))
                };
                cli.ask(&keys::SCENE_APPLY, &command, &soon()).await.unwrap();
            }
            let bytes = std::fs::metadata(&stack.projects()[0]).unwrap().len();
            told.push(format!(
                "one selection command: {:.2} ms to the answer; 1000 took {bytes} bytes of project",
                begun.elapsed().as_secs_f64()
            ));
        }
        drop(running);
    }
    writeln!(std::io::stderr(), "{N} Gaussians\n{}", told.join("\n")).unwrap();
}
