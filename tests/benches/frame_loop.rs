//! What the loop of the view costs beside drawing: processor time of its process for each picture of nothing, with the
//! rest of the stack at peace and at work.
//!
//!     cargo bench --workspace --bench frame_loop -- --seconds 10 --rounds 5

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a bench fails by its helpers and prints what it measured"
)]

use std::process::Stdio;
use std::time::{Duration, Instant};

use sg_proto::keys::{self, role};
use sg_proto::render::{CaptureRequest, State};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Command, SetBackground, SetVisibility, Target};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_tests::bench::{argument, processor_time};
use sg_tests::stack::Stack;

/// Pictures a second that the view is to draw.
const PACE: f64 = 120.0;
/// Changes of the scene a second while the stack is at work: a hand that drags, at a headset's pace.
const CHANGES: f64 = 90.0;
/// Others that follow everything; one of them is stopped.
const LISTENERS: usize = 4;

/// A while of the view's life.
#[derive(Debug, Clone, Copy)]
struct While {
    /// Of its process, microseconds for each picture.
    cpu_us: f64,
    pictures_a_second: f64,
    changes_a_second: f64,
}

fn main() {
    let (time, rounds) = (Duration::from_secs(argument("--seconds", 10).into()), argument("--rounds", 5));
    let settings = [
        // One pixel of a scene that is hidden: nothing is rasterised.
        "service.render-view.params.width=1".to_owned(),
        "service.render-view.params.height=1".to_owned(),
        format!("service.render-view.params.frames_per_second={PACE}"),
        "defaults.liveness=600".to_owned(),
    ];
    let stack = Stack::up_with(&settings).unwrap();
    let pid = stack.ps().iter().find(|s| s["name"] == role::RENDER_VIEW).unwrap()["pid"].as_u64().unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        let bus = stack.join(role::CLI).await.unwrap();
        let all = Some(Target { everything: true, ..Target::default() });
        change(&bus, Action::SetVisibility(SetVisibility { target: all, visible: false })).await;
        let (mut peace, mut work) = (Vec::new(), Vec::new());
        for _ in 0..rounds {
            peace.push(measured(&bus, pid, time, &|| 0).await);
            let mut listeners: Vec<_> = (0..LISTENERS)
                .map(|_| {
                    let mut watch = stack.command().unwrap();
                    watch.args(["watch", "--json", "--all"]).stdout(Stdio::null()).spawn().unwrap()
                })
                .collect();
            tokio::time::sleep(Duration::from_millis(500)).await;
            let stopped = nix::unistd::Pid::from_raw(listeners[0].id().try_into().unwrap());
            nix::sys::signal::kill(stopped, nix::sys::signal::Signal::SIGSTOP).unwrap();
            let changes = std::sync::Arc::new(std::sync::atomic::AtomicU64::new(0));
            let (counted, hand) = (changes.clone(), bus.clone());
            let dragging = tokio::spawn(async move {
                let mut beat = tokio::time::interval(Duration::from_secs_f64(1.0 / CHANGES));
                for n in 0_u64.. {
                    beat.tick().await;
                    let color = sg_proto::scene::Color { red: (n % 256) as f32 / 255.0, green: 0.5, blue: 0.5 };
                    change(&hand, Action::SetBackground(SetBackground { color: Some(color) })).await;
                    counted.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                }
            });
            let looking = tokio::spawn(look(bus.clone()));
            let count = || changes.load(std::sync::atomic::Ordering::Relaxed);
            work.push(measured(&bus, pid, time, &count).await);
            dragging.abort();
            looking.abort();
            for listener in &mut listeners {
                listener.kill().unwrap();
                listener.wait().unwrap();
            }
        }
        let seconds = time.as_secs();
        println!("{rounds} rounds of {seconds} s each way; median of the rounds (least to most)\n");
        println!("| the rest of the stack | processor time a picture, µs | pictures a second | changes a second |");
        println!("| --- | --- | --- | --- |");
        let row = |name: &str, list: &[While]| {
            let of = |what: fn(&While) -> f64| {
                let mut all: Vec<f64> = list.iter().map(what).collect();
                all.sort_by(f64::total_cmp);
                format!("{:.0} ({:.0} to {:.0})", all[all.len() / 2], all[0], all[all.len() - 1])
            };
            println!(
                "| {name} | {} | {} | {} |",
                of(|w| w.cpu_us),
                of(|w| w.pictures_a_second),
                of(|w| w.changes_a_second)
            );
        };
        row("at peace", &peace);
        row(&format!("at work: {LISTENERS} listeners, one of them stopped; changes; captures"), &work);
    });
}

/// Pictures on request, one after another.
async fn look(bus: Bus) {
    let request = CaptureRequest { width: 64, height: 64, ..CaptureRequest::default() };
    loop {
        // Whether one comes in time is not what is measured.
        let _ = bus.ask(&keys::CAPTURE, &request, &Context::root()).await;
    }
}

async fn change(bus: &Bus, action: Action) {
    let context = Context::root();
    let command = Command { id: context.id.clone(), expected_revision: 0, action: Some(action) };
    bus.ask(&keys::SCENE_APPLY, &command, &context).await.unwrap();
}

async fn measured(bus: &Bus, pid: u64, time: Duration, changes: &dyn Fn() -> u64) -> While {
    let (begun, before, drawn, changed) = (Instant::now(), processor_time(pid), frames(bus).await, changes());
    tokio::time::sleep(time).await;
    let seconds = begun.elapsed().as_secs_f64();
    let (used, pictures) = (processor_time(pid) - before, (frames(bus).await - drawn) as f64);
    While {
        cpu_us: used.as_secs_f64() * 1e6 / pictures,
        pictures_a_second: pictures / seconds,
        changes_a_second: (changes() - changed) as f64 / seconds,
    }
}

async fn frames(bus: &Bus) -> u64 {
    let state: State = bus.newest(&keys::VIEW_STATE, &Context::root()).await.unwrap();
    state.frames
}
