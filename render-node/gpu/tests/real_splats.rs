//! The levels' promises on trained scenes. Found by `SUPERGAUSSIAN_DATA`.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by panicking and says what it measured")]

use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};
use sg_formats::load::{LoadOptions, load};
use sg_gpu::{Rasterizer, Renderer, Settings};
use sg_raster::image::Image;
use sg_raster::image_error::Difference;
use sg_raster::render::{Options, Projection, Quality, render};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;
use sg_scene::{camera_motion, framing};

mod support;

use support::device;

fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("SUPERGAUSSIAN_DATA").map(PathBuf::from);
    if folder.is_none() {
        let required = std::env::var("SUPERGAUSSIAN_REQUIRE_DATA").is_ok_and(|v| v == "1");
        assert!(!required, "SUPERGAUSSIAN_DATA must name the folder of the real data");
        println!("SKIPPED: real splats; set SUPERGAUSSIAN_DATA to the folder of the real data");
    }
    folder
}

/// Loads a scene. A `.zst` is first unpacked to a temporary place.
fn scene(path: &Path) -> Scene {
    if path.extension().is_some_and(|e| e == "zst") {
        let folder = tempfile::tempdir().unwrap();
        let plain = folder.path().join("scene.ply");
        let packed = std::fs::read(path).unwrap();
        std::fs::write(&plain, zstd::decode_all(&packed[..]).unwrap()).unwrap();
        return load(&plain, &LoadOptions::default()).unwrap().scene;
    }
    load(path, &LoadOptions::default()).unwrap().scene
}

#[test]
fn every_quality_level_of_the_donut_meets_its_error_bound_from_all_sides() {
    every_quality_level_meets_its_error_bound("donut_fused.ply");
}

#[test]
fn every_quality_level_of_the_biker_meets_its_error_bound_from_all_sides() {
    every_quality_level_meets_its_error_bound("biker.compressed.ply");
}

#[test]
fn every_quality_level_of_the_robot_meets_its_error_bound_from_all_sides() {
    every_quality_level_meets_its_error_bound("playbot_lod3_31000.ply.zst");
}

fn every_quality_level_meets_its_error_bound(name: &str) {
    let Some(data) = data() else { return };
    let gpu = device();
    let scene = scene(&data.join("splats").join(name));
    let mut device = gpu.as_ref().map(|gpu| Renderer::new(gpu, &scene).unwrap());
    let mut appearance = Appearance::of(&scene);
    appearance.background = Vec3::ONE;
    let front = framing::default_camera(&scene, 344, 368);
    let bounds = framing::visible_box(&scene);
    let middle = 0.5 * (bounds.min + bounds.max);
    for (right, up, closer) in [(0.0, 0.0, 1.0), (120.0, 25.0, 1.0), (200.0, -40.0, 3.0)] {
        let camera = camera_motion::dolly(&camera_motion::orbit(&front, middle, right, up), middle, closer);
        for (projection, rasterizers) in
            [(Projection::Affine, &Rasterizer::ALL[..]), (Projection::PerRay, &[Rasterizer::Tiles][..])]
        {
            // All rays in order take seconds, so each scene is drawn from one side.
            if projection == Projection::PerRay && up != 25.0 {
                continue;
            }
            let draw = |quality| {
                render(&scene, &appearance, &camera, Options { quality, projection, ..Options::default() }).unwrap()
            };
            let exact = draw(Quality::Exact).image;
            let what = format!("{name} {right}°, {projection:?}");
            for quality in [Quality::Standard, Quality::Fast] {
                held(&format!("{what}: cores"), quality, &draw(quality).image, &exact);
                for rasterizer in rasterizers.iter().copied() {
                    if let Some(device) = &mut device {
                        let settings = Settings { quality, rasterizer, projection, ..Settings::default() };
                        let cameras = std::slice::from_ref(&camera);
                        let (images, _) = device.picture(cameras, &appearance, settings).unwrap();
                        held(&format!("{what}: {rasterizer:?}"), quality, &images[0], &exact);
                    }
                }
            }
            if let Some(device) = device.as_mut().filter(|_| up == 25.0 && projection == Projection::Affine) {
                // Near enough for an order of fewer bits, too near for anything to fade.
                let near = Camera { near: 1e-3 * camera.eye().distance(middle), ..camera.clone() };
                moves(device, (&appearance, &what), projection, [&camera, &near], &exact);
            }
        }
    }
}

/// A picture in motion: the cut-offs alone, and those with an order of fewer bits.
fn moves(
    device: &mut Renderer,
    (appearance, what): (&Appearance, &str),
    projection: Projection,
    cameras: [&Camera; 2],
    exact: &Image,
) {
    let still = Settings { projection, ..Settings::default() };
    let pairs = |device: &mut Renderer, settings| {
        device.draw_complete(&[cameras[0].clone()], appearance, settings).unwrap().tile_pairs
    };
    let standard = pairs(device, still);
    let fast = pairs(device, Settings { quality: Quality::Fast, ..still });
    for (camera, name) in cameras.into_iter().zip(["cut-offs", "cut-offs and order"]) {
        let settings = Settings { in_motion: true, ..still };
        let (images, stats) = device.picture(std::slice::from_ref(camera), appearance, settings).unwrap();
        let d = Difference::between(&images[0], exact).unwrap();
        println!(
            "{what}, in motion, {name}: {:.1} dB, footprint {:.1} dB; {} pairs, standard {standard}, fast {fast}",
            d.psnr_db, d.footprint_psnr_db, stats.tile_pairs
        );
        assert!(d.psnr_db.min(d.footprint_psnr_db) >= 35.0, "{d:?}");
        assert!(stats.tile_pairs < fast && fast < standard);
    }
}

fn held(what: &str, quality: Quality, image: &Image, exact: &Image) {
    let (decibel, coverage) = if quality == Quality::Standard { (50.0, 0.01) } else { (40.0, 0.03) };
    assert!(image.rgba.iter().all(|x| x.is_finite()));
    let d = Difference::between(image, exact).unwrap();
    println!(
        "{what}, {quality:?} {:.1} dB, footprint {:.1} dB, coverage {:.4} %, max {:.4}, {:.4} % above 2/255",
        d.psnr_db,
        d.footprint_psnr_db,
        100.0 * d.coverage_error,
        d.max_error,
        100.0 * d.footprint_share_above_2_of_255,
    );
    assert!(d.psnr_db >= decibel && d.footprint_psnr_db >= decibel, "{d:?}");
    assert!(d.coverage_error <= coverage, "{d:?}");
    assert!(quality != Quality::Standard || d.footprint_share_above_2_of_255 <= 1e-3, "{d:?}");
}

/// The robot hovers over its patch of ground and looks at the camera with blue eyes.
#[test]
fn playbot_stands_upright() {
    let Some(data) = data() else { return };
    let scene = scene(&data.join("splats").join("playbot_lod3_31000.ply.zst"));
    let camera = framing::default_camera(&scene, 256, 256);
    let image = render(&scene, &Appearance::of(&scene), &camera, Quality::Standard).unwrap().image;
    let mean = |from: u32, to: u32| {
        let sum: DVec3 = (from..to)
            .flat_map(|y| (0..256).map(move |x| (x, y)))
            .filter_map(|(x, y)| image.pixel(x, y))
            .map(|[_, g, b, a]| DVec3::new(g.into(), b.into(), a.into()))
            .sum();
        sum / f64::from((to - from) * 256)
    };
    let (sky, head, ground) = (mean(0, 50), mean(72, 92), mean(152, 164));
    assert!(sky.z < 0.01 && head.z > 0.1 && head.z < 0.35 && ground.z > 0.5, "{sky} {head} {ground}");
    let eye = image.pixel(132, 83).unwrap();
    assert!(eye[2] > 0.3 && eye[2] > 5.0 * eye[0], "a blue eye: {eye:?}");
}

/// A moving window draws fewer pixels. They show the means of the picture at rest over their areas: at least 30 dB on the footprint
/// from a quarter of the edge on, at least 27 dB below. Pictures of fewer pixels that are no previews have down to 14 dB.
#[test]
fn a_preview_shows_the_means_of_the_picture_at_rest() {
    let Some(data) = data() else { return };
    let gpu = device();
    for name in ["donut_fused.ply", "biker.compressed.ply", "playbot_lod3_31000.ply.zst"] {
        let scene = scene(&data.join("splats").join(name));
        let mut device = gpu.as_ref().map(|gpu| Renderer::new(gpu, &scene).unwrap());
        let camera = framing::default_camera(&scene, 1032, 1104);
        for opacity in [1.0, 0.2] {
            let mut appearance = Appearance::of(&scene);
            appearance.background = Vec3::ONE;
            appearance.base.iter_mut().for_each(|base| base.opacity = opacity);
            let still = render(&scene, &appearance, &camera, Quality::Standard).unwrap().image;
            for scale in [0.75, 0.5, 0.35, 0.25, 0.18] {
                let small = camera_motion::preview(&camera, scale);
                let means = still.averaged(small.width, small.height);
                let fast = Options { quality: Quality::Fast, ..Options::default() };
                let db = |camera: &Camera| {
                    let image = render(&scene, &appearance, camera, fast).unwrap().image;
                    Difference::between(&image, &means).unwrap().footprint_psnr_db
                };
                let (preview, plain) = (db(&small), db(&camera_motion::scaled(&camera, scale)));
                let least = if scale < 0.25 { 27.0 } else { 30.0 };
                assert!(preview > least, "{name}, opacity {opacity}, edge {scale}: {preview:.1} dB");
                println!("{name}, opacity {opacity}, edge {scale}: {preview:.1} dB, plain {plain:.1} dB");
                if let Some(device) = &mut device {
                    let settings = Settings { quality: Quality::Fast, ..Settings::default() };
                    let cameras = std::slice::from_ref(&small);
                    let (images, _) = device.picture(cameras, &appearance, settings).unwrap();
                    let of_device = Difference::between(&images[0], &means).unwrap().footprint_psnr_db;
                    assert!((of_device - preview).abs() < 0.5, "{name}, {scale}: {of_device:.1}, {preview:.1} dB");
                }
            }
        }
    }
}
