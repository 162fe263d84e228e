//! Training of Gaussians on pictures of a volume or a mesh: quality over seconds, and edits against the same edits of the transfer
//! function, for several volumes. Before that, the ray marching of these pictures: the marcher in f32 against its exact twin.
//! And direct starts by their number of Gaussians. With `--functions`: other transfer functions for one scene.
//!
//!     cargo bench --workspace --bench training -- --data ../../shared/data/volumes --seconds 60 --out training
//!
//! Each volume has the transfer function of the demo (`launch/demo`). The synthetic volume needs no file. Held-out cameras are those
//! of the seed, so they are the same for every run. Decibels are over the footprint: pixels that the volume or the
//! Gaussians cover by more than 1/1024.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a bench fails by its helpers and prints what it measured"
)]

mod functions;

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Parser;
use glam::{DVec3, Vec3};
use plotters::prelude::{ChartBuilder, Color, LineSeries, PathElement, SeriesLabelPosition};
use sg_fit::training::{Measurement, TrainingOptions, TrainingView, ViewOptions, train, volume_views};
use sg_fit::{Options, direct_start};
use sg_raster::image::Image;
use sg_raster::image_error::Difference;
use sg_raster::render::{Quality, render};
use sg_raster::volume::{fast_march, march, region};
use sg_scene::appearance::{Appearance, Clip};
use sg_scene::camera::{Camera, LightMode};
use sg_scene::model::Scene;
use sg_tests::plot::{BLUE, Drawn, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILION, svg};
use sg_volume::phantom::{self, VesselTree};
use sg_volume::transfer::ControlPoint;
use sg_volume::{ReadOptions, ScalarField, ScalarFieldRef, TransferFunction, read_dataset};

/// The synthetic volume, real ones and meshes: the file below the folder of volumes, and the transfer function from here.
const VOLUMES: [(&str, Option<[&str; 2]>); 8] = [
    ("phantom", None),
    ("bonsai", Some(["bonsai_256x256x256_uint8.raw.zst", "../launch/demo/bonsai.tf.json"])),
    ("aneurism", Some(["aneurism_256x256x256_uint8.raw.zst", "../launch/demo/aneurism.tf.json"])),
    ("tooth", Some(["tooth_103x94x161_uint8.raw.zst", "../launch/demo/tooth.tf.json"])),
    ("lobster", Some(["lobster_small_120x120x34_uint8.raw.zst", "benches/transfer-functions/lobster.tf.json"])),
    ("heptane", Some(["heptane_cropped_302x302x302_uint8.raw.zst", "benches/transfer-functions/heptane.tf.json"])),
    ("blunt fin", Some(["../meshes/bluntfin_187395tets.vtu.zst", "benches/transfer-functions/bluntfin.tf.json"])),
    ("combustor", Some(["../meshes/comb_215040tets.vtu.zst", "benches/transfer-functions/combustor.tf.json"])),
];

/// Seconds at which the table has a column.
const COLUMNS: [f64; 6] = [0.0, 5.0, 15.0, 30.0, 60.0, 180.0];

/// Gaussians of the direct starts.
const STARTS: [usize; 5] = [1500, 5000, 20_000, 50_000, 200_000];

/// Opacity of a faded base unit.
const FADED: f32 = 0.2;

#[derive(Debug, Parser)]
struct Arguments {
    /// Folder of the volumes. Without it the synthetic volume is the only one.
    #[arg(long)]
    data: Option<PathBuf>,
    /// Only volumes of these names.
    #[arg(long = "volume")]
    volumes: Vec<String>,
    /// Gaussians.
    #[arg(long, default_value_t = 20_000)]
    gaussians: usize,
    /// Seconds of training.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// Pictures to train on.
    #[arg(long, default_value_t = 96)]
    views: usize,
    /// Pixels along each edge of a picture.
    #[arg(long, default_value_t = 512)]
    size: u32,
    /// Folder for `training.md`, `training.svg` and a strip of pictures for each volume: the volume, the direct start, the trained
    /// scene, and eight times the difference.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Measure other transfer functions for scenes of the first one, and nothing else. Writes `functions.md`.
    #[arg(long)]
    functions: bool,
    /// Passed by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// A change of a picture, made to the transfer function and to the Gaussians.
struct Edit {
    name: String,
    function: TransferFunction,
    camera: Camera,
    clip: Option<Clip>,
    /// Palette shift, opacity and visibility of each base unit.
    units: Vec<(Vec3, f32, bool)>,
}

/// The tables of the run, line by line.
struct Tables {
    marching: Vec<String>,
    starts: Vec<String>,
    training: Vec<String>,
    edits: Vec<String>,
}

struct Course {
    name: &'static str,
    measurements: Vec<Measurement>,
}

fn main() {
    let arguments = Arguments::parse();
    if arguments.functions {
        return other_functions(&arguments);
    }
    let mut tables = Tables {
        marching: head(&["volume", "exact, ms", "f32, ms", "RMS error", "greatest error"]),
        starts: head(&["volume, Gaussians", "s", "dB over the footprint", "least", "dB of the frame", "SSIM"]),
        training: head(&[
            "volume, Gaussians",
            "views, s",
            &COLUMNS.map(|s| format!("{s} s")).join(" | "),
            "steps in a second",
            "SSIM: start, result",
            "least dB: start, result",
            "coverage",
        ]),
        edits: head(&["volume", "edit", "dB: direct start", "trained", "trained, to the unedited picture"]),
    };
    let mut courses = Vec::new();
    for (name, files) in VOLUMES {
        let is_asked = arguments.volumes.is_empty() || arguments.volumes.iter().any(|v| v == name);
        let Some((field, function)) = is_asked.then(|| volume(&arguments, files)).flatten() else { continue };
        tables.marching.push(marched(&arguments, name, field.as_ref(), &function));
        courses.push(measured(&arguments, name, field.as_ref(), &function, &mut tables));
    }
    let Tables { marching, starts, training, edits } = tables;
    let tables = [marching, starts, training, edits].map(|lines| lines.join("\n")).join("\n\n");
    println!("{tables}");
    if let Some(out) = &arguments.out {
        std::fs::create_dir_all(out).unwrap();
        std::fs::write(out.join("training.md"), tables + "\n").unwrap();
        std::fs::write(out.join("training.svg"), svg((900, 420), |area| draw(area, &courses)).unwrap()).unwrap();
    }
}

/// The table of other transfer functions.
fn other_functions(arguments: &Arguments) {
    let mut table = functions::columns();
    for (name, files) in VOLUMES {
        let is_asked = arguments.volumes.is_empty() || arguments.volumes.iter().any(|v| v == name);
        let Some((field, function)) = is_asked.then(|| volume(arguments, files)).flatten() else { continue };
        let ScalarField::Grid(field) = field else { continue };
        let rows = functions::rows(arguments, name, &field, &function);
        rows.iter().for_each(|row| eprint_line(row));
        table.extend(rows);
    }
    let table = table.join("\n");
    println!("{table}");
    if let Some(out) = &arguments.out {
        std::fs::create_dir_all(out).unwrap();
        std::fs::write(out.join("functions.md"), table + "\n").unwrap();
    }
}

/// The first two lines of a table.
fn head(columns: &[&str]) -> Vec<String> {
    let line = format!("| {} |", columns.join(" | "));
    let rule = "| --- ".repeat(line.matches('|').count() - 1) + "|";
    vec![line, rule]
}

fn volume(arguments: &Arguments, files: Option<[&str; 2]>) -> Option<(ScalarField, TransferFunction)> {
    let Some([file, function]) = files else {
        let raster = VesselTree::new().rasterize(128, 0).unwrap();
        return Some((ScalarField::Grid(raster.volume().unwrap().to_field()), phantom::transfer_function()));
    };
    let path = arguments.data.as_ref()?.join(file);
    let function = Path::new(env!("CARGO_MANIFEST_DIR")).join(function);
    let function = TransferFunction::load(&function).unwrap().function;
    let options = ReadOptions { preferred: function.variable.clone(), ..ReadOptions::default() };
    Some((read_dataset(&path, &options).unwrap_or_else(|e| panic!("{e}")).to_field(), function))
}

/// A row of ray marching: both marchers on the same cameras, in turn.
fn marched(arguments: &Arguments, name: &str, field: ScalarFieldRef<'_>, function: &TransferFunction) -> String {
    let classifier = function.classifier(field.range()).unwrap();
    let of_views = ViewOptions { views: 0, held_out: 4, size: arguments.size, ..ViewOptions::default() };
    let (_, views) = volume_views(field, &classifier, &of_views, |_, _| {});
    let marcher = field.marcher(classifier, 0.5);
    let (mut seconds, mut squares, mut greatest, mut numbers) = ([0.0; 2], 0.0, 0.0_f64, 0);
    for view in &views {
        let mut pictures = [march, fast_march].into_iter().zip(&mut seconds).map(|(march, seconds)| {
            let clock = Instant::now();
            let picture = march(&marcher, &view.camera);
            *seconds += clock.elapsed().as_secs_f64();
            picture
        });
        let (exact, fast) = (pictures.next().unwrap(), pictures.next().unwrap());
        for (a, b) in exact.rgba.iter().zip(&fast.rgba) {
            let error = f64::from((a - b).abs());
            squares += error * error;
            greatest = greatest.max(error);
            numbers += 1;
        }
    }
    let [exact, fast] = seconds.map(|seconds| 1e3 * seconds / views.len() as f64);
    let rms = (squares / f64::from(numbers)).sqrt();
    format!("| {name} | {exact:.0} | {fast:.0} ({:.2}×) | {rms:.6} | {greatest:.4} |", fast / exact)
}

/// A row for each number of Gaussians: the direct start against the held-out pictures.
fn started(
    name: &str,
    field: ScalarFieldRef<'_>,
    function: &TransferFunction,
    held_out: &[TrainingView],
) -> Vec<String> {
    let rows = STARTS.into_iter().map(|gaussians| {
        let clock = Instant::now();
        let options = Options { gaussians, ..Options::default() };
        let mut scene = direct_start(field, function, &options, |_| {}).unwrap().scene;
        let seconds = clock.elapsed().as_secs_f64();
        let none = TrainingOptions { iterations: 0, ..TrainingOptions::default() };
        let found = train(&mut scene, held_out, held_out, &none, |_, _| ControlFlow::Continue(())).unwrap().result;
        format!(
            "| {name}, {} | {seconds:.1} | {:.1} | {:.1} | {:.1} | {:.3} |",
            scene.len(),
            found.footprint_psnr_db,
            found.least_footprint_psnr_db,
            found.psnr_db,
            found.ssim
        )
    });
    rows.collect()
}

/// Trains on one volume; adds a row of quality, and rows of edits.
fn measured(
    arguments: &Arguments,
    name: &'static str,
    field: ScalarFieldRef<'_>,
    function: &TransferFunction,
    tables: &mut Tables,
) -> Course {
    let options = Options { gaussians: arguments.gaussians, ..Options::default() };
    let start = direct_start(field, function, &options, |_| {}).unwrap().scene;
    let classifier = function.classifier(field.range()).unwrap();
    let of_views = ViewOptions { views: arguments.views, size: arguments.size, ..ViewOptions::default() };
    let clock = Instant::now();
    let (views, held_out) = volume_views(field, &classifier, &of_views, |_, _| {});
    let rendering = clock.elapsed().as_secs_f64();
    tables.starts.extend(started(name, field, function, &held_out));
    let options = TrainingOptions {
        iterations: usize::MAX,
        seconds: Some(arguments.seconds),
        measure_every: 25,
        ..TrainingOptions::default()
    };
    let mut scene = start.clone();
    let report = train(&mut scene, &views, &held_out, &options, |found, _| {
        eprint_line(&format!("{name}: {:.1} s, {:.2} dB", found.seconds, found.footprint_psnr_db));
        ControlFlow::Continue(())
    })
    .unwrap();
    let at = |seconds: f64| {
        let reached = report.measurements.iter().rev().find(|m| m.seconds <= seconds + 0.5);
        let is_over = seconds > report.seconds + 1.0;
        reached.filter(|_| !is_over).map_or_else(String::new, |m| format!("{:.1}", m.footprint_psnr_db))
    };
    let (first, result) = (report.measurements[0], report.result);
    tables.training.push(format!(
        "| {name}, {} | {}, {rendering:.1} | {} | {:.1} | {:.3}, {:.3} | {:.1}, {:.1} | {:.2} |",
        scene.len(),
        views.len(),
        COLUMNS.map(at).join(" | "),
        report.iterations as f64 / report.seconds,
        first.ssim,
        result.ssim,
        first.least_footprint_psnr_db,
        result.least_footprint_psnr_db,
        result.coverage
    ));
    let view = &held_out[0];
    strip(arguments, name, view, [&start, &scene]);
    for edit in all_edits(&start, field, function, &view.camera) {
        let reference = edit.reference(field);
        let [before, after] = [&start, &scene].map(|scene| decibels(&edit.drawn(scene), &reference));
        let change = decibels(&view.reference, &reference);
        tables.edits.push(format!("| {name} | {} | {before:.1} | {after:.1} | {change:.1} |", edit.name));
    }
    Course { name, measurements: report.measurements }
}

#[allow(clippy::print_stderr, reason = "a run takes minutes")]
fn eprint_line(line: &str) {
    eprintln!("{line}");
}

fn decibels(picture: &Image, reference: &Image) -> f64 {
    Difference::between(picture, reference).unwrap().footprint_psnr_db
}

/// The edits of a scene, seen by one camera.
fn all_edits(scene: &Scene, field: ScalarFieldRef<'_>, function: &TransferFunction, camera: &Camera) -> Vec<Edit> {
    let count = scene.units.len();
    let plain = |name: &str| Edit {
        name: name.to_owned(),
        function: function.clone(),
        camera: camera.clone(),
        clip: None,
        units: vec![(Vec3::ZERO, 1.0, true); count],
    };
    let mut edits = vec![plain("none")];
    for (unit, name) in scene.units.iter().map(|unit| &unit.name).enumerate() {
        let mut recolored = plain(&format!("{name} bluer"));
        recolored.units[unit].0 = Vec3::new(-0.3, -0.1, 0.3);
        let mut faded = plain(&format!("{name} at 20 %"));
        faded.units[unit].1 = FADED;
        edits.extend([recolored, faded]);
        if count > 1 {
            let mut alone = plain(&format!("{name} alone"));
            alone.units.iter_mut().enumerate().for_each(|(k, edit)| edit.2 = k == unit);
            let mut hidden = plain(&format!("without {name}"));
            hidden.units[unit].2 = false;
            edits.extend([alone, hidden]);
        }
    }
    for edit in &mut edits {
        edit.function = edited(function, field, &edit.units);
    }
    let mut lit = plain("light from the left");
    let view = camera.view().inverse();
    lit.camera.light.mode = LightMode::Direction;
    lit.camera.light.direction = view.transform_vector3(DVec3::new(-1.0, -0.5, -0.7)).as_vec3().to_array();
    let mut white = plain("white background");
    white.camera.background = [1.0; 3];
    let mut clipped = plain("clipped");
    let bounds = field.bounds();
    let ahead = view.transform_vector3(DVec3::Z);
    clipped.clip = Some(Clip::plane(0.5 * (bounds.min + bounds.max), ahead));
    edits.extend([lit, white, clipped]);
    edits
}

/// A transfer function with an edit of each base unit.
fn edited(function: &TransferFunction, field: ScalarFieldRef<'_>, units: &[(Vec3, f32, bool)]) -> TransferFunction {
    let classifier = function.classifier(field.range()).unwrap();
    // At a border two points of one value: the end of one unit and the begin of the next.
    let mut points = Vec::new();
    let mut values: Vec<f64> = function.points.iter().map(|point| point.value).collect();
    values.extend(function.base_units.iter().flat_map(|unit| unit.range));
    values.sort_by(f64::total_cmp);
    values.dedup();
    for value in values {
        let (color, opacity) = classifier.evaluate(value);
        let beside = (function.domain[1] - function.domain[0]) * 1e-9;
        let mut owners: Vec<usize> = [value - beside, value + beside].map(|at| classifier.unit(at).unit).to_vec();
        owners.dedup();
        for owner in owners {
            let (shift, factor, is_visible) = units.get(owner).copied().unwrap_or((Vec3::ZERO, 1.0, true));
            let color = (color + shift).clamp(Vec3::ZERO, Vec3::ONE).to_array();
            points.push(ControlPoint { value, color, opacity: if is_visible { factor * opacity } else { 0.0 } });
        }
    }
    TransferFunction { points, ..function.clone() }
}

impl Edit {
    /// The volume with the edit.
    fn reference(&self, field: ScalarFieldRef<'_>) -> Image {
        let classifier = self.function.classifier(field.range()).unwrap();
        let marcher = field.marcher(classifier, 0.5).clipped(self.clip.iter().map(region).collect());
        march(&marcher, &self.camera)
    }

    /// The Gaussians with the edit.
    fn drawn(&self, scene: &Scene) -> Image {
        let mut appearance = Appearance::of(scene);
        appearance.light = self.camera.light;
        appearance.background = self.camera.background();
        appearance.clips.extend(self.clip.clone());
        for (base, (shift, opacity, visible)) in appearance.base.iter_mut().zip(&self.units) {
            base.palette += *shift;
            base.opacity *= opacity;
            base.visible = *visible;
        }
        render(scene, &appearance, &self.camera, Quality::Standard).unwrap().image
    }
}

/// The volume, the direct start, the trained scene and eight times its difference, side by side.
fn strip(arguments: &Arguments, name: &str, view: &TrainingView, scenes: [&Scene; 2]) {
    let Some(out) = &arguments.out else { return };
    std::fs::create_dir_all(out).unwrap();
    let drawn =
        scenes.map(|scene| render(scene, &view.appearance(scene), &view.camera, Quality::Standard).unwrap().image);
    let difference: Vec<f32> =
        drawn[1].rgba.iter().zip(&view.reference.rgba).map(|(a, b)| 8.0 * (a - b).abs()).collect();
    let difference = Image { rgba: difference, ..view.reference.clone() };
    let parts = [&view.reference, &drawn[0], &drawn[1], &difference];
    let width = view.reference.width as usize;
    let rows = (0..view.reference.height as usize).flat_map(|y| {
        parts.into_iter().flat_map(move |part| {
            part.as_pixels()[y * width..(y + 1) * width].iter().map(|[r, g, b, _]| [*r, *g, *b, 1.0])
        })
    });
    let rgba: Vec<f32> = rows.collect::<Vec<[f32; 4]>>().into_flattened();
    let strip = Image { width: 4 * view.reference.width, height: view.reference.height, rgba };
    strip.save(&out.join(format!("{name}.png"))).unwrap();
}

fn draw(area: &sg_tests::plot::Area<'_>, courses: &[Course]) -> Drawn {
    let all = || courses.iter().flat_map(|course| &course.measurements);
    let most = all().map(|m| m.seconds).fold(1.0, f64::max);
    let low = all().map(|m| m.footprint_psnr_db).fold(f64::INFINITY, f64::min).floor();
    let high = all().map(|m| m.footprint_psnr_db).fold(0.0, f64::max).ceil();
    let mut chart = ChartBuilder::on(area)
        .caption("Held-out pictures against ray marching", ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(50)
        .build_cartesian_2d(0.0..most, low..high.max(low + 1.0))?;
    chart.configure_mesh().x_desc("seconds of training").y_desc("PSNR over the footprint, dB").draw()?;
    for (course, color) in courses.iter().zip([BLUE, GREEN, VERMILION, ORANGE, PURPLE, SKY_BLUE]) {
        let line = course.measurements.iter().map(|m| (m.seconds, m.footprint_psnr_db));
        chart
            .draw_series(LineSeries::new(line, color.stroke_width(2)))?
            .label(course.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(plotters::prelude::WHITE)
        .draw()?;
    Ok(())
}
