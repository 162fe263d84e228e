//! A window at rest, and one whose services stand still.

use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use sg_proto::keys::role;
use sg_runtime::bus::Bus;
use sg_tests::bench::niceness;
use sg_tests::screen::Screen;
use sg_tests::stack::{SERVICES, Stack};
use sg_tests::until::{PATIENCE, scene, view};

use crate::MIDDLE;

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
        assert_eq!(others.len(), SERVICES - 1);
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
