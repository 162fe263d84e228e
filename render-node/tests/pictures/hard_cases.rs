//! Gaussians and views that break renderers.

use glam::{DVec3, Vec3};
use rand::RngExt;
use sg_render_node::image::Image;
use sg_render_node::metrics::Difference;
use sg_render_node::render::Quality::{self, Exact, Fast, Standard};
use sg_render_node::render::render;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;

use crate::oracle;
use crate::quality::keeps_its_promises;
use crate::scenes::{
    Blob, any_rotation, around_the_eye, camera, cloud, draw, fog, logit, scene, seeded, side_view, uniform3,
};

const LEVELS: [Quality; 3] = [Exact, Standard, Fast];

fn alpha(image: &Image, x: u32, y: u32) -> f32 {
    image.pixel(x, y).unwrap()[3]
}

#[test]
fn needles_of_ten_thousand_to_one() {
    let mut rng = seeded(7);
    let needles: Vec<Blob> = (0..400)
        .map(|_| Blob {
            position: uniform3(&mut rng, -1.0, 1.0) + Vec3::new(0.0, 0.0, 3.0),
            log_scale: Vec3::new(3.0_f32.ln(), 3e-4_f32.ln(), 3e-4_f32.ln()),
            rotation: any_rotation(&mut rng),
            logit: logit(0.7),
            color: uniform3(&mut rng, 0.0, 1.0),
        })
        .collect();
    keeps_its_promises("needles", &needles, &side_view(200, 150, 40.0));
}

/// Why the tile's offset is taken in f64: this needle passes through the picture 10⁵ px from its centre.
#[test]
fn a_needle_seen_far_from_its_centre() {
    let tilt = 0.3_f32;
    let far = Blob {
        position: Vec3::new(2000.0 * tilt.cos(), 2000.0 * tilt.sin(), 2.0),
        log_scale: Vec3::new(800.0_f32.ln(), -20.0, -20.0),
        rotation: [(0.5 * tilt).cos(), 0.0, 0.0, (0.5 * tilt).sin()],
        logit: 30.0,
        ..Blob::default()
    };
    let scene = scene(&[far]);
    let camera = camera(100.0, 64, 64);
    let exact = draw(&scene, &camera, Exact).image;
    let standard = draw(&scene, &camera, Standard).image;
    assert!(exact.rgba.iter().any(|a| *a > 0.02), "it is in the picture");
    let d = Difference::between(&standard, &exact).unwrap();
    assert!(d.max_error < 2e-3 && d.footprint_psnr_db > 60.0, "{d:?}");
}

#[test]
fn smaller_than_a_pixel_and_of_no_size() {
    // Of any size below a pixel the dilation's 0.3 px² is what is left: α = o·exp(−½r²/0.3).
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
    let points: Vec<Blob> = cloud(3000, 8).iter().map(|b| Blob { log_scale: Vec3::splat(-9.0), ..*b }).collect();
    keeps_its_promises("sub-pixel", &points, &side_view(120, 90, 40.0));
}

#[test]
fn huge_ones_cover_everything() {
    for size in [1e6_f32, 1e20, 1e38] {
        let huge = Blob { log_scale: Vec3::splat(size.ln()), logit: logit(0.5), ..Blob::default() };
        for quality in LEVELS {
            let drawn = draw(&scene(&[huge, Blob::default()]), &camera(80.0, 40, 30), quality);
            assert!((alpha(&drawn.image, 0, 0) - 0.5).abs() < 1e-5, "{quality:?} {size}");
            assert!(drawn.image.rgba.iter().all(|x| x.is_finite()));
        }
    }
}

#[test]
fn what_is_not_a_number_is_dropped_and_counted() {
    let good = Blob::default();
    let nan = f32::NAN;
    let broken = [
        Blob { position: Vec3::new(nan, 0.0, 2.0), ..good },
        Blob { position: Vec3::new(0.0, f32::INFINITY, 2.0), ..good },
        Blob { log_scale: Vec3::new(0.0, nan, 0.0), ..good },
        Blob { log_scale: Vec3::splat(f32::INFINITY), ..good },
        Blob { log_scale: Vec3::splat(700.0), ..good },
        Blob { rotation: [nan, 0.0, 0.0, 1.0], ..good },
        Blob { rotation: [f32::INFINITY, 0.0, 0.0, 1.0], ..good },
        Blob { logit: nan, ..good },
        Blob { color: Vec3::new(0.0, nan, 0.0), ..good },
        Blob { color: Vec3::new(0.0, f32::INFINITY, 0.0), ..good },
    ];
    let camera = camera(80.0, 33, 33);
    for quality in LEVELS {
        let want = draw(&scene(&[good]), &camera, quality).image;
        let mut all = broken.to_vec();
        all.insert(4, good);
        let got = draw(&scene(&all), &camera, quality);
        assert_eq!((got.report.dropped_non_finite, got.report.drawn), (broken.len(), 1), "{quality:?}");
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
    let mut blobs = around_the_eye(fog(400, 0.01, 9));
    for z in [1e-3, 1e-5, 2e-6, 1e-6, 0.0, -1e-3] {
        blobs.push(Blob { position: Vec3::new(0.0, 0.0, z), logit: logit(0.03), ..Blob::default() });
        blobs.push(Blob { position: Vec3::new(1e-3, 2e-3, z), logit: logit(0.02), ..Blob::default() });
    }
    let camera = camera(40.0, 64, 48);
    keeps_its_promises("eye inside", &blobs, &camera);
    let drawn = draw(&scene(&blobs), &camera, Exact);
    assert!(drawn.report.culled_near > 150);
    // 1e-6 as f32 lies below 1e-6: the last three pairs are behind the plane.
    let front = draw(&scene(&blobs[400..]), &camera, Exact);
    assert_eq!((front.report.culled_near, front.report.drawn), (6, 6));
}

#[test]
fn a_field_of_view_of_110_degrees() {
    keeps_its_promises("110 degrees", &cloud(5000, 10), &side_view(240, 180, 110.0));
}

#[test]
fn equal_depths_everywhere() {
    let sheet: Vec<Blob> =
        cloud(3000, 11).iter().map(|b| Blob { position: Vec3::new(b.position.x, b.position.y, 3.0), ..*b }).collect();
    let camera = camera(80.0, 120, 90);
    keeps_its_promises("one depth", &sheet, &camera);
    let exact = draw(&scene(&sheet), &camera, Exact).image;
    assert!(oracle::distance(&exact, &oracle::draw(&sheet, &camera, DVec3::ZERO)) < 2e-7);
}

#[test]
fn opacity_one_hides_what_is_behind() {
    for logit in [40.0, f32::INFINITY] {
        let front = Blob { logit, color: Vec3::X, ..Blob::default() };
        let behind = Blob { position: Vec3::new(0.0, 0.0, 4.0), color: Vec3::Y, logit, ..Blob::default() };
        for quality in LEVELS {
            let image = draw(&scene(&[behind, front]), &camera(80.0, 33, 33), quality).image;
            let [r, g, b, a] = image.pixel(16, 16).unwrap();
            assert!((r - 1.0).abs() < 1e-6 && g.abs() < 1e-6 && b == 0.0 && (a - 1.0).abs() < 1e-6, "{quality:?}");
        }
    }
    let opaque: Vec<Blob> = cloud(5000, 12).iter().map(|b| Blob { logit: f32::INFINITY, ..*b }).collect();
    keeps_its_promises("opacity 1", &opaque, &side_view(160, 120, 40.0));
}

#[test]
fn all_below_one_in_255() {
    let faint: Vec<Blob> = cloud(5000, 13).iter().map(|b| Blob { logit: logit(0.003), ..*b }).collect();
    keeps_its_promises("all below 1/255", &faint, &side_view(160, 120, 40.0));
}

#[test]
fn a_thousand_layers_of_fog() {
    let layers: Vec<Blob> = (0..1000)
        .map(|k| Blob {
            position: Vec3::new(0.0, 0.0, 2.0 + 0.001 * k as f32),
            log_scale: Vec3::splat(-1.0),
            logit: logit(0.004),
            color: if k % 2 == 0 { Vec3::ONE } else { Vec3::X },
            ..Blob::default()
        })
        .collect();
    let camera = camera(80.0, 65, 65);
    keeps_its_promises("thousand layers", &layers, &camera);
    let want = 1.0 - 0.996_f64.powi(1000);
    for quality in LEVELS {
        let got = f64::from(alpha(&draw(&scene(&layers), &camera, quality).image, 32, 32));
        assert!((got - want).abs() < 1e-5, "{quality:?}: {got} {want}");
    }
    keeps_its_promises("thousand-layer cloud", &fog(3000, 0.01, 14), &side_view(100, 80, 30.0));
}

/// Why positions become relative to the camera in f64: narrowed first, nothing of this picture would be left.
#[test]
fn a_million_units_from_the_origin() {
    // Positions in steps of 1/8 are exact in f32 at both places.
    let near: Vec<Blob> = cloud(2000, 15)
        .iter()
        .map(|b| Blob { position: (b.position * 64.0).round() / 8.0, log_scale: b.log_scale + 2.0, ..*b })
        .collect();
    let shift = Vec3::new(1_048_576.0, -1_048_576.0, 524_288.0);
    let far: Vec<Blob> = near.iter().map(|b| Blob { position: b.position + shift, ..*b }).collect();
    let target = DVec3::new(0.0, 0.0, 24.0);
    // No direction along which the lattice of positions has planes: equal depths would be ordered by rounding.
    let eye = DVec3::new(10.371, -6.213, 2.137);
    let view = |offset: DVec3| Camera::look_at(eye + offset, target + offset, DVec3::NEG_Y, 40.0, 160, 120);
    let (here, there) = (view(DVec3::ZERO), view(shift.as_dvec3()));
    for quality in LEVELS {
        let a = draw(&scene(&near), &here, quality).image;
        let b = draw(&scene(&far), &there, quality).image;
        let d = Difference::between(&b, &a).unwrap();
        assert!(d.psnr_db > 90.0, "{quality:?}: {d:?}");
    }
    keeps_its_promises("offset 1e6", &far, &there);
}

#[test]
fn one_gaussian_and_none() {
    keeps_its_promises("one", &[Blob::default()], &camera(80.0, 33, 20));
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
    let none = sg_scene::model::Scene::compose(vec![], None);
    assert_eq!(draw(&none, &camera(80.0, 1, 1), Standard).image.rgba, [0.0; 4]);
}

#[test]
fn a_random_mixture_of_extremes_stays_finite() {
    let mut rng = seeded(16);
    let blobs: Vec<Blob> = (0..500)
        .map(|_| {
            let mut extreme = || match rng.random_range(0..8) {
                0 => 0.0,
                1 => f32::MIN_POSITIVE,
                2 => 1e-30,
                3 => 3e38,
                4 => -1e-3,
                5 => 80.0,
                6 => -100.0,
                _ => 1.5,
            };
            Blob {
                position: Vec3::new(extreme(), extreme(), extreme()),
                log_scale: Vec3::new(extreme(), extreme(), extreme()),
                rotation: std::array::from_fn(|_| extreme()),
                logit: extreme(),
                color: Vec3::new(extreme(), extreme(), extreme()),
            }
        })
        .collect();
    for quality in LEVELS {
        let drawn = draw(&scene(&blobs), &camera(20.0, 40, 30), quality);
        assert!(drawn.image.rgba.iter().all(|x| x.is_finite()), "{quality:?}");
        assert!(drawn.report.drawn > 0);
    }
}
