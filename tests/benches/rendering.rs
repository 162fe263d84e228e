//! Milliseconds against decibels for every renderer. One run compares levels of the CPU renderer, both rasterizers of the
//! graphics device, and other renderers.
//!
//!     cargo bench --workspace --bench rendering -- --out measured
//!
//! With a walk-through (`tests/benches/walks`) it prints three numbers for each pose: the decibels against the ray-consistent
//! reference, the pairs of a Gaussian and a tile, and the milliseconds. With a volume it adds the decibels against ray marching of it:
//!
//!     cargo bench --workspace --bench rendering -- --scene bonsai/scene.toml --walk tests/benches/walks/bonsai.txt \
//!         --size 800x600 --volume bonsai_256x256x256_uint8.raw.zst --transfer-function launch/demo/bonsai.tf.json
//!
//! Each scene is turned once around for each row; before that the same turn is drawn unmeasured. Wall time is that of a
//! picture the device has finished; nothing is read back. The error is the worst over views of that turn, against `exact`.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a bench fails by its helpers and prints what it measured"
)]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use clap::Parser;
use glam::{DMat4, DVec3};
use sg_formats::load::{LoadOptions, load};
use sg_formats::save::{SaveOptions, save};
use sg_gpu::{DeviceClass, Gpu, PassSeconds, Rasterizer, Renderer, Settings};
use sg_raster::image::Image;
use sg_raster::image_error::Difference;
use sg_raster::render::{Projection, Quality, render};
use sg_raster::volume::march;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::camera_path::CameraPath;
use sg_scene::model::Scene;
use sg_scene::{camera_motion, framing};
use sg_tests::bench::quantile;
use sg_tests::shells::{Look, shells};
use sg_volume::dvr::RayMarcher;
use sg_volume::read::read_volume;
use sg_volume::transfer::TransferFunction;

/// Distance between two eyes as a share of the distance to the object in view: 63 mm at 1.5 m.
const EYES_APART: f64 = 0.042;

#[derive(Debug, Parser)]
struct Arguments {
    /// Scenes: a number of made Gaussians with harmonics of degree 0, `lit:` and a number, or a file.
    #[arg(long = "scene", default_values = ["168000", "lit:168000", "832000"])]
    scenes: Vec<String>,
    /// Sizes: `1032x1104` for one eye, `2x2064x2208` for two.
    #[arg(long = "size", default_values = ["1032x1104", "2x2064x2208"])]
    sizes: Vec<String>,
    /// A walk-through of the scene instead of a turn.
    #[arg(long)]
    walk: Option<PathBuf>,
    /// Rays at `standard` as the reference of the walk-through. They are about 80 dB from `exact`, and take a fiftieth of the time.
    #[arg(long, requires = "walk")]
    standard_reference: bool,
    /// The volume of the scene, for the walk-through.
    #[arg(long, requires = "walk", requires = "transfer_function")]
    volume: Option<PathBuf>,
    /// Its transfer function.
    #[arg(long, requires = "volume")]
    transfer_function: Option<PathBuf>,
    /// Vertical field of view of the walk-through, degrees [default: its file's].
    #[arg(long, requires = "walk")]
    field_of_view: Option<f64>,
    /// Folder for the pictures of the walk-through.
    #[arg(long, requires = "walk")]
    pictures: Option<PathBuf>,
    /// Pictures of one turn.
    #[arg(long, default_value_t = 24)]
    frames: usize,
    /// Views of the turn whose error is measured.
    #[arg(long, default_value_t = 2)]
    views: usize,
    /// Rows whose name contains one of these alone.
    #[arg(long)]
    only: Vec<String>,
    /// A program that draws as others do (tests/peers/splatting); may be given for each of them with its arguments.
    #[arg(long)]
    peer: Vec<String>,
    /// Folder for `rendering.json` and `rendering.md`.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Passed by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// One row of the table.
#[derive(Debug, serde::Serialize)]
struct Row {
    scene: String,
    gaussians: usize,
    size: String,
    renderer: String,
    /// Milliseconds by the clock: least, median, 99th percentile.
    least_ms: f64,
    median_ms: f64,
    p99_ms: f64,
    passes: Option<PassSeconds>,
    /// Worst over the measured views; nothing where the renderer gave no picture.
    error: Option<Worst>,
}

#[derive(Debug, Clone, Copy, serde::Serialize)]
struct Worst {
    psnr_db: f64,
    footprint_psnr_db: f64,
    coverage_error: f64,
    max_error: f64,
}

impl Worst {
    fn of(images: &[Image], exact: &[Image]) -> Option<Self> {
        let differences = images.iter().zip(exact).map(|(image, exact)| Difference::between(image, exact).unwrap());
        differences
            .map(|d| Self {
                psnr_db: d.psnr_db,
                footprint_psnr_db: d.footprint_psnr_db,
                coverage_error: d.coverage_error,
                max_error: d.max_error,
            })
            .reduce(|a, b| Self {
                psnr_db: a.psnr_db.min(b.psnr_db),
                footprint_psnr_db: a.footprint_psnr_db.min(b.footprint_psnr_db),
                coverage_error: a.coverage_error.max(b.coverage_error),
                max_error: a.max_error.max(b.max_error),
            })
    }
}

/// A scene with a turn around it; each step has a camera for each eye.
struct Job {
    name: String,
    size: String,
    scene: Scene,
    appearance: Appearance,
    turn: Vec<Vec<Camera>>,
    views: usize,
    exact: Vec<Image>,
}

impl Job {
    fn new(name: &str, size: &str, arguments: &Arguments) -> Self {
        let scene = match (name.strip_prefix("lit:").unwrap_or(name).parse(), name.starts_with("lit:")) {
            (Ok(n), true) => shells(n, Look::Lit),
            (Ok(n), false) => shells(n, Look::Plain),
            (Err(_), _) => load(Path::new(name), &LoadOptions::default()).unwrap().scene,
        };
        let (eyes, one) = size.strip_prefix("2x").map_or((1, size), |one| (2, one));
        let (width, height) = one.split_once('x').unwrap();
        let (width, height) = (width.parse().unwrap(), height.parse().unwrap());
        let bounds = framing::visible_box(&scene);
        let middle = 0.5 * (bounds.min + bounds.max);
        let first = framing::default_camera(&scene, width, height);
        let apart = 0.5 * EYES_APART * first.eye().distance(middle);
        let turn: Vec<Vec<Camera>> = (0..arguments.frames)
            .map(|k| {
                let camera = camera_motion::orbit(&first, middle, 360.0 * k as f64 / arguments.frames as f64, 0.0);
                let eye = |x: f64| {
                    let moved = DMat4::from_translation(DVec3::new(-x, 0.0, 0.0)) * camera.view();
                    Camera { world_to_camera: moved.transpose().to_cols_array(), ..camera.clone() }
                };
                if eyes == 1 { vec![camera] } else { vec![eye(-apart), eye(apart)] }
            })
            .collect();
        let appearance = Appearance::of(&scene);
        let mut job = Self {
            name: name.to_owned(),
            size: size.to_owned(),
            scene,
            appearance,
            turn,
            views: arguments.views,
            exact: Vec::new(),
        };
        job.exact = job
            .measured_views()
            .flatten()
            .map(|c| render(&job.scene, &job.appearance, c, Quality::Exact).unwrap().image)
            .collect();
        job
    }

    /// Views spread over the turn whose error is measured.
    fn measured_views(&self) -> impl Iterator<Item = &[Camera]> {
        let step = (self.turn.len() / self.views.max(1)).max(1);
        self.turn.iter().step_by(step).take(self.views).map(Vec::as_slice)
    }

    fn row(&self, renderer: &str, mut ms: Vec<f64>, passes: Option<PassSeconds>, images: &[Image]) -> Row {
        Row {
            scene: self.name.clone(),
            gaussians: self.scene.len(),
            size: self.size.clone(),
            renderer: renderer.to_owned(),
            least_ms: quantile(&mut ms, 0.0),
            median_ms: quantile(&mut ms, 0.5),
            p99_ms: quantile(&mut ms, 0.99),
            passes,
            error: Worst::of(images, &self.exact),
        }
    }

    fn cpu(&self, name: &str, quality: Quality) -> Row {
        let draw = |cameras: &[Camera]| -> Vec<Image> {
            let one = |c| render(&self.scene, &self.appearance, c, quality).unwrap().image;
            cameras.iter().map(one).collect()
        };
        let images: Vec<Image> = self.measured_views().flat_map(draw).collect();
        let ms = self.turn.iter().map(|cameras| {
            let began = Instant::now();
            drop(draw(cameras));
            1e3 * began.elapsed().as_secs_f64()
        });
        self.row(name, ms.collect(), None, &images)
    }

    fn device(&self, name: &str, gpu: &Gpu, settings: Settings) -> Row {
        let mut renderer = Renderer::new(gpu, &self.scene).unwrap();
        let mut images = Vec::new();
        for cameras in self.measured_views() {
            images.extend(renderer.picture(cameras, &self.appearance, settings).unwrap().0);
        }
        for cameras in &self.turn {
            renderer.draw(cameras, &self.appearance, settings).unwrap();
            renderer.finish().unwrap();
        }
        let (mut ms, mut passes) = (Vec::new(), Vec::new());
        for cameras in &self.turn {
            let began = Instant::now();
            renderer.draw(cameras, &self.appearance, settings).unwrap();
            let (drawn, complete) = renderer.finish().unwrap();
            ms.push(1e3 * began.elapsed().as_secs_f64());
            assert!(complete, "a picture of the measured turn lacks something");
            passes.extend(drawn.seconds);
        }
        passes.sort_by(|a, b| a.total().total_cmp(&b.total()));
        self.row(name, ms, passes.get(passes.len() / 2).copied(), &images)
    }

    /// Has another program draw the same turn of the same file.
    fn peer(&self, command: &str) -> Option<Row> {
        let folder = tempfile::tempdir().unwrap();
        let (scene, turn, out) =
            (folder.path().join("scene.ply"), folder.path().join("turn.json"), folder.path().join("out"));
        if self.scene.units.iter().any(|u| u.gaussians.shading.is_some()) {
            return None;
        }
        save(&scene, &self.scene, &SaveOptions::default()).unwrap();
        std::fs::write(&turn, serde_json::to_string(&self.turn).unwrap()).unwrap();
        std::fs::create_dir(&out).unwrap();
        let mut words = command.split_whitespace();
        let step = (self.turn.len() / self.views.max(1)).max(1);
        let output = Command::new(words.next()?)
            .args(words)
            .args([&scene, &turn, &out])
            .arg(step.to_string())
            .arg(self.views.to_string())
            .output()
            .unwrap();
        if !output.status.success() {
            eprintln!("{command}: {}", String::from_utf8_lossy(&output.stderr));
            return None;
        }
        let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let ms = told["ms"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
        let images: Vec<Image> = (0..self.exact.len()).map(|k| read(&out.join(format!("{k}.npy")))).collect();
        Some(self.row(told["name"].as_str().unwrap(), ms, None, &images))
    }
}

/// A picture as a peer writes it: float32 (height, width, 4).
fn read(path: &Path) -> Image {
    let npy = npyz::NpyFile::new(std::io::BufReader::new(std::fs::File::open(path).unwrap())).unwrap();
    let (height, width) = (npy.shape()[0] as u32, npy.shape()[1] as u32);
    Image { width, height, rgba: npy.into_vec().unwrap() }
}

/// Prints a table of a walk-through, and the least decibels of each renderer.
fn walk(arguments: &Arguments, path: &Path, gpu: Option<&Gpu>) {
    let mut walk = CameraPath::read(path).unwrap();
    walk.fov_y_degrees = arguments.field_of_view.unwrap_or(walk.fov_y_degrees);
    let name = arguments.scenes.first().unwrap();
    let scene = load(Path::new(name), &LoadOptions::default()).unwrap().scene;
    let volume = arguments.volume.as_ref().zip(arguments.transfer_function.as_ref());
    let volume = volume.map(|(volume, function)| {
        let field = read_volume(volume).unwrap().to_field();
        let function = TransferFunction::load(function).unwrap().function;
        let classifier = function.classifier(field.range()).unwrap();
        (field, classifier)
    });
    let marcher = volume.as_ref().map(|(field, classifier)| RayMarcher::new(field, classifier.clone(), 0.5));
    let (width, height) = arguments.sizes.first().unwrap().split_once('x').unwrap();
    let size = [width.parse().unwrap(), height.parse().unwrap()];
    let look = Appearance { background: glam::Vec3::splat(0.2), ..Appearance::of(&scene) };
    let mut renderer = gpu.map(|gpu| Renderer::new(gpu, &scene).unwrap());
    println!("{name}, {} Gaussians, {width} x {height}", scene.len());
    println!(
        "| pose | renderer | dB, footprint | pairs | ms | dB to ray marching |\n| --- | --- | --- | --- | --- | --- |"
    );
    let mut least = std::collections::BTreeMap::<&str, f64>::new();
    for (k, camera) in walk.cameras(size).enumerate() {
        let quality = if arguments.standard_reference { Quality::Standard } else { Quality::Exact };
        let by_rays = sg_raster::render::Options { projection: Projection::PerRay, ..quality.into() };
        let exact = render(&scene, &look, &camera, by_rays).unwrap().image;
        let marched = marcher.as_ref().map(|marcher| march(marcher, &camera));
        let keep = |what: &str, image: &Image| {
            if let Some(folder) = &arguments.pictures {
                std::fs::create_dir_all(folder).unwrap();
                image.save(&folder.join(format!("{k}-{what}.png"))).unwrap();
            }
        };
        keep("rays", &exact);
        marched.iter().for_each(|image| keep("marched", image));
        let mut row = |what: &'static str, image: &Image, pairs: u64, ms: f64| {
            let db = Difference::between(image, &exact).unwrap().footprint_psnr_db;
            let volume = marched
                .as_ref()
                .map_or_else(String::new, |m| format!("{:.1}", Difference::between(image, m).unwrap().psnr_db));
            println!("| {k} | {what} | {db:.1} | {pairs} | {ms:.0} | {volume} |");
            let worst = least.entry(what).or_insert(f64::INFINITY);
            *worst = worst.min(db);
            keep(what, image);
        };
        let exact_too = Some(("exact", Quality::Exact)).filter(|_| !arguments.standard_reference);
        for (what, quality) in exact_too.into_iter().chain([("cores", Quality::Standard)]) {
            let drawn = render(&scene, &look, &camera, quality).unwrap();
            row(what, &drawn.image, drawn.report.tile_pairs, 1e3 * drawn.report.seconds.total);
        }
        if let Some(renderer) = &mut renderer {
            for (what, rasterizer) in [("tiles", Rasterizer::Tiles), ("quads", Rasterizer::Quads)] {
                let settings = Settings { rasterizer, ..Settings::default() };
                let cameras = std::slice::from_ref(&camera);
                let (images, stats) = renderer.picture(cameras, &look, settings).unwrap();
                let began = Instant::now();
                renderer.draw_complete(cameras, &look, settings).unwrap();
                row(what, &images[0], stats.tile_pairs.into(), 1e3 * began.elapsed().as_secs_f64());
            }
        }
    }
    println!("least: {least:.1?}");
}

fn main() {
    let arguments = Arguments::parse();
    let gpu = Gpu::open(DeviceClass::Any).inspect_err(|e| println!("SKIPPED on the device: {e}")).ok();
    if let Some(path) = &arguments.walk {
        return walk(&arguments, path, gpu.as_ref());
    }
    let chosen = |name: &str| arguments.only.is_empty() || arguments.only.iter().any(|o| name.contains(o.as_str()));
    let mut rows = Vec::new();
    println!("{}", heading(gpu.as_ref()));
    for scene in &arguments.scenes {
        for size in &arguments.sizes {
            let job = Job::new(scene, size, &arguments);
            let mut add = |row: Row| {
                println!("{}", line(&row));
                rows.push(row);
            };
            for (name, quality) in [("CPU standard", Quality::Standard), ("CPU fast", Quality::Fast)] {
                if chosen(name) {
                    add(job.cpu(name, quality));
                }
            }
            for rasterizer in Rasterizer::ALL {
                for quality in [Quality::Standard, Quality::Fast] {
                    for shared_shading in [false, true] {
                        let shared = if shared_shading { ", one shading for both eyes" } else { "" };
                        let name = format!("wgpu {rasterizer:?} {quality:?}{shared}").to_lowercase();
                        if let Some(gpu) = &gpu
                            && chosen(&name)
                            && (!shared_shading || job.turn.first().is_some_and(|eyes| eyes.len() > 1))
                        {
                            add(job.device(
                                &name,
                                gpu,
                                Settings { quality, rasterizer, shared_shading, ..Settings::default() },
                            ));
                        }
                    }
                }
            }
            for peer in &arguments.peer {
                job.peer(peer).into_iter().for_each(&mut add);
            }
        }
    }
    if let Some(out) = &arguments.out {
        std::fs::create_dir_all(out).unwrap();
        let table: Vec<String> = rows.iter().map(line).collect();
        std::fs::write(out.join("rendering.md"), format!("{}\n{}\n", heading(gpu.as_ref()), table.join("\n"))).unwrap();
        std::fs::write(out.join("rendering.json"), serde_json::to_string_pretty(&rows).unwrap()).unwrap();
    }
}

fn heading(gpu: Option<&Gpu>) -> String {
    let device = gpu.map_or_else(|| "no device".to_owned(), |gpu| gpu.name().to_owned());
    format!(
        "{device}; {} threads\n\n| scene | size | renderer | ms: least / median / p99 | list + project + sort + bin + pair sort + blend + compose, ms | dB frame / footprint | coverage error % | max error |\n| --- | --- | --- | --- | --- | --- | --- | --- |",
        rayon::current_num_threads()
    )
}

fn line(row: &Row) -> String {
    let passes = row.passes.map_or_else(String::new, |p| {
        [p.list, p.project, p.sort, p.bin, p.pair_sort, p.blend, p.compose]
            .map(|s| format!("{:.1}", 1e3 * s))
            .join(" + ")
    });
    let error = row.error.map_or_else(
        || "| | ".to_owned(),
        |e| {
            format!(
                "{:.1} / {:.1} | {:.3} | {:.4}",
                e.psnr_db,
                e.footprint_psnr_db,
                100.0 * e.coverage_error,
                e.max_error
            )
        },
    );
    format!(
        "| {} | {} | {} | {:.1} / {:.1} / {:.1} | {passes} | {error} |",
        row.scene, row.size, row.renderer, row.least_ms, row.median_ms, row.p99_ms
    )
}
