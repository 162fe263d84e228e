//! Base units of the labels of a label map: names, colours, places and surfaces.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]
#![allow(clippy::print_stderr, reason = "a skipped test says so")]

use std::path::PathBuf;

use glam::{DMat3, DVec3, Vec3};
use sg_fit::label_start::direct_start_of_labels;
use sg_fit::label_units::{Background, LabelUnits};
use sg_fit::labels::{LabelError, labels_of};
use sg_fit::{DirectError, DirectStart, Options};
use sg_reclassify::{reclassify_scene, sources};
use sg_scene::model::Scene;
use sg_volume::label_table::color_at;
use sg_volume::transfer::{ControlPoint, Scale, Units};
use sg_volume::{Field, Grid, LabelTable, TransferFunction, Volume, automatic_transfer_function, read_volume};

const RADIUS: f64 = 8.5;
const MIDDLES: [DVec3; 2] = [DVec3::new(11.0, 11.5, 11.5), DVec3::new(28.0, 11.5, 11.5)];

fn grid() -> Grid {
    Grid::new([40, 24, 24], DVec3::new(0.5, 0.5, 0.5), DVec3::new(-3.0, 0.0, 9.0), DMat3::IDENTITY).unwrap()
}

/// Values in two balls that touch, and around them.
fn balls(values: [f32; 3]) -> Volume {
    let grid = grid();
    let value = |i: usize| {
        let at = grid.voxel(i).as_dvec3();
        let ball = MIDDLES.iter().position(|middle| at.distance(*middle) <= RADIUS);
        ball.map_or(values[0], |ball| values[ball + 1])
    };
    let values: Vec<f32> = (0..grid.len()).map(value).collect();
    Volume::new(grid, values.into(), None).unwrap()
}

fn map() -> Volume {
    balls([0.0, 1.0, 2.0])
}

/// Grey by value, and transparent up to 10.
fn function() -> TransferFunction {
    let point = |value, gray, opacity| ControlPoint { value, color: [gray; 3], opacity };
    TransferFunction {
        domain: [0.0, 100.0],
        units: Units::Raw,
        scale: Scale::Linear,
        variable: None,
        points: vec![point(10.0, 0.1, 0.0), point(20.0, 0.2, 0.02), point(100.0, 0.9, 0.3)],
        base_units: Vec::new(),
    }
}

fn start(field: &Field, labels: &LabelUnits, gaussians: usize) -> Result<DirectStart, DirectError> {
    let function = if labels.stands_alone() { labels.even_function() } else { function() };
    direct_start_of_labels(field, &function, labels, &Options { gaussians, ..Options::default() }, |_| {})
}

/// Share of a unit's Gaussians with their centres in voxels of a label: of their number, and of their opacities.
fn shares(scene: &Scene, unit: usize, map: &Volume, label: i32) -> [f64; 2] {
    let found = labels_of(scene, map).unwrap();
    let unit = &scene.units[unit];
    let (mut count, mut weight, mut all) = (0.0, 0.0, 0.0);
    for i in 0..unit.gaussians.len() {
        let opacity = f64::from(unit.gaussians.opacity(i));
        all += opacity;
        if found[unit.first + i] == label {
            count += 1.0;
            weight += opacity;
        }
    }
    [count / unit.gaussians.len() as f64, weight / all]
}

#[test]
fn touching_balls_are_units_with_names_and_colours() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("names.txt");
    std::fs::write(&file, "1 255 0 51 1 1 1 \"left ball\"\n7 0 0 255 1 1 1 \"absent\"\n").unwrap();
    let table = LabelTable::load(&file).unwrap();
    let labels = LabelUnits::new(&map(), &table, Background::LeftOut).unwrap();
    assert_eq!(labels.without_voxels(), 1);
    let field = balls([20.0, 100.0, 100.0]).to_field();
    // Cells of several voxels, and parts of voxels.
    for gaussians in [300, 30_000] {
        let made = start(&field, &labels, gaussians).unwrap();
        let names: Vec<&str> = made.scene.units.iter().map(|unit| unit.name.as_str()).collect();
        assert_eq!(names, ["left ball", "label 2"]);
        let palette = [Vec3::new(1.0, 0.0, 0.2), Vec3::from_array(color_at(1))];
        let total = made.scene.len();
        assert!(total > gaussians * 9 / 10 && total <= gaussians, "{total}");
        for (at, unit) in made.scene.units.iter().enumerate() {
            let label = at as i32 + 1;
            assert_eq!((made.report.units[at].label, unit.palette), (Some(label), palette[at]));
            let offsets = &unit.gaussians.shading.as_ref().unwrap().offset_color;
            assert!(offsets.iter().all(|offset| offset.length() < 1e-6));
            // The balls are equal.
            assert!(unit.gaussians.len() > total * 2 / 5, "{} of {total}", unit.gaussians.len());
            let found = shares(&made.scene, at, &map(), label);
            assert!(found.iter().all(|share| *share >= 0.99), "{label}: {found:?}");
        }
        // The function of the file gives back the colours.
        let mut again = made.scene.clone();
        reclassify_scene(&mut again, &function()).unwrap();
        for (unit, before) in again.units.iter().zip(&made.scene.units) {
            let colors = [unit, before].map(|unit| &unit.gaussians.shading.as_ref().unwrap().offset_color);
            assert!(colors[0].iter().zip(colors[1]).all(|(now, then)| now.distance(*then) < 1e-4), "{}", unit.name);
        }
    }
}

#[test]
fn voxels_without_a_label_can_be_the_rest() {
    let labels = LabelUnits::new(&map(), &LabelTable::default(), Background::Rest).unwrap();
    let made = start(&balls([60.0, 100.0, 100.0]).to_field(), &labels, 6000).unwrap();
    let names: Vec<&str> = made.scene.units.iter().map(|unit| unit.name.as_str()).collect();
    assert_eq!(names, ["label 1", "label 2", "rest"]);
    let rest = &made.scene.units[2];
    assert_eq!(made.report.units[2].label, Some(0));
    assert!(rest.palette.distance(Vec3::splat(0.55)) < 0.2, "the function's grey: {}", rest.palette);
    let found = shares(&made.scene, 2, &map(), 0);
    assert!(found.iter().all(|share| *share >= 0.95), "{found:?}");
    assert!(
        !rest.gaussians.is_empty() && rest.gaussians.len() <= made.scene.len() * 11 / 20,
        "{}",
        rest.gaussians.len()
    );
}

#[test]
fn a_map_alone_has_surfaces() {
    let labels = LabelUnits::alone(&map(), &LabelTable::default()).unwrap();
    let made = start(&map().to_field(), &labels, 5000).unwrap();
    assert_eq!(made.scene.units.len(), 2);
    for (at, unit) in made.scene.units.iter().enumerate() {
        let g = &unit.gaussians;
        assert!(!sources::keeps_values(g) && unit.values.is_none());
        let found = shares(&made.scene, at, &map(), at as i32 + 1);
        assert!(found.iter().all(|share| *share >= 0.99), "{found:?}");
        let shading = g.shading.as_ref().unwrap();
        let (mut surface, mut outward, mut opacity) = (0, 0, 0.0);
        for i in 0..g.len() {
            let out = grid().to_voxel(made.scene.position(unit.first + i).unwrap()) - MIDDLES[at];
            if out.length() > RADIUS - 1.5 {
                surface += 1;
                opacity += g.opacity(i);
                outward += usize::from(shading.normal[i].dot(out.normalize().as_vec3()) > 0.8);
            }
        }
        assert!(surface * 2 > g.len(), "most are at the surface: {surface} of {}", g.len());
        assert!(outward * 10 > surface * 9, "{outward} of {surface}");
        assert!(opacity / surface as f32 > 0.4, "{}", opacity / surface as f32);
    }
}

#[test]
fn hidden_labels_have_no_unit_and_wrong_grids_are_refused() {
    let labels = LabelUnits::new(&map(), &LabelTable::default(), Background::LeftOut).unwrap();
    let one = start(&balls([100.0, 100.0, 5.0]).to_field(), &labels, 500).unwrap();
    assert_eq!((one.scene.units.len(), one.scene.units[0].name.as_str()), (1, "label 1"));
    assert_eq!(one.report.units.len(), 1);
    let none = start(&balls([100.0, 5.0, 5.0]).to_field(), &labels, 500).unwrap_err();
    assert!(matches!(none, DirectError::LabelsHidden(voxels) if voxels > 4000), "{none}");
    let other = Volume::new(Grid::unit([40, 24, 24]).unwrap(), vec![100.0_f32; 40 * 24 * 24].into(), None).unwrap();
    let refused = start(&other.to_field(), &labels, 500).unwrap_err();
    assert!(matches!(refused, DirectError::Labels(LabelError::GridMismatch { .. })), "{refused}");
}

#[test]
fn nuclei_of_a_brain_are_units() {
    let Some(data) = std::env::var_os("SUPERGAUSSIAN_DATA").map(PathBuf::from) else {
        assert!(
            std::env::var_os("SUPERGAUSSIAN_REQUIRE_DATA").is_none_or(|v| v != "1"),
            "SUPERGAUSSIAN_DATA is needed"
        );
        eprintln!("SKIPPED: set SUPERGAUSSIAN_DATA to the data folder");
        return;
    };
    let map = read_volume(&data.join("labels/cit168_labels_165x198x168_uint8.raw.zst")).unwrap();
    let field = read_volume(&data.join("labels/cit168_t1w_165x198x168_uint8.raw.zst")).unwrap().to_field();
    let labels = LabelUnits::new(&map, &LabelTable::default(), Background::LeftOut).unwrap();
    let function = automatic_transfer_function(&field, None).unwrap();
    let options = Options { gaussians: 20_000, ..Options::default() };
    let made = direct_start_of_labels(&field, &function, &labels, &options, |_| {}).unwrap();
    assert_eq!(made.scene.units.len(), 32);
    for (at, unit) in made.report.units.iter().enumerate() {
        let found = shares(&made.scene, at, &map, unit.label.unwrap());
        assert!(found.iter().all(|share| *share >= 0.95), "{}: {found:?}", unit.name);
    }
}
