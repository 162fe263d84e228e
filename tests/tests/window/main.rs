//! The window of a whole running stack, with a simulated mouse and keyboard.

#![allow(
    clippy::panic,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stderr,
    reason = "a test fails by panicking"
)]

mod device;
mod first_hour;
mod opening;
mod resting;

use std::path::Path;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use sg_formats::load::{LoadOptions, load};
use sg_proto::keys::{self, role};
use sg_proto::scene::State;
use sg_runtime::bus::Bus;
use sg_tests::screen::{SIZE, Screen};
use sg_tests::stack::Stack;
use sg_tests::until::{PATIENCE, scene, selected, soon, view};

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
        let walked = drag_until_selected(&screen, &bus, &stroke, "a stroke").await;
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

        // The next wider answer to the stroke, one step of the history.
        let steps = back.undo.len();
        key("period");
        let wider = scene(&bus, "a wider answer", |s| selected(s) > selected(&back)).await;
        assert!(wider.undo.first().is_some_and(|line| line.contains("Reach")), "{:?}", wider.undo);
        assert_eq!(wider.undo.len(), steps + 1, "{:?}", wider.undo);
        // The wheel with Alt goes the other way.
        screen.act(&["keydown", "alt"]).unwrap();
        screen.act(&["click", "5"]).unwrap();
        screen.act(&["keyup", "alt"]).unwrap();
        scene(&bus, "a narrower answer", |s| s.revision > wider.revision && selected(s) < selected(&wider)).await;
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

/// Drags until something is selected. The front surface has to be known before a tool can begin on it, so what finds nothing is
/// repeated.
async fn drag_until_selected(screen: &Screen, bus: &Bus, places: &[[i32; 2]], what: &str) -> State {
    let begun = Instant::now();
    loop {
        screen.drag(places).unwrap();
        if let Some(state) = selected_soon(bus, Duration::from_secs(8)).await {
            return state;
        }
        assert!(begun.elapsed() < PATIENCE, "{what} selects nothing");
    }
}

/// The scene once something is selected; `None` if nothing is within `patience`. A busy machine takes its time, and a stroke that is
/// repeated too early would be a second one.
async fn selected_soon(bus: &Bus, patience: Duration) -> Option<State> {
    let begun = Instant::now();
    while begun.elapsed() < patience {
        let state = bus.newest(&keys::SCENE_STATE, &soon()).await.unwrap();
        if selected(&state) > 0 {
            return Some(state);
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    None
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
    let places = [[x, MIDDLE[1]], [x + 20, MIDDLE[1]], [x + 60, MIDDLE[1]]];
    let sphere = drag_until_selected(screen, bus, &places, "a sphere").await;
    assert!(selected(&sphere) != selected(&polygon), "{sphere:?}");
    key("ctrl+z");
    scene(bus, "no sphere", |s| selected(s) == 0).await;
    key("ctrl+z");
    scene(bus, "the selection as it was", |s| selected(s) == selected(before)).await;
    key("Escape");
    key("b");
}
