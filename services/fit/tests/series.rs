//! Time series: starts from the step before, what they keep, and masks that follow what moves.
#![allow(clippy::unwrap_used, reason = "a test that cannot be set up fails")]

use std::ops::ControlFlow;

use glam::DVec3;
use sg_fit::Options;
use sg_fit::series::{Series, StartKind, StepStart, carried};
use sg_fit::training::{TrainingOptions, ViewOptions, train, volume_views};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_volume::transfer::{BaseUnitRange, ControlPoint, Scale, TransferFunction, Units};
use sg_volume::{Field, Grid, ScalarField, Volume};

const SIZE: usize = 40;
const RANGE: [f64; 2] = [0.0, 200.0];

fn field(of: impl Fn(DVec3) -> f64) -> Field {
    let grid = Grid::unit([SIZE; 3]).unwrap();
    let values: Vec<f32> = (0..grid.len()).map(|i| of(grid.voxel(i).as_dvec3()) as f32).collect();
    Volume::new(grid, values.into(), None).unwrap().to_field().with_range(RANGE)
}

fn function() -> TransferFunction {
    let point = |value, color, opacity| ControlPoint { value, color, opacity };
    let unit = |name: &str, low, high| BaseUnitRange { name: name.to_owned(), range: [low, high] };
    TransferFunction {
        domain: [0.0, 200.0],
        units: Units::Raw,
        scale: Scale::Linear,
        variable: None,
        points: vec![
            point(20.0, [0.2, 0.4, 0.9], 0.0),
            point(60.0, [0.2, 0.4, 0.9], 0.5),
            point(150.0, [0.9, 0.4, 0.2], 0.9),
        ],
        base_units: vec![unit("outer", 20.0, 100.0), unit("inner", 100.0, 200.0)],
    }
}

/// A ball with soft borders: 150 inside.
fn ball(p: DVec3, at: DVec3, radius: f64) -> f64 {
    150.0 / (1.0 + (2.0 * ((p - at).length() - radius)).exp())
}

/// Two balls: they part along x and move along y, `t` from 0.
fn centers(t: f64) -> [DVec3; 2] {
    let middle = DVec3::new(19.5, 12.0 + 1.5 * t, 19.5);
    let apart = DVec3::X * (4.0 + 1.0 * t);
    [middle - apart, middle + apart]
}

fn splitting(t: f64) -> Field {
    field(|p| centers(t).into_iter().map(|at| ball(p, at, 5.0)).fold(0.0, f64::max))
}

fn options(gaussians: usize) -> Options {
    Options { gaussians, ..Options::default() }
}

fn views(size: u32) -> ViewOptions {
    ViewOptions { views: 16, held_out: 4, size, ..ViewOptions::default() }
}

/// A step: its start, and its scene after some steps of training.
fn step(series: &mut Series, field: Field, iterations: usize) -> (StepStart, Scene) {
    let own = ScalarField::Grid(field);
    if let Some(start) = series.unchanged(own.as_ref()) {
        return (start.clone(), start.scene);
    }
    let Some(direct) = series.direct(own.as_ref(), |_| {}).unwrap() else {
        let start = series.empty(own.as_ref());
        series.finish(start.scene.clone(), own);
        return (start.clone(), start.scene);
    };
    let (training, held_out) = volume_views(own.as_ref(), series.classifier(), &views(96), |_, _| {});
    let start = series.start(direct, own.as_ref(), &training).unwrap();
    let mut scene = start.scene.clone();
    let options = TrainingOptions { iterations, measure_every: 20, ..TrainingOptions::default() };
    train(&mut scene, &training, &held_out, &options, |_, _| ControlFlow::Continue(())).unwrap();
    series.finish(scene.clone(), own);
    (start, scene)
}

/// The Gaussians nearer to the first ball than to the second.
fn truth(scene: &Scene, t: f64) -> Mask {
    let [one, other] = centers(t);
    Mask::from_fn(scene.len(), |i| {
        let at = scene.position(i).unwrap();
        (at - one).length() < (at - other).length()
    })
}

fn overlap(a: &Mask, b: &Mask) -> f64 {
    let both = (0..a.len()).filter(|i| a.get(*i) && b.get(*i)).count();
    let either = (0..a.len()).filter(|i| a.get(*i) || b.get(*i)).count();
    both as f64 / either as f64
}

#[test]
fn a_mask_follows_its_ball_through_a_split() {
    let mut series = Series::new(&function(), RANGE, options(1500)).unwrap();
    let (_, scene) = step(&mut series, splitting(0.0), 60);
    let mut mask = truth(&scene, 0.0);
    for t in 1..7 {
        let t = f64::from(t);
        let (start, scene) = step(&mut series, splitting(t), 60);
        assert_eq!((start.previous.len(), start.scene.len()), (scene.len(), scene.len()));
        mask = carried(&mask, &start.previous);
        let found = overlap(&mask, &truth(&scene, t));
        let [direct, warm] = start.decibels.unwrap();
        println!("{t}: {:?} {direct:.2} {warm:.2} kept {} placed {} removed {} IoU {found:.3}", start.kind, start.kept, start.placed, start.removed);
        assert!(found > 0.95, "{t}: {found}");
    }
}
