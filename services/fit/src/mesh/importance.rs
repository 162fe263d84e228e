//! Importance of the places in a mesh, and the number of samples that it asks for.

use glam::{DVec3, UVec3, Vec3};
use rayon::prelude::*;
use sg_volume::opacity::extinction;
use sg_volume::{Classifier, Field, Grid, MeshField, Surfaceness};

use super::samples::{CellSampler, RawSample, Samples};
use crate::importance::{BOUNDARY_GAIN, importance_of_value, opacity_over};
use crate::options::Options;
use crate::visibility::least_optical_depth;

/// Samples of a tetrahedron for a first estimate of its importance: of a small one, of a large one, and most of one of which only a
/// thin part counts.
const FIRST_SAMPLES: [usize; 3] = [4, 64, 4096];
/// Samples with an importance that make an estimate good enough.
const LEAST_HITS: f64 = 8.0;
/// Most samples of one tetrahedron.
const MOST_SAMPLES: f64 = 65_536.0;

/// Optical depth of one base unit in front of each place, on the coarse grid.
pub(super) struct Occlusion {
    grid: Grid,
    depth: Vec<f32>,
}

impl Occlusion {
    /// `reference` is the length that the opacities refer to.
    pub(super) fn new(even: &Field, classifier: &Classifier, unit: usize, reference: f64) -> Self {
        let grid = even.grid().clone();
        let extinctions: Vec<f32> = (0..grid.len())
            .into_par_iter()
            .with_min_len(4096)
            .map(|i| {
                let raw = even.raw(i);
                // NaN is transparent: outside the mesh.
                if classifier.unit(raw).unit == unit { extinction(classifier.opacity(raw), reference) } else { 0.0 }
            })
            .collect();
        let dims = UVec3::from_array(grid.dims().map(|n| n as u32));
        let step = |d: [i32; 3]| grid.vector_to_world(DVec3::from_array(d.map(f64::from))).length() as f32;
        let depth = least_optical_depth(&extinctions, dims, step);
        Self { grid, depth }
    }

    /// The depth at a position of the world.
    fn at(&self, world: DVec3) -> f32 {
        self.depth.get(self.grid.nearest(world)).copied().unwrap_or(0.0)
    }
}

/// The importance of samples.
pub(super) struct ImportanceRule<'a> {
    pub(super) field: &'a MeshField,
    pub(super) classifier: &'a Classifier,
    pub(super) surfaceness: &'a Surfaceness,
    /// By base unit; `None` if nothing hides.
    pub(super) occlusion: Vec<Option<Occlusion>>,
    /// Values of the empty space around the subject.
    pub(super) background: Option<[f64; 2]>,
    /// Length that stands for a voxel.
    pub(super) edge: f64,
    pub(super) options: &'a Options,
}

/// What the first samples tell of a tetrahedron.
pub(super) struct CellEstimate {
    pub(super) units: Vec<UnitEstimate>,
    /// Share of the samples with an importance.
    share: f64,
    /// Whether a visible sample is outside the ranges of all base units.
    pub(super) is_outside: bool,
}

/// The part of one base unit in a tetrahedron.
#[derive(Clone, Copy)]
pub(super) struct UnitEstimate {
    pub(super) unit: usize,
    pub(super) importance: f64,
    pub(super) is_visible: bool,
}

/// One sample.
struct Sample {
    unit: usize,
    /// Importance of a volume of one cubic edge around it.
    importance: f32,
    is_visible: bool,
    is_outside: bool,
}

impl CellEstimate {
    /// The part of a unit, which begins empty.
    fn part(&mut self, unit: usize) -> &mut UnitEstimate {
        let place = self.units.iter().position(|of| of.unit == unit).unwrap_or(self.units.len());
        if place == self.units.len() {
            self.units.push(UnitEstimate { unit, importance: 0.0, is_visible: false });
        }
        &mut self.units[place]
    }

    /// Samples of the tetrahedron, where one has the importance `grains` of its unit.
    pub(super) fn samples(&self, grains: &[f64]) -> usize {
        let wanted = |of: &UnitEstimate| match grains.get(of.unit) {
            Some(grain) if *grain > 0.0 => of.importance / grain,
            _ => 0.0,
        };
        // A visible tetrahedron has at least a few, as its first ones may have missed what is visible.
        let least = if self.units.is_empty() { FIRST_SAMPLES[0] as f64 } else { 1.0 };
        // Where only a thin part counts, most samples miss it.
        let sum = self.units.iter().map(wanted).sum::<f64>() / self.share.max(1e-3);
        sum.ceil().clamp(least, MOST_SAMPLES) as usize
    }
}

impl ImportanceRule<'_> {
    /// The importance at a position from the middle of the mesh.
    fn sample(&self, at: DVec3, raw: f64, gradient: Vec3) -> Sample {
        let matched = self.classifier.unit(raw);
        let reference = self.field.reference_length();
        let over_edge = |raw: f64| opacity_over(extinction(self.classifier.opacity(raw), reference), self.edge as f32);
        let opacity = over_edge(raw);
        let rise = f64::from(gradient.length()) * self.edge;
        let boundary = (over_edge(raw + rise) - over_edge(raw - rise)).abs().min(1.0);
        let hidden_depth = if opacity > 0.0 {
            let occlusion = self.occlusion.get(matched.unit).and_then(Option::as_ref);
            occlusion.map_or(0.0, |of| of.at(self.field.middle() + at))
        } else {
            0.0
        };
        let emphasis = (-hidden_depth).exp().max(self.options.interior as f32) * (1.0 + BOUNDARY_GAIN * boundary);
        let importance = (emphasis * opacity).max(self.least(raw, gradient));
        let is_visible = opacity > 0.0;
        Sample { unit: matched.unit, importance, is_visible, is_outside: is_visible && !matched.inside }
    }

    /// Importance where another transfer function shows the value.
    fn least(&self, raw: f64, gradient: Vec3) -> f32 {
        let hidden = self.options.hidden as f32;
        if hidden == 0.0 {
            return 0.0;
        }
        hidden * importance_of_value(raw, gradient.length(), self.background, self.surfaceness)
    }

    /// The importance of a tetrahedron from its first samples. Where few of a large one count, more are taken.
    pub(super) fn estimate(&self, cell: u32) -> CellEstimate {
        let of = CellSampler::new(self.field, cell);
        let cubes = of.cell.volume() / self.edge.powi(3);
        // Eight for each cube of an edge resolve all that a Gaussian can.
        let most = ((8.0 * cubes).ceil() as usize).clamp(FIRST_SAMPLES[0], FIRST_SAMPLES[2]);
        let [low, high] = of.cell.range();
        let mut count = most.min(FIRST_SAMPLES[1]);
        loop {
            let estimate = self.estimate_of(&of, cubes, count);
            let is_enough = estimate.share * count as f64 >= LEAST_HITS || count == most;
            if is_enough || !self.classifier.is_visible_between(low, high) {
                return estimate;
            }
            count = (8 * count).min(most);
        }
    }

    fn estimate_of(&self, of: &CellSampler, cubes: f64, count: usize) -> CellEstimate {
        let mut estimate = CellEstimate { units: Vec::new(), share: 0.0, is_outside: false };
        for k in 0..count {
            let (at, raw, gradient) = of.sample(k, count);
            let sample = self.sample(at, raw, gradient);
            estimate.is_outside |= sample.is_outside;
            let importance = f64::from(sample.importance) * cubes / count as f64;
            if importance <= 0.0 {
                continue;
            }
            estimate.share += 1.0 / count as f64;
            let UnitEstimate { importance: sum, is_visible, .. } = estimate.part(sample.unit);
            *sum += importance;
            *is_visible |= sample.is_visible;
        }
        estimate
    }

    /// The samples of all tetrahedra by base unit, each set along a Morton curve.
    pub(super) fn samples(&self, cells: &[u32], counts: &[usize], units: usize) -> Vec<Samples> {
        let found: Vec<Vec<(usize, RawSample)>> = cells
            .par_iter()
            .zip(counts)
            .with_min_len(256)
            .map(|(&cell, &count)| {
                let of = CellSampler::new(self.field, cell);
                let share = of.cell.volume() / count as f64;
                let each = |k| {
                    let (at, raw, gradient) = of.sample(k, count);
                    let sample = self.sample(at, raw, gradient);
                    let weight = f64::from(sample.importance) * share / self.edge.powi(3);
                    let own = RawSample { at, raw, gradient, cell, count: count as u32, weight: weight as f32 };
                    (weight > 0.0).then_some((sample.unit, own))
                };
                (0..count).filter_map(each).collect()
            })
            .collect();
        let mut by_unit: Vec<Vec<RawSample>> = (0..units).map(|_| Vec::new()).collect();
        for (unit, sample) in found.into_iter().flatten() {
            if let Some(of) = by_unit.get_mut(unit) {
                of.push(sample);
            }
        }
        let bounds = self.field.bounds();
        let half = 0.5 * (bounds.max - bounds.min).max_element();
        by_unit.into_iter().map(|samples| Samples::new(samples, half)).collect()
    }
}
