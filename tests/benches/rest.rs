//! The cost of a window at rest, minimised and covered, and the time until its picture is sharp after a motion.
//!
//! It is the real window on a screen of its own, with a mouse that drags. Its process's threads and their priorities come last.
//!
//!     cargo bench --workspace --bench rest -- --seconds 10 --gaussians 100000 --turns 5

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a bench fails by its helpers and prints what it measured"
)]

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use sg_proto::keys::{self, role};
use sg_proto::render::State;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_tests::bench::{argument, niceness, processor_time, quantile, thread_time};
use sg_tests::made_scene;
use sg_tests::screen::{SIZE, Screen};
use sg_tests::stack::Stack;

/// How long a window may take to open, to come to rest, or to show a change.
const PATIENCE: Duration = Duration::from_secs(120);

/// The thread of the window's loop.
const LOOP: &str = "display";

/// How often the screen is looked at after a motion.
const LOOKS: Duration = Duration::from_millis(15);

/// How long a picture must stay to be the last one of a motion.
const STAYS: Duration = Duration::from_millis(2500);

fn main() {
    let time = Duration::from_secs(argument("--seconds", 10).into());
    let (gaussians, turns) = (argument("--gaussians", 100_000), argument("--turns", 5));
    let Some(screen) = Screen::open().unwrap() else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = made_scene::write(folder.path(), gaussians).unwrap();
    let settings = [format!("service.scene.params.scene={}", scene.display())];
    let home = folder.path().to_str().unwrap();
    let env = [("DISPLAY", screen.display()), ("XDG_CONFIG_HOME", home)];
    let stack = Stack::up_of("desktop.toml", &settings, &env).unwrap();
    let window = screen.window("Super-Gaussian", PATIENCE).unwrap();
    let pid = stack.ps().iter().find(|s| s["name"] == role::RENDER_VIEW).unwrap()["pid"].as_u64().unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let bus = runtime.block_on(stack.join(role::CLI)).unwrap();
    let measured = |what: &str| {
        let begin = (frames(&runtime, &bus), processor_time(pid), thread_time(pid, LOOP), Instant::now());
        std::thread::sleep(time);
        let seconds = begin.3.elapsed().as_secs_f64();
        let share = |now: Duration, then: Duration| 100.0 * now.saturating_sub(then).as_secs_f64() / seconds;
        let (all, display) = (share(processor_time(pid), begin.1), share(thread_time(pid, LOOP), begin.2));
        println!("| {what} | {all:.2} | {display:.2} | {} |", frames(&runtime, &bus) - begin.0);
    };
    println!("{gaussians} Gaussians, window of {} × {} pixels, {} s each\n", SIZE[0], SIZE[1], time.as_secs());
    println!("| window | process, % of a core | its loop, % of a core | frames |");
    println!("| --- | --- | --- | --- |");
    rest(&runtime, &bus);
    measured("at rest");
    screen.minimize(&window).unwrap();
    rest(&runtime, &bus);
    measured("minimised");
    screen.restore(&window).unwrap();
    screen.window("Super-Gaussian", PATIENCE).unwrap();
    rest(&runtime, &bus);
    measured("at rest again");

    let (mut sharp, mut drawing): (Vec<f64>, Vec<f64>) = (0..turns)
        .map(|k| {
            let seconds = sharp_after_a_turn(&screen, k);
            (seconds, 1e-3 * told(&runtime, &bus).render_ms)
        })
        .unzip();
    let [least, median, most] = [0.0, 0.5, 1.0].map(|share| quantile(&mut sharp, share));
    println!("\nSharp after a motion: {median:.2} s ({least:.2} to {most:.2}) in {turns} turns;");
    println!("the drawing of the last picture takes {:.2} s of it.", quantile(&mut drawing, 0.5));
    let state = told(&runtime, &bus);
    println!("{}: {} pictures, {} late in motion.\n", state.engine, state.frames, state.late);

    let mut threads: BTreeMap<(i32, String), usize> = BTreeMap::new();
    for (name, nice) in niceness(pid) {
        let kind = name.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches('-').to_owned();
        *threads.entry((nice, kind)).or_default() += 1;
    }
    println!("| niceness | threads |");
    println!("| --- | --- |");
    for ((nice, kind), count) in threads {
        println!("| {nice} | {count} × {kind} |");
    }
}

fn told(runtime: &tokio::runtime::Runtime, bus: &Bus) -> State {
    runtime.block_on(bus.newest(&keys::VIEW_STATE, &Context::root())).unwrap()
}

fn frames(runtime: &tokio::runtime::Runtime, bus: &Bus) -> u64 {
    told(runtime, bus).shown
}

/// Waits until the window shows no frames for four seconds; goes on with a message if it never does.
fn rest(runtime: &tokio::runtime::Runtime, bus: &Bus) {
    let begun = Instant::now();
    let mut before = frames(runtime, bus);
    loop {
        std::thread::sleep(Duration::from_secs(4));
        let now = frames(runtime, bus);
        if before > 0 && now == before {
            return;
        }
        if begun.elapsed() > PATIENCE / 4 {
            eprintln!("the window does not come to rest: {} frames in 4 s", now - before);
            return;
        }
        before = now;
    }
}

/// Drags the scene for a second; seconds from the last motion of the mouse until the picture stays as it is then.
fn sharp_after_a_turn(screen: &Screen, turn: u32) -> f64 {
    let middle = [SIZE[0] as i32 / 2, SIZE[1] as i32 / 2];
    let way = if turn.is_multiple_of(2) { 4 } else { -4 };
    let to = |k: i32| {
        let [x, y] = [middle[0] + way * k, middle[1] + k / 3].map(|n| n.to_string());
        screen.act(&["mousemove", &x, &y]).unwrap();
    };
    to(0);
    screen.act(&["mousedown", "1"]).unwrap();
    let begun = Instant::now();
    let mut k = 0;
    while begun.elapsed() < Duration::from_secs(1) {
        k += 1;
        to(k);
        std::thread::sleep(Duration::from_millis(12));
    }
    let last = Instant::now();
    // The middle of the window: no panel and no status line.
    let region = || screen.rows((SIZE[1] / 4..3 * SIZE[1] / 4).step_by(8), 450..990).unwrap();
    let (mut newest, mut changed) = (region(), last);
    while changed.elapsed() < STAYS {
        std::thread::sleep(LOOKS);
        let now = region();
        if now != newest {
            (newest, changed) = (now, Instant::now());
        }
    }
    screen.act(&["mouseup", "1"]).unwrap();
    changed.duration_since(last).as_secs_f64()
}
