//! Other transfer functions for a scene, against ray marching under them, beside a direct start of each.

use std::time::Instant;

use sg_fit::training::{TrainingOptions, TrainingView, ViewOptions, train, volume_views};
use sg_fit::{Options, direct_start};
use sg_raster::render::{Quality, render};
use sg_reclassify::{reclassify_scene, sources};
use sg_scene::model::Scene;
use sg_volume::transfer::{ControlPoint, Scale, Units};
use sg_volume::{Field, TransferFunction, background_values};

use crate::{decibels, head};

/// Importance of what the first function hides, of the scenes that are made for other functions.
const HIDDEN: f64 = 0.3;

/// Pictures that are compared under each function.
const PICTURES: usize = 3;

pub(crate) fn columns() -> Vec<String> {
    head(&[
        "volume, function",
        "direct start under it, dB",
        "scene of the first function: untrained",
        "trained",
        "with hidden values, untrained",
        "trained",
        "ms",
    ])
}

/// Functions that no scene was made for. Their values lie between the end of the empty space and the greatest one.
fn unseen(field: &Field, first: &TransferFunction) -> Vec<(&'static str, TransferFunction)> {
    let range = field.range();
    let [from, to] = background_values(field).unwrap_or([range.low; 2]);
    // What lies above the empty space, or below where that is dense.
    let (low, high) = if to < range.high { (to.max(range.low), range.high) } else { (range.low, from) };
    let point = |t: f64, color: [f32; 3], opacity| ControlPoint { value: low + t * (high - low), color, opacity };
    let function = |points| TransferFunction {
        domain: [range.low, range.high],
        units: Units::Raw,
        scale: Scale::Linear,
        variable: None,
        points,
        base_units: Vec::new(),
    };
    let shell = |t: f64, color| vec![point(t - 0.06, color, 0.0), point(t, color, 0.6), point(t + 0.06, color, 0.0)];
    vec![
        ("its own", first.clone()),
        ("grey ramp", function(vec![point(0.1, [0.1; 3], 0.0), point(0.7, [1.0; 3], 0.3)])),
        ("shell at 0.3", function(shell(0.3, [0.9, 0.6, 0.3]))),
        ("shell at 0.5", function(shell(0.5, [0.3, 0.7, 0.9]))),
        ("dense", function(vec![point(0.5, [0.8, 0.8, 0.7], 0.0), point(0.52, [0.9, 0.9, 0.8], 0.9)])),
        ("fog and core", {
            let mut points = vec![point(0.15, [0.2, 0.4, 0.9], 0.0), point(0.25, [0.2, 0.4, 0.9], 0.05)];
            points.extend([point(0.35, [0.2, 0.4, 0.9], 0.0), point(0.45, [0.9, 0.2, 0.1], 0.0)]);
            points.extend([point(0.6, [0.9, 0.2, 0.1], 0.7), point(1.0, [0.9, 0.2, 0.1], 0.7)]);
            function(points)
        }),
    ]
}

/// A row for each function.
pub(crate) fn rows(arguments: &crate::Arguments, name: &str, field: &Field, first: &TransferFunction) -> Vec<String> {
    let options = |hidden| Options { gaussians: arguments.gaussians, hidden, ..Options::default() };
    let scenes: Vec<[Scene; 2]> = [0.0, HIDDEN]
        .into_iter()
        .map(|hidden| {
            let start = direct_start(field, first, &options(hidden), |_| {}).unwrap().scene;
            [start.clone(), trained(arguments, field, first, &start)]
        })
        .collect();
    unseen(field, first)
        .into_iter()
        .map(|(of, function)| {
            let classifier = function.classifier(field.range()).unwrap();
            let views = ViewOptions { views: 0, held_out: PICTURES, size: arguments.size, seed: 1 };
            let (_, views) = volume_views(field, &classifier, &views, |_, _| {});
            let refit = mean(&direct_start(field, &function, &options(0.0), |_| {}).unwrap().scene, &views);
            let mut milliseconds = f64::INFINITY;
            let mut under = |scene: &Scene| {
                let mut scene = scene.clone();
                let clock = Instant::now();
                reclassify_scene(&mut scene, &function).unwrap();
                milliseconds = milliseconds.min(1e3 * clock.elapsed().as_secs_f64());
                mean(&scene, &views)
            };
            let [plain, hidden] = [0, 1].map(|k| [0, 1].map(|trained| under(&scenes[k][trained])));
            format!(
                "| {name}, {of} | {refit:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {milliseconds:.1} |",
                plain[0], plain[1], hidden[0], hidden[1]
            )
        })
        .collect()
}

/// A direct start, trained under its function.
fn trained(arguments: &crate::Arguments, field: &Field, function: &TransferFunction, start: &Scene) -> Scene {
    let classifier = function.classifier(field.range()).unwrap();
    let views = ViewOptions { views: arguments.views, size: arguments.size, ..ViewOptions::default() };
    let (views, held_out) = volume_views(field, &classifier, &views, |_, _| {});
    let options =
        TrainingOptions { iterations: usize::MAX, seconds: Some(arguments.seconds), ..TrainingOptions::default() };
    let mut scene = start.clone();
    train(&mut scene, &views, &held_out, &options, |_, _| std::ops::ControlFlow::Continue(())).unwrap();
    sources::follow_training(&mut scene, start, &classifier);
    scene
}

/// Mean decibels over the footprints.
fn mean(scene: &Scene, views: &[TrainingView]) -> f64 {
    let of = |view: &TrainingView| {
        let picture = render(scene, &view.appearance(scene), &view.camera, Quality::Standard).unwrap().image;
        decibels(&picture, &view.reference)
    };
    views.iter().map(of).sum::<f64>() / views.len() as f64
}
