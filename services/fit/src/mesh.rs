//! Gaussians of the tetrahedra of a mesh, from samples within them.
//!
//! Each tetrahedron gets as many samples as its importance asks for, evenly spread within it. No grid stands between the values
//! and the Gaussians; only the depth of what hides a place is computed on a coarse one.

use std::time::Instant;

use glam::{DAffine3, DMat3, DVec3, UVec3, Vec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use sg_volume::opacity::extinction;
use sg_volume::{Classifier, Field, Grid, MeshField, Surfaceness, background_values};

use crate::importance::{BOUNDARY_GAIN, opacity_over};
use crate::options::{DirectError, HOMOGENEOUS, Options};
use crate::pieces::{Piece, Pieces};
use crate::placed::{Placed, PlacedUnit, apportion};
use crate::placement::{relaxed_cells, systematic_sample};
use crate::report::Seconds;
use crate::shape::{GaussianBuilder, Splat};
use crate::visibility::least_optical_depth;

/// Voxels along the longest side of the coarse grid on which occlusion is computed.
const OCCLUSION_EDGE: usize = 96;
/// Samples for each Gaussian.
const SAMPLES: f64 = 16.0;
/// Samples of a tetrahedron for a first estimate of its importance: of a small one, of a large one, and most of one of which only a
/// thin part counts.
const FIRST_SAMPLES: [usize; 3] = [4, 64, 4096];
/// Samples with an importance that make an estimate good enough.
const LEAST_HITS: f64 = 8.0;
/// Most samples of one tetrahedron.
const MOST_SAMPLES: f64 = 65_536.0;

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
    let background = even.as_ref().and_then(background_values).unwrap_or([f64::NAN; 2]);
    let shown = field.visible_cells(classifier);
    let nothing = || DirectError::NothingVisible {
        count: field.cells().len(),
        elements: "tetrahedra",
        low: range.low,
        high: range.high,
        non_finite: range.non_finite,
    };
    if shown.is_empty() {
        return Err(nothing());
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
        return Err(nothing());
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
            let mut random = ChaCha8Rng::seed_from_u64(options.seed.wrapping_add((unit as u64) << 32));
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
            };
            splats = (0..cells.len())
                .into_par_iter()
                .with_min_len(64)
                .filter_map(|i| builder.splat(cells.points(i)))
                .collect();
            seconds.shape += clock.elapsed().as_secs_f64();
        } else {
            stage("shaping Gaussians");
        }
        let visible = visible.get(unit).copied().unwrap_or(0);
        units.push(PlacedUnit { splats, importance: samples.importance, visible });
    }
    Ok(Placed { units, visible: visible_cells, outside_ranges, edge, seconds })
}

/// Optical depth of one base unit in front of each place, on the coarse grid.
struct Occlusion {
    grid: Grid,
    depth: Vec<f32>,
}

impl Occlusion {
    /// `reference` is the length that the opacities refer to.
    fn new(even: &Field, classifier: &Classifier, unit: usize, reference: f64) -> Self {
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
struct ImportanceRule<'a> {
    field: &'a MeshField,
    classifier: &'a Classifier,
    surfaceness: &'a Surfaceness,
    /// By base unit; `None` if nothing hides.
    occlusion: Vec<Option<Occlusion>>,
    /// Values of the empty space around the subject.
    background: [f64; 2],
    /// Length that stands for a voxel.
    edge: f64,
    options: &'a Options,
}

/// What the first samples tell of a tetrahedron.
struct CellEstimate {
    units: Vec<UnitEstimate>,
    /// Share of the samples with an importance.
    share: f64,
    /// Whether a visible sample is outside the ranges of all base units.
    is_outside: bool,
}

/// The part of one base unit in a tetrahedron.
#[derive(Clone, Copy)]
struct UnitEstimate {
    unit: usize,
    importance: f64,
    is_visible: bool,
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
    fn samples(&self, grains: &[f64]) -> usize {
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
        if hidden == 0.0 || !raw.is_finite() {
            return 0.0;
        }
        let boundary = self.surfaceness.at(raw, gradient.length());
        let inside = if self.background[0] <= raw && raw <= self.background[1] { 0.0 } else { HOMOGENEOUS };
        hidden * (inside + (1.0 - HOMOGENEOUS) * boundary)
    }

    /// The importance of a tetrahedron from its first samples. Where few of a large one count, more are taken.
    fn estimate(&self, cell: u32) -> CellEstimate {
        let of = CellSampler::new(self.field, cell);
        let cubes = of.volume / self.edge.powi(3);
        // Eight for each cube of an edge resolve all that a Gaussian can.
        let most = ((8.0 * cubes).ceil() as usize).clamp(FIRST_SAMPLES[0], FIRST_SAMPLES[2]);
        let [low, high] = self.field.cell(cell as usize).range();
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
    fn samples(&self, cells: &[u32], counts: &[usize], units: usize) -> Vec<Samples> {
        let found: Vec<Vec<(usize, RawSample)>> = cells
            .par_iter()
            .zip(counts)
            .with_min_len(256)
            .map(|(&cell, &count)| {
                let of = CellSampler::new(self.field, cell);
                let share = of.volume / count as f64;
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

/// Even samples of one tetrahedron.
struct CellSampler {
    corners: [DVec3; 4],
    values: [f64; 4],
    gradients: [Vec3; 4],
    volume: f64,
    /// The start of the sequence: that of neighbours differs, so that their samples form no lattice together.
    start: [f64; 3],
}

/// Steps of the additive recurrence with the lowest discrepancy in three dimensions: powers of the reciprocal of the real root
/// of x⁴ = x + 1 (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences").
const STEPS: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3];

impl CellSampler {
    fn new(field: &MeshField, cell: u32) -> Self {
        let of = field.cell(cell as usize);
        let mut random = ChaCha8Rng::seed_from_u64(u64::from(cell));
        Self {
            corners: of.corners,
            values: of.values,
            gradients: field.corner_gradients(cell as usize),
            volume: of.volume(),
            start: [random.random(), random.random(), random.random()],
        }
    }

    /// Position, raw value and gradient of sample `k`. The only one is in the middle.
    fn sample(&self, k: usize, count: usize) -> (DVec3, f64, Vec3) {
        let c = if count == 1 {
            [0.25; 4]
        } else {
            folded([0, 1, 2].map(|axis| (self.start[axis] + k as f64 * STEPS[axis]).fract()))
        };
        let at = self.corners.iter().zip(c).map(|(p, c)| *p * c).sum();
        let raw = self.values.iter().zip(c).map(|(v, c)| v * c).sum();
        let gradient = self.gradients.iter().zip(c).map(|(g, c)| *g * c as f32).sum();
        (at, raw, gradient)
    }
}

/// Barycentric coordinates of a point of the unit cube, folded into a tetrahedron: even where the points are (Rocchini and
/// Cignoni 2000, "Generating random points in a tetrahedron").
fn folded([mut s, mut t, mut u]: [f64; 3]) -> [f64; 4] {
    if s + t > 1.0 {
        (s, t) = (1.0 - s, 1.0 - t);
    }
    if t + u > 1.0 {
        (t, u) = (1.0 - u, 1.0 - s - t);
    } else if s + t + u > 1.0 {
        (s, u) = (1.0 - t - u, s + t + u - 1.0);
    }
    [1.0 - s - t - u, s, t, u]
}

/// A sample with its tetrahedron, and the number of that one's samples.
struct RawSample {
    at: DVec3,
    raw: f64,
    gradient: Vec3,
    cell: u32,
    count: u32,
    weight: f32,
}

/// The samples of one base unit along a Morton curve: neighbours in the list are neighbours in space.
struct Samples {
    /// From the middle of the mesh.
    positions: Vec<[f32; 3]>,
    weights: Vec<f32>,
    own: Vec<RawSample>,
    importance: f64,
}

impl Samples {
    /// `half` is half the longest side of the mesh.
    fn new(mut own: Vec<RawSample>, half: f64) -> Self {
        own.par_sort_by_cached_key(|sample| (morton(sample.at, half), sample.cell));
        Self {
            positions: own.iter().map(|sample| sample.at.as_vec3().to_array()).collect(),
            weights: own.iter().map(|sample| sample.weight).collect(),
            importance: own.iter().map(|sample| f64::from(sample.weight)).sum(),
            own,
        }
    }

    /// A random way from the middle of a sample's part of its tetrahedron: that of a point of the whole one, made smaller.
    fn within(&self, field: &MeshField, sample: usize, at: [f64; 3]) -> DVec3 {
        let Some(sample) = self.own.get(sample) else { return DVec3::ZERO };
        let corners = field.cell(sample.cell as usize).corners;
        let point: DVec3 = corners.iter().zip(folded(at)).map(|(p, c)| *p * c).sum();
        let middle = corners.iter().sum::<DVec3>() / 4.0;
        (point - middle) / f64::from(sample.count).cbrt()
    }
}

/// The place on a Morton curve through the cube from −`half` to `half`, with 21 bits for each axis.
fn morton(at: DVec3, half: f64) -> u64 {
    let spread = |x: f64| {
        let cells = f64::from(1 << 21);
        let mut bits = ((0.5 + 0.5 * x / half) * cells).clamp(0.0, cells - 1.0) as u64;
        for (shift, mask) in [
            (32, 0x001f_0000_0000_ffff),
            (16, 0x001f_0000_ff00_00ff),
            (8, 0x100f_00f0_0f00_f00f),
            (4, 0x10c3_0c30_c30c_30c3),
            (2, 0x1249_2492_4924_9249),
        ] {
            bits = (bits | bits << shift) & mask;
        }
        bits
    };
    spread(at.x) | spread(at.y) << 1 | spread(at.z) << 2
}

/// The samples of one base unit as the pieces of cells: one piece for each.
struct SamplePieces<'a> {
    samples: &'a Samples,
    field: &'a MeshField,
}

impl Pieces for SamplePieces<'_> {
    fn for_each(&self, point: u32, mut f: impl FnMut(Piece)) {
        if let Some(sample) = self.samples.own.get(point as usize) {
            let volume = self.field.cell(sample.cell as usize).volume() / f64::from(sample.count);
            f(Piece { place: sample.at, weight: sample.weight, share: volume / self.unit_volume(), point });
        }
    }

    fn value_and_gradient(&self, piece: &Piece) -> (f64, Vec3) {
        self.samples
            .own
            .get(piece.point as usize)
            .map_or((f64::NAN, Vec3::ZERO), |sample| (sample.raw, sample.gradient))
    }

    fn extent(&self, piece: &Piece) -> DMat3 {
        let Some(sample) = self.samples.own.get(piece.point as usize) else { return DMat3::ZERO };
        // The covariance of a tetrahedron, made smaller to the sample's part of it.
        let corners = self.field.cell(sample.cell as usize).corners;
        let middle = corners.iter().sum::<DVec3>() / 4.0;
        let sum = corners.iter().fold(DMat3::ZERO, |sum, corner| {
            let d = *corner - middle;
            sum + DMat3::from_cols(d * d.x, d * d.y, d * d.z)
        });
        sum * (f64::from(sample.count).powf(-2.0 / 3.0) / 20.0)
    }

    fn to_world(&self) -> DAffine3 {
        DAffine3::from_translation(self.field.middle())
    }

    fn unit_volume(&self) -> f64 {
        self.field.reference_length().powi(3)
    }

    fn reference_length(&self) -> f64 {
        self.field.reference_length()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn folded_points_are_in_the_tetrahedron(at in prop::array::uniform3(0.0..1.0_f64)) {
            let c = folded(at);
            prop_assert!(c.iter().all(|c| *c >= -1e-12), "{c:?}");
            prop_assert!((c.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn folded_points_are_even() {
        let count = 200_000.0;
        let mut sum = [0.0; 4];
        let mut square = 0.0;
        for k in 0..200_000 {
            let c = folded(STEPS.map(|step| (0.5 + f64::from(k) * step).fract()));
            (0..4).for_each(|i| sum[i] += c[i]);
            square += c[1] * c[1];
        }
        // The moments of an even tetrahedron: 1/4, and 1/10.
        assert!(sum.iter().all(|s| (s / count - 0.25).abs() < 1e-3), "{sum:?}");
        assert!((square / count - 0.1).abs() < 1e-3, "{}", square / count);
    }

    #[test]
    fn the_curve_orders_octants() {
        let at = |x, y, z| morton(DVec3::new(x, y, z), 1.0);
        let octants: Vec<u64> = (0..8)
            .map(|k| {
                at(
                    if k & 1 > 0 { 0.5 } else { -0.5 },
                    if k & 2 > 0 { 0.5 } else { -0.5 },
                    if k & 4 > 0 { 0.5 } else { -0.5 },
                )
            })
            .collect();
        assert!(octants.is_sorted());
        assert_eq!(at(1.0, 1.0, 1.0), (1 << 63) - 1);
        assert_eq!(at(-1.0, -1.0, -1.0), 0);
    }
}
