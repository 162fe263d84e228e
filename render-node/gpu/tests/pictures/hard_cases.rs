//! The promises on every case of the list, and further known facts of the hard ones.

use glam::{DMat4, DVec3, Vec3};
use sg_raster::image::Image;
use sg_raster::image_error::Difference;
use sg_raster::render::Quality::{self, Exact, Fast, Standard};
use sg_raster::render::render;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::cases::{self, FAR};
use crate::oracle;
use crate::quality::promises_are_kept;
use crate::scenes::{Blob, camera, crowd, draw, logit, scene};

const LEVELS: [Quality; 3] = [Exact, Standard, Fast];

fn alpha(image: &Image, x: u32, y: u32) -> f32 {
    image.pixel(x, y).unwrap()[3]
}

#[test]
fn every_quality_level_meets_its_error_bound_on_every_case() {
    for case in cases::all() {
        promises_are_kept(case.name, &case.scene, &case.appearance, &case.camera);
    }
}

#[test]
fn a_needle_far_from_its_centre() {
    let cases = cases::all();
    let case = cases.iter().find(|c| c.name == "needle far from its centre").unwrap();
    let picture = |quality| render(&case.scene, &case.appearance, &case.camera, quality).unwrap().image;
    let (exact, standard) = (picture(Exact), picture(Standard));
    assert!(exact.rgba.iter().any(|a| *a > 0.02), "it is in the picture");
    let d = Difference::between(&standard, &exact).unwrap();
    assert!(d.max_error < 2e-3 && d.footprint_psnr_db > 60.0, "{d:?}");
}

#[test]
fn smaller_than_a_pixel_and_of_no_size() {
    // Of any size below a pixel only the dilation's 0.3 px² is left: α = o·exp(−½r²/0.3).
    for log_scale in [1e-5_f32.ln(), -80.0, f32::NEG_INFINITY] {
        let point = Blob { log_scale: Vec3::splat(log_scale), logit: logit(0.9), ..Blob::default() };
        for quality in LEVELS {
            let drawn = draw(&scene(&[point]), &camera(80.0, 17, 17), quality);
            assert_eq!(drawn.report.drawn, 1);
            for (x, want) in [(8, 0.9), (9, 0.9 * (-0.5_f32 / 0.3).exp())] {
                let got = alpha(&drawn.image, x, 8);
                assert!((got - want).abs() < 1e-4, "{quality:?} {log_scale}: {got} {want}");
            }
        }
    }
}

#[test]
fn huge_gaussians_cover_everything() {
    for size in [1e6_f32, 1e20, 1e38] {
        let huge = Blob { log_scale: Vec3::splat(size.ln()), logit: logit(0.5), ..Blob::default() };
        for quality in LEVELS {
            let drawn = draw(&scene(&[huge, Blob::default()]), &camera(80.0, 40, 30), quality);
            // Half of it lies before the eye.
            assert!((alpha(&drawn.image, 0, 0) - 0.25).abs() < 1e-4, "{quality:?} {size}");
            assert!(drawn.image.rgba.iter().all(|x| x.is_finite()));
        }
    }
}

#[test]
fn non_finite_gaussians_are_dropped_and_counted() {
    let camera = camera(80.0, 33, 33);
    for quality in LEVELS {
        let want = draw(&scene(&[Blob::default()]), &camera, quality).image;
        let got = draw(&scene(&cases::not_numbers()), &camera, quality);
        assert_eq!((got.report.dropped_non_finite, got.report.drawn), (cases::broken().len(), 1), "{quality:?}");
        assert_eq!(got.image, want, "{quality:?}");
    }
}

#[test]
fn quaternions_of_any_length() {
    let long = Blob { log_scale: Vec3::new(-1.5, -3.0, -4.0), ..Blob::default() };
    let camera = camera(80.0, 33, 33);
    let picture = |rotation| draw(&scene(&[Blob { rotation, ..long }]), &camera, Standard).image;
    let unit = picture([0.5, 0.5, 0.5, 0.5]);
    for factor in [1e-30_f32, 0.01, 7.0, 1e30] {
        assert!(oracle::distance(&picture([0.5 * factor; 4]), &unit) < 1e-5, "{factor}");
    }
    assert_eq!(picture([0.0; 4]), picture([1.0, 0.0, 0.0, 0.0]), "zero is the identity");
}

#[test]
fn the_eye_inside_a_gaussian_and_the_near_plane_through_many() {
    let blobs = cases::near_plane();
    let camera = camera(40.0, 64, 48);
    // The eye is in all of the last twelve, half of each lies before it.
    let around = draw(&scene(&blobs[400..]), &camera, Exact);
    assert_eq!((around.report.culled_near, around.report.drawn), (0, 12));
    let want = 1.0 - (1.0 - 0.5 * 0.03_f64).powi(6) * (1.0 - 0.5 * 0.02_f64).powi(6);
    let got = f64::from(alpha(&around.image, 32, 24));
    assert!((got - want).abs() < 2e-3, "{got} {want}");
    // A near distance beyond them takes them all away.
    let beyond = draw(&scene(&blobs[400..]), &Camera { near: 3.0, ..camera }, Exact);
    assert_eq!((beyond.report.culled_near, beyond.report.drawn), (12, 0));
}

#[test]
fn equal_depths_everywhere() {
    let sheet = cases::one_depth();
    let camera = camera(80.0, 120, 90);
    let exact = draw(&scene(&sheet), &camera, Exact).image;
    assert!(oracle::distance(&exact, &oracle::draw(&sheet, &camera, DVec3::ZERO)) < 2e-7);
}

#[test]
fn opacity_one_hides_gaussians_behind() {
    for logit in [40.0, f32::INFINITY] {
        let front = Blob { logit, color: Vec3::X, ..Blob::default() };
        let behind = Blob { position: Vec3::new(0.0, 0.0, 4.0), color: Vec3::Y, logit, ..Blob::default() };
        for quality in LEVELS {
            let image = draw(&scene(&[behind, front]), &camera(80.0, 33, 33), quality).image;
            let [r, g, b, a] = image.pixel(16, 16).unwrap();
            assert!((r - 1.0).abs() < 1e-6 && g.abs() < 1e-6 && b == 0.0 && (a - 1.0).abs() < 1e-6, "{quality:?}");
        }
    }
}

#[test]
fn a_thousand_layers_of_fog() {
    let layers = cases::thousand_layers();
    let camera = camera(80.0, 65, 65);
    let want = 1.0 - 0.996_f64.powi(1000);
    for quality in LEVELS {
        let got = f64::from(alpha(&draw(&scene(&layers), &camera, quality).image, 32, 32));
        assert!((got - want).abs() < 1e-5, "{quality:?}: {got} {want}");
    }
}

#[test]
fn a_million_units_from_the_origin() {
    let (near, here) = cases::on_a_lattice();
    let (far, there) = cases::far_from_the_origin();
    assert!(far.iter().zip(&near).all(|(f, n)| f.position - FAR == n.position), "the same scene");
    for quality in LEVELS {
        let a = draw(&scene(&near), &here, quality).image;
        let b = draw(&scene(&far), &there, quality).image;
        let d = Difference::between(&b, &a).unwrap();
        assert!(d.psnr_db > 90.0, "{quality:?}: {d:?}");
    }
}

#[test]
fn no_gaussian_leaves_the_background() {
    for blobs in [vec![], vec![Blob { position: Vec3::NEG_Z, ..Blob::default() }]] {
        let scene = scene(&blobs);
        let mut appearance = Appearance::of(&scene);
        appearance.background = Vec3::new(0.25, 0.5, 0.75);
        for quality in LEVELS {
            let drawn = render(&scene, &appearance, &camera(80.0, 33, 20), quality).unwrap();
            assert!(drawn.image.pixels().all(|p| p == [0.25, 0.5, 0.75, 0.0]), "{quality:?}");
            assert_eq!((drawn.image.pixels().len(), drawn.report.drawn), (33 * 20, 0));
        }
    }
    let none = Scene::compose(vec![], None);
    assert_eq!(draw(&none, &camera(80.0, 1, 1), Standard).image.rgba, [0.0; 4]);
}

#[test]
#[ignore = "takes a minute and 6 GB"]
fn ten_million_in_stereo_and_twenty_million() {
    let eye = |x: f64| Camera { cx: 320.0 + 100.0 * x, ..camera(600.0, 640, 640) };
    let shifted = |x: f64| Camera {
        world_to_camera: DMat4::from_translation(DVec3::new(-x, 0.0, 0.0)).transpose().to_cols_array(),
        ..eye(x)
    };
    for (n, eyes) in [(10_000_000, vec![-0.032, 0.032]), (20_000_000, vec![0.0])] {
        let scene = crowd(n);
        for x in eyes {
            let drawn = draw(&scene, &shifted(x), Standard);
            println!("{n} at {x}: {:?}", drawn.report);
            assert!(drawn.report.drawn == n && drawn.image.rgba.iter().all(|v| v.is_finite()));
            assert!(alpha(&drawn.image, 320, 320) > 0.99);
        }
    }
}
