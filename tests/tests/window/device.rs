//! The device that draws the window's pictures: pictures that stay on it, and its loss.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use sg_edit::EditState;
use sg_formats::load::{LoadOptions, load};
use sg_gpu::backend::{Backend, Engine};
use sg_gpu::{DeviceClass, Gpu, Rasterizer};
use sg_tests::screen::{SIZE, Screen};
use sg_tests::small_scene;
use sg_tests::until::PATIENCE;
use sg_viewer::display::{Tools, ViewPort, ViewState};
use sg_viewer::window::{self, Setup};

use crate::MIDDLE;

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
            .args(["--exact", "device::shows_a_scene_until_it_is_killed", "--ignored", "--nocapture"])
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
        // The keyboard may reach the window later than its first frame.
        while panels() {
            screen.act(&["key", "h"]).unwrap();
            let pressed = Instant::now();
            while panels() && pressed.elapsed() < Duration::from_secs(3) {
                assert!(begun.elapsed() < PATIENCE, "panels stay: {}", this.log());
                std::thread::sleep(Duration::from_millis(50));
            }
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
