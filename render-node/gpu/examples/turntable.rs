//! A scene from all sides as each backend draws it, with sixteen times the difference to `exact` below each row:
//! `cargo run --release --workspace --example turntable -- bonsai/scene.toml sheet.png`.

#![allow(clippy::print_stdout, reason = "an example says what it measured")]

use std::error::Error;
use std::path::Path;

use sg_formats::load::{LoadOptions, load};
use sg_gpu::{DeviceClass, Gpu, Rasterizer, Renderer, Settings};
use sg_raster::image::Image;
use sg_raster::image_error::Difference;
use sg_raster::render::{Quality, render};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::{camera_motion, framing};

/// Views of one turn, and the edge of each picture in pixels.
const VIEWS: u32 = 4;
const SIZE: u32 = 144;

/// The factor on differences.
const FACTOR: f32 = 16.0;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, out] = arguments.as_slice() else {
        return Err("two arguments: a scene file and the picture to write".into());
    };
    let scene = load(Path::new(scene), &LoadOptions::default())?.scene;
    let appearance = Appearance::of(&scene);
    let first = framing::default_camera(&scene, SIZE, SIZE);
    let bounds = framing::visible_box(&scene);
    let middle = 0.5 * (bounds.min + bounds.max);
    let turn: Vec<Camera> = (0..VIEWS)
        .map(|k| camera_motion::orbit(&first, middle, 360.0 * f64::from(k) / f64::from(VIEWS), 0.0))
        .collect();
    let on_cores = |quality| -> Result<Vec<Image>, Box<dyn Error>> {
        Ok(turn.iter().map(|c| render(&scene, &appearance, c, quality).map(|r| r.image)).collect::<Result<_, _>>()?)
    };
    let exact = on_cores(Quality::Exact)?;
    let mut rows = vec![("cores, standard".to_owned(), on_cores(Quality::Standard)?)];
    let gpu = Gpu::open(DeviceClass::Any)?;
    let mut renderer = Renderer::new(&gpu, &scene)?;
    for rasterizer in [Rasterizer::Tiles, Rasterizer::Quads] {
        let settings = Settings { rasterizer, ..Settings::default() };
        let mut images = Vec::new();
        for camera in &turn {
            images.extend(renderer.picture(std::slice::from_ref(camera), &appearance, settings)?.0);
        }
        rows.push((format!("{}, {rasterizer:?}, standard", gpu.name()), images));
    }
    let mut sheet = exact.clone();
    for (name, images) in rows {
        let mut least = f64::INFINITY;
        for (image, exact) in images.iter().zip(&exact) {
            least = least.min(Difference::between(image, exact)?.footprint_psnr_db);
        }
        println!("{name}: at least {least:.1} dB over the footprint");
        let differences: Vec<Image> = images.iter().zip(&exact).map(|(a, b)| magnified(a, b)).collect();
        sheet.extend(images);
        sheet.extend(differences);
    }
    side_by_side(&sheet).save(Path::new(out))?;
    Ok(())
}

/// FACTOR times the absolute difference of each colour.
fn magnified(image: &Image, exact: &Image) -> Image {
    let rgba = image.rgba.iter().zip(&exact.rgba).map(|(a, b)| FACTOR * (a - b).abs()).collect();
    Image { rgba, ..*image }
}

/// Pictures of one size in rows of VIEWS.
fn side_by_side(pictures: &[Image]) -> Image {
    let (across, edge) = (VIEWS as usize, SIZE as usize);
    let rows = pictures.len().div_ceil(across);
    let mut rgba = Vec::with_capacity(4 * edge * edge * pictures.len());
    for row in pictures.chunks(across) {
        for y in 0..edge {
            rgba.extend(row.iter().flat_map(|p| p.rgba.get(4 * edge * y..4 * edge * (y + 1)).unwrap_or_default()));
        }
    }
    Image { width: VIEWS * SIZE, height: (rows * edge) as u32, rgba }
}
