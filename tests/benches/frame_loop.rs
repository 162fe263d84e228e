//! The cost of the view's loops beside drawing, with the rest of the stack idle and busy. For the view without a display: the
//! processor time of its process for each empty picture. For a window and a headset's room: the processor time of the loop's
//! thread for each frame. Other threads fill the pixels, on the cores or on a software device.
//!
//!     cargo bench --workspace --bench frame_loop -- --seconds 10 --rounds 5

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a bench fails by its helpers and prints what it measured"
)]

use std::path::Path;
use std::process::{Child, Command as Program, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use sg_proto::keys::{self, role};
use sg_proto::render::{CaptureRequest, State};
use sg_proto::scene::command::Action;
use sg_proto::scene::{SetBackground, SetVisibility, Stroke, StrokeKind, StrokeMode, Target};
use sg_proto::selection::SampleRequest;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_tests::bench::{argument, processor_time, thread_time};
use sg_tests::commands::apply;
use sg_tests::screen::Screen;
use sg_tests::small_scene::{SAC, STROKE};
use sg_tests::stack::Stack;

#[allow(dead_code, reason = "made for tests; a bench needs a runtime alone")]
#[path = "../../render-node/viewer/tests/headset/monado.rs"]
mod monado;

/// Pictures a second that the view without a display is to draw.
const PACE: f64 = 120.0;
/// Changes of the scene a second while the stack is busy, and samples of a stroke. This is the pace of a hand at a headset.
const CHANGES: f64 = 90.0;
/// Others that follow everything; one of them is stopped.
const LISTENERS: usize = 4;
/// The thread of a display's loop.
const LOOP: &str = "display";

/// The view under measurement.
struct Subject {
    name: &'static str,
    stack: Stack,
    /// Whether it is the loop of a display rather than the whole process that counts.
    display: bool,
    /// The program that moves the mouse over the window.
    mouse: Option<Program>,
}

/// A while of the view's life.
#[derive(Debug, Clone, Copy)]
struct While {
    /// Microseconds for each frame.
    cpu_us: f64,
    frames_a_second: f64,
    changes_a_second: f64,
}

fn main() {
    let (time, rounds) = (Duration::from_secs(argument("--seconds", 10).into()), argument("--rounds", 5));
    println!("{rounds} rounds of {} s each way; median of the rounds (least to most)\n", time.as_secs());
    println!("| loop | the rest of the stack | processor time a frame, µs | frames a second | changes a second |");
    println!("| --- | --- | --- | --- | --- |");
    let never = "defaults.liveness=600".to_owned();
    // One pixel of a scene that is hidden: nothing is rasterised.
    let pixel = |edge: &str| format!("service.render-view.params.{edge}=1");
    let pace = format!("service.render-view.params.frames_per_second={PACE}");
    let stack = Stack::up_with(&[pixel("width"), pixel("height"), pace, never.clone()]).unwrap();
    measure(Subject { name: "view without a display", stack, display: false, mouse: None }, time, rounds);

    let home = tempfile::tempdir().unwrap();
    let home = home.path().to_str().unwrap();
    if let Some(screen) = Screen::open().unwrap() {
        let env = [("DISPLAY", screen.display()), ("XDG_CONFIG_HOME", home)];
        let stack = Stack::up_of("desktop.toml", std::slice::from_ref(&never), &env).unwrap();
        screen.window("Super-Gaussian", Duration::from_secs(60)).unwrap();
        // To and fro over the picture and a panel, sixty times a second.
        let mut mouse = Program::new("xdotool");
        mouse.env("DISPLAY", screen.display()).stdout(Stdio::null());
        for k in 0..20_000 {
            let x = 200 + (k * 7) % 1000;
            mouse.args(["mousemove", &x.to_string(), "400", "sleep", "0.0166"]);
        }
        measure(Subject { name: "window, 1440 × 900", stack, display: true, mouse: Some(mouse) }, time, rounds);
    }
    if monado::folder().is_some() {
        let _alone = monado::alone();
        let folder = monado::room();
        let _runtime = monado::Runtime::start_in(&monado::Display::None, folder.path());
        let exec = Path::new(env!("CARGO_MANIFEST_DIR")).join("../ops/room-under-monado.sh");
        let settings = [format!("service.render-view.exec={}", exec.display()), never];
        let node = sg_tests::executable("supergaussian-render-node").unwrap();
        let env = [
            ("XDG_RUNTIME_DIR", folder.path().to_str().unwrap()),
            ("SUPERGAUSSIAN_RENDER_NODE", node.to_str().unwrap()),
        ];
        let stack = Stack::up_of("vr.toml", &settings, &env).unwrap();
        measure(Subject { name: "room under Monado", stack, display: true, mouse: None }, time, rounds);
    } else {
        eprintln!("SKIPPED: no Monado, the room is not measured");
    }
}

/// Measures one view, at peace and at work in turn.
fn measure(subject: Subject, time: Duration, rounds: u32) {
    let Subject { name, stack, display, mouse } = subject;
    let pid = stack.ps().iter().find(|s| s["name"] == role::RENDER_VIEW).unwrap()["pid"].as_u64().unwrap();
    let used = move || if display { thread_time(pid, LOOP) } else { processor_time(pid) };
    let moving = mouse.map(|mut mouse| Ended(mouse.spawn().unwrap()));
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        let bus = stack.join(role::CLI).await.unwrap();
        let all = Some(Target { everything: true, ..Target::default() });
        change(&bus, Action::SetVisibility(SetVisibility { target: all, visible: false })).await;
        let (mut peace, mut work) = (Vec::new(), Vec::new());
        for _ in 0..rounds {
            peace.push(measured(&bus, (&used, display), time, &|| 0).await);
            let listeners: Vec<Ended> = (0..LISTENERS)
                .map(|_| {
                    let mut watch = stack.command().unwrap();
                    Ended(watch.args(["watch", "--json", "--all"]).stdout(Stdio::null()).spawn().unwrap())
                })
                .collect();
            tokio::time::sleep(Duration::from_millis(500)).await;
            kill(Pid::from_raw(listeners[0].0.id().try_into().unwrap()), Signal::SIGSTOP).unwrap();
            let changes = Arc::new(AtomicU64::new(0));
            let busy = [
                tokio::spawn(drag(bus.clone(), Arc::clone(&changes))),
                tokio::spawn(draw(bus.clone())),
                tokio::spawn(look(bus.clone())),
            ];
            work.push(measured(&bus, (&used, display), time, &|| changes.load(Ordering::Relaxed)).await);
            busy.iter().for_each(tokio::task::JoinHandle::abort);
        }
        let row = |rest: &str, list: &[While]| {
            let of = |what: fn(&While) -> f64| {
                let mut all: Vec<f64> = list.iter().map(what).collect();
                all.sort_by(f64::total_cmp);
                format!("{:.0} ({:.0} to {:.0})", all[all.len() / 2], all[0], all[all.len() - 1])
            };
            let (cpu, frames) = (of(|w| w.cpu_us), of(|w| w.frames_a_second));
            println!("| {name} | {rest} | {cpu} | {frames} | {} |", of(|w| w.changes_a_second));
        };
        row("at peace", &peace);
        row("at work", &work);
    });
    drop(moving);
}

/// A program that ends with its owner.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A hand that drags a colour: a change of the scene each time.
async fn drag(bus: Bus, counted: Arc<AtomicU64>) {
    let mut beat = tokio::time::interval(Duration::from_secs_f64(1.0 / CHANGES));
    for n in 0_u64.. {
        beat.tick().await;
        let color = sg_proto::scene::Color { red: (n % 256) as f32 / 255.0, green: 0.5, blue: 0.5 };
        change(&bus, Action::SetBackground(SetBackground { color: Some(color) })).await;
        counted.fetch_add(1, Ordering::Relaxed);
    }
}

/// A hand that draws a walk stroke to and fro and never lifts the brush.
async fn draw(bus: Bus) {
    let mut beat = tokio::time::interval(Duration::from_secs_f64(1.0 / CHANGES));
    for n in 0_u64.. {
        beat.tick().await;
        let points = SAC.map(|x| x + 0.05 * ((n % 40) as f64 / 20.0 - 1.0)).to_vec();
        let (mode, kind) = (StrokeMode::Walk.into(), StrokeKind::Foreground.into());
        let samples = Some(Stroke { mode, kind, radius: STROKE, points, pressure: Vec::new(), depth: None });
        let request = SampleRequest { stroke: format!("bench-{}", n / 400), samples, ..SampleRequest::default() };
        // The measurement is not about the timeliness of answers.
        let _ = bus.ask(&keys::SELECTION_SAMPLE, &request, &Context::root()).await;
    }
}

/// Pictures on request, one after another.
async fn look(bus: Bus) {
    let request = CaptureRequest { width: 64, height: 64, ..CaptureRequest::default() };
    loop {
        // As above.
        let _ = bus.ask(&keys::CAPTURE, &request, &Context::root()).await;
    }
}

async fn change(bus: &Bus, action: Action) {
    apply(bus, action, &Context::root()).await.unwrap();
}

async fn measured(
    bus: &Bus,
    (used, display): (&impl Fn() -> Duration, bool),
    time: Duration,
    changes: &dyn Fn() -> u64,
) -> While {
    let (drawn, before) = frames(bus, used, display).await;
    let (begun, changed) = (Instant::now(), changes());
    tokio::time::sleep(time).await;
    let (newest, after) = frames(bus, used, display).await;
    let (seconds, frames) = (begun.elapsed().as_secs_f64(), (newest - drawn) as f64);
    While {
        cpu_us: (after - before).as_secs_f64() * 1e6 / frames,
        frames_a_second: frames / seconds,
        changes_a_second: (changes() - changed) as f64 / seconds,
    }
}

/// Frames so far, and the time they have taken. A display reports its frames every second; this returns just after a report.
async fn frames(bus: &Bus, used: &impl Fn() -> Duration, display: bool) -> (u64, Duration) {
    let told = async || -> State { bus.newest(&keys::VIEW_STATE, &Context::root()).await.unwrap() };
    let first = told().await;
    if !display {
        return (first.frames, used());
    }
    let begun = Instant::now();
    loop {
        let state = told().await;
        if state.shown != first.shown {
            return (state.shown, used());
        }
        assert!(begun.elapsed() < Duration::from_secs(30), "the display shows nothing new");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}
