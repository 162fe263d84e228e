//! The image of a direct start against the ray-marched image of its volume: unlit, 45° field of view.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use glam::{DVec3, Vec3};
use sg_fit::{Options, direct_start};
use sg_raster::image_error::Difference;
use sg_raster::render::{Quality, render};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_volume::dvr::{self, Lighting, Pinhole};
use sg_volume::phantom::{self, VesselTree};

#[test]
fn more_and_flatter_gaussians_come_nearer_to_the_volume() {
    let field = VesselTree::new().rasterize(64, 1).unwrap().volume().unwrap().to_field();
    let function = phantom::transfer_function();
    let bounds = field.grid().bounds();
    let (middle, size) = (0.5 * (bounds.min + bounds.max), (bounds.max - bounds.min).length());
    let camera = Camera::look_at(middle + DVec3::new(0.3, -1.0, 0.25) * size, middle, DVec3::Z, 45.0, 320, 320);
    let pinhole = Pinhole {
        width: 320,
        height: 320,
        focal: [camera.fx, camera.fy],
        center: [camera.cx, camera.cy],
        world_to_camera: camera.view(),
    };
    let classifier = function.classifier(field.range()).unwrap();
    let marched = dvr::render(&field, &classifier, &pinhole, Lighting::Unlit, Vec3::ZERO, 0.5);

    let quality = |gaussians: usize, flattening: f64| {
        let options = Options { gaussians, flattening, ..Options::default() };
        let mut scene = direct_start(&field, &function, &options, |_| {}).unwrap().scene;
        for unit in &mut scene.units {
            let shading = unit.gaussians.shading.as_mut().unwrap();
            shading.ambient.fill(1.0);
            shading.diffuse.fill(0.0);
            shading.specular.fill(0.0);
        }
        let mut appearance = Appearance::of(&scene);
        appearance.background = Vec3::ZERO;
        let image = render(&scene, &appearance, &camera, Quality::Standard).unwrap().image;
        let mut reference = image.clone();
        reference.rgba = marched.pixels.iter().flatten().copied().collect();
        Difference::between(&image, &reference).unwrap()
    };
    let (few, some, many) = (quality(1_000, 0.6), quality(5_000, 0.6), quality(20_000, 0.6));
    let thick = quality(5_000, 1.0);
    let table = format!("1k {few:?}\n5k {some:?}\n20k {many:?}\n5k unflattened {thick:?}");
    assert!(few.psnr_db > FEW && some.psnr_db > SOME && many.psnr_db > MANY, "{table}");
    assert!(some.footprint_psnr_db > few.footprint_psnr_db + 2.0, "{table}");
    assert!(some.footprint_psnr_db > thick.footprint_psnr_db + 2.0, "{table}");
    assert!(many.coverage_error < 0.03, "{table}");
}

/// Least PSNR over the frame in dB for each budget.
const FEW: f64 = 27.0;
const SOME: f64 = 34.0;
const MANY: f64 = 35.0;
