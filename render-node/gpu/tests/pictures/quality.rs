//! Each level keeps its promise against the reference, and no level depends on the number of threads.

use sg_raster::image_error::Difference;
use sg_raster::render::Quality::{Exact, Fast, Standard};
use sg_raster::render::render;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::scenes::{Blob, cloud, fog, scene, side_view, surface};

fn keeps_its_promises(name: &str, blobs: &[Blob], camera: &Camera) {
    let scene = scene(blobs);
    let appearance = Appearance { background: camera.background(), ..Appearance::of(&scene) };
    promises_are_kept(name, &scene, &appearance, camera);
}

/// Checks both promises and prints the measurements.
pub(crate) fn promises_are_kept(name: &str, scene: &Scene, appearance: &Appearance, camera: &Camera) {
    let exact = render(scene, appearance, camera, Exact).unwrap();
    assert!(exact.image.rgba.iter().all(|x| x.is_finite()), "{name}");
    for (quality, decibel, coverage) in [(Standard, 50.0, 0.01), (Fast, 40.0, 0.03)] {
        let got = render(scene, appearance, camera, quality).unwrap();
        assert!(got.image.rgba.iter().all(|x| x.is_finite()), "{name}");
        let d = Difference::between(&got.image, &exact.image).unwrap();
        println!(
            "{name:40} {quality:?}: {:.1} dB, footprint {:.1} dB, coverage {:.4} %, max {:.4}, {:.3} % above 2/255",
            d.psnr_db,
            d.footprint_psnr_db,
            100.0 * d.coverage_error,
            d.max_error,
            100.0 * d.footprint_share_above_2_of_255
        );
        assert!(d.psnr_db >= decibel && d.footprint_psnr_db >= decibel, "{name}: {d:?}");
        assert!(d.coverage_error <= coverage, "{name}: {d:?}");
        if quality == Standard {
            assert!(d.footprint_share_above_2_of_255 <= 1e-3, "{name}: {d:?}");
        }
    }
}

#[test]
fn on_made_scenes() {
    keeps_its_promises("cloud", &cloud(20_000, 1), &side_view(320, 240, 40.0));
    keeps_its_promises(
        "cloud from within",
        &cloud(5_000, 2),
        &Camera::look_at(
            glam::DVec3::new(0.1, 0.2, 2.9),
            glam::DVec3::new(0.0, 0.3, 4.0),
            glam::DVec3::NEG_Y,
            80.0,
            200,
            160,
        ),
    );
    keeps_its_promises("surface", &surface(20_000, 3), &side_view(320, 240, 40.0));
    keeps_its_promises("faint fog", &fog(5_000, 0.004, 4), &side_view(160, 120, 40.0));
    keeps_its_promises("fainter fog", &fog(5_000, 0.0005, 5), &side_view(160, 120, 40.0));
}

#[test]
fn pictures_do_not_depend_on_the_number_of_threads() {
    let scene = scene(&cloud(9_000, 6));
    let appearance = Appearance::of(&scene);
    let camera = side_view(333, 211, 50.0);
    for quality in [Exact, Standard, Fast] {
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| render(&scene, &appearance, &camera, quality).unwrap().image)
        };
        let one = with(1);
        for threads in [2, 5] {
            let many = with(threads);
            let same = one.rgba.iter().zip(&many.rgba).all(|(a, b)| a.to_bits() == b.to_bits());
            assert!(same, "{quality:?}, {threads} threads");
        }
    }
}
