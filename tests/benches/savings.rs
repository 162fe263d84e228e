//! The device's cost of drawing the features that a scene has, and the saving from leaving out the absent ones. Times are
//! milliseconds of the pass that projects and shades and of the whole picture. The table also has bytes a Gaussian and the error
//! of half precision.
//!
//!     cargo bench --workspace --bench savings -- --gaussians 168000 --rounds 15

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a bench fails by its helpers and prints what it measured"
)]

use std::sync::Arc;

use glam::{DVec3, Vec3};
use sg_gpu::{DeviceClass, Gpu, Options, PassSeconds, Rasterizer, Renderer, Settings};
use sg_raster::image::Image;
use sg_raster::image_error::Difference;
use sg_scene::appearance::{Appearance, Clip, Overlay, UnitAppearance};
use sg_scene::camera::Camera;
use sg_scene::framing;
use sg_scene::mask::Mask;
use sg_scene::model::{Harmonics, Scene};
use sg_scene::tone::Tone;
use sg_tests::bench::{argument, quantile};
use sg_tests::shells::{Look, shells};

/// Edge of the pictures: small, so that the cost of a Gaussian is not lost in the cost of pixels.
const SIZE: u32 = 256;

fn main() {
    let gaussians = argument("--gaussians", 168_000) as usize;
    let rounds = argument("--rounds", 15) as usize;
    let Ok(gpu) = Gpu::open(DeviceClass::Any).inspect_err(|e| println!("SKIPPED: {e}")) else { return };
    println!("{}; {gaussians} Gaussians, {SIZE} x {SIZE}, {rounds} rounds\n", gpu.name());
    println!(
        "| scene | bytes a Gaussian | project and shade, ms: least / median | list, ms | all, ms | against full precision |"
    );
    println!("| --- | --- | --- | --- | --- | --- |");
    let bench = Bench { gpu, rounds };
    for (name, scene) in scenes(gaussians) {
        let look = Appearance::of(&scene);
        let full = bench.row(name, &scene, &look, false, None);
        if name != NO_LIGHT && name != BARE {
            bench.row(&format!("{name}, in half precision"), &scene, &look, true, Some(&full));
        }
    }
    let scene = shells(gaussians, Look::Lit);
    for (name, look) in looks(&scene) {
        bench.row(name, &scene, &look, false, None);
    }
}

const BARE: &str = "one colour";
const NO_LIGHT: &str = "lit, no highlights";

fn scenes(gaussians: usize) -> Vec<(&'static str, Scene)> {
    let of_degree = |degree: u8| {
        let mut scene = shells(gaussians, Look::Plain);
        let columns = scene.units[0].gaussians.harmonics.as_mut().unwrap();
        let terms = (usize::from(degree) + 1).pow(2) - 1;
        let rest = columns.dc.iter().flat_map(|dc| (0..terms).map(|k| dc.map(|x| 0.2 * (x * (k + 1) as f32).sin())));
        *columns = Harmonics { degree, rest: rest.collect(), dc: columns.dc.clone() };
        scene
    };
    let mut bare = shells(gaussians, Look::Plain);
    bare.units[0].gaussians.harmonics = None;
    let mut dull = shells(gaussians, Look::Lit);
    dull.units[0].gaussians.shading.as_mut().unwrap().specular.fill(0.0);
    vec![
        (BARE, bare),
        ("harmonics of degree 0", of_degree(0)),
        ("harmonics of degree 1", of_degree(1)),
        ("harmonics of degree 2", of_degree(2)),
        ("harmonics of degree 3", of_degree(3)),
        (NO_LIGHT, dull),
        ("lit", shells(gaussians, Look::Lit)),
    ]
}

/// The lit scene with further features that have a cost.
fn looks(scene: &Scene) -> Vec<(&'static str, Appearance)> {
    let plain = Appearance::of(scene);
    let n = scene.len();
    let third = Arc::new(Mask::from_fn(n, |i| i % 3 == 0));
    let unit = UnitAppearance {
        mask: Arc::clone(&third),
        color: Some(Vec3::X),
        opacity: 0.8,
        visible: true,
        tone: Tone::NEUTRAL,
    };
    let overlay = Overlay { mask: third, color: Vec3::Y, mix: 0.6, opacity: 1.0 };
    let clip = Clip::plane(DVec3::ZERO, DVec3::X);
    vec![
        ("lit, a highlighted selection", Appearance { overlay: Some(overlay), ..plain.clone() }),
        ("lit, one unit", Appearance { units: vec![unit.clone()], ..plain.clone() }),
        ("lit, eight units", Appearance { units: vec![unit; 8], ..plain.clone() }),
        ("lit, a clip plane through the middle", Appearance { clips: vec![clip], ..plain.clone() }),
        ("lit, colours of its own", Appearance { colors: Some(Arc::from(vec![Vec3::ONE; n])), ..plain }),
    ]
}

struct Bench {
    gpu: Gpu,
    rounds: usize,
}

impl Bench {
    /// Prints the row of a scene under a look, and gives its picture.
    fn row(&self, name: &str, scene: &Scene, look: &Appearance, half: bool, full: Option<&Image>) -> Image {
        let options = Options { half, ..Options::default() };
        let mut renderer = Renderer::with_options(&self.gpu, scene, options).unwrap();
        let rasterizer = if renderer.blends_quads() { Rasterizer::Quads } else { Rasterizer::Tiles };
        let settings = Settings { rasterizer, ..Settings::default() };
        let cameras: [Camera; 1] = [framing::default_camera(scene, SIZE, SIZE)];
        let image = renderer.picture(&cameras, look, settings).unwrap().0.remove(0);
        let passes: Vec<PassSeconds> = (0..self.rounds)
            .filter_map(|_| {
                renderer.draw(&cameras, look, settings).unwrap();
                renderer.finish().unwrap().0.seconds
            })
            .collect();
        let ms = |of: fn(&PassSeconds) -> f64, share: f64| {
            quantile(&mut passes.iter().map(|p| 1e3 * of(p)).collect::<Vec<_>>(), share)
        };
        let error = full.map_or_else(String::new, |full| {
            format!("{:.1} dB", Difference::between(&image, full).unwrap().footprint_psnr_db)
        });
        println!(
            "| {name} | {:.1} | {:.1} / {:.1} | {:.1} | {:.1} | {error} |",
            renderer.column_bytes() as f64 / scene.len() as f64,
            ms(|p| p.project, 0.0),
            ms(|p| p.project, 0.5),
            ms(|p| p.list, 0.5),
            ms(PassSeconds::total, 0.5),
        );
        image
    }
}
