//! The graphics device against the reference: every case, both rasterizers, both projections, both levels.

use sg_gpu::{Rasterizer, Renderer, Settings};
use sg_raster::image_error::Difference;
use sg_raster::render::Quality::{Exact, Fast, Standard};
use sg_raster::render::{Options, Projection, render};

use crate::cases;
use crate::support::device;

#[test]
fn every_case_on_the_device() {
    let settings = |rasterizer| Settings { rasterizer, ..Settings::default() };
    hold(&Rasterizer::ALL.map(settings));
}

#[test]
fn every_case_by_ray_on_the_device() {
    hold(&[Settings { projection: Projection::PerRay, ..Settings::default() }]);
}

/// Holds pictures of one projection to their level's promise against that projection's reference.
fn hold(each: &[Settings]) {
    let Some(gpu) = device() else { return };
    let mut broken = Vec::new();
    for case in cases::all() {
        let projection = each[0].projection;
        let reference = Options { quality: Exact, projection, ..Options::default() };
        let exact = render(&case.scene, &case.appearance, &case.camera, reference).unwrap().image;
        let mut renderer = Renderer::new(&gpu, &case.scene).unwrap();
        for settings in each {
            let rasterizer = settings.rasterizer;
            for (quality, decibel, coverage) in [(Standard, 50.0, 0.01), (Fast, 40.0, 0.03)] {
                let settings = Settings { quality, ..*settings };
                let cameras = std::slice::from_ref(&case.camera);
                let (images, drawn) = renderer.picture(cameras, &case.appearance, settings).unwrap();
                let d = Difference::between(&images[0], &exact).unwrap();
                let line = format!(
                    "{:30} {rasterizer:?} {quality:?}: {:.1} dB, footprint {:.1} dB, coverage {:.4} %, max {:.4}, {:.3} % above 2/255; {} listed, {} pairs",
                    case.name,
                    d.psnr_db,
                    d.footprint_psnr_db,
                    100.0 * d.coverage_error,
                    d.max_error,
                    100.0 * d.footprint_share_above_2_of_255,
                    drawn.listed,
                    drawn.tile_pairs,
                );
                println!("{line}");
                let held = images[0].rgba.iter().all(|x| x.is_finite())
                    && d.psnr_db >= decibel
                    && d.footprint_psnr_db >= decibel
                    && d.coverage_error <= coverage
                    && (quality != Standard || d.footprint_share_above_2_of_255 <= 1e-3);
                // Squares of its coordinates leave f32. The test only requires there that every pixel is a number.
                let beyond = case.name == "mixture of extremes" && images[0].rgba.iter().all(|x| x.is_finite());
                if !held && !beyond {
                    broken.push(line);
                }
            }
        }
    }
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
}
