//! Pictures in motion, and pictures of half precision: their error and what they save.

use sg_gpu::{Options, Rasterizer, Renderer, Settings};
use sg_raster::image::Image;
use sg_raster::image_error::Difference;
use sg_raster::render::{Options as Reference, Projection, Quality, render};

use crate::cases;
use crate::support::device;

/// Least decibels of a picture in motion over the frame and over the footprint.
const MOTION_DECIBELS: f64 = 35.0;

/// Cases of other kinds. The last two have the largest errors.
const CASES: [&str; 8] = [
    "eye in a centre",
    "eye touches a surface, near distance",
    "needles",
    "110 degrees",
    "one depth",
    "harmonics of degree 3",
    "thousand layers",
    "two moved units",
];

/// In the affine projection on cases of all kinds, and by ray on the first one, since references by ray take long. Run by hand
/// with `MOTION_CASES=all` it draws every case.
#[test]
fn motion_draws_fewer_pairs_within_its_bound() {
    let Some(gpu) = device() else { return };
    let (mut all, mut fast, mut fewer) = (0, 0, 0);
    let every = std::env::var("MOTION_CASES").is_ok_and(|v| v == "all");
    for (k, case) in cases::all().into_iter().filter(|c| every || CASES.contains(&c.name)).enumerate() {
        let mut renderer = Renderer::new(&gpu, &case.scene).unwrap();
        let mut camera = case.camera.clone();
        // An order of fewer bits needs a near distance.
        camera.near = camera.near.max(1e-3 * case.scene.bounds.longest_edge());
        let cameras = std::slice::from_ref(&camera);
        for projection in [Projection::Affine, Projection::PerRay] {
            if projection == Projection::PerRay && k > 0 {
                continue;
            }
            let reference = Reference { quality: Quality::Exact, projection, ..Reference::default() };
            let Ok(exact) = render(&case.scene, &case.appearance, &camera, reference) else { continue };
            let standard = Settings { projection, ..Settings::default() };
            let (_, before) = renderer.picture(cameras, &case.appearance, standard).unwrap();
            let quick = Settings { quality: Quality::Fast, ..standard };
            let (_, quick) = renderer.picture(cameras, &case.appearance, quick).unwrap();
            for rasterizer in [Rasterizer::Tiles, Rasterizer::Quads] {
                if rasterizer == Rasterizer::Quads && projection == Projection::PerRay {
                    continue;
                }
                let settings = Settings { in_motion: true, rasterizer, ..standard };
                let (images, drawn) = renderer.picture(cameras, &case.appearance, settings).unwrap();
                let d = Difference::between(&images[0], &exact.image).unwrap();
                println!(
                    "{:30} {projection:?} {rasterizer:?}: {:.1} dB, footprint {:.1} dB, coverage {:.2} %; {} of {} pairs, fast {}",
                    case.name,
                    d.psnr_db,
                    d.footprint_psnr_db,
                    100.0 * d.coverage_error,
                    drawn.tile_pairs,
                    before.tile_pairs,
                    quick.tile_pairs
                );
                assert!(images[0].rgba.iter().all(|x| x.is_finite()), "{}", case.name);
                // Squares of its coordinates leave f32.
                if case.name != "mixture of extremes" {
                    assert!(d.psnr_db.min(d.footprint_psnr_db) >= MOTION_DECIBELS, "{}: {d:?}", case.name);
                }
                if rasterizer == Rasterizer::Tiles {
                    assert!(drawn.tile_pairs <= before.tile_pairs, "{}", case.name);
                    (all, fast, fewer) = (all + before.tile_pairs, fast + quick.tile_pairs, fewer + drawn.tile_pairs);
                }
            }
        }
    }
    println!("{fewer} pairs of {all} in all; fast {fast}");
}

/// What a target of eight bits stores.
fn eight_bits(image: &Image) -> Vec<u8> {
    image.rgba.iter().map(|x| (255.0 * x.clamp(0.0, 1.0)).round() as u8).collect()
}

/// Pictures of half precision differ from those of full precision by one step of eight bits at most, with every rasterizer.
#[test]
fn half_precision_costs_at_most_one_step_of_eight_bits() {
    let Some(gpu) = device() else { return };
    let mut worst = f64::INFINITY;
    for (k, case) in cases::all().into_iter().enumerate() {
        // A renderer is made for each.
        if k % 8 != 1 {
            continue;
        }
        let half = Options { half_pictures: true, ..Options::default() };
        let pictures = [Options::default(), half].map(|options| {
            let mut renderer = Renderer::with_options(&gpu, &case.scene, options).unwrap();
            let cameras = std::slice::from_ref(&case.camera);
            [Rasterizer::Tiles, Rasterizer::Quads].map(|rasterizer| {
                let settings = Settings { rasterizer, ..Settings::default() };
                renderer.picture(cameras, &case.appearance, settings).unwrap().0.remove(0)
            })
        });
        let [full, half] = pictures;
        for (full, half) in full.iter().zip(&half) {
            let d = Difference::between(half, full).unwrap();
            let [a, b] = [full, half].map(eight_bits);
            let step = a.iter().zip(&b).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(step <= Some(1), "{}: {step:?}", case.name);
            if d.footprint_psnr_db.is_finite() {
                worst = worst.min(d.footprint_psnr_db);
            }
        }
    }
    println!("half precision: at least {worst:.1} dB over the footprint");
    assert!(worst > 65.0, "{worst} dB");
}
