//! The latency of answers to a hand, over the bus of a running stack, at the pace of a headset. One time runs from a sample of a
//! stroke to its preview selection. The other runs from the stroke's end to the committed selection.
//!
//!     cargo bench --workspace --bench strokes -- --gaussians 170000 --strokes 10
//!
//! With `--pictures 90` the view draws all the while, on every core. With `--every-scale 0` walks have one fixed leak.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a bench fails by its helpers and prints what it measured"
)]

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use sg_proto::keys::{self, role};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Color, SetBackground, Stroke, StrokeKind, StrokeMode};
use sg_proto::selection::{SampleRequest, StrokesRequest};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_tests::bench::{argument, processor_time, quantile, waiting_time};
use sg_tests::commands::apply;
use sg_tests::made_scene;
use sg_tests::stack::Stack;

/// Samples a second, and of one stroke: three seconds.
const PACE: f64 = 90.0;
const SAMPLES: usize = 270;
/// Radius of the brush, a fraction of the box's longest edge.
const RADIUS: f64 = 0.03;
/// Upper ends of the histogram's bins, milliseconds.
const BINS: [f64; 9] = [0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 15.0, 30.0, f64::INFINITY];

/// Measurements of the strokes of one mode, in milliseconds.
#[derive(Default)]
struct Measured {
    /// From sending a sample to its answer, while the view drew no picture.
    at_rest: Vec<f64>,
    /// The same while it drew one.
    drawing: Vec<f64>,
    /// Of either, in the selection process.
    preview: Vec<f64>,
    /// From sending the whole stroke to receiving its selection.
    seen: Vec<f64>,
    /// From sending the whole stroke to the committed, durable selection.
    end: Vec<f64>,
    /// The part of that in the selection process: hit test, walk, mask.
    step: Vec<f64>,
    /// Processor time of the selection process by the clock.
    cpu: Duration,
    clock: Duration,
    /// How long threads waited for a core while samples were drawn: this process's, the router's, selection's.
    waited: [Duration; 3],
}

/// Every service that a sample passes through.
struct Stage {
    bus: Bus,
    pids: [u64; 3],
    /// When the view drew, newest last.
    pictures: Arc<Mutex<Vec<(Instant, Instant)>>>,
}

fn main() {
    let (gaussians, strokes) = (argument("--gaussians", 170_000), argument("--strokes", 10));
    let pictures = argument("--pictures", 0);
    let folder = tempfile::tempdir().unwrap();
    let scene = made_scene::write(folder.path(), gaussians).unwrap();
    let every_scale = argument("--every-scale", 1) != 0;
    let settings = [
        format!("service.selection.params.every_scale={every_scale}"),
        format!("service.scene.params.scene={}", scene.display()),
        format!("service.render-view.params.frames_per_second={pictures}.0"),
    ];
    let stack = Stack::up_with(&settings).unwrap();
    let selection = stack.ps().iter().find(|s| s["name"] == role::SELECTION).unwrap()["pid"].as_u64().unwrap();
    let pids = [u64::from(std::process::id()), u64::from(stack.supervisor()), selection];
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        let bus = stack.join(role::CLI).await.unwrap();
        let stage = Stage { pictures: watch(&bus).await, bus, pids };
        let clusters = stage.bus.newest(&keys::SELECTION_STATE, &Context::root()).await.unwrap().clusters;
        println!("{gaussians} Gaussians, {clusters} Super-Gaussians, {strokes} strokes of {SAMPLES} samples at {PACE} a second, the view's pictures a second at least {pictures}; ms\n");
        println!("| mode | sample to preview: median / p99 / most | of that in the process: median / p99 | samples while a picture is drawn: number, p99 | else: p99 | end to result seen: median / p99 / most | to result durable: median / p99 / most | of that in the process: median / p99 | processor |");
        println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
        let mut histograms = Vec::new();
        for mode in [StrokeMode::Point, StrokeMode::Cluster, StrokeMode::Walk] {
            let mut measured = Measured::default();
            for number in 0..strokes {
                draw(&stage, mode, number, &mut measured).await;
            }
            let Measured { at_rest, drawing, preview, seen, end, step, cpu, clock, waited } = &mut measured;
            let mut sample = [&at_rest[..], &drawing[..]].concat();
            let name = mode.as_str_name().trim_start_matches("STROKE_MODE_").to_lowercase();
            println!(
                "| {name} | {:.2} / {:.2} / {:.2} | {:.2} / {:.2} | {}, {:.2} | {:.2} | {:.1} / {:.1} / {:.1} | {:.1} / {:.1} / {:.1} | {:.1} / {:.1} | {:.0} % |",
                quantile(&mut sample, 0.5),
                quantile(&mut sample, 0.99),
                quantile(&mut sample, 1.0),
                quantile(preview, 0.5),
                quantile(preview, 0.99),
                drawing.len(),
                quantile(drawing, 0.99),
                quantile(at_rest, 0.99),
                quantile(seen, 0.5),
                quantile(seen, 0.99),
                quantile(seen, 1.0),
                quantile(end, 0.5),
                quantile(end, 0.99),
                quantile(end, 1.0),
                quantile(step, 0.5),
                quantile(step, 0.99),
                100.0 * cpu.as_secs_f64() / clock.as_secs_f64(),
            );
            let each = waited.map(|w| w.as_secs_f64() * 1e6 / sample.len().max(1) as f64);
            histograms.push((name, sample, each));
        }
        let mut alone = Vec::new();
        for n in 0..50_u8 {
            let color = Some(Color { red: f32::from(n) / 50.0, green: 0.5, blue: 0.5 });
            let (action, context) = (Action::SetBackground(SetBackground { color }), context());
            let sent = Instant::now();
            apply(&stage.bus, action, &context).await.unwrap();
            alone.push(sent.elapsed().as_secs_f64() * 1e3);
            // The view's drawing of this change must not delay the next one.
            tokio::time::sleep(Duration::from_millis(400)).await;
        }
        println!("\nOf a committed selection, what every durable change of the scene takes: {:.1} / {:.1}", quantile(&mut alone, 0.5), quantile(&mut alone, 0.99));
        println!("\nSamples by the time of their preview, and how long threads waited for a core, µs a sample:\n");
        let bin = |k: usize| if BINS[k].is_finite() { format!("≤ {}", BINS[k]) } else { "more".to_owned() };
        println!("| mode | {} | the hand's process, the router's, selection's |", (0..BINS.len()).map(bin).collect::<Vec<_>>().join(" | "));
        println!("| --- |{} --- |", " --- |".repeat(BINS.len()));
        for (name, sample, waited) in histograms {
            let mut counts = [0_usize; BINS.len()];
            for ms in sample {
                counts[BINS.iter().position(|b| ms <= *b).unwrap()] += 1;
            }
            println!("| {name} | {} | {} |", counts.map(|c| c.to_string()).join(" | "), waited.map(|w| format!("{w:.0}")).join(", "));
        }
    });
}

/// Notes when the view drew.
async fn watch(bus: &Bus) -> Arc<Mutex<Vec<(Instant, Instant)>>> {
    let pictures = Arc::new(Mutex::new(Vec::new()));
    let mut frames = bus.subscribe(&keys::VIEW_FRAME, role::RENDER_VIEW, 64).await.unwrap();
    let noted = Arc::clone(&pictures);
    tokio::spawn(async move {
        while let Some((frame, _)) = frames.next().await {
            let now = Instant::now();
            noted.lock().unwrap().push((now - Duration::from_secs_f64(frame.render_ms / 1e3), now));
        }
    });
    pictures
}

/// Draws one stroke sample by sample, then commits it as a whole.
async fn draw(stage: &Stage, mode: StrokeMode, number: u32, measured: &mut Measured) {
    let Stage { bus, pids, pictures } = stage;
    let restart = StrokesRequest { restart: true, ..StrokesRequest::default() };
    bus.ask(&keys::SELECTION_STROKES, &restart, &context()).await.unwrap();
    let name = format!("{mode:?}-{number}");
    let (began, used, waited) = (Instant::now(), processor_time(pids[2]), pids.map(waiting_time));
    let mut beat = tokio::time::interval(Duration::from_secs_f64(1.0 / PACE));
    let whole: Vec<f64> = (0..SAMPLES).flat_map(|k| hand(number, k)).collect();
    let stroke = |points: Vec<f64>| Stroke {
        mode: mode.into(),
        kind: StrokeKind::Foreground.into(),
        radius: RADIUS,
        points,
        pressure: Vec::new(),
        depth: None,
    };
    let mut answered = Vec::with_capacity(SAMPLES);
    for sample in whole.chunks(3) {
        beat.tick().await;
        let request =
            SampleRequest { stroke: name.clone(), samples: Some(stroke(sample.to_vec())), ..SampleRequest::default() };
        let sent = Instant::now();
        let reply = bus.ask(&keys::SELECTION_SAMPLE, &request, &context()).await.unwrap();
        answered.push((sent, Instant::now()));
        measured.preview.push(reply.preview_ms);
    }
    measured.cpu += processor_time(pids[2]) - used;
    measured.clock += began.elapsed();
    for (sum, (pid, before)) in measured.waited.iter_mut().zip(pids.iter().zip(waited)) {
        *sum += waiting_time(*pid).saturating_sub(before);
    }
    let request = StrokesRequest { strokes: vec![stroke(whole)], ..StrokesRequest::default() };
    let mut previews = bus.subscribe(&keys::SELECTION_PREVIEW, role::SELECTION, 8).await.unwrap();
    // So that every router on the way knows the subscribers.
    tokio::time::sleep(Duration::from_millis(50)).await;
    let context = context();
    let sent = Instant::now();
    let (reply, seen) = tokio::join!(bus.ask(&keys::SELECTION_STROKES, &request, &context), async {
        let (_, told) = previews.next().await.unwrap();
        assert_eq!(told.cause, context.id, "what is told is of this stroke");
        sent.elapsed()
    });
    measured.end.push(sent.elapsed().as_secs_f64() * 1e3);
    measured.seen.push(seen.as_secs_f64() * 1e3);
    let reply = reply.unwrap();
    measured.step.push(reply.walk_ms);
    // A picture is reported when it is done. Pictures under way at the last sample are waited for.
    tokio::time::sleep(Duration::from_secs(1)).await;
    let drawn = std::mem::take(&mut *pictures.lock().unwrap());
    for (sent, back) in answered {
        let during = drawn.iter().any(|(from, to)| sent < *to && *from < back);
        let list = if during { &mut measured.drawing } else { &mut measured.at_rest };
        list.push((back - sent).as_secs_f64() * 1e3);
    }
}

fn context() -> Context {
    Context::root().deadline_in(Duration::from_secs(30))
}

/// The position of a hand at a sample: a smooth curve through the middle of the box, another one for each stroke.
fn hand(number: u32, sample: usize) -> [f64; 3] {
    let (t, phase) = (sample as f64 / SAMPLES as f64, f64::from(number) * 0.7);
    let wave = |k: f64, shift: f64| 0.5 + 0.25 * (std::f64::consts::TAU * t * k + phase + shift).sin();
    [wave(1.0, 0.0), wave(0.7, 1.0), wave(1.3, 2.0)]
}
