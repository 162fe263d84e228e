//! Time series: each step started from the one before, against direct starts, at equal seconds of training.
//!
//!     cargo bench --workspace --bench series -- --data ../../shared/data/volumes --seconds 20 --out series
//!
//! The series: a ball that splits and moves, a shell that grows, the synthetic vessels while a contrast agent comes in, and a scanned
//! tooth that turns by two degrees in each step. Both starts of a step are trained on the same pictures and measured with the same
//! held-out ones. The step after goes on from the warm one.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a bench fails by its helpers and prints what it measured"
)]

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use glam::{DQuat, DVec3};
use sg_fit::Options;
use sg_fit::series::{Series, StartKind};
use sg_fit::training::{Measurement, TrainingOptions, TrainingView, ViewOptions, train, volume_views};
use sg_scene::model::Scene;
use sg_volume::phantom::{VesselTree, transfer_function};
use sg_volume::transfer::{ControlPoint, Scale, Units};
use sg_volume::{Field, Grid, ScalarField, TransferFunction, Volume, read_volume};

/// Seconds at which the table has a column.
const COLUMNS: [f64; 5] = [0.0, 2.0, 5.0, 10.0, 20.0];

/// Voxels along each axis of a synthetic step.
const SIZE: usize = 96;

#[derive(Debug, Parser)]
struct Arguments {
    /// Folder of the volumes. Without it the series are synthetic.
    #[arg(long)]
    data: Option<PathBuf>,
    /// Only series of these names.
    #[arg(long = "series")]
    names: Vec<String>,
    /// Steps of each series.
    #[arg(long, default_value_t = 4)]
    steps: usize,
    /// Gaussians.
    #[arg(long, default_value_t = 10_000)]
    gaussians: usize,
    /// Seconds of training.
    #[arg(long, default_value_t = 20.0)]
    seconds: f64,
    /// Pictures to train on.
    #[arg(long, default_value_t = 48)]
    views: usize,
    /// Pixels along each edge of a picture.
    #[arg(long, default_value_t = 384)]
    size: u32,
    /// Shares of the first rates to train warm starts with. The step after goes on from the first of them.
    #[arg(long, value_delimiter = ',', default_values_t = [0.3_f32])]
    rates: Vec<f32>,
    /// Folder for `series.md`.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Passed by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// A series: its name, its function, the range of all its values, and its steps.
type Case = (&'static str, TransferFunction, [f64; 2], Box<dyn Fn(usize) -> Field>);

fn main() {
    let arguments = Arguments::parse();
    let mut table = vec![
        format!("| series, step | start | {} | render, s |", COLUMNS.map(|s| format!("{s} s")).join(" | ")),
        "| --- ".repeat(3 + COLUMNS.len()) + "|",
    ];
    for case in cases(&arguments) {
        if arguments.names.is_empty() || arguments.names.iter().any(|name| name == case.0) {
            measured(&arguments, &case, &mut table);
        }
    }
    let table = table.join("\n");
    println!("{table}");
    if let Some(out) = &arguments.out {
        std::fs::create_dir_all(out).unwrap();
        std::fs::write(out.join("series.md"), table + "\n").unwrap();
    }
}

/// The rows of one series.
fn measured(arguments: &Arguments, (name, function, range, step): &Case, table: &mut Vec<String>) {
    let options = Options { gaussians: arguments.gaussians, ..Options::default() };
    let mut series = Series::new(function, *range, options).unwrap();
    for index in 0..arguments.steps {
        let own = ScalarField::Grid(step(index).with_range(*range));
        let of_views = ViewOptions { views: arguments.views, size: arguments.size, ..ViewOptions::default() };
        let clock = Instant::now();
        let views = volume_views(own.as_ref(), series.classifier(), &of_views, |_, _| {});
        let rendering = clock.elapsed().as_secs_f64();
        let direct = series.direct(own.as_ref(), |_| {}).unwrap().unwrap();
        let clock = Instant::now();
        let start = series.start(direct.clone(), own.as_ref(), &views.0).unwrap();
        let starting = clock.elapsed().as_secs_f64();
        let mut row = |what: &str, start: &Scene, rates: f32| {
            let (scene, reached) = trained(arguments, start, &views, rates);
            let line = format!("| {name}, {index} | {what} | {} | {rendering:.1} |", reached.join(" | "));
            eprintln!("{line}");
            table.push(line);
            scene
        };
        let mut next = row("direct", &direct, 1.0);
        if start.kind == StartKind::Warm {
            for (k, rates) in arguments.rates.iter().enumerate() {
                let what =
                    format!("warm in {starting:.1} s, rates {rates}: {} went, {} came", start.removed, start.placed);
                let scene = row(&what, &start.scene, *rates);
                if k == 0 {
                    next = scene;
                }
            }
        } else if index > 0 {
            eprintln!("{name}, {index}: the direct start is better: {:?}", start.decibels);
        }
        series.finish(next, own);
    }
}

/// A trained scene, and its decibels at the seconds of the columns.
fn trained(
    arguments: &Arguments,
    start: &Scene,
    (views, held_out): &(Vec<TrainingView>, Vec<TrainingView>),
    rates: f32,
) -> (Scene, Vec<String>) {
    let defaults = TrainingOptions::default();
    let options = TrainingOptions {
        iterations: usize::MAX,
        seconds: Some(arguments.seconds),
        measure_every: 20,
        rates: defaults.rates.times(rates),
        ..defaults
    };
    let mut scene = start.clone();
    let report = train(&mut scene, views, held_out, &options, |_, _| ControlFlow::Continue(())).unwrap();
    let at = |seconds: f64| {
        let reached = report.measurements.iter().take_while(|m| m.seconds <= seconds + 0.5);
        let best = reached.map(|m: &Measurement| m.footprint_psnr_db).fold(f64::NAN, f64::max);
        if seconds > report.seconds + 1.0 { String::new() } else { format!("{best:.2}") }
    };
    (scene, COLUMNS.map(at).to_vec())
}

fn cases(arguments: &Arguments) -> Vec<Case> {
    let point = |value, color, opacity| ControlPoint { value, color, opacity };
    let function = TransferFunction {
        domain: [0.0, 200.0],
        units: Units::Raw,
        scale: Scale::Linear,
        variable: None,
        points: vec![
            point(20.0, [0.2, 0.4, 0.9], 0.0),
            point(60.0, [0.2, 0.4, 0.9], 0.3),
            point(150.0, [0.9, 0.4, 0.2], 0.9),
        ],
        base_units: Vec::new(),
    };
    let mut all: Vec<Case> = vec![
        ("splitting ball", function.clone(), [0.0, 150.0], Box::new(splitting)),
        ("growing shell", function, [0.0, 150.0], Box::new(growing)),
        ("contrast agent", transfer_function(), [0.0, 255.0], Box::new(bolus)),
    ];
    if let Some(data) = &arguments.data {
        let tooth = read_volume(&data.join("tooth_103x94x161_uint8.raw.zst")).unwrap().to_field();
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(TOOTH);
        let function = TransferFunction::load(&file).unwrap().function;
        let range = [tooth.range().low, tooth.range().high];
        all.push(("turning tooth", function, range, Box::new(move |step| turned(&tooth, step))));
    }
    all
}

/// The transfer function of the tooth, from here.
const TOOTH: &str = "../launch/demo/tooth.tf.json";

fn field(of: impl Fn(DVec3) -> f64) -> Field {
    let grid = Grid::unit([SIZE; 3]).unwrap();
    let values: Vec<f32> = (0..grid.len()).map(|i| of(grid.voxel(i).as_dvec3()) as f32).collect();
    Volume::new(grid, values.into(), None).unwrap().to_field()
}

/// 150 inside, 0 outside, within about two voxels.
fn inside(distance: f64) -> f64 {
    150.0 / (1.0 + (2.0 * distance).exp())
}

fn splitting(step: usize) -> Field {
    let t = step as f64;
    let (middle, apart) = (DVec3::new(47.5, 35.0 + 2.0 * t, 47.5), DVec3::X * (12.0 + 2.0 * t));
    field(|p| {
        [middle - apart, middle + apart].into_iter().map(|at| inside((p - at).length() - 16.0)).fold(0.0, f64::max)
    })
}

fn growing(step: usize) -> Field {
    let radius = 20.0 + 2.0 * step as f64;
    field(|p| inside(((p - DVec3::splat(47.5)).length() - radius).abs() - 2.5))
}

/// The vessels fill from below.
fn bolus(step: usize) -> Field {
    let volume = VesselTree::new().rasterize(SIZE, 0).unwrap().volume().unwrap().to_field();
    let front = SIZE as f64 * (0.4 + 0.15 * step as f64);
    let values: Vec<f32> = (0..volume.grid().len())
        .map(|i| {
            let z = volume.grid().voxel(i).as_dvec3().z;
            let filled = 1.0 / (1.0 + ((z - front) / 4.0).exp());
            (volume.raw(i) * (0.25 + 0.75 * filled)) as f32
        })
        .collect();
    Volume::new(volume.grid().clone(), values.into(), None).unwrap().to_field()
}

/// A volume turned around its middle, by two degrees in each step.
fn turned(field: &Field, step: usize) -> Field {
    let grid = field.grid();
    let bounds = grid.bounds();
    let middle = 0.5 * (bounds.min + bounds.max);
    let back = DQuat::from_axis_angle(DVec3::new(0.2, 0.3, 1.0).normalize(), -(2.0 * step as f64).to_radians());
    let value = |i: usize| {
        let world = middle + back * (grid.to_world(grid.voxel(i).as_dvec3()) - middle);
        field.sample(grid.to_voxel(world)).unwrap_or(0.0) as f32
    };
    let values: Vec<f32> = (0..grid.len()).map(value).collect();
    Volume::new(grid.clone(), values.into(), None).unwrap().to_field()
}
