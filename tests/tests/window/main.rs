//! The window of a whole running stack, with a simulated mouse and keyboard.

#![allow(
    clippy::panic,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stderr,
    reason = "a test fails by panicking"
)]

mod first_hour;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use sg_edit::EditState;
use sg_formats::load::{LoadOptions, load};
use sg_gpu::backend::{Backend, Engine};
use sg_gpu::{DeviceClass, Gpu, Rasterizer};
use sg_proto::keys::{self, role};
use sg_proto::launch::OpenRequest;
use sg_proto::scene::State;
use sg_runtime::bus::Bus;
use sg_tests::bench::niceness;
use sg_tests::screen::{SIZE, Screen};
use sg_tests::small_scene;
use sg_tests::stack::{SESSION, Stack};
use sg_tests::until::{PATIENCE, scene, selected, soon, view};
use sg_viewer::display::{Tools, ViewPort, ViewState};
use sg_viewer::window::{self, Setup};

/// The middle of the picture if no panels are beside it.
const MIDDLE: [i32; 2] = [SIZE[0] as i32 / 2, SIZE[1] as i32 / 2];

#[test]
fn a_person_brushes_names_speaks_and_closes() {
    let Some(screen) = Screen::open().unwrap() else { return };
    let home = tempfile::tempdir().unwrap();
    let home = home.path().display().to_string();
    // Without a session's bus the window asks for names itself.
    let bus = ("DBUS_SESSION_BUS_ADDRESS", "");
    let env = [("DISPLAY", screen.display()), ("XDG_CONFIG_HOME", &home), ("XDG_PICTURES_DIR", &home), bus];
    let settings = ["service.render-view.params.quality=fast".to_owned()];
    let mut stack = Stack::up_of("desktop.toml", &settings, &env).unwrap();
    screen.window("Super-Gaussian", PATIENCE).unwrap();
    let key = |key: &str| screen.act(&["key", key]).map(drop).unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        let bus = stack.join(role::CLI).await.unwrap();
        let begun = view(&bus, "a picture in the window", |v| v.display == "window" && v.frames > 0).await;
        assert!(begun.engine.len() > 2 && begun.shown > 0, "{begun:?}");

        // Without panels the picture is the whole window; the body fills its left half.
        key("h");
        key("b");
        // The balls are of few Gaussians: a brush that finds some.
        (0..12).for_each(|_| key("bracketright"));
        let left = MIDDLE[0] - 420;
        let stroke: Vec<[i32; 2]> = (0..6).map(|k| [left - 10 * k, MIDDLE[1] + 4 * k]).collect();
        screen.act(&["mousemove", &left.to_string(), &MIDDLE[1].to_string()]).unwrap();
        // The front surface has to be known before a brush can work. So the stroke is repeated until it is known.
        let begun = Instant::now();
        let walked = loop {
            screen.drag(&stroke).unwrap();
            tokio::time::sleep(Duration::from_millis(300)).await;
            let state = bus.newest(&keys::SCENE_STATE, &soon()).await.unwrap();
            if selected(&state) > 0 {
                break state;
            }
            assert!(begun.elapsed() < PATIENCE, "a stroke selects nothing: {state:?}");
        };
        assert!(walked.undo.first().is_some_and(|line| line.contains("stroke")), "{:?}", walked.undo);
        // It is seen: the highlight is bluer than anything in the scene.
        view(&bus, "a picture of the selection", |v| v.revision >= walked.revision).await;
        let begun = Instant::now();
        loop {
            let whole = [0, 40, SIZE[0], SIZE[1] - 80];
            let blue = screen.shot().unwrap().share(whole, |[r, _, b]| i32::from(b) > i32::from(r) + 40);
            if blue > 1e-4 {
                break;
            }
            assert!(begun.elapsed() < PATIENCE, "no highlight on the screen: {blue}");
            tokio::time::sleep(Duration::from_millis(100)).await;
        }

        key("ctrl+z");
        scene(&bus, "a stroke taken back", |s| selected(s) == 0 || s.revision > walked.revision + 2).await;
        key("ctrl+shift+z");
        let back = scene(&bus, "a stroke brought back", |s| selected(s) > 0).await;

        // Less leak, and the region grows: tried at once, one step of the history when the keys rest.
        let steps = back.undo.len();
        (0..12).for_each(|_| key("period"));
        let wider = scene(&bus, "a walk with less leak", |s| selected(s) > selected(&back)).await;
        assert!(wider.undo.first().is_some_and(|line| line.contains("Reach")), "{:?}", wider.undo);
        assert_eq!(wider.undo.len(), steps + 1, "{:?}", wider.undo);
        // The wheel with Alt goes the other way.
        screen.act(&["keydown", "alt"]).unwrap();
        screen.act(&["click", "--repeat", "3", "--delay", "40", "4"]).unwrap();
        screen.act(&["keyup", "alt"]).unwrap();
        scene(&bus, "a walk with more leak", |s| s.revision > wider.revision && selected(s) <= selected(&wider)).await;
        key("ctrl+z");
        key("ctrl+z");
        scene(&bus, "the walk as it was", |s| selected(s) == selected(&back) && s.undo.len() == steps).await;

        // The selection leaves the program as a file of its own.
        key("ctrl+e");
        tokio::time::sleep(Duration::from_millis(500)).await;
        key("ctrl+a");
        let file = Path::new(&home).join("body.ply");
        screen.act(&["type", &file.display().to_string()]).unwrap();
        key("Return");
        let begun = Instant::now();
        while !file.exists() {
            assert!(begun.elapsed() < PATIENCE, "no file of the selection");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        let exported = load(&file, &LoadOptions::default()).unwrap().scene;
        assert_eq!(exported.len() as u64, selected(&back));

        polygon_and_sphere(&screen, &bus, left, &back).await;

        // Another mode: whole Super-Gaussians, and Shift takes away.
        key("2");
        screen.act(&["keydown", "shift"]).unwrap();
        screen.drag(&stroke).unwrap();
        screen.act(&["keyup", "shift"]).unwrap();
        let less = |s: &State| selected(s) < selected(&back);
        scene(&bus, "clusters taken away", less).await;
        key("ctrl+z");
        scene(&bus, "they are back", |s| selected(s) == selected(&back)).await;

        // A name from the keyboard; letters that are typed are no shortcuts.
        key("ctrl+s");
        tokio::time::sleep(Duration::from_millis(500)).await;
        screen.act(&["type", "--delay", "40", "left lobe"]).unwrap();
        key("Return");
        let saved = scene(&bus, "a saved unit", |s| s.units.iter().any(|u| u.name == "left lobe")).await;
        assert_eq!(saved.units.len(), 1);

        // Sent to the agents.
        key("Escape");
        key("Return");
        tokio::time::sleep(Duration::from_millis(500)).await;
        screen.act(&["type", "--delay", "40", "make the left lobe red"]).unwrap();
        key("Return");
        let red = |s: &State| s.units.iter().any(|u| u.color.is_some_and(|c| c.red > 0.8 && c.blue < 0.3));
        let told = scene(&bus, "a red unit", red).await;

        // The process dies and comes back; nothing of the scene is lost, and the window is there again.
        let pid = stack.ps().iter().find(|s| s["name"] == "render-view").and_then(|s| s["pid"].as_i64()).unwrap();
        kill(Pid::from_raw(pid.try_into().unwrap()), Signal::SIGKILL).unwrap();
        view(&bus, "the window after it died", |v| {
            v.display == "window" && v.frames > 0 && v.revision >= told.revision
        })
        .await;
    });
    screen.window("Super-Gaussian", PATIENCE).unwrap();
    key("ctrl+q");
    let ended = stack.ended(PATIENCE);
    assert_eq!(ended, Some(Some(0)), "closing the window ends the stack\n{}", stack.log());
    let kept = std::fs::read_to_string(Path::new(&home).join("supergaussian/window.toml")).unwrap();
    assert!(kept.contains("radius"), "{kept}");
}

/// Selects with a polygon about the body at `x`, and with a sphere on it, and takes back both. The selection ends as it begins, with
/// the brush as the tool.
async fn polygon_and_sphere(screen: &Screen, bus: &Bus, x: i32, before: &State) {
    let key = |key: &str| screen.act(&["key", key]).map(drop).unwrap();
    key("ctrl+d");
    scene(bus, "no selection", |s| selected(s) == 0).await;
    key("j");
    for [dx, dy] in [[-150, -160], [120, -150], [130, 160], [-140, 150]] {
        screen.drag(&[[x + dx, MIDDLE[1] + dy]]).unwrap();
    }
    key("Return");
    let polygon = scene(bus, "the inside of a polygon", |s| selected(s) > 0).await;
    key("ctrl+z");
    scene(bus, "no polygon", |s| selected(s) == 0).await;
    key("o");
    // The front surface has to be known before a sphere can begin on it.
    let begun = Instant::now();
    let sphere = loop {
        screen.drag(&[[x, MIDDLE[1]], [x + 20, MIDDLE[1]], [x + 60, MIDDLE[1]]]).unwrap();
        tokio::time::sleep(Duration::from_millis(500)).await;
        let state = bus.newest(&keys::SCENE_STATE, &soon()).await.unwrap();
        if selected(&state) > 0 {
            break state;
        }
        assert!(begun.elapsed() < PATIENCE, "a sphere selects nothing: {state:?}");
    };
    assert!(selected(&sphere) != selected(&polygon), "{sphere:?}");
    key("ctrl+z");
    scene(bus, "no sphere", |s| selected(s) == 0).await;
    key("ctrl+z");
    scene(bus, "the selection as it was", |s| selected(s) == selected(before)).await;
    key("Escape");
    key("b");
}

/// Sessions that were opened from a stack; ended with their windows when dropped.
struct Opened(PathBuf);

impl Opened {
    /// Runs the command to its end: whether that went well.
    fn run(&self, arguments: &[&str]) -> bool {
        sg_tests::command(&self.0).unwrap().args(arguments).output().unwrap().status.success()
    }

    /// Names of those that run.
    fn names(&self) -> Vec<String> {
        let folders = std::fs::read_dir(&self.0).unwrap().flatten();
        let names = folders.map(|f| f.file_name().to_string_lossy().into_owned());
        names.filter(|name| name != SESSION && self.run(&["ps", "--session", name])).collect()
    }

    /// Waits until as many run.
    fn until(&self, count: usize) -> Vec<String> {
        let begun = Instant::now();
        loop {
            let names = self.names();
            if names.len() == count {
                return names;
            }
            assert!(begun.elapsed() < PATIENCE, "{names:?} run and not {count}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Whether edits in one are kept: a project begins with the same short name of the scene.
    fn keeps(&self, name: &str) -> bool {
        let files = std::fs::read_dir(self.0.join(".data/supergaussian/projects")).unwrap().flatten();
        let scene = name.rsplit_once('-').unwrap().0;
        files.map(|f| f.file_name().into_string().unwrap()).any(|f| f.starts_with(scene) && f.ends_with(".sgproj"))
    }
}

impl Drop for Opened {
    fn drop(&mut self) {
        for name in self.names() {
            self.run(&["down", "--session", &name]);
        }
    }
}

#[test]
fn a_dropped_scene_opens_in_a_window_and_a_session_of_its_own() {
    let Some(screen) = Screen::open().unwrap() else { return };
    let home = tempfile::tempdir().unwrap();
    let other = home.path().join("an other");
    std::fs::create_dir(&other).unwrap();
    let scene = small_scene::write(&other).unwrap();
    // Its content differs from that of the stack's scene, or both would be one project.
    let text = std::fs::read_to_string(&scene).unwrap().replace("max = [3.0", "max = [3.5");
    std::fs::write(&scene, text).unwrap();
    let broken = home.path().join("broken.ply");
    std::fs::write(&broken, "ply\nno header\n").unwrap();
    let volume = home.path().join("cube_24x24x24_uint8.raw");
    // Denser towards the middle.
    let off = |k: usize| (k as i32 - 12).unsigned_abs() as u8;
    let voxels = (0..24 * 24 * 24).map(|i| 240 - 18 * off(i % 24).max(off(i / 24 % 24)).max(off(i / 576)));
    std::fs::write(&volume, voxels.collect::<Vec<u8>>()).unwrap();
    let home = home.path().display().to_string();
    let env = [("DISPLAY", screen.display()), ("XDG_CONFIG_HOME", &home), ("DBUS_SESSION_BUS_ADDRESS", "")];
    let mut stack = Stack::up_of("desktop.toml", &[], &env).unwrap();
    let opened = Opened(stack.run_root());
    let first = screen.window("Super-Gaussian", PATIENCE).unwrap();
    let close = |window: &str| {
        screen.act(&["windowfocus", "--sync", window]).unwrap();
        screen.act(&["key", "ctrl+q"]).unwrap();
    };
    screen.drop_file(&first, &scene, PATIENCE).unwrap();
    let second = screen.window("an other", PATIENCE).unwrap();
    let names = opened.until(1);
    assert!(names[0].starts_with("an-other-"), "{names:?}");
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        let bus = stack.join(role::CLI).await.unwrap();
        // It is there already, and another window of it would be another history of edits.
        let request = OpenRequest { path: scene.display().to_string() };
        let fault = bus.ask(&keys::OPEN, &request, &soon()).await.unwrap_err();
        assert!(fault.message.contains(&names[0]), "{fault}");
        let mut failed = bus.subscribe(&keys::OPEN_FAILED, role::SUPERVISOR, 8).await.unwrap();
        screen.drop_file(&first, &broken, PATIENCE).unwrap();
        let (told, _) = tokio::time::timeout(PATIENCE, failed.next()).await.unwrap().unwrap();
        assert!(told.path.ends_with("broken.ply") && told.reason.contains("broken.ply:"), "{told:?}");
    });
    // The end of one leaves the other as it was.
    close(&second);
    opened.until(0);
    assert!(stack.ps().iter().all(|s| s["state"] == "READY"), "{:?}", stack.ps());
    assert!(opened.keeps(&names[0]));
    // A path that is typed does what a drop does.
    screen.act(&["windowfocus", "--sync", &first]).unwrap();
    screen.act(&["key", "ctrl+o"]).unwrap();
    std::thread::sleep(Duration::from_millis(500));
    screen.act(&["key", "ctrl+a"]).unwrap();
    screen.act(&["type", &scene.display().to_string()]).unwrap();
    screen.act(&["key", "Return"]).unwrap();
    let second = screen.window("an other", PATIENCE).unwrap();
    assert_eq!(opened.until(1), names);
    // The fit of a volume goes on by itself, though its reports have no listener any more.
    screen.drop_file(&first, &volume, PATIENCE).unwrap();
    close(&first);
    assert_eq!(stack.ended(PATIENCE), Some(Some(0)), "closing the window ends its stack\n{}", stack.log());
    let third = screen.window("cube", PATIENCE).unwrap();
    let both = opened.until(2);
    assert!(both.contains(&names[0]) && both.iter().any(|name| name.starts_with("cube_")), "{both:?}");
    close(&second);
    close(&third);
    opened.until(0);
}

#[test]
fn without_a_display_the_error_names_a_remedy() {
    let env = [("DISPLAY", ":4711"), ("WAYLAND_DISPLAY", "")];
    let error = Stack::up_of("desktop.toml", &[], &env).map(drop).unwrap_err();
    assert!(error.contains("no window can be opened") && error.contains("DISPLAY"), "{error}");
}

#[test]
fn a_demo_is_a_window_where_there_is_a_display() {
    let Some(screen) = Screen::open().unwrap() else { return };
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("out");
    let demo = |display: &str, more: &[&str]| {
        let mut demo = sg_tests::command(&home.path().join("run")).unwrap();
        demo.args(["demo", "--gaussians", "3000", "--size", "64", "--out"]).arg(&out).args(more);
        demo.env("DISPLAY", display).env("XDG_CONFIG_HOME", home.path());
        demo.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        demo.spawn().unwrap()
    };
    let seen = demo(screen.display(), &[]);
    screen.window("Super-Gaussian", PATIENCE).unwrap();
    screen.act(&["key", "ctrl+q"]).unwrap();
    let ended = seen.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success() && said.contains("close it to end"), "{said}");
    assert!(out.join("scene.sgproj").is_file() && !out.join("transcript.json").exists());

    // A display that does not exist: the results are left in files.
    let ended = demo(":4711", &[]).wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success() && said.contains("plays a script without a window"), "{said}");
    assert!(out.join("transcript.json").is_file());
}

#[test]
fn a_headset_that_is_not_there_is_a_window_that_says_why() {
    let Some(screen) = Screen::open().unwrap() else { return };
    let home = tempfile::tempdir().unwrap();
    let home = home.path().display().to_string();
    // The machine's own OpenXR plays no part: this runtime does not exist.
    let runtime = format!("{home}/no-runtime.json");
    let env = [("DISPLAY", screen.display()), ("XDG_CONFIG_HOME", &home), ("XR_RUNTIME_JSON", &runtime)];
    let stack = Stack::up_of("vr.toml", &[], &env).unwrap();
    screen.window("Super-Gaussian", PATIENCE).unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        let bus = stack.join(role::CLI).await.unwrap();
        view(&bus, "a picture in the window", |v| v.display == "window" && v.frames > 0).await;
    });
    let logs = std::fs::read_dir(stack.session_folder().join("logs")).unwrap();
    let said: String = logs.flatten().filter_map(|f| std::fs::read_to_string(f.path()).ok()).collect();
    assert!(said.contains("the window takes the headset's place") && said.contains("OpenXR"), "{said}");
}

/// Frames that a window has shown, once it shows no more for two seconds. It tells them every second.
async fn frames_at_rest(bus: &Bus) -> u64 {
    let begun = Instant::now();
    let shown = async || view(bus, "the view", |v| v.shown > 0).await.shown;
    let mut before = shown().await;
    loop {
        tokio::time::sleep(Duration::from_secs(3)).await;
        let now = shown().await;
        if now <= before + 2 {
            return now;
        }
        assert!(begun.elapsed() < PATIENCE, "the window does not come to rest: {before} frames, then {now}");
        before = now;
    }
}

#[test]
fn a_window_at_rest_draws_no_frames_and_a_minimised_one_none_at_all() {
    let Some(screen) = Screen::open().unwrap() else { return };
    let home = tempfile::tempdir().unwrap();
    let home = home.path().display().to_string();
    let env = [("DISPLAY", screen.display()), ("XDG_CONFIG_HOME", &home)];
    let stack = Stack::up_of("desktop.toml", &[], &env).unwrap();
    let window = screen.window("Super-Gaussian", PATIENCE).unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        let bus = stack.join(role::CLI).await.unwrap();
        view(&bus, "a picture in the window", |v| v.display == "window" && v.frames > 0).await;
        let before = frames_at_rest(&bus).await;
        tokio::time::sleep(Duration::from_secs(2)).await;
        let after = view(&bus, "the view", |_| true).await.shown;
        assert!(after <= before + 2, "{} frames in two seconds at rest", after - before);

        // Its drawing threads give way to everything else.
        let pid = stack.ps().iter().find(|s| s["name"] == "render-view").unwrap()["pid"].as_u64().unwrap();
        let all = niceness(pid);
        let drawing: Vec<_> = all.iter().filter(|(name, _)| name.starts_with("draws-")).collect();
        assert!(!drawing.is_empty() && drawing.iter().all(|(_, nice)| *nice >= 10), "{all:?}");
        assert!(all.iter().any(|(name, nice)| name == "display" && *nice < 10), "{all:?}");

        // Nobody sees the change, so no frame is drawn of it until the window is back.
        screen.minimize(&window).unwrap();
        let before = frames_at_rest(&bus).await;
        let revision = scene(&bus, "the scene", |_| true).await.revision;
        let (status, _, all) = stack.run(&["say", "make the body red"]).unwrap();
        assert_eq!(status, Some(0), "{all}");
        scene(&bus, "a red body", |s| s.revision > revision).await;
        tokio::time::sleep(Duration::from_secs(3)).await;
        let hidden = view(&bus, "the view", |_| true).await;
        assert_eq!(hidden.shown, before, "frames of a minimised window");
        screen.restore(&window).unwrap();
        view(&bus, "the change on the screen", |v| v.revision > revision && v.shown > before).await;
    });
}

#[test]
fn frames_go_on_while_every_other_service_stands_still() {
    let Some(screen) = Screen::open().unwrap() else { return };
    let home = tempfile::tempdir().unwrap();
    let home = home.path().display().to_string();
    let env = [("DISPLAY", screen.display()), ("XDG_CONFIG_HOME", &home)];
    // No process may be taken for hung while it is stopped here.
    let stack = Stack::up_of("desktop.toml", &["defaults.liveness=600".to_owned()], &env).unwrap();
    screen.window("Super-Gaussian", PATIENCE).unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        let bus = stack.join(role::CLI).await.unwrap();
        view(&bus, "a picture in the window", |v| v.display == "window" && v.frames > 0).await;
        let services = stack.ps();
        let others: Vec<_> = services
            .iter()
            .filter(|s| s["name"] != "render-view")
            .map(|s| Pid::from_raw(s["pid"].as_i64().unwrap().try_into().unwrap()))
            .collect();
        assert_eq!(others.len(), 6);
        // Ask for a change, so that a request waits beside the loop.
        for pid in &others {
            kill(*pid, Signal::SIGSTOP).unwrap();
        }
        screen.act(&["key", "ctrl+z"]).unwrap();
        let before = view(&bus, "the view itself", |_| true).await;
        // A window at rest draws nothing, so the hand moves on until there are enough frames: on a busy machine that takes longer.
        let (begun, mut k) = (Instant::now(), 0);
        let after = loop {
            let (x, y) = (MIDDLE[0] + 4 * (k % 40), MIDDLE[1] + k % 40);
            screen.act(&["mousemove", &x.to_string(), &y.to_string()]).unwrap();
            if k == 0 {
                screen.act(&["mousedown", "1"]).unwrap();
            }
            k += 1;
            tokio::time::sleep(Duration::from_millis(50)).await;
            let now = view(&bus, "the view itself", |_| true).await;
            if now.shown > before.shown + 15 && now.frames > before.frames + 3 {
                break now;
            }
            assert!(begun.elapsed() < PATIENCE, "no frames of a turn: {now:?}");
        };
        screen.act(&["mouseup", "1"]).unwrap();
        assert!(after.revision == before.revision, "nobody told of anything");
        for pid in &others {
            // On a busy machine the bus may have given one up by now, and the supervisor have started it again.
            let _ = kill(*pid, Signal::SIGCONT);
        }
        let (status, _, all) = stack.run(&["say", "hide everything"]).unwrap();
        assert_eq!(status, Some(0), "{all}");
    });
}

/// The view of the process of [`shows_a_scene_until_it_is_killed`], and whether its pictures are copied.
const SHOWN: [&str; 2] = ["SUPERGAUSSIAN_TESTS_SHOW", "SUPERGAUSSIAN_TESTS_COPY"];

#[test]
#[ignore = "the process that the test of a lost device starts"]
fn shows_a_scene_until_it_is_killed() {
    let [Ok(path), Ok(copies)] = SHOWN.map(std::env::var) else { return };
    sg_runtime::telemetry::init_command();
    let scene = load(Path::new(&path), &LoadOptions::default()).unwrap().scene;
    let engine = Engine::new(scene.clone(), Backend::Gpu, Some(Rasterizer::Quads)).unwrap();
    let gpu = engine.gpu().unwrap().clone();
    let (view_port, _service) = ViewPort::new(ViewState::of(Arc::new(EditState::of_scene(&scene, &path, "hash"))));
    std::thread::spawn(move || {
        let mut line = String::new();
        std::io::stdin().read_line(&mut line).unwrap();
        gpu.lose();
    });
    let setup = Setup {
        scene: Arc::new(scene),
        engine,
        view_port,
        title: "shown".to_owned(),
        tools: Tools::default(),
        quality: None,
        copies: Some(copies == "true"),
        settings: None,
        pictures: PathBuf::from(path).with_file_name("kept"),
        file: None,
        scratch: None,
        opened: Box::new(|| ()),
    };
    window::run(setup).unwrap();
}

/// A process with a window, without its panels, that is killed when dropped.
struct Showing {
    process: Child,
    log: PathBuf,
}

impl Showing {
    fn start(screen: &Screen, scene: &Path, copies: bool) -> Self {
        let log = scene.with_file_name(format!("log-{copies}"));
        let process = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "shows_a_scene_until_it_is_killed", "--ignored", "--nocapture"])
            .env("DISPLAY", screen.display())
            .env("SUPERGAUSSIAN_LOG", "info,zenoh=error,sg_viewer=debug")
            .envs(SHOWN.into_iter().zip([scene.as_os_str(), copies.to_string().as_ref()]))
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(std::fs::File::create(&log).unwrap())
            .spawn()
            .unwrap();
        screen.window("shown", PATIENCE).unwrap();
        let this = Self { process, log };
        // A key that comes before the window has its first frame is lost.
        let panels = || screen.shot().unwrap().share([20, 100, 200, 600], |p| p != [0; 3]) > 0.5;
        let begun = Instant::now();
        while !panels() {
            assert!(begun.elapsed() < PATIENCE, "no panels: {}", this.log());
            std::thread::sleep(Duration::from_millis(50));
        }
        screen.act(&["key", "h"]).unwrap();
        while panels() {
            assert!(begun.elapsed() < PATIENCE, "panels stay: {}", this.log());
            std::thread::sleep(Duration::from_millis(50));
        }
        this
    }

    fn lose(&mut self) {
        writeln!(self.process.stdin.as_mut().unwrap(), "lose").unwrap();
    }

    fn log(&self) -> String {
        std::fs::read_to_string(&self.log).unwrap()
    }

    /// How often the log contains a text.
    fn said(&self, words: &str) -> usize {
        self.log().matches(words).count()
    }

    /// How many pictures at rest, as wide as the screen, have been drawn.
    fn at_rest(&self) -> usize {
        self.said(&format!("a picture at rest: {}x", SIZE[0]))
    }

    /// The [`picture`] once it stays and something holds.
    fn settled(&self, screen: &Screen, what: &str, holds: impl Fn(&[[u8; 3]]) -> bool) -> Vec<[u8; 3]> {
        let picture = || picture(screen);
        let (begun, mut before, mut same) = (Instant::now(), picture(), 0);
        loop {
            // Each motion is a frame; over the status line it changes nothing.
            let [x, y] = [MIDDLE[0] + same, SIZE[1] as i32 - 10].map(|n| n.to_string());
            screen.act(&["mousemove", &x, &y]).unwrap();
            std::thread::sleep(Duration::from_millis(250));
            let now = picture();
            same = if now == before && holds(&now) { same + 1 } else { 0 };
            // The picture at rest is drawn when `holds` says so; it is on the screen a frame later.
            if same == 8 {
                return now;
            }
            assert!(begun.elapsed() < PATIENCE, "{what}: {}", self.log());
            before = now;
        }
    }
}

impl Drop for Showing {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The screen without the window's bars at its upper and lower edge.
fn picture(screen: &Screen) -> Vec<[u8; 3]> {
    screen.shot().unwrap().pixels[60 * SIZE[0]..(SIZE[1] - 60) * SIZE[0]].to_vec()
}

#[test]
fn pictures_kept_on_the_device_equal_copied_ones_and_survive_device_loss() {
    let Some(screen) = Screen::open().unwrap() else { return };
    if let Err(error) = Gpu::open(DeviceClass::Any) {
        assert!(std::env::var_os("SUPERGAUSSIAN_REQUIRE_GPU").is_none_or(|v| v != "1"), "{error}");
        eprintln!("SKIPPED: {error}");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = small_scene::write(folder.path()).unwrap();
    let shows = |pixels: &[[u8; 3]]| pixels.iter().filter(|p| p[0] > 60).count() > 10_000;
    let copied = {
        let showing = Showing::start(&screen, &scene, true);
        let picture = showing.settled(&screen, "a copied picture", |now| shows(now) && showing.at_rest() > 0);
        assert_eq!(showing.said("pictures stay on"), 0);
        picture
    };
    let mut showing = Showing::start(&screen, &scene, false);
    let stays =
        showing.settled(&screen, "a picture that stays on the device", |now| shows(now) && showing.at_rest() > 0);
    assert_eq!(showing.said("pictures stay on"), 1);
    let apart =
        |other: &[[u8; 3]]| stays.iter().flatten().zip(other.iter().flatten()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(apart(&copied) <= Some(1), "{:?} of 255 apart", apart(&copied));

    let drawn = showing.at_rest();
    showing.lose();
    let back = showing.settled(&screen, "a picture from a device opened anew", |now| {
        shows(now) && showing.said("pictures stay on") == 2 && showing.at_rest() > drawn
    });
    assert_eq!(apart(&back), Some(0), "another picture than before");
    let across: Vec<_> = (0..8).map(|k| [MIDDLE[0] + 12 * k, MIDDLE[1]]).collect();
    let (begun, drawn) = (Instant::now(), showing.at_rest());
    // All of a drag in one frame is a click.
    while picture(&screen) == stays {
        assert!(begun.elapsed() < PATIENCE, "no turn on the new device: {}", showing.log());
        screen.drag(&across).unwrap();
    }
    showing.settled(&screen, "the picture after a turn", |now| shows(now) && now != stays && showing.at_rest() > drawn);
    assert!(showing.process.try_wait().unwrap().is_none());
}
