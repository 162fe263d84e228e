//! How much the picture along one and the same ray changes when the camera turns or zooms, for each projection and quality
//! level, and what each costs: `cargo run --release --workspace --example view_consistency -- SCENE... [--size PIXELS]`.
//!
//! A camera at the scene's default distance with 100° of field of view is turned about its eye (yaw 5, 15 and 30°, roll 20°) or
//! zoomed (1.25×). Where its pixels' rays meet the turned picture that is sampled and compared with the straight one. Sampling
//! costs nothing: the turned picture is drawn at 4 × 4 offsets of a quarter pixel and put together to one four times as
//! fine, in which even a Gaussian of the least width (√0.3 px) is smooth, and read there bicubically.

#![allow(clippy::print_stdout, reason = "a bench prints its table")]

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use glam::{DMat4, DQuat, DVec2};
use sg_render_node::image::Image;
use sg_render_node::metrics::Difference;
use sg_render_node::render::{Options, Projection, Quality, render};
use sg_render_node::view;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::load::{LoadOptions, load};
use sg_scene::model::Scene;

/// Offsets along each axis.
const FINE: usize = 4;

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

/// A picture four times as fine in samples, of the same pixels.
struct Fine {
    width: usize,
    height: usize,
    rgba: Vec<f32>,
}

impl Fine {
    fn draw(scene: &Scene, look: &Appearance, camera: &Camera, options: Options) -> Result<Self, Box<dyn Error>> {
        let (w, h) = (camera.width as usize, camera.height as usize);
        let (width, height) = (FINE * w, FINE * h);
        let mut rgba = vec![0.0; 4 * width * height];
        for j in 0..FINE {
            for i in 0..FINE {
                let shift = |k: usize| (k as f64 + 0.5) / FINE as f64 - 0.5;
                let moved = Camera { cx: camera.cx - shift(i), cy: camera.cy - shift(j), ..camera.clone() };
                let image = render(scene, look, &moved, options)?.image;
                for (k, pixel) in image.pixels().enumerate() {
                    let at = 4 * ((k / w * FINE + j) * width + k % w * FINE + i);
                    if let Some(to) = rgba.get_mut(at..at + 4) {
                        to.copy_from_slice(pixel);
                    }
                }
            }
        }
        Ok(Self { width, height, rgba })
    }

    /// Catmull and Rom's cubic at pixel coordinates; `None` near the edges and outside.
    fn at(&self, pixel: DVec2) -> Option<[f32; 4]> {
        let place = pixel * FINE as f64 - 0.5;
        let cell = place.floor();
        let inside =
            cell.x >= 1.0 && cell.y >= 1.0 && cell.x + 2.0 < self.width as f64 && cell.y + 2.0 < self.height as f64;
        if !inside {
            return None;
        }
        let weights = |t: f64| {
            let (t2, t3) = (t * t, t * t * t);
            [
                0.5 * (-t + 2.0 * t2 - t3),
                0.5 * (2.0 - 5.0 * t2 + 3.0 * t3),
                0.5 * (t + 4.0 * t2 - 3.0 * t3),
                0.5 * (t3 - t2),
            ]
        };
        let (wx, wy) = (weights(place.x - cell.x), weights(place.y - cell.y));
        let mut sum = [0.0_f64; 4];
        for (j, wy) in wy.iter().enumerate() {
            for (i, wx) in wx.iter().enumerate() {
                let at = 4 * ((cell.y as usize + j - 1) * self.width + cell.x as usize + i - 1);
                for (sum, x) in sum.iter_mut().zip(self.rgba.get(at..at + 4)?) {
                    *sum += wx * wy * f64::from(*x);
                }
            }
        }
        Some(sum.map(|x| x as f32))
    }
}

/// The turned picture along the straight one's rays, and the straight one where those are in it; nothing elsewhere.
fn along_rays(straight: &Image, camera: &Camera, turned: &Fine, turn: &Turn) -> (Image, Image) {
    let (mut got, mut want) = (straight.clone(), straight.clone());
    let pixels = got.rgba.chunks_exact_mut(4).zip(want.rgba.chunks_exact_mut(4));
    for (k, (got, want)) in pixels.enumerate() {
        let pixel = DVec2::new((k % camera.width as usize) as f64 + 0.5, (k / camera.width as usize) as f64 + 0.5);
        let focal = DVec2::new(camera.fx, camera.fy);
        let ray = ((pixel - DVec2::new(camera.cx, camera.cy)) / focal).extend(1.0);
        let there = turn.rotation * ray;
        let at = there.truncate() / there.z * focal * turn.zoom + DVec2::new(camera.cx, camera.cy);
        match turned.at(at).filter(|_| there.z > 0.0) {
            Some(sample) => got.copy_from_slice(&sample),
            None => {
                got.fill(0.0);
                want.fill(0.0);
            }
        }
    }
    (got, want)
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
    for file in &files {
        let scene = load(Path::new(file), &LoadOptions::default())?.scene;
        let look = Appearance::of(&scene);
        let framed = view::default_view(&scene, size, size);
        let bounds = view::visible_box(&scene);
        let middle = 0.5 * (bounds.min + bounds.max);
        let focal = 0.5 * f64::from(size) / (0.5 * FIELD_OF_VIEW.to_radians()).tan();
        // Near enough that the scene fills the wider view.
        let close = view::dolly(&framed, middle, framed.fx / focal);
        let camera = Camera { fx: focal, fy: focal, ..close };
        let name = Path::new(file).file_name().map_or_else(|| file.clone(), |n| n.to_string_lossy().into_owned());
        println!("{name}: {} Gaussians, {size} x {size}, {FIELD_OF_VIEW}°, eye {:.2}", scene.len(), camera.eye());
        print!("| projection | quality | ms |");
        for turn in turns() {
            print!(" {} dB |", turn.name);
        }
        println!(" against its exact, dB |");
        for projection in [Projection::Affine, Projection::PerRay] {
            let exact = render(&scene, &look, &camera, Options { quality: Quality::Exact, projection })?.image;
            for quality in [Quality::Exact, Quality::Standard, Quality::Fast] {
                let options = Options { quality, projection };
                let mut times: Vec<f64> = (0..7)
                    .map(|_| {
                        let began = Instant::now();
                        render(&scene, &look, &camera, options).map(|_| 1e3 * began.elapsed().as_secs_f64())
                    })
                    .collect::<Result<_, _>>()?;
                times.sort_by(f64::total_cmp);
                let straight = render(&scene, &look, &camera, options)?.image;
                print!("| {projection:?} | {quality:?} | {:.0} |", times.get(3).copied().unwrap_or_default());
                for turn in turns() {
                    let world = (DMat4::from_quat(turn.rotation) * camera.view()).transpose().to_cols_array();
                    let turned = Camera {
                        world_to_camera: world,
                        fx: turn.zoom * camera.fx,
                        fy: turn.zoom * camera.fy,
                        ..camera.clone()
                    };
                    let fine = Fine::draw(&scene, &look, &turned, options)?;
                    let (got, want) = along_rays(&straight, &camera, &fine, &turn);
                    let d = Difference::between(&got, &want)?;
                    print!(" {:.1} |", d.footprint_psnr_db);
                }
                println!(" {:.1} |", Difference::between(&straight, &exact)?.footprint_psnr_db);
            }
        }
    }
    Ok(())
}
