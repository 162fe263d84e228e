//! Properties of a direct start: budget, determinism, optical depth and colours, and unusual volumes.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use std::collections::HashSet;

use glam::{DMat3, DVec3, Vec3};
use sg_fit::{DirectError, DirectStart, Options, direct_start};
use sg_scene::mask::Mask;
use sg_scene::model::{Convention, Scene};
use sg_scene::size::size;
use sg_volume::dvr::Material;
use sg_volume::phantom::{self, VesselTree};
use sg_volume::transfer::{BaseUnitRange, ControlPoint, Scale, Units};
use sg_volume::{Field, Grid, TransferFunction, Volume};

fn function(points: &[(f64, [f32; 3], f32)], units: &[(&str, f64, f64)]) -> TransferFunction {
    TransferFunction {
        domain: [0.0, 255.0],
        units: Units::Raw,
        scale: Scale::Linear,
        variable: None,
        points: points.iter().map(|&(value, color, opacity)| ControlPoint { value, color, opacity }).collect(),
        base_units: units.iter().map(|&(n, a, b)| BaseUnitRange { name: n.into(), range: [a, b] }).collect(),
    }
}

fn field(grid: Grid, f: impl Fn(DVec3) -> f32) -> Field {
    let values: Vec<f32> = (0..grid.len()).map(|i| f(grid.voxel(i).as_dvec3())).collect();
    Volume::new(grid, values.into(), None).unwrap().to_field()
}

fn start(field: &Field, function: &TransferFunction, gaussians: usize) -> Result<DirectStart, DirectError> {
    direct_start(field, function, &Options { gaussians, ..Options::default() }, |_| {})
}

/// Gaussians only where the volume is seen.
fn shell(field: &Field, function: &TransferFunction, gaussians: usize) -> DirectStart {
    direct_start(field, function, &Options { gaussians, interior: 0.0, ..Options::default() }, |_| {}).unwrap()
}

/// A ball of value 200 and radius 8 in 24³ voxels of value 0, one voxel of ramp.
fn ball(grid: Grid) -> Field {
    field(grid, |p| 200.0 * (8.5 - (p - 11.5).length()).clamp(0.0, 1.0) as f32)
}

fn ball_function() -> TransferFunction {
    function(&[(20.0, [1.0, 0.5, 0.2], 0.0), (150.0, [1.0, 0.5, 0.2], 0.8)], &[])
}

#[test]
fn one_seed_gives_one_scene_on_any_number_of_threads() {
    let volume = VesselTree::new().rasterize(48, 3).unwrap().volume().unwrap().to_field();
    let f = phantom::transfer_function();
    let with = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let options = Options { gaussians: 3000, seed, ..Options::default() };
        pool.install(|| direct_start(&volume, &f, &options, |_| {}).unwrap().scene)
    };
    let a = with(1, 7);
    assert_eq!(a, with(3, 7));
    assert_ne!(a.units[0].gaussians.position, with(2, 8).units[0].gaussians.position);
}

#[test]
fn a_ball_becomes_a_surface_with_outward_normals() {
    let s = shell(&ball(Grid::unit([24; 3]).unwrap()), &ball_function(), 2000);
    let [unit] = s.scene.units.as_slice() else { panic!("one unit") };
    let g = &unit.gaussians;
    let shading = g.shading.as_ref().unwrap();
    g.check_lengths().unwrap();
    assert!(g.len() <= 2000 && g.len() > 1950, "{}", g.len());
    assert_eq!((unit.convention, unit.oriented_normals), (Convention::Ours, true));
    assert_eq!(unit.name, "volume");
    assert!((unit.palette - Vec3::new(1.0, 0.5, 0.2)).length() < 1e-5);
    let bounds = s.scene.bounds;
    assert_eq!((bounds.min, bounds.max), (DVec3::splat(-0.5), DVec3::splat(23.5)));
    let (mut radial, mut agreeing, mut flat) = (0.0, 0, 0.0);
    for i in 0..g.len() {
        let out = (g.position[i] - 11.5).normalize();
        radial += (g.position[i] - 11.5).length();
        agreeing += usize::from(shading.normal[i].dot(out) > 0.9);
        let scale = g.scale(i);
        flat += scale.z / scale.y;
        // The shortest axis is the last one; it stands on the surface.
        let axis = g.unit_rotation(i).as_quat() * Vec3::Z;
        agreeing += usize::from(axis.dot(out) > 0.8);
        assert!(scale.x >= scale.y && scale.y >= scale.z && scale.z > 0.0);
        assert!((0.0..1.0).contains(&g.opacity(i)));
        assert!(shading.offset_color[i].length() < 1e-5);
        assert!((shading.normal[i].length() - 1.0).abs() < 1e-4);
    }
    let n = g.len() as f32;
    assert!((6.5..8.5).contains(&(radial / n)), "mean radius {}", radial / n);
    assert!(agreeing as f32 > 1.9 * n, "{agreeing} of {}", 2.0 * n);
    assert!((0.3..0.75).contains(&(flat / n)), "{}", flat / n);
    assert!(s.report.importance_captured > 0.7, "{}", s.report.importance_captured);
}

#[test]
fn coverage_is_even_where_the_volume_is() {
    // A homogeneous haze: distances to the nearest neighbour hardly vary, unlike those of random points (σ/μ = 0.36).
    let haze = field(Grid::unit([20; 3]).unwrap(), |_| 100.0);
    let s = start(&haze, &function(&[(100.0, [0.5; 3], 0.02)], &[]), 800).unwrap();
    let p = &s.scene.units[0].gaussians.position;
    let nearest: Vec<f32> = p
        .iter()
        .enumerate()
        .map(|(i, a)| {
            let others = p.iter().enumerate().filter(|(j, _)| *j != i);
            others.map(|(_, b)| a.distance(*b)).fold(f32::INFINITY, f32::min)
        })
        .collect();
    let mean = nearest.iter().sum::<f32>() / nearest.len() as f32;
    let spread = (nearest.iter().map(|d| (d - mean).powi(2)).sum::<f32>() / nearest.len() as f32).sqrt() / mean;
    assert!(spread < 0.2, "{spread}");
    assert!(s.report.units[0].mean_surfaceness < 0.01);
    let shading = s.scene.units[0].gaussians.shading.as_ref().unwrap();
    assert!(shading.ambient.iter().all(|&ka| (ka - Material::STANDARD.haze_ambient).abs() < 0.01));
    assert!(shading.diffuse.iter().all(|&kd| kd < 0.01), "without a surface no direction counts");
}

#[test]
fn the_optical_depth_of_a_haze_is_kept() {
    let haze = field(Grid::unit([24; 3]).unwrap(), |_| 100.0);
    let f = function(&[(100.0, [0.5; 3], 0.01)], &[]);
    let s = start(&haze, &f, 1500).unwrap();
    let g = &s.scene.units[0].gaussians;
    // The integrated extinction of a Gaussian is 2π·s₁·s₂·Li₂(o), Li₂(o) = o + o²/4 + o³/9 + …; the volume's is extinction · volume.
    let total: f64 = (0..g.len())
        .map(|i| {
            let scale = g.scale(i).as_dvec3();
            let o = f64::from(g.opacity(i));
            std::f64::consts::TAU * scale.x * scale.y * (o + o * o / 4.0 + o.powi(3) / 9.0)
        })
        .sum();
    let want = -(-0.01_f64).ln_1p() / haze.grid().reference_length() * 24.0_f64.powi(3);
    assert!((total / want - 1.0).abs() < 2e-3, "{total} {want}");
}

#[test]
fn units_follow_the_ranges_and_keep_their_colours() {
    let volume = field(Grid::unit([24; 3]).unwrap(), |p| if p.x < 12.0 { 50.0 } else { 150.0 });
    let f = function(
        &[(99.0, [0.1, 0.6, 0.2], 0.3), (101.0, [0.7, 0.2, 0.1], 0.6)],
        &[("green", 0.0, 100.0), ("nowhere", 200.0, 255.0), ("red", 100.0, 200.0)],
    );
    let s = start(&volume, &f, 1000).unwrap();
    let names: Vec<&str> = s.scene.units.iter().map(|u| u.name.as_str()).collect();
    assert_eq!(names, ["green", "nowhere", "red"]);
    assert_eq!(s.scene.units[1].gaussians.len(), 0);
    assert!((s.scene.units[0].palette - Vec3::new(0.1, 0.6, 0.2)).length() < 1e-5);
    assert!((s.scene.units[2].palette - Vec3::new(0.7, 0.2, 0.1)).length() < 1e-5);
    // A cell's centroid lies among its own unit's voxels.
    assert!(s.scene.units[0].gaussians.position.iter().all(|p| p.x < 12.0));
    assert!(s.scene.units[2].gaussians.position.iter().all(|p| p.x > 11.0));
    assert!(s.scene.units[0].gaussians.len() > 100 && s.scene.units[2].gaussians.len() > 100);
    assert_eq!(s.report.voxels_outside_base_units, 0);
}

#[test]
fn values_between_the_ranges_go_to_the_nearest_unit_and_are_counted() {
    let volume = field(Grid::unit([8; 3]).unwrap(), |p| if p.x < 4.0 { 50.0 } else { 95.0 });
    let f = function(&[(0.0, [0.5; 3], 0.3)], &[("a", 40.0, 60.0), ("b", 120.0, 200.0)]);
    let s = start(&volume, &f, 100).unwrap();
    assert_eq!(s.report.voxels_outside_base_units, 256);
    assert!(s.scene.units[1].gaussians.position.iter().all(|p| p.x > 3.4));
    assert!(!s.scene.units[1].gaussians.is_empty());
}

#[test]
fn odd_volumes_are_answered() {
    let opaque = function(&[(0.0, [0.5; 3], 0.9)], &[]);
    // One voxel; one voxel thick; more Gaussians than voxels; a constant volume.
    for dims in [[1, 1, 1], [16, 16, 1], [1, 9, 1], [5, 5, 5]] {
        let volume = field(Grid::unit(dims).unwrap(), |_| 80.0);
        let s = start(&volume, &opaque, 4000).unwrap();
        let g = &s.scene.units[0].gaussians;
        assert!(g.len() > 2000 && g.len() <= 4000, "{dims:?}: {}", g.len());
        let bounds = s.scene.bounds;
        for (p, l) in g.position.iter().zip(&g.log_scale) {
            let p = p.as_dvec3();
            assert!(p.cmpge(bounds.min).all() && p.cmple(bounds.max).all(), "{dims:?}: {p}");
            assert!(l.is_finite());
        }
        let places: HashSet<[u32; 3]> = g.position.iter().map(|p| p.to_array().map(f32::to_bits)).collect();
        assert_eq!(places.len(), g.len(), "no two in one place");
    }
    // One Gaussian.
    let volume = ball(Grid::unit([24; 3]).unwrap());
    let s = start(&volume, &ball_function(), 1).unwrap();
    assert_eq!(s.scene.len(), 1);
    assert!((s.scene.units[0].gaussians.position[0] - 11.5).length() < 1.0);
}

#[test]
fn nan_is_transparent_and_counted() {
    let volume = field(Grid::unit([8; 3]).unwrap(), |p| if p.x < 4.0 { f32::NAN } else { 100.0 });
    let s = start(&volume, &function(&[(0.0, [0.5; 3], 0.5)], &[]), 500).unwrap();
    assert_eq!((s.report.non_finite_voxels, s.report.visible_voxels), (256, 256));
    assert!(s.scene.units[0].gaussians.position.iter().all(|p| p.is_finite() && p.x > 3.4));
    let nothing = field(Grid::unit([4; 3]).unwrap(), |_| f32::NAN);
    let error = start(&nothing, &function(&[(0.0, [0.5; 3], 0.5)], &[]), 10).unwrap_err();
    assert!(matches!(error, DirectError::NothingVisible { count: 64, non_finite: 64, .. }), "{error}");
}

#[test]
fn invalid_input_is_refused() {
    let volume = ball(Grid::unit([24; 3]).unwrap());
    let clear = function(&[(0.0, [0.5; 3], 0.0)], &[]);
    let message = start(&volume, &clear, 10).unwrap_err().to_string();
    assert!(message.contains("nothing is visible") && message.contains("0 to 200"), "{message}");
    assert_eq!(start(&volume, &ball_function(), 0), Err(DirectError::Budget(0)));
    let thick = Options { flattening: 0.0, ..Options::default() };
    assert_eq!(direct_start(&volume, &ball_function(), &thick, |_| {}), Err(DirectError::Flattening(0.0)));
    let inside = Options { interior: 1.5, ..Options::default() };
    assert_eq!(direct_start(&volume, &ball_function(), &inside, |_| {}), Err(DirectError::Interior(1.5)));
    let hidden = Options { hidden: -0.5, ..Options::default() };
    assert_eq!(direct_start(&volume, &ball_function(), &hidden, |_| {}), Err(DirectError::Hidden(-0.5)));
    let mut many = ball_function();
    many.base_units = (0..256).map(|i| BaseUnitRange { name: i.to_string(), range: [0.0, 255.0] }).collect();
    assert_eq!(start(&volume, &many, 10), Err(DirectError::TooManyUnits(256)));
}

#[test]
fn physical_space_is_kept_far_from_the_origin_too() {
    // Rotated, mirrored, anisotropic, and 1e7 away: the same ball at its new place.
    let direction = DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_X, DVec3::NEG_Z);
    let origin = DVec3::new(1e7, -2e7, 3e6);
    let spacing = DVec3::new(0.01, 0.02, 0.03);
    let grid = Grid::new([24; 3], spacing, origin, direction).unwrap();
    let s = start(&ball(grid.clone()), &ball_function(), 1500).unwrap();
    let near =
        start(&ball(Grid::new([24; 3], spacing, DVec3::ZERO, direction).unwrap()), &ball_function(), 1500).unwrap();
    let middle = grid.to_world(DVec3::splat(11.5));
    for i in 0..s.scene.len() {
        let r = (grid.to_voxel(s.scene.position(i).unwrap()) - 11.5).length();
        assert!(r < 9.0, "{i}: {r} voxels from the middle at {middle}");
        // The error of f32 positions at 1e7 would be whole metres of rounding against a ball of 0.3.
        let difference = s.scene.position(i).unwrap() - origin - near.scene.position(i).unwrap();
        assert!(difference.length() < 1e-5, "{difference}");
    }
    assert!(grid.bounds().min.abs_diff_eq(s.scene.bounds.min, 1e-9));
}

#[test]
fn progress_is_reported_in_order() {
    let mut seen = Vec::new();
    direct_start(&ball(Grid::unit([24; 3]).unwrap()), &ball_function(), &Options::default(), |p| seen.push(p)).unwrap();
    assert_eq!(seen.len(), seen[0].of);
    assert!(seen.iter().enumerate().all(|(i, p)| p.done == i && p.of == seen.len()));
}

#[test]
fn a_fitted_body_encloses_its_volume() {
    // A ball in millimetres, in voxels that are no cubes.
    let grid = Grid::new([40; 3], DVec3::new(0.5, 0.5, 1.0), DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let radius = 8.0;
    let whole = field(grid, |p| {
        let place = (p - 19.5) * DVec3::new(0.5, 0.5, 1.0);
        (200.0 * (radius + 0.5 - place.length()).clamp(0.0, 1.0)) as f32
    });
    let measured = |scene: &Scene| size(scene, &Mask::full(scene.len())).unwrap();
    for (gaussians, is_shell) in [(1000, true), (16_000, true), (1000, false), (16_000, false)] {
        let made = if is_shell {
            Ok(shell(&whole, &ball_function(), gaussians))
        } else {
            start(&whole, &ball_function(), gaussians)
        };
        let found = measured(&made.unwrap().scene);
        let share = found.enclosed / (4.0 / 3.0 * std::f64::consts::PI * f64::powi(radius, 3));
        assert!((found.extent / (2.0 * radius) - 1.0).abs().max_element() < 0.05, "{}", found.extent);
        // Gaussians of the surface reach beyond it, by some 4 % of the radius.
        assert!((0.95..1.15).contains(&share), "{share}");
        let is_hollow = found.occupied < 0.5 * found.enclosed;
        assert_eq!(is_hollow, is_shell, "{gaussians}: {} of {}", found.occupied, found.enclosed);
    }
    // Vessels of a few voxels; the tips of the thinnest stay open. Their walls blur over voxels, and the outer part of a wall hides
    // less than half of the light.
    let raster = VesselTree::new().rasterize(96, 1).unwrap();
    let labels = raster.labels().unwrap().to_field();
    let truth = labels.values().iter().filter(|label| **label > 0.0).count() as f64;
    let scene = start(&raster.volume().unwrap().to_field(), &phantom::transfer_function(), 30_000).unwrap().scene;
    let share = measured(&scene).enclosed / (truth * (scene.bounds.longest_edge() / 96.0).powi(3));
    assert!((0.55..1.15).contains(&share), "{share}");
}

/// A core of value 200 in a shell of value 100.
fn nested() -> Field {
    field(Grid::unit([32; 3]).unwrap(), |p| {
        let r = (p - 15.5).length();
        (100.0 * (13.0 - r).clamp(0.0, 1.0) + 100.0 * (6.0 - r).clamp(0.0, 1.0)) as f32
    })
}

#[test]
fn gaussians_of_hidden_values_wait_for_another_function() {
    let core = function(&[(140.0, [1.0, 0.2, 0.2], 0.0), (190.0, [1.0, 0.2, 0.2], 0.8)], &[]);
    let whole = function(&[(40.0, [0.2, 0.4, 1.0], 0.0), (90.0, [0.2, 0.4, 1.0], 0.5)], &[]);
    let (volume, options) = (nested(), Options { gaussians: 4000, hidden: 0.3, ..Options::default() });
    let DirectStart { mut scene, report } = direct_start(&volume, &core, &options, |_| {}).unwrap();
    let radius = |scene: &Scene, i: usize| (scene.position(i).unwrap() - 15.5).length();
    let opacity = |scene: &Scene, i: usize| scene.units[0].gaussians.opacity(i);
    let outside: Vec<usize> = (0..scene.len()).filter(|&i| (8.0..12.0).contains(&radius(&scene, i))).collect();
    assert!(outside.len() > 400 && report.units[0].hidden >= outside.len(), "{} {report:?}", outside.len());
    assert!(outside.iter().all(|&i| opacity(&scene, i) < 1e-6), "hidden until then");
    // They belong to nothing that is shown.
    let all = direct_start(&volume, &core, &Options { hidden: 0.0, ..options }, |_| {}).unwrap();
    assert!((scene.units[0].palette - all.scene.units[0].palette).length() < 0.02);
    assert_eq!((all.report.units[0].hidden, all.report.visible_voxels), (0, report.visible_voxels));

    let before = scene.units[0].gaussians.clone();
    sg_reclassify::reclassify(&mut scene.units[0], &whole).unwrap();
    let shown = outside.iter().filter(|&&i| opacity(&scene, i) > 0.2).count();
    assert!(shown > outside.len() * 3 / 4, "{shown} of {}", outside.len());
    let after = &scene.units[0].gaussians;
    assert_eq!(
        (&before.position, &before.rotation, &before.log_scale),
        (&after.position, &after.rotation, &after.log_scale)
    );
    let blue = scene.units[0].palette + after.shading.as_ref().unwrap().offset_color[outside[0]];
    assert!((blue - Vec3::new(0.2, 0.4, 1.0)).length() < 0.02, "{blue}");
}

#[test]
fn the_own_function_gives_back_the_direct_start() {
    let volume = VesselTree::new().rasterize(48, 3).unwrap().volume().unwrap().to_field();
    let f = phantom::transfer_function();
    let started = start(&volume, &f, 3000).unwrap().scene;
    let mut again = started.clone();
    sg_reclassify::reclassify(&mut again.units[0], &f).unwrap();
    let (before, after) = (&started.units[0].gaussians, &again.units[0].gaussians);
    let mean = |of: &dyn Fn(usize) -> f64| (0..before.len()).map(of).sum::<f64>() / before.len() as f64;
    let opacities = mean(&|i| f64::from((before.opacity(i) - after.opacity(i)).abs()));
    let (a, b) = (before.shading.as_ref().unwrap(), after.shading.as_ref().unwrap());
    let colors = mean(&|i| f64::from((a.offset_color[i] - b.offset_color[i]).length()));
    let diffuse = (0..before.len()).map(|i| (a.diffuse[i] - b.diffuse[i]).abs()).fold(0.0, f32::max);
    assert!(opacities < 0.03 && colors < 1e-3 && diffuse < 1e-4, "{opacities} {colors} {diffuse}");
}

#[test]
fn what_training_changed_stays_under_its_own_function() {
    let volume = VesselTree::new().rasterize(48, 3).unwrap().volume().unwrap().to_field();
    let f = phantom::transfer_function();
    let classifier = f.classifier(volume.range()).unwrap();
    let started = start(&volume, &f, 2000).unwrap().scene;
    let mut trained = started.clone();
    let gaussians = &mut trained.units[0].gaussians;
    for i in 0..gaussians.len() {
        let wave = (i as f32).sin();
        gaussians.opacity_logit[i] += 0.3 * wave;
        gaussians.log_scale[i] += 0.1 * wave;
        let color = &mut gaussians.shading.as_mut().unwrap().offset_color[i];
        *color = (*color + 0.05 * wave).clamp(-started.units[0].palette, 1.0 - started.units[0].palette);
    }
    sg_reclassify::sources::follow_training(&mut trained, &started, &classifier);
    let mut again = trained.clone();
    sg_reclassify::reclassify(&mut again.units[0], &f).unwrap();
    let (before, after) = (&trained.units[0].gaussians, &again.units[0].gaussians);
    let same = |i: &usize| {
        let (a, b) = (before.shading.as_ref().unwrap(), after.shading.as_ref().unwrap());
        (before.opacity(*i) - after.opacity(*i)).abs() < 2e-3
            && (a.offset_color[*i] - b.offset_color[*i]).length() < 1e-4
    };
    // Gaussians that the function nearly hides could have any factor, so theirs is bounded.
    assert!((0..before.len()).filter(same).count() > before.len() * 95 / 100);
}
