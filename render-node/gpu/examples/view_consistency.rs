//! The change of the picture along one and the same ray when the camera turns or zooms, for each projection and quality level,
//! and the cost of each. Run: `cargo run --release --workspace --example view_consistency -- SCENE... [--size PIXELS]`.
//!
//! A camera at the scene's default distance with 100° of field of view is turned about its eye or zoomed (1.25×). The turns are
//! yaw 5, 15 and 30°, and roll 20°. Rays go through 128 pixels of the straight picture. The turned picture is drawn at the place
//! that holds the same ray. It is shifted by a fraction of a pixel so that the ray passes through a pixel's centre: nothing is
//! resampled. The PSNR is over those rays. A zoom changes the size of a pixel, hence the dilation, in both projections.

#![allow(clippy::print_stdout, reason = "a bench prints its table")]

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use glam::{DMat4, DQuat, DVec2};
use sg_formats::load::{LoadOptions, load};
use sg_gpu::{DeviceClass, Gpu, Renderer, Settings};
use sg_raster::image::Image;
use sg_raster::image_error::Difference;
use sg_raster::render::{Options, Projection, Quality, render};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;
use sg_scene::{camera_motion, framing};

/// Rays that are compared.
const RAYS: usize = 128;

/// Edge of the picture that is drawn around a ray: a tile.
const TILE: u32 = 16;

/// Vertical field of view in degrees.
const FIELD_OF_VIEW: f64 = 100.0;

struct Turn {
    name: &'static str,
    rotation: DQuat,
    zoom: f64,
}

fn turns() -> Vec<Turn> {
    let yaw = |name, degrees: f64| Turn { name, rotation: DQuat::from_rotation_y(degrees.to_radians()), zoom: 1.0 };
    vec![
        yaw("yaw 5°", 5.0),
        yaw("yaw 15°", 15.0),
        yaw("yaw 30°", 30.0),
        Turn { name: "roll 20°", rotation: DQuat::from_rotation_z(20.0_f64.to_radians()), zoom: 1.0 },
        Turn { name: "zoom 1.25", rotation: DQuat::IDENTITY, zoom: 1.25 },
    ]
}

/// Pixels of the picture whose rays are compared: a lattice that fills it evenly without rows (Roberts 2018).
fn pixels(size: u32) -> Vec<(u32, u32)> {
    let at = |k: usize, step: f64| ((0.5 + k as f64 * step).fract() * f64::from(size)) as u32;
    (0..RAYS).map(|k| (at(k, 0.754_877_666), at(k, 0.569_840_291))).collect()
}

/// Makes a picture of the scene at hand.
type Draws<'a> = dyn FnMut(&Camera, Options) -> Result<Image, Box<dyn Error>> + 'a;

/// The turned camera's colour along the ray through a pixel of the straight one. It is drawn at the same place of a tile, so that
/// the ray passes through the pixel's centre. `None` if the turned picture does not hold the ray.
fn seen(
    draw: &mut Draws<'_>,
    camera: &Camera,
    turn: &Turn,
    (x, y): (u32, u32),
    options: Options,
) -> Result<Option<[f32; 4]>, Box<dyn Error>> {
    let focal = DVec2::new(camera.fx, camera.fy);
    let principal = DVec2::new(camera.cx, camera.cy);
    let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
    let there = turn.rotation * ((pixel - principal) / focal).extend(1.0);
    let at = there.truncate() / there.z * focal * turn.zoom + principal;
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    if there.z <= 0.0 || at.cmplt(DVec2::ZERO).any() || at.cmpge(size).any() {
        return Ok(None);
    }
    let (column, row) = (x % TILE, y % TILE);
    let shifted = principal - at + DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
    let tile = Camera {
        width: TILE,
        height: TILE,
        fx: turn.zoom * camera.fx,
        fy: turn.zoom * camera.fy,
        cx: shifted.x,
        cy: shifted.y,
        world_to_camera: (DMat4::from_quat(turn.rotation) * camera.view()).transpose().to_cols_array(),
        ..camera.clone()
    };
    Ok(draw(&tile, options)?.pixel(column, row))
}

/// PSNR over the rays that both pictures hold and either sees something on.
fn along_rays(
    draw: &mut Draws<'_>,
    camera: &Camera,
    turn: &Turn,
    straight: &Image,
    options: Options,
) -> Result<f64, Box<dyn Error>> {
    let (mut got, mut want) = (Vec::new(), Vec::new());
    for pixel in pixels(camera.width) {
        let Some(turned) = seen(draw, camera, turn, pixel, options)? else { continue };
        got.extend(turned);
        want.extend(straight.pixel(pixel.0, pixel.1).unwrap_or_default());
    }
    let row = |rgba: Vec<f32>| Image { width: (rgba.len() / 4) as u32, height: 1, rgba };
    Ok(Difference::between(&row(got), &row(want))?.footprint_psnr_db)
}

/// Milliseconds of five pictures, decibels along identical rays under each turn, decibels against the reference.
fn row(
    name: &str,
    draw: &mut Draws<'_>,
    camera: &Camera,
    options: Options,
    exact: &Image,
) -> Result<(), Box<dyn Error>> {
    let straight = draw(camera, options)?;
    let mut times: Vec<f64> = (0..5)
        .map(|_| {
            let began = Instant::now();
            draw(camera, options).map(|_| 1e3 * began.elapsed().as_secs_f64())
        })
        .collect::<Result<_, _>>()?;
    times.sort_by(f64::total_cmp);
    let Options { quality, projection, .. } = options;
    print!("| {name} | {projection:?} | {quality:?} | {:.0} |", times.get(2).copied().unwrap_or_default());
    for turn in turns() {
        let db = along_rays(draw, camera, &turn, &straight, options)?;
        print!(" {db:.1} |");
    }
    println!(" {:.1} |", Difference::between(&straight, exact)?.footprint_psnr_db);
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut files = Vec::new();
    let mut size = 256_u32;
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--size" => size = arguments.next().ok_or("--size takes a number of pixels")?.parse()?,
            _ => files.push(argument),
        }
    }
    let gpu = Gpu::open(DeviceClass::Any).inspect_err(|e| println!("SKIPPED on the device: {e}")).ok();
    for file in &files {
        let scene = load(Path::new(file), &LoadOptions::default())?.scene;
        table(file, &scene, size, gpu.as_ref())?;
    }
    Ok(())
}

/// The table of one scene.
fn table(file: &str, scene: &Scene, size: u32, gpu: Option<&Gpu>) -> Result<(), Box<dyn Error>> {
    let look = Appearance::of(scene);
    let framed = framing::default_camera(scene, size, size);
    let bounds = framing::visible_box(scene);
    let middle = 0.5 * (bounds.min + bounds.max);
    let focal = 0.5 * f64::from(size) / (0.5 * FIELD_OF_VIEW.to_radians()).tan();
    // Near enough that the scene fills the wider view.
    let close = camera_motion::dolly(&framed, middle, framed.fx / focal);
    let camera = Camera { fx: focal, fy: focal, ..close };
    let name = Path::new(file).file_name().map_or_else(|| file.to_owned(), |n| n.to_string_lossy().into_owned());
    println!("{name}: {} Gaussians, {size} x {size}, {FIELD_OF_VIEW}°\n", scene.len());
    print!("| drawn by | projection | quality | ms |");
    for turn in turns() {
        print!(" {} dB |", turn.name);
    }
    println!(" against its exact, dB |\n|---|---|---|---|{}---|", "---|".repeat(turns().len()));
    let mut cores = |camera: &Camera, options| Ok(render(scene, &look, camera, options)?.image);
    let mut renderer = gpu.map(|gpu| Renderer::new(gpu, scene)).transpose()?;
    for projection in [Projection::Affine, Projection::PerRay] {
        let exact = cores(&camera, Options { quality: Quality::Exact, projection, ..Options::default() })?;
        for quality in [Quality::Exact, Quality::Standard, Quality::Fast] {
            row("cores", &mut cores, &camera, Options { quality, projection, ..Options::default() }, &exact)?;
        }
        let Some(renderer) = &mut renderer else { continue };
        let mut device = |camera: &Camera, options| -> Result<Image, Box<dyn Error>> {
            let Options { quality, projection, .. } = options;
            let settings = Settings { quality, projection, ..Settings::default() };
            let (mut images, _) = renderer.picture(std::slice::from_ref(camera), &look, settings)?;
            images.pop().ok_or_else(|| "the device made no picture".into())
        };
        for quality in [Quality::Standard, Quality::Fast] {
            row("device, tiles", &mut device, &camera, Options { quality, projection, ..Options::default() }, &exact)?;
        }
    }
    Ok(())
}
