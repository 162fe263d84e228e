//! Gaussians of the voxels of a volume.

use std::time::Instant;

use rayon::prelude::*;
use sg_volume::{Classifier, Field, Surfaceness, background_values};

use crate::classification::Classification;
use crate::importance::{candidates, importance_of_value};
use crate::options::{DirectError, Options};
use crate::placed::{Placed, PlacedUnit, apportion};
use crate::placement::{Points, VoxelPieces, place};
use crate::report::Seconds;
use crate::shape::{GaussianBuilder, Splat};

/// Standard deviation in voxels of the smoothing before gradients. Without it normals follow the noise of single voxels.
const GRADIENT_SMOOTHING: f32 = 1.0;

/// Places the Gaussians of all base units. `stage` gets the name of each stage.
pub(crate) fn place_gaussians(
    field: &Field,
    classifier: &Classifier,
    options: &Options,
    stage: &mut dyn FnMut(&'static str),
) -> Result<Placed, DirectError> {
    let count = classifier.unit_count();
    let mut seconds = Seconds::default();

    stage("classifying voxels");
    let clock = Instant::now();
    let smooth = field.smoothed(GRADIENT_SMOOTHING);
    let surfaceness = Surfaceness::new(field, classifier);
    let emphasis = (options.hidden > 0.0).then(|| emphasis_of_values(field, &smooth, &surfaceness));
    let classification = Classification::new(field, classifier, emphasis);
    let visible_voxels = classification.statistics.iter().map(|c| c.visible).sum();
    if visible_voxels == 0 {
        return Err(DirectError::nothing_visible(field));
    }
    seconds.classify = clock.elapsed().as_secs_f64();

    let clock = Instant::now();
    let mut found = Vec::with_capacity(count);
    for unit in 0..count {
        stage("computing importance");
        found.push(
            classification
                .crop(unit)
                .map(|crop| candidates(&crop, field.grid(), options.interior as f32, options.hidden as f32)),
        );
    }
    seconds.importance = clock.elapsed().as_secs_f64();
    let totals: Vec<f64> = found.iter().map(|c| c.as_ref().map_or(0.0, |c| c.total)).collect();
    let budgets = apportion(&totals, options.gaussians);

    let mut units = Vec::with_capacity(count);
    for (unit, (candidates, budget)) in found.into_iter().zip(budgets).enumerate() {
        stage("placing Gaussians");
        let clock = Instant::now();
        let mut splats: Vec<Splat> = Vec::new();
        if let Some(candidates) = candidates.filter(|_| budget > 0) {
            let points = Points::new(&candidates, &classification, budget);
            let seed = options.seed_of(unit);
            let cells = place(&candidates, &points, field, budget, options.relaxation_rounds, seed)?;
            seconds.placement += clock.elapsed().as_secs_f64();
            stage("shaping Gaussians");
            let clock = Instant::now();
            let builder = GaussianBuilder {
                pieces: &VoxelPieces { points: &points, list: &candidates.list, field, smooth: &smooth },
                classifier,
                surfaceness: &surfaceness,
                flattening: options.flattening,
                keeps_hidden: options.hidden > 0.0,
            };
            splats = builder.splats(&cells);
            seconds.shape += clock.elapsed().as_secs_f64();
        } else {
            stage("shaping Gaussians");
        }
        units.push(PlacedUnit {
            splats,
            importance: totals.get(unit).copied().unwrap_or(0.0),
            visible: classification.statistics.get(unit).map_or(0, |of| of.visible),
        });
    }
    Ok(Placed {
        units,
        visible: visible_voxels,
        outside_ranges: classification.statistics.iter().map(|c| c.outside_ranges).sum(),
        edge: field.grid().spacing().min_element(),
        seconds,
    })
}

/// Importance of each voxel where another transfer function shows its value ([`importance_of_value`]).
fn emphasis_of_values(field: &Field, smooth: &Field, surfaceness: &Surfaceness) -> Vec<f32> {
    let background = background_values(field);
    let emphasis = |i: usize| {
        let at = field.grid().voxel(i);
        let gradient = smooth.gradient_at(at.x, at.y, at.z);
        importance_of_value(field.raw(i), gradient.length(), background, surfaceness)
    };
    (0..field.grid().len()).into_par_iter().with_min_len(1024).map(emphasis).collect()
}
