//! Picking against a test of every Gaussian.

use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};
use sg_raster::pick::{SURFACE, front_ids, pick, pick_ray};
use sg_raster::render::{Options, Projection, Quality, RenderError, render};
use sg_scene::appearance::{Appearance, Clip, UnitAppearance};
use sg_scene::camera::Camera;
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_scene::tone::Tone;

use crate::scenes::{Blob, camera, cloud, logit, scene, side_view, surface};

const BOTH: [Projection; 2] = [Projection::Affine, Projection::PerRay];

/// The front Gaussian as pictures tell it: the first that, all behind it hidden, brings A to the level. Asks for a picture of
/// one pixel for each Gaussian in order of `depths`.
fn by_pictures(
    scene: &Scene,
    look: &Appearance,
    camera: &Camera,
    at: DVec2,
    projection: Projection,
    level: f32,
) -> Option<u32> {
    let one = Camera { width: 1, height: 1, cx: camera.cx - at.x + 0.5, cy: camera.cy - at.y + 0.5, ..camera.clone() };
    let options = Options { quality: Quality::Exact, projection, ..Options::default() };
    let coverage = |shown: &dyn Fn(usize) -> bool| {
        let mask = Arc::new(Mask::from_fn(scene.len(), |i| !shown(i)));
        let mut look = look.clone();
        look.units.push(UnitAppearance { mask, color: None, opacity: 1.0, visible: false, tone: Tone::NEUTRAL });
        render(scene, &look, &one, options).unwrap().image.pixel(0, 0).unwrap()[3]
    };
    // Colours that count: each Gaussian alone in white over the others in black tells its share T·α. The shares of those in front
    // of it sum to the opacity accumulated before it.
    let share = |i: usize| {
        let mut look = look.clone();
        look.colors = Some((0..scene.len()).map(|k| if k == i { Vec3::ONE } else { Vec3::ZERO }).collect());
        render(scene, &look, &one, options).unwrap().image.pixel(0, 0).unwrap()[0]
    };
    if coverage(&|_| true) < level {
        return None;
    }
    // A Gaussian's share is its α times the transmittance of the nearer ones; alone it is α.
    let mut found: Option<(f32, usize)> = None;
    for i in 0..scene.len() {
        let alone = coverage(&|k| k == i);
        if alone < 1e-6 {
            continue;
        }
        let before = 1.0 - share(i) / alone;
        let after = before + share(i);
        if before < level && after >= level && found.is_none_or(|(least, _)| before < least) {
            found = Some((before, i));
        }
    }
    found.map(|(_, i)| i as u32)
}

#[test]
fn the_front_is_where_pictures_say() {
    let scene = scene(&cloud(60, 31).iter().map(|b| Blob { log_scale: b.log_scale + 1.5, ..*b }).collect::<Vec<_>>());
    let look = Appearance::of(&scene);
    let camera = side_view(40, 30, 40.0);
    for projection in BOTH {
        let (ids, _) = front_ids(&scene, &look, &camera, projection, SURFACE).unwrap();
        let mut hits = 0;
        for (x, y) in [(20, 15), (14, 12), (25, 18), (18, 8), (28, 12), (1, 1)] {
            let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let want = by_pictures(&scene, &look, &camera, at, projection, 0.5);
            let got = pick(&scene, &look, &camera, projection, at, SURFACE).unwrap();
            assert_eq!(got.map(|h| h.gaussian), want, "{projection:?} {x},{y}");
            assert_eq!(ids.at(x, y), want, "{projection:?} {x},{y}");
            hits += usize::from(want.is_some());
        }
        assert!(hits >= 3, "there is something to hit: {hits}");
    }
}

#[test]
fn every_pixel_of_the_id_image_equals_picking() {
    let scene = scene(&surface(1500, 32));
    let look = Appearance::of(&scene);
    let camera = side_view(45, 37, 45.0);
    for projection in BOTH {
        let (ids, report) = front_ids(&scene, &look, &camera, projection, 0.7).unwrap();
        assert!(report.drawn > 1000);
        for (x, y) in (0..45).step_by(4).flat_map(|x| (0..37).step_by(3).map(move |y| (x, y))) {
            let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let hit = pick(&scene, &look, &camera, projection, at, 0.7).unwrap();
            assert_eq!(ids.at(x, y), hit.map(|h| h.gaussian), "{projection:?} {x},{y}");
            // The point lies on the pixel's ray, at its depth, near the Gaussian.
            let Some(hit) = hit else { continue };
            let seen = camera.view().transform_point3(hit.point);
            let back = seen.truncate() / seen.z * camera.fx + DVec2::new(camera.cx, camera.cy);
            assert!((back - at).length() < 1e-6 && (seen.z - hit.depth).abs() < 1e-9);
            assert!(hit.point.distance(scene.position(hit.gaussian as usize).unwrap()) < 0.5);
        }
    }
    assert_eq!(front_ids(&scene, &look, &camera, Projection::Affine, SURFACE).unwrap().0.at(45, 0), None);
}

#[test]
fn a_sheet_is_hit_at_its_depth() {
    // A flat opaque Gaussian across the view at depth 3, tilted by 45° about y, and a faint one before it.
    let tilt = std::f32::consts::FRAC_PI_8;
    let sheet = Blob {
        position: Vec3::new(0.0, 0.0, 3.0),
        log_scale: Vec3::new(0.0, 0.0, -9.0),
        rotation: [tilt.cos(), 0.0, tilt.sin(), 0.0],
        logit: 12.0,
        ..Blob::default()
    };
    let faint = Blob { position: Vec3::new(0.0, 0.0, 1.0), logit: logit(0.3), ..Blob::default() };
    let scene = scene(&[faint, sheet]);
    let look = Appearance::of(&scene);
    let camera = camera(60.0, 64, 64);
    for projection in BOTH {
        for (x, y) in [(32.0, 32.0), (40.0, 32.0), (26.0, 45.0)] {
            let hit = pick(&scene, &look, &camera, projection, DVec2::new(x, y), SURFACE).unwrap().unwrap();
            // The hit lies on the plane x + z = 3 or z − x = 3, depending on the turn, along the ray (s, ·, 1).
            let s = (x - 32.0) / 60.0;
            let planes = [3.0 / (1.0 + s), 3.0 / (1.0 - s)];
            let off = planes.map(|z| (hit.depth - z).abs()).into_iter().fold(f64::INFINITY, f64::min);
            assert!(hit.gaussian == 1 && off < 0.02, "{projection:?} {x},{y}: {hit:?} {planes:?}");
        }
        // From 30 % on, the faint one is the front.
        let hit = pick(&scene, &look, &camera, projection, DVec2::splat(32.0), 0.29).unwrap().unwrap();
        assert!(hit.gaussian == 0 && (hit.depth - 1.0).abs() < 1e-6, "{hit:?}");
    }
    let along = |from: DVec3, direction: DVec3| pick_ray(&scene, &look, from, direction, 1e-3, SURFACE).unwrap();
    let hit = along(DVec3::new(0.0, 0.0, 6.0), DVec3::new(0.0, 0.0, -4.0)).unwrap();
    assert!(hit.gaussian == 1 && (hit.depth - 3.0).abs() < 1e-3 && (hit.point.z - 3.0).abs() < 1e-3, "{hit:?}");
    assert_eq!(along(DVec3::new(0.0, 0.0, 6.0), DVec3::Z), None, "it lies behind");
    let error = pick_ray(&scene, &look, DVec3::ZERO, DVec3::ZERO, 1e-3, SURFACE).unwrap_err();
    assert!(matches!(error, RenderError::Ray), "{error}");
    for level in [0.0, 1.1, f64::NAN] {
        let error = pick(&scene, &look, &camera, Projection::Affine, DVec2::ZERO, level).unwrap_err();
        assert!(matches!(error, RenderError::Level { .. }), "{error}");
    }
}

#[test]
fn hidden_gaussians_are_not_hit() {
    let near = Blob { logit: 9.0, ..Blob::default() };
    let far = Blob { position: Vec3::new(0.0, 0.0, 4.0), log_scale: Vec3::splat(-0.5), ..near };
    let scene = scene(&[near, far]);
    let camera = camera(80.0, 33, 33);
    let front = |look: &Appearance, projection| {
        let hit = pick(&scene, look, &camera, projection, DVec2::splat(16.5), SURFACE).unwrap().map(|h| h.gaussian);
        assert_eq!(front_ids(&scene, look, &camera, projection, SURFACE).unwrap().0.at(16, 16), hit);
        hit
    };
    let plain = Appearance::of(&scene);
    let unit = |visible, opacity| UnitAppearance {
        mask: Arc::new(Mask::from_fn(2, |i| i == 0)),
        color: None,
        opacity,
        visible,
        tone: Tone::NEUTRAL,
    };
    for projection in BOTH {
        assert_eq!(front(&plain, projection), Some(0));
        assert_eq!(front(&Appearance { units: vec![unit(false, 1.0)], ..plain.clone() }, projection), Some(1));
        assert_eq!(front(&Appearance { units: vec![unit(true, 0.2)], ..plain.clone() }, projection), Some(1));
        let behind = Clip::plane(DVec3::new(0.0, 0.0, 3.0), DVec3::Z);
        assert_eq!(front(&Appearance { clips: vec![behind.clone()], ..plain.clone() }, projection), Some(1));
        let all = Clip { keep_inside: false, ..Clip::between(DVec3::splat(-9.0), DVec3::splat(9.0), true) };
        assert_eq!(front(&Appearance { clips: vec![behind, all], ..plain.clone() }, projection), None);
    }
}
