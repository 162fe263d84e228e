//! How fast a hand is answered: from a sample of a stroke to what the stroke would select so far, and from its end to the
//! selection that is committed, over the bus of a running stack, at the pace of a headset.
//!
//!     cargo bench --workspace --bench strokes -- --gaussians 170000 --strokes 10

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a bench fails by its helpers and prints what it measured"
)]

use std::time::{Duration, Instant};

use sg_proto::keys::{self, role};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Color, Command, SetBackground, Stroke, StrokeKind, StrokeMode};
use sg_proto::selection::{SampleRequest, StrokesRequest};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_tests::bench::{argument, processor_time, quantile};
use sg_tests::made_scene;
use sg_tests::stack::Stack;

/// Samples a second, and of one stroke: three seconds.
const PACE: f64 = 90.0;
const SAMPLES: usize = 270;
/// Radius of the brush, a fraction of the box's longest edge.
const RADIUS: f64 = 0.03;
/// Upper ends of the histogram's bins, milliseconds.
const BINS: [f64; 9] = [0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 15.0, 30.0, f64::INFINITY];

/// What was measured of the strokes of one mode, milliseconds.
#[derive(Default)]
struct Measured {
    /// From sending a sample to its answer.
    sample: Vec<f64>,
    /// Of that, in the selection process.
    preview: Vec<f64>,
    /// From sending the whole stroke to the committed selection.
    end: Vec<f64>,
    /// Of that, in the selection process: what the stroke hits, the walk, the mask.
    step: Vec<f64>,
    /// Processor time of the selection process by the clock.
    cpu: Duration,
    clock: Duration,
}

fn main() {
    let (gaussians, strokes) = (argument("--gaussians", 170_000), argument("--strokes", 10));
    let folder = tempfile::tempdir().unwrap();
    let scene = made_scene::write(folder.path(), gaussians).unwrap();
    let stack = Stack::up_with(&[format!("service.scene.params.scene={}", scene.display())]).unwrap();
    let pid = stack.ps().iter().find(|s| s["name"] == role::SELECTION).unwrap()["pid"].as_u64().unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        let bus = stack.join(role::CLI).await.unwrap();
        let clusters = bus.newest(&keys::SELECTION_STATE, &Context::root()).await.unwrap().clusters;
        println!("{gaussians} Gaussians, {clusters} Super-Gaussians, {strokes} strokes of {SAMPLES} samples at {PACE} a second; ms\n");
        println!("| mode | sample to preview: median / p99 / most | of that in the process: median / p99 | end to committed selection: median / p99 | of that in the process: median / p99 | processor |");
        println!("| --- | --- | --- | --- | --- | --- |");
        let mut histograms = Vec::new();
        for mode in [StrokeMode::Point, StrokeMode::Cluster, StrokeMode::Walk] {
            let mut measured = Measured::default();
            for number in 0..strokes {
                draw(&bus, pid, mode, number, &mut measured).await;
            }
            let Measured { sample, preview, end, step, cpu, clock } = &mut measured;
            println!(
                "| {} | {:.2} / {:.2} / {:.2} | {:.2} / {:.2} | {:.1} / {:.1} | {:.1} / {:.1} | {:.0} % |",
                mode.as_str_name().trim_start_matches("STROKE_MODE_").to_lowercase(),
                quantile(sample, 0.5),
                quantile(sample, 0.99),
                quantile(sample, 1.0),
                quantile(preview, 0.5),
                quantile(preview, 0.99),
                quantile(end, 0.5),
                quantile(end, 0.99),
                quantile(step, 0.5),
                quantile(step, 0.99),
                100.0 * cpu.as_secs_f64() / clock.as_secs_f64(),
            );
            histograms.push((mode, measured.sample));
        }
        let mut alone = Vec::new();
        for n in 0..50_u8 {
            let color = Some(Color { red: f32::from(n) / 50.0, green: 0.5, blue: 0.5 });
            let action = Some(Action::SetBackground(SetBackground { color }));
            let context = context();
            let command = Command { id: context.id.clone(), expected_revision: 0, action };
            let sent = Instant::now();
            bus.ask(&keys::SCENE_APPLY, &command, &context).await.unwrap();
            alone.push(sent.elapsed().as_secs_f64() * 1e3);
            // What the view draws of it is not to be in the way of the next.
            tokio::time::sleep(Duration::from_millis(400)).await;
        }
        println!("\nOf a committed selection, what every durable change of the scene takes: {:.1} / {:.1}", quantile(&mut alone, 0.5), quantile(&mut alone, 0.99));
        println!("\nSamples by the time of their preview:\n");
        let bin = |k: usize| if BINS[k].is_finite() { format!("≤ {}", BINS[k]) } else { "more".to_owned() };
        println!("| mode | {} |", (0..BINS.len()).map(bin).collect::<Vec<_>>().join(" | "));
        println!("| --- |{}", " --- |".repeat(BINS.len()));
        for (mode, sample) in histograms {
            let mut counts = [0_usize; BINS.len()];
            for ms in sample {
                counts[BINS.iter().position(|b| ms <= *b).unwrap()] += 1;
            }
            let name = mode.as_str_name().trim_start_matches("STROKE_MODE_").to_lowercase();
            println!("| {name} | {} |", counts.map(|c| c.to_string()).join(" | "));
        }
    });
}

/// Draws one stroke sample by sample, then commits it as a whole.
async fn draw(bus: &Bus, pid: u64, mode: StrokeMode, number: u32, measured: &mut Measured) {
    let restart = StrokesRequest { restart: true, ..StrokesRequest::default() };
    bus.ask(&keys::SELECTION_STROKES, &restart, &context()).await.unwrap();
    let name = format!("{mode:?}-{number}");
    let (began, before) = (Instant::now(), processor_time(pid));
    let mut beat = tokio::time::interval(Duration::from_secs_f64(1.0 / PACE));
    let whole: Vec<f64> = (0..SAMPLES).flat_map(|k| hand(number, k)).collect();
    let stroke = |points: Vec<f64>| Stroke {
        mode: mode.into(),
        kind: StrokeKind::Foreground.into(),
        radius: RADIUS,
        points,
        pressure: Vec::new(),
    };
    for sample in whole.chunks(3) {
        beat.tick().await;
        let request = SampleRequest { stroke: name.clone(), samples: Some(stroke(sample.to_vec())) };
        let sent = Instant::now();
        let reply = bus.ask(&keys::SELECTION_SAMPLE, &request, &context()).await.unwrap();
        measured.sample.push(sent.elapsed().as_secs_f64() * 1e3);
        measured.preview.push(reply.preview_ms);
    }
    measured.cpu += processor_time(pid) - before;
    measured.clock += began.elapsed();
    let request = StrokesRequest { strokes: vec![stroke(whole)], ..StrokesRequest::default() };
    let sent = Instant::now();
    let reply = bus.ask(&keys::SELECTION_STROKES, &request, &context()).await.unwrap();
    measured.end.push(sent.elapsed().as_secs_f64() * 1e3);
    measured.step.push(reply.walk_ms);
}

fn context() -> Context {
    Context::root().deadline_in(Duration::from_secs(30))
}

/// Where a hand is at a sample: a smooth curve through the middle of the box, another one for each stroke.
fn hand(number: u32, sample: usize) -> [f64; 3] {
    let (t, phase) = (sample as f64 / SAMPLES as f64, f64::from(number) * 0.7);
    let wave = |k: f64, shift: f64| 0.5 + 0.25 * (std::f64::consts::TAU * t * k + phase + shift).sin();
    [wave(1.0, 0.0), wave(0.7, 1.0), wave(1.3, 2.0)]
}
