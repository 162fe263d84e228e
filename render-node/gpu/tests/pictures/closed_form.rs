//! Pictures whose pixels follow from a formula on paper.

use glam::Vec3;
use sg_raster::render::Quality::{Exact, Fast, Standard};
use sg_raster::render::render;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;

use crate::scenes::{Blob, around_the_eye, camera, cloud, draw, fog, logit, scene, side_view, surface};
use crate::{cases, oracle};

/// A picture with a pixel centre exactly on the optical axis.
const ODD: u32 = 33;

#[test]
fn one_gaussian_has_the_peak_and_width_of_ewa_with_dilation() {
    // σ = 0.1 at depth 2 with f = 80 px: 4 px, and 0.3 px² of dilation.
    let scene = scene(&[Blob { logit: logit(0.8), ..Blob::default() }]);
    let picture = draw(&scene, &camera(80.0, ODD, ODD), Exact).image;
    let variance = 16.0 + 0.3;
    for y in 0..ODD {
        for x in 0..ODD {
            let [r, g, b, a] = picture.pixel(x, y).unwrap();
            let (dx, dy) = (f64::from(x) - 16.0, f64::from(y) - 16.0);
            let alpha = 0.8 * (-0.5 * (dx * dx + dy * dy) / variance).exp();
            assert!((f64::from(a) - alpha).abs() < 2e-7, "{x},{y}: {a} {alpha}");
            assert!((r - a).abs() < 1e-6 && (g - 0.5 * a).abs() < 1e-6 && (b - 0.25 * a).abs() < 1e-6);
        }
    }
}

#[test]
fn off_the_axis_the_jacobian_stretches() {
    // At (1, 0, 2) with f = 40: mean 20 px to the right, variance (fσ/z)²·(1 + (x/z)²) along x and (fσ/z)² along y.
    let scene = scene(&[Blob { position: Vec3::new(1.0, 0.0, 2.0), ..Blob::default() }]);
    let picture = draw(&scene, &camera(40.0, 65, ODD), Exact).image;
    let (vx, vy) = (4.0 * 1.25 + 0.3, 4.0 + 0.3);
    for (x, y) in [(52, 16), (54, 16), (49, 16), (52, 19), (55, 12)] {
        let (dx, dy) = (f64::from(x) - 52.0, f64::from(y) - 16.0);
        let want = 0.5 * (-0.5 * (dx * dx / vx + dy * dy / vy)).exp();
        let [.., a] = picture.pixel(x, y).unwrap();
        assert!((f64::from(a) - want).abs() < 1e-6, "{x},{y}: {a} {want}");
    }
}

#[test]
fn two_gaussians_compose_front_to_back() {
    let near = Blob { position: Vec3::new(0.0, 0.0, 1.0), logit: logit(0.75), color: Vec3::X, ..Blob::default() };
    let far = Blob { position: Vec3::new(0.0, 0.0, 2.0), logit: logit(0.5), color: Vec3::Y, ..Blob::default() };
    for blobs in [[near, far], [far, near]] {
        let scene = scene(&blobs);
        let mut appearance = Appearance::of(&scene);
        appearance.background = Vec3::new(0.0, 0.0, 0.8);
        for quality in [Exact, Standard, Fast] {
            let picture = render(&scene, &appearance, &camera(80.0, ODD, ODD), quality).unwrap().image;
            let got = picture.pixel(16, 16).unwrap();
            // 0.75 · red, then ¼ · 0.5 · green, then ⅛ of the background.
            for (got, want) in got.into_iter().zip([0.75, 0.125, 0.1, 0.875]) {
                assert!((got - want).abs() < 1e-6, "{quality:?}: {got} {want}");
            }
        }
    }
}

#[test]
fn equal_depths_are_ordered_by_index() {
    let red = Blob { logit: logit(0.75), color: Vec3::X, ..Blob::default() };
    let green = Blob { color: Vec3::Y, ..red };
    for (blobs, want) in [([red, green], [0.75, 0.1875]), ([green, red], [0.1875, 0.75])] {
        for quality in [Exact, Standard, Fast] {
            let picture = draw(&scene(&blobs), &camera(80.0, ODD, ODD), quality).image;
            let [r, g, ..] = picture.pixel(16, 16).unwrap();
            assert!((r - want[0]).abs() < 1e-6 && (g - want[1]).abs() < 1e-6, "{quality:?}");
        }
    }
}

#[test]
fn the_reference_equals_the_definition() {
    let background = Vec3::new(0.1, 0.2, 0.3);
    let near = Camera { near: 0.3, ..camera(30.0, 48, 48) };
    let nearby = |near: f64| Camera { near, ..side_view(75, 50, 110.0) };
    for (name, blobs, camera) in [
        ("cloud", cloud(600, 1), side_view(75, 50, 40.0)),
        ("cloud, 110°", cloud(600, 2), side_view(75, 50, 110.0)),
        ("surface", surface(800, 3), side_view(61, 77, 45.0)),
        ("eye inside a fog", around_the_eye(fog(300, 0.05, 4)), camera(30.0, 48, 48)),
        ("eye inside a cloud", around_the_eye(cloud(400, 5)), camera(30.0, 48, 48)),
        ("eye inside a cloud, with a near distance", around_the_eye(cloud(400, 5)), near),
        ("cloud, 110°, dilated as by rays", cloud(600, 2), nearby(0.1)),
        ("points beside the axis", cases::beside_the_axis(), Camera { near: 0.01, ..camera(30.0, 48, 48) }),
        ("cloud, 110°, between", cloud(600, 2), nearby(0.01)),
    ] {
        let scene = scene(&blobs);
        let mut appearance = Appearance::of(&scene);
        appearance.background = background;
        let got = render(&scene, &appearance, &camera, Exact).unwrap();
        let want = oracle::draw(&blobs, &camera, background.as_dvec3());
        let distance = oracle::distance(&got.image, &want);
        println!("{name}: {distance:.1e}, drawn {}", got.report.drawn);
        // The definition inverts the covariances of points and thin discs.
        let bound = if name == "points beside the axis" { 1e-6 } else { 2e-7 };
        assert!(distance < bound, "{name}: {distance}");
        assert!(got.report.drawn > 20);
        assert!(
            got.image.pixels().any(|p| p[3] > 0.1) && got.image.pixels().any(|p| p[3] < 0.9),
            "there is something to compare"
        );
    }
}
