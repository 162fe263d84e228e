//! Windows that open: beside another one, for a demo, in place of a headset, and not at all.

use std::path::PathBuf;
use std::process::Stdio;
use std::time::{Duration, Instant};

use sg_proto::keys::{self, role};
use sg_proto::launch::OpenRequest;
use sg_tests::screen::Screen;
use sg_tests::small_scene;
use sg_tests::stack::{SESSION, Stack};
use sg_tests::until::{PATIENCE, soon, view};

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
        let request = OpenRequest { path: scene.display().to_string(), ..OpenRequest::default() };
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
    // A raw file cannot say its spacing, so the window asks. Enter takes what it proposes.
    std::thread::sleep(Duration::from_secs(1));
    screen.act(&["windowfocus", "--sync", &first]).unwrap();
    screen.act(&["key", "Return"]).unwrap();
    std::thread::sleep(Duration::from_secs(1));
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

#[test]
fn a_long_open_shows_its_progress_and_escape_leaves_nothing_behind() {
    let Some(screen) = Screen::open().unwrap() else { return };
    let home = tempfile::tempdir().unwrap();
    let edge = 160_usize;
    let off = |k: usize| k.abs_diff(edge / 2) as u8;
    // Denser towards the middle, so that there is something to place.
    let voxels = (0..edge.pow(3)).map(|i| 250 - 2 * off(i % edge).max(off(i / edge % edge)).max(off(i / edge / edge)));
    let volume = home.path().join(format!("heart_{edge}x{edge}x{edge}_uint8.raw"));
    std::fs::write(&volume, voxels.collect::<Vec<u8>>()).unwrap();
    let run = home.path().join("run");
    let mut open = sg_tests::command(&run).unwrap();
    open.arg("open").arg(&volume).env("DISPLAY", screen.display()).env("XDG_CONFIG_HOME", home.path());
    let open = open.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    screen.window("Opening", PATIENCE).unwrap();
    screen.act(&["key", "Escape"]).unwrap();
    let ended = open.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success() && said.contains("cancelled; nothing was opened"), "{said}");
    let sessions = std::fs::read_dir(&run).unwrap().flatten().map(|f| f.file_name().into_string().unwrap());
    let left: Vec<_> = sessions.filter(|name| !name.starts_with('.')).collect();
    assert!(left.is_empty(), "{left:?}");
    let windows = screen.act(&["search", "--onlyvisible", "--name", "heart|Opening"]).unwrap_or_default();
    assert_eq!(windows, "", "a window is left");
}
