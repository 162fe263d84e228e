//! Gaussians that touch hundreds of tiles: a workgroup lists the pairs of each.

use glam::Vec2;
use sg_gpu::{Options, Renderer, Settings};
use sg_raster::image_error::Difference;
use sg_raster::render::{Options as OnCores, Projection, render};
use sg_scene::camera::Camera;
use sg_scene::camera_motion::scaled;

use crate::cases::{self, Case};
use crate::support::device;

/// Edge of the pictures over that of the cases, which have fewer tiles than a large Gaussian touches.
const LARGER: f64 = 8.0;

fn large_cases() -> Vec<(Case, Camera)> {
    let names = ["huge", "near distance in a cloud", "eye in a centre"];
    let chosen = cases::all().into_iter().filter(|case| names.contains(&case.name));
    let with_camera = |case: Case| {
        let camera = scaled(&case.camera, LARGER);
        (case, camera)
    };
    let found: Vec<_> = chosen.map(with_camera).collect();
    assert_eq!(found.len(), names.len());
    found
}

#[test]
fn every_tile_of_a_large_gaussian_is_drawn() {
    let Some(gpu) = device() else { return };
    for (case, camera) in large_cases() {
        for projection in [Projection::Affine, Projection::PerRay] {
            let options = OnCores { projection, ..OnCores::default() };
            let cores = render(&case.scene, &case.appearance, &camera, options).unwrap().image;
            // One window of pairs, and many. Rays sort each window by itself.
            let windows: &[u32] = if projection == Projection::Affine { &[1 << 20, 300] } else { &[1 << 20] };
            let draw = |listed_pairs: &u32| {
                let options = Options { listed_pairs: *listed_pairs, ..Options::default() };
                let mut renderer = Renderer::with_options(&gpu, &case.scene, options).unwrap();
                let settings = Settings { projection, ..Settings::default() };
                let cameras = std::slice::from_ref(&camera);
                let (mut images, stats) = renderer.picture(cameras, &case.appearance, settings).unwrap();
                assert!(stats.tile_pairs > 300, "{} has {} pairs", case.name, stats.tile_pairs);
                images.remove(0)
            };
            let pictures: Vec<_> = windows.iter().map(draw).collect();
            assert!(pictures.iter().all(|p| *p == pictures[0]), "{}: windows make another picture", case.name);
            let d = Difference::between(&pictures[0], &cores).unwrap();
            assert!(d.psnr_db >= 60.0 && d.coverage_error <= 0.01, "{} {projection:?}: {d:?}", case.name);
        }
    }
}

#[test]
fn a_mask_hides_tiles_of_a_large_gaussian_and_changes_no_other() {
    let Some(gpu) = device() else { return };
    for (case, camera) in large_cases() {
        let mut renderer = Renderer::new(&gpu, &case.scene).unwrap();
        let mut draw = |mask: &[[Vec2; 3]]| {
            renderer.hide([mask, mask]);
            let cameras = std::slice::from_ref(&camera);
            let (mut images, stats) = renderer.picture(cameras, &case.appearance, Settings::default()).unwrap();
            (images.remove(0), stats.tile_pairs)
        };
        // The upper left half.
        let (masked, fewer) = draw(&[[Vec2::ZERO, Vec2::X, Vec2::Y]]);
        let (whole, all) = draw(&[]);
        assert!(fewer < all, "{}: {fewer} of {all} pairs", case.name);
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        for (k, (a, b)) in masked.pixels().zip(whole.pixels()).enumerate() {
            let at = [(k % camera.width as usize) as f64 + 0.5, (k / camera.width as usize) as f64 + 0.5];
            assert!(a == b || at[0] / width + at[1] / height <= 1.0, "{}: pixel {at:?}", case.name);
        }
        let hidden = masked.pixels().next().unwrap();
        assert_eq!(hidden[3], 0.0, "{}: the corner is hidden", case.name);
        assert!(whole.pixels().next().unwrap()[3] > 0.0, "{}: the corner has something to hide", case.name);
    }
}
