//! Predicted milliseconds of graphics cards from counted work: a walk-through of 60 poses with both eyes of a headset, from outside
//! to the inside of each scene. No graphics card takes part.
//!
//!     cargo bench --workspace --bench costs -- --scene bonsai-170000/scene.toml --scene bonsai-830000/scene.toml --out costs
//!
//! With `--measure` it draws the poses on a device too. It prints the measured milliseconds of each pass beside those predicted for a
//! card, and how counted work and measured seconds correlate:
//!
//!     cargo bench --workspace --bench costs -- --scene bonsai-170000/scene.toml --poses 12 --measure --card h100
//!
//! With `--foveation` it counts tiles with half resolution in the periphery too, and prints their decibels to the whole picture:
//!
//!     cargo bench --workspace --bench costs -- --scene bonsai-830000/scene.toml --poses 8 --rasterizer tiles --foveation 20 --foveation 30

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a bench fails by its helpers and prints what it measured"
)]

use std::path::{Path, PathBuf};

use clap::Parser;
use glam::{DQuat, DVec3};
use plotters::prelude::{ChartBuilder, LineSeries, PathElement, RGBColor, SeriesLabelPosition};
use sg_formats::load::{LoadOptions, load};
use sg_gpu::counts::{
    Card, FrameWork, Pass, PassWork, TargetFormat, WorkOptions, frame_work, validates_indirect_calls,
};
use sg_gpu::{DeviceClass, Gpu, Options, Rasterizer, Settings};
use sg_raster::counts::{HEADSET_SIZE, headset};
use sg_raster::foveation::Foveation;
use sg_raster::image::Image;
use sg_raster::render::{Options as Drawing, render};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::framing;
use sg_scene::model::Scene;
use sg_tests::bench::quantile;
use sg_tests::plot::{Area, BLUE, Drawn, GREEN, GREY, ORANGE, VERMILION, svg};

use measured::{TIMED, compared, correlation, measured, software_work};

mod measured;

/// Parts of the walk-through: metres from the middle of the scene, whose longest edge is 1 m in the room.
const PLACES: [(&str, f64); 4] = [("outside", 1.5), ("0.8 m", 0.8), ("0.6 m", 0.6), ("inside", 0.25)];

/// Milliseconds of a frame at 90 Hz with a fifth to spare, and the goal for poses from outside.
const GOALS: [f64; 2] = [8.9, 5.0];

#[derive(Debug, Parser)]
struct Arguments {
    /// Scenes.
    #[arg(long = "scene", required = true)]
    scenes: Vec<PathBuf>,
    /// Poses, spread evenly over the parts of the walk-through.
    #[arg(long, default_value_t = 60)]
    poses: usize,
    /// Width and height of one eye's picture.
    #[arg(long, default_value_t = format!("{}x{}", HEADSET_SIZE[0], HEADSET_SIZE[1]))]
    size: String,
    /// Methods of blending: tiles, quads, bands.
    #[arg(long = "rasterizer", default_values = ["tiles", "quads"])]
    rasterizers: Vec<String>,
    /// Degrees beyond which tiles have half the resolution. Each adds a row, and decibels of the left eye's pictures on the cores.
    #[arg(long = "foveation", value_parser = clap::value_parser!(u8).range(1..=89))]
    foveations: Vec<u8>,
    /// Evaluations are counted in one tile out of so many.
    #[arg(long, default_value_t = 8)]
    sample: u32,
    /// Draws on a device too.
    #[arg(long)]
    measure: bool,
    /// Card whose predictions stand beside the measured milliseconds.
    #[arg(long, default_value = Card::ALL[0].name)]
    card: String,
    /// Draws as while the view moves: coarser cut-offs, and an order of 16 bits. Counts and predictions are those of a view at rest.
    #[arg(long)]
    in_motion: bool,
    /// Tiles read each splat from the lists, as on software devices, not from copies in workgroup memory.
    #[arg(long)]
    unstaged: bool,
    /// Folder for `costs.md`, `costs.svg` and the counts as `costs.json`.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Passed by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// A pose of the walk-through.
struct Pose {
    place: usize,
    eyes: [Camera; 2],
}

/// The walk-through of a scene.
fn poses(scene: &Scene, count: usize, size: [u32; 2]) -> Vec<Pose> {
    let bounds = framing::framed_box(scene);
    let (middle, metre) = (0.5 * (bounds.min + bounds.max), bounds.size().max_element());
    let first = framing::default_camera(scene, 64, 64);
    let up = if scene.units.iter().any(|u| u.gaussians.shading.is_some()) { DVec3::Z } else { DVec3::NEG_Y };
    let outwards = (first.eye() - middle).reject_from(up).normalize_or(up.any_orthonormal_vector());
    let each = count / PLACES.len();
    let pose = |(place, k): (usize, usize)| {
        let angle = std::f64::consts::TAU * k as f64 / each as f64;
        let turn = DQuat::from_axis_angle(up, angle);
        let height = 0.3 * (2.0 * angle).sin();
        let ahead = turn * (outwards + height * up).normalize();
        let distance = PLACES[place].1;
        let (eye, target) = match PLACES[place].0 {
            // Within, the eye walks on rings and looks past the middle.
            "inside" => {
                let ring = distance * (1.0 + k as f64 % 3.0) / 3.0;
                (middle + ring * metre * ahead, middle - 0.5 * metre * (DQuat::from_axis_angle(up, 0.6) * ahead))
            }
            _ => (middle + distance * metre * ahead, middle),
        };
        let camera = Camera::look_at(eye, target, up, 60.0, 64, 64);
        Pose { place, eyes: headset(&camera, metre, size) }
    };
    (0..PLACES.len()).flat_map(|place| (0..each).map(move |k| (place, k))).map(pose).collect()
}

fn rasterizer(name: &str) -> Rasterizer {
    match name {
        "tiles" => Rasterizer::Tiles,
        "quads" => Rasterizer::Quads,
        "bands" => Rasterizer::Bands,
        _ => panic!("`{name}` is no tiles, quads or bands"),
    }
}

/// A scene's walk-through with one method of blending.
struct Row {
    scene: String,
    gaussians: usize,
    name: String,
    places: Vec<usize>,
    works: Vec<FrameWork>,
}

impl Row {
    /// Predicted milliseconds at all poses, or at those of one part.
    fn milliseconds(&self, card: &Card, place: Option<usize>) -> Vec<f64> {
        let chosen = self.places.iter().zip(&self.works).filter(|(at, _)| place.is_none_or(|place| place == **at));
        chosen.map(|(_, work)| 1e3 * work.seconds(card).iter().sum::<f64>()).collect()
    }

    fn with(&self, name: &str, target: TargetFormat, validates: bool) -> Self {
        Self {
            scene: self.scene.clone(),
            gaussians: self.gaussians,
            name: format!("{}, {name}", self.name),
            places: self.places.clone(),
            works: self.works.iter().map(|work| work.with(target, validates)).collect(),
        }
    }

    /// The line of the table for a card.
    fn line(&self, card: &Card) -> String {
        self.line_of(card.name, |place| self.milliseconds(card, place))
    }

    /// A line of the table from the milliseconds of a part, or of all: median and 95th percentile of each part and of all.
    fn line_of(&self, name: &str, milliseconds: impl Fn(Option<usize>) -> Vec<f64>) -> String {
        let places = (0..PLACES.len()).map(Some).chain([None]);
        let cells = places.map(|place| {
            let mut ms = milliseconds(place);
            format!("{:.2} / {:.2}", quantile(&mut ms, 0.5), quantile(&mut ms, 0.95))
        });
        let cells = cells.collect::<Vec<_>>().join(" | ");
        format!("| {}, {} | {} | {name} | {cells} |", self.scene, self.gaussians, self.name)
    }

    /// The passes at the pose of the median predicted time on the first card.
    fn passes(&self, place: usize) -> Vec<String> {
        let [card, ..] = Card::ALL;
        let mut of_place: Vec<&FrameWork> =
            self.places.iter().zip(&self.works).filter(|(at, _)| **at == place).map(|(_, work)| work).collect();
        of_place.sort_by_key(|work| (1e9 * work.seconds(&card).iter().sum::<f64>()) as u64);
        let Some(work) = of_place.get(of_place.len() / 2) else { return Vec::new() };
        let seconds = work.seconds(&card);
        let line = |(pass, seconds): (&PassWork, &f64)| {
            format!(
                "| {} | {} | {} | {} | {} | {} | {:.1} | {:.1} | {} | {} | {} | {:.3} |",
                self.scene,
                self.name,
                PLACES[place].0,
                pass.pass.name(),
                pass.blended + pass.stored,
                if pass.pass == Pass::TileLists { pass.tile_pairs } else { pass.evaluated },
                pass.bytes_read as f64 / 1e6,
                pass.bytes_written as f64 / 1e6,
                pass.commands.dispatches,
                pass.commands.draws,
                pass.commands.barriers,
                1e3 * seconds,
            )
        };
        work.passes.iter().zip(&seconds).map(line).collect()
    }
}

const HEADING: &str = "| scene | blending | card | outside | 0.8 m | 0.6 m | inside | all |\n| --- | --- | --- | --- | --- | --- | --- | --- |";

const PASS_HEADING: &str = "| scene | blending | place | pass | fragments | pairs or evaluations | MB read | MB written | dispatches | draws | barriers | ms, rtx-3090 |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |";

/// Draws the milliseconds of the first card over the poses.
fn draw(area: &Area<'_>, rows: &[&Row]) -> Drawn {
    let [card, ..] = Card::ALL;
    let lines: Vec<(String, Vec<f64>)> = rows
        .iter()
        .map(|row| {
            (format!("{} thousand Gaussians, {}", row.gaussians / 1000, row.name), row.milliseconds(&card, None))
        })
        .collect();
    let poses = lines.iter().map(|(_, ms)| ms.len()).max().unwrap_or(1);
    let top = lines.iter().flat_map(|(_, ms)| ms).fold(10.0_f64, |a, b| a.max(*b)).min(60.0);
    let mut chart = ChartBuilder::on(area)
        .margin(16)
        .caption("Predicted milliseconds of both eyes on an RTX 3090", ("sans-serif", 20))
        .x_label_area_size(40)
        .y_label_area_size(50)
        .build_cartesian_2d(0.0..PLACES.len() as f64, 0.0..1.05 * top)?;
    let part = poses as f64 / PLACES.len() as f64;
    let middle = |at: &f64| (at.fract() - 0.5).abs() < 0.1;
    chart
        .configure_mesh()
        .x_labels(2 * PLACES.len() + 1)
        .x_label_formatter(&|at| match PLACES.get(*at as usize) {
            Some((name, _)) if middle(at) => (*name).to_owned(),
            _ => String::new(),
        })
        .x_desc("poses of the walk-through")
        .y_desc("ms")
        .disable_x_mesh()
        .draw()?;
    for goal in GOALS {
        chart.draw_series(LineSeries::new([(0.0, goal), (PLACES.len() as f64, goal)], &GREY))?;
    }
    let colors: [RGBColor; 4] = [BLUE, ORANGE, GREEN, VERMILION];
    for ((name, ms), color) in lines.iter().zip(colors.into_iter().cycle()) {
        let points = ms.iter().enumerate().map(|(k, ms)| ((k as f64 + 0.5) / part, ms.min(1.04 * top)));
        chart
            .draw_series(LineSeries::new(points, &color))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], color));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(plotters::prelude::WHITE)
        .draw()?;
    Ok(())
}

/// Decibels of some pixels of the footprint: A > 1/1024 in either picture.
fn decibels(image: &Image, reference: &Image, of: impl Fn([u32; 2]) -> bool) -> f64 {
    let (mut sum, mut count) = (0.0, 0_u64);
    for (k, (a, b)) in image.pixels().zip(reference.pixels()).enumerate() {
        let at = [k as u32 % image.width, k as u32 / image.width];
        if a[3].max(b[3]) > 1.0 / 1024.0 && of(at) {
            sum += a.iter().zip(b).take(3).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
            count += 3;
        }
    }
    -10.0 * (sum / count as f64).log10()
}

/// Each pixel is the mean of its block of 2 × 2 pixels: the best of half resolution.
fn block_means(image: &Image) -> Image {
    let pixels = image.rgba.as_chunks::<4>().0;
    let (width, height) = (image.width as usize, image.height as usize);
    let mean = |k: usize| -> [f32; 4] {
        let (x, y) = (k % width / 2 * 2, k / width / 2 * 2);
        let places =
            [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[dx, dy]| [(x + dx).min(width - 1), (y + dy).min(height - 1)]);
        std::array::from_fn(|c| places.iter().map(|[x, y]| pixels[y * width + x][c]).sum::<f32>() / 4.0)
    };
    Image { rgba: (0..pixels.len()).flat_map(mean).collect(), ..image.clone() }
}

/// Lines of the table of errors: the left eye's pictures on the cores, each against the one with every pixel.
fn foveation_errors(scene: &Scene, poses: &[Pose], foveations: &[u8]) -> Vec<String> {
    let look = Appearance::of(scene);
    let draw = |camera: &Camera, foveation| {
        let options = Drawing { foveation, ..Drawing::default() };
        render(scene, &look, camera, options).unwrap().image
    };
    let mut errors: Vec<Vec<[f64; 4]>> = vec![Vec::new(); foveations.len() * PLACES.len()];
    for pose in poses {
        let camera = &pose.eyes[0];
        let whole = draw(camera, None);
        let means = block_means(&whole);
        for (k, degrees) in foveations.iter().enumerate() {
            let foveation = Foveation::beyond(*degrees).unwrap();
            let foveated = draw(camera, Some(foveation));
            let coarse = |at| foveation.is_coarse(camera, at);
            errors[k * PLACES.len() + pose.place].push([
                decibels(&foveated, &whole, |at| !coarse(at)),
                decibels(&foveated, &whole, coarse),
                decibels(&foveated, &means, coarse),
                decibels(&means, &whole, coarse),
            ]);
        }
    }
    let line = |(k, of): (usize, &Vec<[f64; 4]>)| {
        let least = |c: usize| of.iter().map(|errors| errors[c]).filter(|e| !e.is_nan()).fold(f64::INFINITY, f64::min);
        let (degrees, place) = (foveations[k / PLACES.len()], PLACES[k % PLACES.len()].0);
        let cells: Vec<String> = (0..4).map(|c| format!("{:.1}", least(c))).collect();
        format!("| {degrees} | {place} | {} |", cells.join(" | "))
    };
    errors.iter().enumerate().map(line).collect()
}

const ERROR_HEADING: &str = "| whole resolution up to, degrees | place | least dB of the middle | of the periphery | of the periphery to block means | block means of the periphery |\n| --- | --- | --- | --- | --- | --- |";

fn main() {
    let arguments = Arguments::parse();
    let (width, height) = arguments.size.split_once('x').unwrap();
    let size = [width.parse().unwrap(), height.parse().unwrap()];
    let gpu = arguments.measure.then(|| Gpu::open(DeviceClass::Any).unwrap());
    let mut rows: Vec<Row> = Vec::new();
    let mut errors = Vec::new();
    let Some(card) = Card::ALL.iter().find(|card| card.name == arguments.card) else {
        panic!("`{}` is none of {}", arguments.card, Card::ALL.map(|card| card.name).join(", "))
    };
    let mut pairs: Vec<(&str, String, f64, f64)> = Vec::new();
    let mut whole_frames = vec![HEADING.to_owned()];
    let mut timed_passes = vec![format!(
        "| scene | blending | place | pass | predicted, {}, ms | measured, ms | measured / predicted |\n| --- | --- | --- | --- | --- | --- | --- |",
        card.name
    )];
    for path in &arguments.scenes {
        let scene = load(path, &LoadOptions::default()).unwrap().scene;
        let named = |path: &Path| Some(path.file_name()?.to_string_lossy().into_owned());
        let name = path.parent().and_then(named).or_else(|| named(path)).unwrap();
        let poses = poses(&scene, arguments.poses, size);
        let whole = arguments.rasterizers.iter().map(|method| (method, None));
        let tiles = arguments.rasterizers.iter().filter(|method| *method == "tiles");
        let foveated = tiles.flat_map(|method| arguments.foveations.iter().map(move |f| (method, Some(*f))));
        for (method, degrees) in whole.chain(foveated) {
            let foveation = degrees.and_then(Foveation::beyond);
            let in_motion = arguments.in_motion;
            let settings =
                Settings { rasterizer: rasterizer(method), depths: true, foveation, in_motion, ..Settings::default() };
            let staged_blending = Some(!arguments.unstaged);
            let renderer = Options { half_pictures: true, staged_blending, ..Options::default() };
            let sample = arguments.sample;
            let options = WorkOptions { settings, renderer, presented: true, sample, ..WorkOptions::default() };
            let look = Appearance::of(&scene);
            let works = poses.iter().map(|pose| frame_work(&scene, &look, &pose.eyes, options).unwrap()).collect();
            let places = poses.iter().map(|pose| pose.place).collect();
            let called = degrees.map_or_else(|| method.clone(), |degrees| format!("{method}, foveation {degrees}°"));
            let row = Row { scene: name.clone(), gaussians: scene.len(), name: called, places, works };
            println!("{HEADING}");
            for card in &Card::ALL {
                println!("{}", row.line(card));
            }
            let drawn = gpu.as_ref().map(|gpu| (gpu, measured(gpu, &scene, &poses, settings, renderer)));
            if let Some((gpu, drawn)) = drawn.filter(|(_, drawn)| drawn.len() == poses.len()) {
                let [whole, passes] = compared(&row, &drawn, gpu.name(), card);
                println!("{}", whole.join("\n"));
                whole_frames.extend(whole);
                timed_passes.extend(passes);
                for (work, drawn) in row.works.iter().zip(&drawn) {
                    for ((pass, of), seconds) in TIMED.iter().zip(drawn.passes) {
                        let work = work.passes.iter().filter(|w| of.contains(&w.pass)).map(software_work).sum();
                        pairs.push((pass, row.name.clone(), work, seconds));
                    }
                }
            }
            rows.push(row);
        }
        if !arguments.foveations.is_empty() {
            errors.extend(foveation_errors(&scene, &poses, &arguments.foveations));
        }
    }
    let mut table = vec![HEADING.to_owned()];
    let validates = validates_indirect_calls();
    for row in &rows {
        let variants = [
            (!row.name.starts_with("tiles")).then(|| row.with("f16 targets", TargetFormat::Float16, validates)),
            validates.then(|| row.with("without validation of indirect calls", row.works[0].target, false)),
        ];
        for row in std::iter::once(row).chain(variants.iter().flatten()) {
            table.extend(Card::ALL.iter().map(|card| row.line(card)));
        }
    }
    table.push(format!("\n{PASS_HEADING}"));
    for row in &rows {
        table.extend([0, 3].into_iter().flat_map(|place| row.passes(place)));
    }
    if !errors.is_empty() {
        table.push(format!("\n{ERROR_HEADING}"));
        table.append(&mut errors);
    }
    for row in &rows {
        let commands: Vec<u32> = row.works.iter().map(|work| work.commands().barriers).collect();
        let (least, most) = (commands.iter().min().unwrap(), commands.iter().max().unwrap());
        table.push(format!("\n{}, {}: {least} to {most} barriers a frame", row.scene, row.name));
    }
    if !pairs.is_empty() {
        table.push(String::new());
        table.append(&mut whole_frames);
        table.push(String::new());
        table.append(&mut timed_passes);
        table.push(
            "\n| blending | pass | pictures | correlation of work and seconds |\n| --- | --- | --- | --- |".to_owned(),
        );
        let mut keys: Vec<(String, &str)> = pairs.iter().map(|p| (p.1.clone(), p.0)).collect();
        keys.dedup();
        keys.sort();
        keys.dedup();
        for (method, pass) in keys {
            let of: Vec<(f64, f64)> =
                pairs.iter().filter(|p| p.0 == pass && p.1 == method).map(|p| (p.2, p.3)).collect();
            let r = correlation(&of).map_or_else(|| "work does not vary".to_owned(), |r| format!("{r:.3}"));
            table.push(format!("| {method} | {pass} | {} | {r} |", of.len()));
        }
    }
    println!("\n{}", table.join("\n"));
    if let Some(out) = &arguments.out {
        std::fs::create_dir_all(out).unwrap();
        std::fs::write(out.join("costs.md"), table.join("\n") + "\n").unwrap();
        let shown: Vec<&Row> = rows.iter().collect();
        std::fs::write(out.join("costs.svg"), svg((1000, 480), |area| draw(area, &shown)).unwrap()).unwrap();
        let works: Vec<_> = rows
            .iter()
            .map(|row| serde_json::json!({"scene": row.scene, "blending": row.name, "frames": row.works}))
            .collect();
        std::fs::write(out.join("costs.json"), serde_json::to_string(&works).unwrap()).unwrap();
    }
}
