//! Gaussians of the tetrahedra of a mesh, from samples within them.
//!
//! Each tetrahedron gets as many samples as its importance asks for, evenly spread within it. No grid stands between the values
//! and the Gaussians; only the depth of what hides a place is computed on a coarse one.

mod importance;
mod samples;

use std::time::Instant;

use glam::Vec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use sg_volume::{Classifier, MeshField, Surfaceness, background_values};

use self::importance::{CellEstimate, ImportanceRule, Occlusion};
use self::samples::SamplePieces;
use crate::options::{DirectError, Options};
use crate::placed::{Placed, PlacedUnit, apportion};
use crate::placement::{relaxed_cells, systematic_sample};
use crate::report::Seconds;
use crate::shape::{GaussianBuilder, Splat};

/// Voxels along the longest side of the coarse grid on which occlusion is computed.
const OCCLUSION_EDGE: usize = 96;
/// Samples for each Gaussian.
const SAMPLES: f64 = 16.0;

/// Places the Gaussians of all base units. `stage` gets the name of each stage.
pub(crate) fn place_gaussians(
    field: &MeshField,
    classifier: &Classifier,
    options: &Options,
    stage: &mut dyn FnMut(&'static str),
) -> Result<Placed, DirectError> {
    let count = classifier.unit_count();
    let range = field.range();
    let mut seconds = Seconds::default();

    stage("classifying tetrahedra");
    let clock = Instant::now();
    let edge = field.reference_length();
    let surfaceness = Surfaceness::of_range([range.low, range.high], edge, classifier);
    // A mesh without a finite size has no even samples, and nothing hides there.
    let even = field.resampled(OCCLUSION_EDGE).ok();
    // Only hidden values ask for it.
    let background = even.as_ref().filter(|_| options.hidden > 0.0).and_then(background_values);
    let shown = field.visible_cells(classifier);
    if shown.is_empty() {
        return Err(DirectError::nothing_visible(field));
    }
    let candidates: Vec<u32> = if options.hidden > 0.0 { (0..field.cells().len() as u32).collect() } else { shown };
    seconds.classify = clock.elapsed().as_secs_f64();

    let clock = Instant::now();
    let occlusion: Vec<Option<Occlusion>> = (0..count)
        .map(|unit| {
            stage("computing importance");
            even.as_ref().map(|even| Occlusion::new(even, classifier, unit, edge))
        })
        .collect();
    let rule = ImportanceRule { field, classifier, surfaceness: &surfaceness, occlusion, background, edge, options };
    let first: Vec<CellEstimate> = candidates.par_iter().with_min_len(256).map(|&cell| rule.estimate(cell)).collect();
    let mut totals = vec![0.0_f64; count];
    let mut visible = vec![0_usize; count];
    for of in first.iter().flat_map(|estimate| &estimate.units) {
        if let (Some(total), Some(visible)) = (totals.get_mut(of.unit), visible.get_mut(of.unit)) {
            *total += of.importance;
            *visible += usize::from(of.is_visible);
        }
    }
    let outside_ranges = first.iter().filter(|estimate| estimate.is_outside).count();
    let visible_cells = first.iter().filter(|estimate| estimate.units.iter().any(|of| of.is_visible)).count();
    if totals.iter().sum::<f64>() <= 0.0 {
        return Err(DirectError::nothing_visible(field));
    }
    let budgets = apportion(&totals, options.gaussians);
    // Importance of one sample, by base unit.
    let grains: Vec<f64> =
        totals.iter().zip(&budgets).map(|(total, budget)| total / (SAMPLES * (*budget).max(1) as f64)).collect();
    let counts: Vec<usize> = first.iter().map(|estimate| estimate.samples(&grains)).collect();
    let samples = rule.samples(&candidates, &counts, count);
    seconds.importance = clock.elapsed().as_secs_f64();

    let mut units = Vec::with_capacity(count);
    for (unit, (samples, budget)) in samples.into_iter().zip(budgets).enumerate() {
        stage("placing Gaussians");
        let clock = Instant::now();
        let mut splats: Vec<Splat> = Vec::new();
        if budget > 0 && samples.importance > 0.0 {
            let mut random = ChaCha8Rng::seed_from_u64(options.seed_of(unit));
            let boxes = samples.positions.iter().zip(&samples.weights);
            let boxes = boxes.map(|(p, weight)| (Vec3::from_array(*p).as_dvec3(), *weight));
            let jitter = |sample: usize, random: &mut ChaCha8Rng| {
                let at = [random.random(), random.random(), random.random()];
                samples.within(field, sample, at)
            };
            let places = systematic_sample(boxes, jitter, budget, &mut random);
            let cells = relaxed_cells(&samples.positions, &samples.weights, places, options.relaxation_rounds)?;
            seconds.placement += clock.elapsed().as_secs_f64();
            stage("shaping Gaussians");
            let clock = Instant::now();
            let builder = GaussianBuilder {
                pieces: &SamplePieces { samples: &samples, field },
                classifier,
                surfaceness: &surfaceness,
                flattening: options.flattening,
                keeps_hidden: options.hidden > 0.0,
                color: None,
            };
            splats = builder.splats(&cells);
            seconds.shape += clock.elapsed().as_secs_f64();
        } else {
            stage("shaping Gaussians");
        }
        let visible = visible.get(unit).copied().unwrap_or(0);
        units.push(PlacedUnit { splats, importance: samples.importance, visible });
    }
    Ok(Placed { units, visible: visible_cells, outside_ranges, edge, seconds })
}
