//! Direct starts and training from meshes of tetrahedra.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use std::ops::ControlFlow;

use glam::{DVec3, Vec3};
use sg_fit::training::{TrainingOptions, TrainingView, ViewOptions, train, volume_views};
use sg_fit::{DirectError, Options, direct_start};
use sg_raster::image_error::Difference;
use sg_raster::render::{Quality, render};
use sg_scene::model::Scene;
use sg_volume::mesh::MeshValues;
use sg_volume::phantom::{VesselTree, transfer_function};
use sg_volume::transfer::{BaseUnitRange, ControlPoint, Scale, Units};
use sg_volume::{Mesh, MeshField, TransferFunction};

/// The six tetrahedra of a cube between its corners 0 and 7 (Kuhn 1960); bit k of a corner is its place along axis k.
const KUHN: [[usize; 4]; 6] = [[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]];

/// The points and tetrahedra of cubes over the unit cube.
fn cubes(counts: [usize; 3]) -> (Vec<DVec3>, Vec<[u32; 4]>) {
    let [nx, ny, nz] = counts;
    let at = |x: usize, y: usize, z: usize| x + (nx + 1) * (y + (ny + 1) * z);
    let size = DVec3::from_array(counts.map(|n| n as f64));
    let (mut points, mut cells) = (Vec::new(), Vec::new());
    for z in 0..=nz {
        for y in 0..=ny {
            for x in 0..=nx {
                points.push(DVec3::new(x as f64, y as f64, z as f64) / size);
                if x < nx && y < ny && z < nz {
                    let corner = |k: usize| at(x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)) as u32;
                    cells.extend(KUHN.map(|cell| cell.map(corner)));
                }
            }
        }
    }
    (points, cells)
}

fn mesh(counts: [usize; 3], value: impl Fn(DVec3) -> f64) -> Mesh {
    let (points, cells) = cubes(counts);
    let values: Vec<f64> = points.iter().map(|p| value(*p)).collect();
    Mesh::new(points, cells, MeshValues::Points(values.into()), Some("density".to_owned())).unwrap()
}

/// A ball of value 1 with a soft border.
fn ball(p: DVec3) -> f64 {
    (1.0 - ((p - 0.5).length() - 0.25) / 0.15).clamp(0.0, 1.0)
}

fn function(points: &[(f64, [f32; 3], f32)]) -> TransferFunction {
    let point = |&(value, color, opacity)| ControlPoint { value, color, opacity };
    TransferFunction {
        domain: [0.0, 1.0],
        units: Units::Raw,
        scale: Scale::Linear,
        variable: None,
        points: points.iter().map(point).collect(),
        base_units: Vec::new(),
    }
}

fn ball_function() -> TransferFunction {
    function(&[(0.2, [0.9, 0.5, 0.1], 0.0), (0.9, [0.9, 0.5, 0.1], 0.3), (1.0, [0.2, 0.4, 0.9], 0.3)])
}

fn views(
    field: &MeshField,
    function: &TransferFunction,
    options: ViewOptions,
) -> (Vec<TrainingView>, Vec<TrainingView>) {
    volume_views(field, &function.classifier(field.range()).unwrap(), &options, |_, _| {})
}

/// Mean PSNR over what the mesh covers.
fn quality(scene: &Scene, views: &[TrainingView]) -> f64 {
    let of = |view: &TrainingView| {
        let image = render(scene, &view.appearance(scene), &view.camera, Quality::Standard).unwrap().image;
        Difference::between(&image, &view.reference).unwrap().footprint_psnr_db
    };
    views.iter().map(of).sum::<f64>() / views.len() as f64
}

const VIEWS: ViewOptions = ViewOptions { views: 8, held_out: 4, size: 128, seed: 1 };

#[test]
fn a_mesh_gives_as_good_a_scene_as_a_grid_of_the_same_points() {
    let tree = VesselTree::new().rasterize(49, 2).unwrap().volume().unwrap().to_field();
    let at = |p: DVec3| tree.sample(p * 48.0).unwrap();
    let field = mesh([48; 3], at).to_field();
    let function = transfer_function();
    let (_, of_mesh) = views(&field, &function, VIEWS);
    let (_, of_grid) = volume_views(&tree, &function.classifier(tree.range()).unwrap(), &VIEWS, |_, _| {});
    let psnr = |gaussians| {
        let options = Options { gaussians, ..Options::default() };
        let grid = direct_start(&tree, &function, &options, |_| {}).unwrap().scene;
        let start = direct_start(&field, &function, &options, |_| {}).unwrap();
        assert!(start.scene.len() <= gaussians && start.scene.len() > gaussians * 9 / 10, "{}", start.scene.len());
        assert_eq!(start.scene.units.len(), 1);
        assert!(start.report.importance_captured > 0.85, "{:?}", start.report);
        let (own, other) = (quality(&start.scene, &of_mesh), quality(&grid, &of_grid));
        assert!(own > other - 0.6, "{gaussians}: {own:.2}, of the grid {other:.2}");
        own
    };
    let (few, many) = (psnr(2_000), psnr(16_000));
    assert!(many > few + 1.5, "{few:.1} {many:.1}");
}

#[test]
fn the_shapes_of_tetrahedra_hardly_matter() {
    // Cubes, and slabs of 1 : 16, which cut the border of the ball otherwise.
    let psnr = |counts: [usize; 3]| {
        let field = mesh(counts, ball).to_field();
        let function = ball_function();
        let (_, held_out) = views(&field, &function, VIEWS);
        let options = Options { gaussians: 3_000, ..Options::default() };
        quality(&direct_start(&field, &function, &options, |_| {}).unwrap().scene, &held_out)
    };
    let (even, flat) = (psnr([40; 3]), psnr([20, 20, 160]));
    assert!(even > 28.0 && flat > even - 2.0, "{even:.1} {flat:.1}");
}

#[test]
fn few_large_tetrahedra_become_many_gaussians() {
    // One cube of six tetrahedra. The function shows a layer of 1/50 of it.
    let field = mesh([1; 3], |p| p.x).to_field();
    let layer = function(&[(0.5, [1.0; 3], 0.0), (0.51, [1.0; 3], 0.5), (0.52, [1.0; 3], 0.0)]);
    let start = direct_start(&field, &layer, &Options { gaussians: 1_000, ..Options::default() }, |_| {}).unwrap();
    assert!(start.scene.len() > 900, "{}", start.scene.len());
    let gaussians = &start.scene.units[0].gaussians;
    let off = gaussians.position.iter().filter(|p| (p.x - 0.51).abs() > 0.02).count();
    assert_eq!(off, 0);
    // They cover the layer.
    for corner in [Vec3::new(0.51, 0.1, 0.1), Vec3::new(0.51, 0.9, 0.9), Vec3::new(0.51, 0.1, 0.9)] {
        let near = gaussians.position.iter().map(|p| (*p - corner).length()).fold(f32::INFINITY, f32::min);
        assert!(near < 0.1, "{corner} {near}");
    }
}

#[test]
fn a_seed_gives_the_same_scene_on_any_number_of_threads_and_at_any_place() {
    let options = Options { gaussians: 700, seed: 5, ..Options::default() };
    let function = ball_function();
    let near = mesh([12; 3], ball);
    let start = |mesh: &Mesh, threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| direct_start(&mesh.to_field(), &function, &options, |_| {}).unwrap().scene)
    };
    let one = start(&near, 1);
    assert_eq!(one, start(&near, 3));
    let far = DVec3::new(3e7, -1e7, 2e7);
    let points = near.points().iter().map(|p| *p + far).collect();
    let moved = Mesh::new(points, near.cells().to_vec(), near.values().clone(), None).unwrap();
    let scene = start(&moved, 2);
    assert_eq!(scene.len(), one.len());
    for (unit, other) in scene.units.iter().zip(&one.units) {
        for (p, q) in unit.gaussians.position.iter().zip(&other.gaussians.position) {
            let world = unit.transform.transform_point3(p.as_dvec3());
            assert!((world - far - q.as_dvec3()).length() < 1e-3, "{world} {q}");
        }
    }
}

#[test]
fn base_units_hidden_values_and_values_of_cells() {
    let mut function = ball_function();
    let unit = |name: &str, low, high| BaseUnitRange { name: name.into(), range: [low, high] };
    function.base_units = vec![unit("border", 0.0, 0.9), unit("core", 0.9, 1.0), unit("nothing", 1.0, 1.0)];
    let points = mesh([16; 3], ball);
    let middles: Vec<f32> = points
        .cells()
        .iter()
        .map(|c| ball(c.iter().map(|i| points.points()[*i as usize]).sum::<DVec3>() / 4.0) as f32)
        .collect();
    let cells = MeshValues::Cells(middles.into());
    let of_cells = Mesh::new(points.points().to_vec(), points.cells().to_vec(), cells, None).unwrap();
    for mesh in [points, of_cells] {
        let field = mesh.to_field();
        let options = Options { gaussians: 2_000, ..Options::default() };
        let start = direct_start(&field, &function, &options, |_| {}).unwrap();
        let names: Vec<&str> = start.scene.units.iter().map(|u| u.name.as_str()).collect();
        assert_eq!(names, ["border", "core", "nothing"]);
        assert!(start.report.units[..2].iter().all(|u| u.gaussians > 300 && u.hidden == 0 && u.visible_voxels > 100));
        for (unit, range) in start.scene.units.iter().zip([0.2..=0.9, 0.9..=1.0]) {
            let middle =
                unit.gaussians.position.iter().map(|p| (*p - 0.5).length()).sum::<f32>() / unit.gaussians.len() as f32;
            assert!(middle < 0.45, "{}: {middle}", unit.name);
            let palette = unit.palette;
            assert!(palette.is_finite() && *range.start() < 1.0);
        }
        let hidden = direct_start(&field, &function, &Options { hidden: 0.5, ..options }, |_| {}).unwrap();
        assert!(hidden.report.units[0].hidden > 50, "{:?}", hidden.report.units[0]);
    }
}

#[test]
fn training_improves_the_scene_of_a_mesh() {
    let field = mesh([20; 3], ball).to_field();
    let function = ball_function();
    let options = Options { gaussians: 1_000, ..Options::default() };
    let mut scene = direct_start(&field, &function, &options, |_| {}).unwrap().scene;
    let (training, held_out) = views(&field, &function, ViewOptions { views: 16, ..VIEWS });
    let before = quality(&scene, &held_out);
    let options = TrainingOptions { iterations: 150, ..TrainingOptions::default() };
    train(&mut scene, &training, &held_out, &options, |_, _| ControlFlow::Continue(())).unwrap();
    let after = quality(&scene, &held_out);
    assert!(after > before + 2.0, "{before:.1} {after:.1}");
}

#[test]
fn a_mesh_of_which_nothing_is_shown_is_refused() {
    let field = mesh([4; 3], |p| 0.1 * p.x).to_field();
    let error = direct_start(&field, &ball_function(), &Options::default(), |_| {}).unwrap_err();
    assert!(matches!(error, DirectError::NothingVisible { count: 384, elements: "tetrahedra", .. }), "{error}");
    let damaged = mesh([4; 3], |_| f64::NAN).to_field();
    let error = direct_start(&damaged, &ball_function(), &Options::default(), |_| {}).unwrap_err();
    assert!(error.to_string().contains("125 not finite"), "{error}");
}
