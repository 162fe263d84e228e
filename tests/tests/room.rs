//! The room of a whole running stack under Monado, with a simulated head and hands.

#![allow(
    clippy::panic,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and says what it skips"
)]

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::{DQuat, DVec2, DVec3};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use sg_edit::EditState;
use sg_proto::keys::{self, role};
use sg_proto::scene::{ChangesRequest, State};
use sg_runtime::bus::Bus;
use sg_tests::screen::Screen;
use sg_tests::stack::Stack;
use sg_tests::until::{PATIENCE, scene, selected, soon, view};
use sg_tests::{executable, small_scene};
use sg_viewer::display::{ServiceAvailability, Tools, ViewState, WalkCapabilities};
use sg_viewer::hands::{Origin, Placement, Rectangle, Side, Stance};
use sg_viewer::panels::{Panel, PanelHost, Panels, theme};
use sg_viewer::vr::first_place;

use monado::{Controller, Display, Puppet, Runtime};

#[allow(dead_code, reason = "made for tests within the runtime's folder; this one stands outside")]
#[path = "../../render-node/viewer/tests/headset/monado.rs"]
mod monado;

/// A stack whose room is under Monado, and the person in it.
struct Person {
    puppet: Puppet,
    /// How long a hand waits until the room has seen it.
    pause: Duration,
}

fn up(folder: &Path, more: &[&str], display: &str) -> Stack {
    let exec = Path::new(env!("CARGO_MANIFEST_DIR")).join("../ops/room-under-monado.sh");
    let mut settings = vec![
        format!("service.render-view.exec={}", exec.display()),
        "service.render-view.params.resolution=0.3".to_owned(),
        "service.render-view.params.quality=fast".to_owned(),
    ];
    settings.extend(more.iter().map(|s| (*s).to_owned()));
    let node = executable("supergaussian-render-node").unwrap();
    // The script starts other programs than its own.
    let read = [monado::folder().unwrap(), node.parent().unwrap().to_owned()];
    settings.push(format!("service.render-view.read={:?}", read.map(|path| path.display().to_string())));
    let folder = folder.to_str().unwrap();
    let env =
        [("XDG_RUNTIME_DIR", folder), ("SUPERGAUSSIAN_RENDER_NODE", node.to_str().unwrap()), ("DISPLAY", display)];
    Stack::up_of("vr.toml", &settings, &env).unwrap()
}

fn units(state: &State) -> Vec<&str> {
    state.units.iter().map(|u| u.name.as_str()).collect()
}

fn process(stack: &Stack) -> i64 {
    stack.ps().iter().find(|s| s["name"] == "render-view").and_then(|s| s["pid"].as_i64()).unwrap_or(0)
}

fn logs(stack: &Stack) -> String {
    let logs = std::fs::read_dir(stack.session_folder().join("logs")).unwrap();
    logs.flatten().filter_map(|f| std::fs::read_to_string(f.path()).ok()).collect()
}

/// Waits until a line has been in the services' logs so many times.
fn said(stack: &Stack, line: &str, times: usize) {
    let begun = Instant::now();
    while logs(stack).matches(line).count() < times {
        assert!(begun.elapsed() < PATIENCE, "nobody says `{line}`:\n{}", logs(stack));
        std::thread::sleep(Duration::from_millis(50));
    }
}

impl Person {
    /// A person who comes in. The interval between frames sets the pause of the hands.
    async fn enter(bus: &Bus) -> Self {
        let puppet = Puppet::connect();
        let from = view(bus, "frames in the headset", |v| v.display == "headset" && v.frames > 0).await;
        let begun = Instant::now();
        let to = view(bus, "more frames", |v| v.shown > from.shown + 5).await;
        // The state is reported once a second.
        let period = begun.elapsed().max(Duration::from_secs(1)) / u32::try_from(to.shown - from.shown).unwrap_or(1);
        Self { puppet, pause: 4 * period.min(Duration::from_secs(1)) }
    }

    fn controller(&mut self, side: Side) -> &mut Controller {
        match side {
            Side::Left => &mut self.puppet.left,
            Side::Right => &mut self.puppet.right,
        }
    }

    async fn send(&mut self) {
        self.puppet.send();
        tokio::time::sleep(self.pause).await;
    }

    /// Moves a hand so that it points from `from` along `direction`. Monado's scripted controllers are held by their pointer.
    async fn aim(&mut self, side: Side, from: DVec3, direction: DVec3) {
        let orientation = DQuat::from_rotation_arc(DVec3::NEG_Z, direction.normalize());
        let controller = self.controller(side);
        controller.position = from.as_vec3().to_array();
        controller.orientation = orientation.as_quat().to_array();
        self.send().await;
    }

    /// Brings the tip of a brush to a place of the room.
    async fn reach(&mut self, side: Side, at: DVec3) {
        self.aim(side, at - DVec3::new(0.0, 0.0, -0.08), DVec3::NEG_Z).await;
    }

    async fn trigger(&mut self, side: Side, pulled: f32) {
        self.controller(side).trigger = pulled;
        self.send().await;
    }

    async fn stroke(&mut self, side: Side, from: DVec3, to: DVec3) {
        self.reach(side, from).await;
        self.trigger(side, 1.0).await;
        self.reach(side, to).await;
        self.trigger(side, 0.0).await;
    }

    /// Pulls the trigger once on a control of a panel.
    async fn press(&mut self, bus: &Bus, panel: Panel, typing: bool, label: &str) {
        let at = place_of(&shown(bus).await, panel, typing, label);
        let Rectangle { pose, .. } = first_place(panel, Stance::Standing, Origin::Floor);
        let size = panel.size;
        let place = first_place(panel, Stance::Standing, Origin::Floor);
        let on = place.point(DVec2::new(f64::from(at.x / size.x), f64::from(at.y / size.y)));
        let from = on + 0.4 * (pose.orientation * DVec3::Z);
        self.aim(Side::Right, from, on - from).await;
        self.trigger(Side::Right, 1.0).await;
        self.trigger(Side::Right, 0.0).await;
    }

    /// Presses the first or the second button of a hand.
    async fn button(&mut self, side: Side, second: bool) {
        for pressed in [true, false] {
            let controller = self.controller(side);
            *(if second { &mut controller.b } else { &mut controller.a }) = pressed;
            self.send().await;
        }
    }
}

/// The room's view of the scene.
async fn shown(bus: &Bus) -> ViewState {
    let request = ChangesRequest { from: 0, snapshot: true };
    let snapshot = bus.ask(&keys::SCENE_CHANGES, &request, &soon()).await.unwrap().snapshot.unwrap();
    let told = bus.newest(&keys::SCENE_STATE, &soon()).await.unwrap();
    let services = ServiceAvailability { scene: true, selection: true, agents: true, labeling: false };
    // The Select panel has a row for the answers to the newest strokes.
    let context = soon();
    let selection = loop {
        let state = bus.newest(&keys::SELECTION_STATE, &context).await.unwrap();
        if state.revision >= told.revision {
            break state;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    };
    let walk_capabilities =
        Some(WalkCapabilities { tuning: selection.tuning, most_proposals: selection.most_proposals });
    let edited = Arc::new(EditState::from_snapshot(&snapshot).unwrap());
    ViewState {
        services,
        walk_capabilities,
        answers: selection.answers.map(Arc::new),
        undo: told.undo.into(),
        redo: told.redo.into(),
        ..ViewState::of(edited)
    }
}

/// The position of a control of a panel, in points, as a headset has it.
fn place_of(shown: &ViewState, panel: Panel, typing: bool, label: &str) -> egui::Pos2 {
    use egui_kittest::kittest::Queryable as _;
    let mut panels = Panels::new(PanelHost::Headset);
    if typing {
        panels.name_selection();
    }
    let (shown, mut tools) = (shown.clone(), Tools::default());
    let harness = egui_kittest::Harness::builder().with_size(panel.size).build_ui(move |ui| {
        theme::apply(ui.ctx(), &tools);
        let _ = panels.show(panel, ui, &shown, &mut tools);
    });
    let at = harness.get_by_label(label).rect().center();
    assert!(egui::Rect::from_min_size(egui::Pos2::ZERO, panel.size).contains(at), "`{label}` is out of reach at {at}");
    at
}

/// The first position in the room of a place of the scene's box. The place is normalized.
fn at_first(shown: &ViewState, place: [f64; 3]) -> DVec3 {
    let (bounds, view) = (shown.scene.geometry().bounds, shown.scene.view());
    let placement = Placement::fit(bounds, view.up, view.target - view.eye, Stance::Standing, Origin::Floor);
    placement.to_room(bounds.denormalize(DVec3::from_array(place)))
}

#[test]
fn a_person_brushes_names_and_saves_and_the_runtime_dies() {
    if monado::folder().is_none() {
        return;
    }
    let _alone = monado::alone();
    let folder = monado::room();
    let runtime = Runtime::start_in(&Display::None, folder.path());
    let stack = up(folder.path(), &[], "");
    let tokio = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    tokio.block_on(async {
        let bus = stack.join(role::CLI).await.unwrap();
        let mut person = Person::enter(&bus).await;
        let first = shown(&bus).await;
        let sac = at_first(&first, small_scene::SAC);
        let away = sac + DVec3::new(0.0, 0.5, 0.6);
        person.reach(Side::Left, DVec3::new(-0.5, 1.0, 0.0)).await;

        // A stroke through the sac: the selection service's answer is in the scene, and in the room's frames.
        person.stroke(Side::Right, sac - 0.05 * DVec3::X, sac + 0.05 * DVec3::X).await;
        person.reach(Side::Right, away).await;
        let walked = scene(&bus, "a stroke", |s| selected(s) > 0).await;
        assert!(walked.undo.first().is_some_and(|line| line.contains("stroke")), "{:?}", walked.undo);
        view(&bus, "a frame of the selection", |v| v.revision >= walked.revision).await;

        // B takes it back, the other hand's first button brings it back.
        person.button(Side::Right, true).await;
        scene(&bus, "a stroke taken back", |s| selected(s) == 0).await;
        person.button(Side::Left, false).await;
        scene(&bus, "a stroke brought back", |s| selected(s) == selected(&walked)).await;

        // Panels: everything but the selection, and once more; a name, key by key; saved.
        person.press(&bus, Panel::SELECT, false, "invert").await;
        scene(&bus, "an inversion", |s| selected(s) > 0 && selected(s) != selected(&walked)).await;
        person.press(&bus, Panel::SELECT, false, "invert").await;
        scene(&bus, "the selection again", |s| selected(s) == selected(&walked)).await;
        person.press(&bus, Panel::SELECT, false, "name of the new unit").await;
        for key in ["s", "1"] {
            person.press(&bus, Panel::KEYBOARD, true, key).await;
        }
        person.press(&bus, Panel::SELECT, false, "save").await;
        let saved = scene(&bus, "a saved unit", |s| !s.units.is_empty()).await;
        assert_eq!(units(&saved), ["s1"]);
        person.reach(Side::Right, away).await;

        // The runtime dies. The room keeps its place, and nothing of the scene is lost.
        let pid = process(&stack);
        runtime.kill();
        said(&stack, "runtime is gone", 1);
        let without = scene(&bus, "the scene meanwhile", |_| true).await;
        assert_eq!((without.revision, selected(&without)), (saved.revision, selected(&saved)));
        let _runtime = Runtime::start_in(&Display::None, folder.path());
        said(&stack, "the headset is back", 1);
        let mut person = Person::enter(&bus).await;
        assert_eq!(process(&stack), pid, "another process");
        let after = scene(&bus, "the scene after it", |_| true).await;
        assert_eq!((after.revision, selected(&after), units(&after)), (saved.revision, selected(&saved), vec!["s1"]));
        person.reach(Side::Left, DVec3::new(-0.5, 1.0, 0.0)).await;
        person.button(Side::Right, true).await;
        scene(&bus, "an undo in the new session", |s| s.units.is_empty()).await;
        let body = at_first(&first, [0.25, 0.5, 0.5]);
        person.stroke(Side::Right, body - 0.05 * DVec3::X, body + 0.05 * DVec3::X).await;
        scene(&bus, "a stroke in the new session", |s| selected(s) > selected(&walked)).await;
    });
}

#[test]
fn a_blocked_openxr_runtime_does_not_block_shutdown() {
    if monado::folder().is_none() {
        return;
    }
    let _alone = monado::alone();
    let folder = monado::room();
    let runtime = Runtime::start_in(&Display::None, folder.path());
    let signal = |signal| kill(Pid::from_raw(runtime.pid().try_into().unwrap()), signal).unwrap();
    let mut stack = up(folder.path(), &["service.render-view.params.patience=5"], "");
    let tokio = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    tokio.block_on(async {
        let bus = stack.join(role::CLI).await.unwrap();
        let frames = async |after: u64| view(&bus, "frames", |v| v.display == "headset" && v.shown > after).await.shown;
        let first = process(&stack);
        let before = frames(0).await;

        // For a moment: a message reports it, and the same session goes on.
        signal(Signal::SIGSTOP);
        said(&stack, "it hangs or is stopped", 1);
        signal(Signal::SIGCONT);
        said(&stack, "answers again", 1);
        frames(before + 5).await;
        assert_eq!(process(&stack), first);

        // For longer than patience lasts: the process gives up and the next one finds the runtime when it goes on.
        signal(Signal::SIGSTOP);
        said(&stack, "it is asked anew", 1);
        let begun = Instant::now();
        while [0, first].contains(&process(&stack)) {
            assert!(begun.elapsed() < PATIENCE, "{:?}", stack.ps());
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        signal(Signal::SIGCONT);
        frames(0).await;
        stack.wait().unwrap();
        assert!(stack.log().contains("exit status 1"), "{}", stack.log());

        // A stack ends although its room's loop is held.
        signal(Signal::SIGSTOP);
        said(&stack, "it hangs or is stopped", 3);
    });
    let begun = Instant::now();
    let (status, _, all) = stack.run(&["down"]).unwrap();
    assert_eq!(status, Some(0), "{all}");
    assert!(stack.ended(PATIENCE).is_some());
    assert!(begun.elapsed() < Duration::from_secs(15), "{:?}", begun.elapsed());
    signal(Signal::SIGCONT);
}

#[test]
fn a_mirror_window_shows_the_headset_view() {
    if monado::folder().is_none() {
        return;
    }
    let Some(screen) = Screen::open().unwrap() else { return };
    let _alone = monado::alone();
    let folder = monado::room();
    let runtime = Runtime::start_in(&Display::None, folder.path());
    let puppet = Puppet::connect();
    let stack = up(folder.path(), &["service.render-view.params.mirror=true"], screen.display());
    let title = "what the headset shows";
    let seen = |screen: &Screen| {
        let begun = Instant::now();
        loop {
            // The scene is grey and nothing else on the screen is.
            let share = screen.shot().unwrap().share([0, 0, 640, 640], |[r, g, b]| [r, g, b].iter().all(|c| *c > 90));
            if share > 0.02 {
                return;
            }
            assert!(begun.elapsed() < PATIENCE, "no scene in the mirror: {share}\n{}", logs(&stack));
            std::thread::sleep(Duration::from_millis(100));
        }
    };
    screen.window(title, PATIENCE).unwrap();
    seen(&screen);
    // Another runtime, another device: the same window.
    drop(puppet);
    runtime.kill();
    let _runtime = Runtime::start_in(&Display::None, folder.path());
    let _puppet = Puppet::connect();
    said(&stack, "the headset is back", 1);
    let tokio = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let (bus, before) = tokio.block_on(async {
        let bus = stack.join(role::CLI).await.unwrap();
        let before = view(&bus, "frames", |v| v.display == "headset" && v.frames > 0).await.shown;
        (bus, before)
    });
    seen(&screen);

    // Closing it closes nothing else.
    let pid = process(&stack);
    screen.window(title, PATIENCE).unwrap();
    screen.act(&["key", "ctrl+q"]).unwrap();
    said(&stack, "the mirror was closed", 1);
    let begun = Instant::now();
    while screen.act(&["search", "--onlyvisible", "--name", title]).is_ok() {
        assert!(begun.elapsed() < PATIENCE, "the window is still there");
        std::thread::sleep(Duration::from_millis(50));
    }
    tokio.block_on(async { view(&bus, "frames without a mirror", |v| v.shown > before + 5).await });
    assert_eq!(process(&stack), pid);
}
