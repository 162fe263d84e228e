//! The view-consistent mode: against a definition of its own, level against level, and under turns of the camera.

use glam::{DMat4, DQuat, DVec2, DVec3, Vec3};
use sg_raster::image::Image;
use sg_raster::image_error::Difference;
use sg_raster::render::Quality::{self, Exact, Fast, Standard};
use sg_raster::render::{Options, Projection, render};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::oracle::Met;
use crate::scenes::{Blob, around_the_eye, camera, cloud, fog, logit, scene, side_view, surface};
use crate::{cases, oracle};

fn per_ray(quality: Quality) -> Options {
    Options { quality, projection: Projection::PerRay, ..Options::default() }
}

fn near(near: f64, camera: &Camera) -> Camera {
    Camera { near, ..camera.clone() }
}

fn picture(scene: &Scene, camera: &Camera, quality: Quality) -> Image {
    let appearance = Appearance { background: camera.background(), ..Appearance::of(scene) };
    render(scene, &appearance, camera, per_ray(quality)).unwrap().image
}

/// Matrices as in the textbook: the inverse of each covariance, the greatest value on each ray, each pixel sorted.
pub(crate) fn definition(blobs: &[Blob], camera: &Camera) -> Image {
    let background = camera.background().as_dvec3();
    let all: Vec<(Met, f64, DVec3)> = blobs
        .iter()
        .map(|b| {
            let opacity = 1.0 / (1.0 + (-f64::from(b.logit)).exp());
            (Met::new(b, camera), opacity, b.color.as_dvec3().clamp(DVec3::ZERO, DVec3::ONE))
        })
        .collect();
    let mut rgba = Vec::new();
    for y in 0..camera.height {
        for x in 0..camera.width {
            let ray = oracle::ray(camera, DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let mut layers: Vec<(f64, f64, DVec3)> = all
                .iter()
                .map(|(met, opacity, color)| {
                    let (t, seen) = met.on(ray);
                    (t, (opacity * seen).min(1.0), *color)
                })
                .collect();
            layers.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (mut t, mut c) = (1.0, DVec3::ZERO);
            for (_, alpha, color) in layers {
                c += t * alpha * color;
                t *= 1.0 - alpha;
            }
            c += t * background;
            rgba.extend([c.x as f32, c.y as f32, c.z as f32, (1.0 - t) as f32]);
        }
    }
    Image { width: camera.width, height: camera.height, rgba }
}

#[test]
fn the_reference_equals_the_definition() {
    for (name, blobs, camera) in [
        ("cloud", cloud(400, 1), side_view(75, 50, 40.0)),
        ("cloud, 110°", cloud(400, 2), side_view(75, 50, 110.0)),
        ("surface", surface(500, 3), side_view(61, 77, 45.0)),
        ("eye inside a fog", around_the_eye(fog(300, 0.05, 4)), camera(30.0, 48, 48)),
        ("eye inside a cloud, 140°", around_the_eye(cloud(400, 5)), camera(9.0, 48, 48)),
        ("eye inside a cloud, with a near distance", around_the_eye(cloud(400, 5)), near(0.3, &camera(30.0, 48, 48))),
    ] {
        let got = picture(&scene(&blobs), &camera, Exact);
        let distance = oracle::distance(&got, &definition(&blobs, &camera));
        println!("{name}: {distance:.1e}");
        assert!(distance < 1e-6, "{name}: {distance}");
        assert!(got.pixels().any(|p| p[3] > 0.1), "there is something to compare");
    }
}

#[test]
fn on_the_axis_it_is_the_affine_picture() {
    // σ = 4 px seen from far: perspective within it is small, and the dilation is 0.3 px².
    let blob = Blob { position: Vec3::new(0.0, 0.0, 200.0), logit: logit(0.8), ..Blob::default() };
    let scene = scene(&[blob]);
    let camera = camera(8000.0, 33, 33);
    let affine = render(&scene, &Appearance::of(&scene), &camera, Exact).unwrap().image;
    let distance = oracle::distance(&affine, &picture(&scene, &camera, Exact));
    assert!(distance < 1e-5, "{distance}");
}

#[test]
fn every_quality_level_meets_its_error_bound_on_every_case() {
    for case in cases::all() {
        let draw = |quality| render(&case.scene, &case.appearance, &case.camera, per_ray(quality)).unwrap();
        let exact = draw(Exact).image;
        assert!(exact.rgba.iter().all(|x| x.is_finite()), "{}", case.name);
        for (quality, decibel, coverage) in [(Standard, 50.0, 0.01), (Fast, 40.0, 0.03)] {
            let drawn = draw(quality).image;
            assert!(drawn.rgba.iter().all(|x| x.is_finite()), "{}", case.name);
            let d = Difference::between(&drawn, &exact).unwrap();
            println!(
                "{:40} {quality:?}: {:.1} dB, footprint {:.1} dB, coverage {:.4} %, max {:.4}, {:.3} % above 2/255",
                case.name,
                d.psnr_db,
                d.footprint_psnr_db,
                100.0 * d.coverage_error,
                d.max_error,
                100.0 * d.footprint_share_above_2_of_255
            );
            // Scales there span 78 decades. The order in depth is beyond f64, and the reference guesses as well.
            let ordered = case.name != "mixture of extremes";
            let kept = d.psnr_db >= decibel && d.footprint_psnr_db >= decibel;
            assert!(kept || !ordered, "{}: {d:?}", case.name);
            let rare = quality != Standard || d.footprint_share_above_2_of_255 <= 1e-3;
            assert!(rare || !ordered, "{}: {d:?}", case.name);
            assert!(d.coverage_error <= coverage, "{}: {d:?}", case.name);
        }
    }
}

/// Turning the camera does not change the color along a ray, at any distance from the axis.
#[test]
fn a_turn_of_the_camera_changes_no_ray() {
    let scene = scene(&cloud(3000, 21));
    let straight = Camera { background: [0.1, 0.2, 0.3], ..camera(40.0, 65, 65) };
    let distance = |turn: DQuat, projection| {
        let world = (DMat4::from_quat(turn) * straight.view()).transpose().to_cols_array();
        let mut worst = 0.0_f32;
        for (x, y) in [(32, 32), (5, 60), (60, 12), (10, 8), (44, 20)] {
            // The pixel's ray in the turned camera, through a pixel's centre of a picture of one pixel.
            let ray = DVec3::new((f64::from(x) - 32.0) / 40.0, (f64::from(y) - 32.0) / 40.0, 1.0);
            let there = turn * ray;
            let at = there.truncate() / there.z * 40.0;
            let small = Camera {
                width: 1,
                height: 1,
                cx: 0.5 - at.x,
                cy: 0.5 - at.y,
                world_to_camera: world,
                ..straight.clone()
            };
            let appearance = Appearance { background: straight.background(), ..Appearance::of(&scene) };
            let options = Options { quality: Exact, projection, ..Options::default() };
            let one = render(&scene, &appearance, &small, options).unwrap().image.pixel(0, 0).unwrap();
            let all = render(&scene, &appearance, &straight, options).unwrap().image.pixel(x, y).unwrap();
            worst = one.iter().zip(all).fold(worst, |m, (a, b)| m.max((a - b).abs()));
        }
        worst
    };
    for turn in [DQuat::from_rotation_y(0.26), DQuat::from_rotation_x(-0.5), DQuat::from_rotation_z(1.0)] {
        let d = distance(turn, Projection::PerRay);
        assert!(d < 1e-6, "{turn}: {d}");
    }
    let affine = distance(DQuat::from_rotation_y(0.26), Projection::Affine);
    assert!(affine > 0.01, "what the mode is for: {affine}");
}

#[test]
fn pictures_do_not_depend_on_the_number_of_threads() {
    let scene = scene(&cloud(4000, 6));
    let camera = side_view(133, 111, 50.0);
    for quality in [Exact, Standard] {
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| picture(&scene, &camera, quality))
        };
        assert_eq!(with(1), with(3), "{quality:?}");
    }
}
