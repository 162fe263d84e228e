//! The compressed PLY: errors within its steps, and Morton order.

use glam::Vec3;
use sg_scene::model::Scene;
use sg_scene::synthetic::samples;

use super::Folder;
use crate::splat::{Format, WarningCode};
use crate::{LoadOptions, Loaded, SaveOptions, load, save};

/// The greatest error of a round trip within a chunk, per axis, in steps of the chunk's range.
fn steps(before: &[Vec3], after: &[Vec3]) -> Vec3 {
    let mut worst = Vec3::ZERO;
    for (a, b) in before.chunks(256).zip(after.chunks(256)) {
        let low = a.iter().copied().reduce(Vec3::min).unwrap();
        let high = a.iter().copied().reduce(Vec3::max).unwrap();
        // A chunk of a single Gaussian has no range and must be exact.
        let step = ((high - low) / Vec3::new(2047.0, 1023.0, 2047.0)).max(Vec3::splat(f32::MIN_POSITIVE));
        for (p, q) in a.iter().zip(b) {
            worst = worst.max((*p - *q).abs() / step);
        }
    }
    worst
}

#[test]
fn compressed_files_keep_their_steps() {
    let folder = Folder::new();
    for (degree, n) in [(0, 1000), (2, 256), (3, 513)] {
        let scene = Scene::compose(vec![samples::unit("a", samples::harmonic(n, degree, 3))], None);
        let loaded = folder.through("a.compressed.ply", &scene, &SaveOptions::default());
        assert_eq!((loaded.format, loaded.scene.len()), (Format::COMPRESSED, n));
        let (a, b) = (&scene.units[0].gaussians, &loaded.scene.units[0].gaussians);
        // Half a step, plus the rounding to f32 at these magnitudes.
        assert!(steps(&a.position, &b.position).max_element() < 0.501);
        assert!(steps(&a.log_scale, &b.log_scale).max_element() < 0.501);
        let (ha, hb) = (a.harmonics.as_ref().unwrap(), b.harmonics.as_ref().unwrap());
        let color_step = 3.0 / 255.0;
        for i in 0..n {
            assert!((a.opacity(i) - b.opacity(i)).abs() <= 0.5 / 255.0 + 1e-6);
            let turn = a.unit_rotation(i).dot(b.unit_rotation(i)).abs();
            assert!(turn > 1.0 - 4e-6, "rotation {i}: {turn}");
            for c in 0..3 {
                assert!((ha.dc[i][c] - hb.dc[i][c]).abs() <= 0.5 * color_step + 1e-5);
            }
        }
        for (x, y) in ha.rest.as_flattened().iter().zip(hb.rest.as_flattened()) {
            assert!((x - y).abs() <= 0.5 / 32.0 + 1e-6);
        }
        assert_eq!(a.extra, b.extra);
        // Packing is idempotent: the ranges are in the values.
        let again = folder.through("b.compressed.ply", &loaded.scene, &SaveOptions::default());
        assert!(steps(&b.position, &again.scene.units[0].gaussians.position).max_element() < 0.01);
        assert_eq!(again.scene.units[0].gaussians.harmonics.as_ref().unwrap().rest, hb.rest);
    }
}

#[test]
fn compressed_files_hide_gaussians_without_a_position() {
    let folder = Folder::new();
    let mut g = samples::harmonic(300, 0, 4);
    g.position[5] = Vec3::new(f32::NAN, 0.0, f32::INFINITY);
    let scene = Scene::compose(vec![samples::unit("a", g)], None);
    let saved = save(&folder.path("a.compressed.ply"), &scene, &SaveOptions::default()).unwrap();
    assert!(saved.warnings.iter().any(|w| w.code == WarningCode::Lossy && w.message.starts_with("1 Gaussians")));
    let loaded = load(&folder.path("a.compressed.ply"), &LoadOptions::default()).unwrap();
    let g = &loaded.scene.units[0].gaussians;
    assert!(g.opacity(5) < 1e-8 && g.position[5].is_finite());
    assert!(g.position.iter().all(|p| p.abs().max_element() <= 5.0), "a NaN does not spoil its chunk's range");
}

#[test]
fn morton_order_makes_compressed_errors_smaller_and_warns() {
    let folder = Folder::new();
    let scene = Scene::compose(vec![samples::unit("a", samples::harmonic(20_000, 0, 6))], None);
    let options = SaveOptions { reorder: true, ..SaveOptions::default() };
    let saved = save(&folder.path("a.compressed.ply"), &scene, &options).unwrap();
    assert!(saved.warnings.iter().any(|w| w.code == WarningCode::Reordered));
    let in_order = folder.through("b.compressed.ply", &scene, &SaveOptions::default());
    let reordered = load(&folder.path("a.compressed.ply"), &LoadOptions::default()).unwrap();
    // Sum of distances from each original centre to the nearest read one.
    let sum = |read: &Loaded| {
        let read = &read.scene.units[0].gaussians.position;
        let nearest = |p: &Vec3| read.iter().map(|q| p.distance(*q)).fold(f32::INFINITY, f32::min);
        scene.units[0].gaussians.position.iter().step_by(100).map(nearest).sum::<f32>()
    };
    assert!(sum(&reordered) < 0.6 * sum(&in_order), "{} against {}", sum(&reordered), sum(&in_order));
}
