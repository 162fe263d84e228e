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
    let mut before = scene.len();
    for t in 1..7 {
        let t = f64::from(t);
        let (start, scene) = step(&mut series, splitting(t), 60);
        assert_eq!((start.previous.len(), start.scene.len()), (scene.len(), scene.len()));
        mask = carried(&mask, &start.previous);
        let found = overlap(&mask, &truth(&scene, t));
        let [direct, warm] = start.decibels.unwrap();
        assert!(start.kind == StartKind::Warm && warm > direct + 1.0, "{t}: {:?} {direct} {warm}", start.kind);
        assert_eq!((start.kept + start.placed, start.kept + start.removed), (scene.len(), before));
        before = scene.len();
        assert!(found > 0.95, "{t}: {found}");
    }
}

#[test]
fn a_growing_shell_keeps_its_gaussians_and_gets_more() {
    let shell =
        |radius: f64| field(move |p| ball(p, DVec3::splat(19.5), radius) - ball(p, DVec3::splat(19.5), radius - 4.0));
    // The budget leaves room: what covers the small shell does not cover the large one.
    let mut series = Series::new(&function(), RANGE, options(3000)).unwrap();
    let (_, first) = step(&mut series, shell(7.0), 30);
    let mut sum = 0;
    for radius in [9.0, 11.0, 13.0] {
        let (start, _) = step(&mut series, shell(radius), 30);
        sum += start.placed;
        assert!(start.scene.len() <= 3000);
        let near = (0..start.scene.len()).filter(|i| {
            let distance = (start.scene.position(*i).unwrap() - DVec3::splat(19.5)).length();
            (radius - 6.0..radius + 2.5).contains(&distance)
        });
        assert!(near.count() as f64 > 0.97 * start.scene.len() as f64, "{radius}");
        let known = start.previous.iter().filter(|previous| **previous >= 0).count();
        assert!(known as f64 > 0.9 * start.scene.len() as f64, "{radius}: {known}");
    }
    assert!(first.len() > 2700 && sum > 0, "{sum}");
}

#[test]
fn equal_steps_have_equal_scenes_and_the_same_start_twice() {
    let fitted = || {
        let mut series = Series::new(&function(), RANGE, options(800)).unwrap();
        let scenes: Vec<(StartKind, Scene)> = [0.0, 0.0, 1.0, 1.0]
            .map(|t| {
                let (start, scene) = step(&mut series, splitting(t), 20);
                (start.kind, scene)
            })
            .to_vec();
        scenes
    };
    let scenes = fitted();
    let kinds: Vec<StartKind> = scenes.iter().map(|(kind, _)| *kind).collect();
    assert_eq!(kinds, [StartKind::Direct, StartKind::Unchanged, StartKind::Warm, StartKind::Unchanged]);
    assert!(scenes[0].1 == scenes[1].1 && scenes[2].1 == scenes[3].1 && scenes[1].1 != scenes[2].1);
    assert_eq!(scenes, fitted(), "the same seed");
}

#[test]
fn what_does_not_change_stays_as_it_is() {
    // One of two far balls moves.
    let pair = |t: f64| {
        let [one, other] = [DVec3::new(9.0, 9.0, 9.0), DVec3::new(29.0, 29.0 + t, 29.0)];
        field(move |p| ball(p, one, 4.0).max(ball(p, other, 4.0)))
    };
    let mut series = Series::new(&function(), RANGE, options(1000)).unwrap();
    let (_, before) = step(&mut series, pair(0.0), 40);
    let (start, _) = step(&mut series, pair(1.0), 0);
    let mut still = 0;
    for (i, previous) in start.previous.iter().enumerate() {
        let place = start.scene.position(i).unwrap();
        if (place - DVec3::splat(9.0)).length() < 5.0 && *previous >= 0 {
            let (unit, local) = start.scene.locate(i).unwrap();
            let (earlier, there) = before.locate(*previous as usize).unwrap();
            let (now, then) = (&unit.gaussians, &earlier.gaussians);
            assert_eq!(now.position[local], then.position[there]);
            assert_eq!(now.opacity_logit[local], then.opacity_logit[there]);
            assert_eq!(
                now.shading.as_ref().unwrap().offset_color[local],
                then.shading.as_ref().unwrap().offset_color[there]
            );
            still += 1;
        }
    }
    assert!(still > 300, "{still}");
}

#[test]
fn steps_without_anything_visible_have_scenes_of_the_same_units() {
    let mut series = Series::new(&function(), RANGE, options(500)).unwrap();
    let nothing = || field(|_| f64::NAN);
    let mut scenes = Vec::new();
    for field in [nothing(), splitting(0.0), field(|_| 3.0), splitting(1.0)] {
        scenes.push(step(&mut series, field, 10));
    }
    let kinds: Vec<StartKind> = scenes.iter().map(|(start, _)| start.kind).collect();
    assert_eq!(kinds, [StartKind::Empty, StartKind::Direct, StartKind::Empty, StartKind::Direct]);
    let look = |scene: &Scene| -> Vec<(String, glam::Vec3, Option<[f64; 2]>)> {
        scene.units.iter().map(|unit| (unit.name.clone(), unit.palette, unit.values)).collect()
    };
    for (start, scene) in &scenes {
        assert_eq!(look(scene), look(&scenes[0].1));
        assert_eq!(scene.is_empty(), start.kind == StartKind::Empty);
        assert!(start.previous.iter().all(|previous| *previous == -1));
    }
    assert_eq!(scenes[2].0.removed, scenes[1].1.len());
}
