//! Gaussians of the voxels of a volume.

use std::time::Instant;

use rayon::prelude::*;
use sg_volume::{Classifier, Field, Surfaceness, background_values};

use crate::classification::Classification;
use crate::importance::{candidates, importance_of_value};
use crate::label_units::{GRADIENT_SMOOTHING, LabelUnits};
use crate::options::{DirectError, Options};
use crate::placed::{Placed, PlacedUnit, apportion};
use crate::placement::{Points, VoxelPieces, place};
use crate::report::Seconds;
use crate::shape::{GaussianBuilder, Splat};

/// Places the Gaussians of all base units. With `labels`, which must be of the same grid, base units are labels. `stage`
/// gets the name of each stage.
pub(crate) fn place_gaussians(
    field: &Field,
    classifier: &Classifier,
    labels: Option<&LabelUnits>,
    options: &Options,
    stage: &mut dyn FnMut(&'static str),
) -> Result<Placed, DirectError> {
    let count = labels.map_or(classifier.unit_count(), |labels| labels.units().len());
    let mut seconds = Seconds::default();

    stage("classifying voxels");
    let clock = Instant::now();
    let smooth = field.smoothed(GRADIENT_SMOOTHING);
    let surfaceness = Surfaceness::new(field, classifier);
    let emphasis = (options.hidden > 0.0).then(|| emphasis_of_values(field, &smooth, &surfaceness));
    let classification = Classification::new(field, classifier, emphasis, labels);
    let visible_voxels = classification.statistics.iter().map(|c| c.visible).sum();
    if visible_voxels == 0 {
        let of_labels =
            |labels: &LabelUnits| DirectError::LabelsHidden(labels.units().iter().map(|unit| unit.voxels).sum());
        return Err(labels.map_or_else(|| DirectError::nothing_visible(field), of_labels));
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
    let budgets = apportion(&limited_rest(&totals, labels), options.gaussians);
    let span = field.range().high - field.range().low;

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
                pieces: &VoxelPieces {
                    points: &points,
                    list: &candidates.list,
                    field,
                    smooth: &smooth,
                    label: labels.and_then(|labels| labels.part(unit, span)),
                },
                classifier,
                surfaceness: &surfaceness,
                flattening: options.flattening,
                keeps_hidden: options.hidden > 0.0,
                color: labels.and_then(|labels| labels.units().get(unit)?.color),
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

/// The totals of base units for the number of their Gaussians. What has no label counts as much as all labels at most: else
/// a small label in a large volume would be a handful of Gaussians.
fn limited_rest(totals: &[f64], labels: Option<&LabelUnits>) -> Vec<f64> {
    let mut limited = totals.to_vec();
    if let Some(rest) = labels.and_then(LabelUnits::rest).and_then(|rest| limited.get_mut(rest)) {
        let of_labels = totals.iter().sum::<f64>() - *rest;
        if of_labels > 0.0 {
            *rest = f64::min(*rest, of_labels);
        }
    }
    limited
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

#[cfg(test)]
mod tests {
    use sg_volume::{Grid, LabelTable, Volume};

    use super::*;
    use crate::label_units::Background;

    #[test]
    fn the_rest_has_no_more_gaussians_than_the_labels() {
        let map = Volume::new(Grid::unit([3, 1, 1]).unwrap(), vec![0_u8, 1, 2].into(), None).unwrap();
        let units = |background| LabelUnits::new(&map, &LabelTable::default(), background).unwrap();
        let limited = |totals: [f64; 3], labels: Option<&LabelUnits>| limited_rest(&totals, labels);
        let with_rest = units(Background::Rest);
        assert_eq!(limited([1.0, 2.0, 9.0], Some(&with_rest)), [1.0, 2.0, 3.0]);
        assert_eq!(limited([1.0, 2.0, 0.5], Some(&with_rest)), [1.0, 2.0, 0.5]);
        assert_eq!(limited([0.0, 0.0, 9.0], Some(&with_rest)), [0.0, 0.0, 9.0], "nothing else is visible");
        assert_eq!(limited([1.0, 2.0, 9.0], None), [1.0, 2.0, 9.0]);
        assert_eq!(limited([1.0, 2.0, 9.0], Some(&units(Background::LeftOut))), [1.0, 2.0, 9.0]);
    }
}
