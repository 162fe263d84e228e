//! Histograms, and automatic transfer functions by multi-level Otsu thresholds.

use rayon::prelude::*;

use crate::field::Field;
use crate::transfer::{BaseUnitRange, ControlPoint, Scale, TransferFunction, Units};

/// Bins of the histogram.
pub const BINS: usize = 256;
/// Least share of the voxels in a material; fewer are noise.
const LEAST_SHARE: f64 = 2e-4;

/// A value is part of the background if it is more frequent than the background's most frequent one over this number.
const FREQUENT: u64 = 20;

/// An automatic transfer function is not possible.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AutomaticError {
    /// There is no finite value.
    #[error("no voxel has a finite value")]
    NoValues,
    /// All values are the same.
    #[error("every voxel has the value {0}, so no materials can be separated; give a transfer function")]
    Constant(f64),
}

/// Counts of values in [`BINS`] bins of equal width.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    /// Lower border of the first bin.
    pub low: f64,
    /// Upper border of the last bin.
    pub high: f64,
    /// Values in each bin; those outside the borders count in the end bins.
    pub counts: Vec<u64>,
}

impl Histogram {
    /// The histogram of the finite values between two borders.
    #[must_use]
    pub fn of(field: &Field, low: f64, high: f64) -> Self {
        let factor = BINS as f64 / (high - low).max(f64::MIN_POSITIVE);
        let bin = |v: f32| (((field.offset() + f64::from(v) - low) * factor).max(0.0) as usize).min(BINS - 1);
        let counts = field
            .values()
            .par_chunks(1 << 18)
            .map(|chunk| {
                let mut counts = vec![0_u64; BINS];
                for &v in chunk.iter().filter(|v| v.is_finite()) {
                    counts[bin(v)] += 1;
                }
                counts
            })
            .reduce(
                || vec![0; BINS],
                |mut a, b| {
                    a.iter_mut().zip(b).for_each(|(x, y)| *x += y);
                    a
                },
            );
        Self { low, high, counts }
    }

    /// Value at the lower border of bin `i`.
    #[must_use]
    pub fn border(&self, i: usize) -> f64 {
        self.low + (self.high - self.low) * i as f64 / BINS as f64
    }
}

/// A transfer function from the histogram of a volume.
///
/// Multi-level Otsu thresholds (Liao, Chen and Chung 2001) separate up to three materials, one base unit each. The class
/// of the outer faces is transparent. The materials get colours for colour-blind readers (Okabe and Ito 2008); denser
/// ones are more opaque. The same values always give the same function.
///
/// # Errors
/// [`AutomaticError`] if all values are equal or none is finite.
pub fn automatic_transfer_function(field: &Field, variable: Option<&str>) -> Result<TransferFunction, AutomaticError> {
    let (low, high) = robust_range(field)?;
    let histogram = Histogram::of(field, low, high);
    let background = background_bin(field, &histogram);
    // Air fills most volumes. Square roots keep its peak from hiding the thresholds of small structures.
    let weights: Vec<f64> = histogram.counts.iter().map(|&c| (c as f64).sqrt()).collect();
    let total: u64 = histogram.counts.iter().sum();
    let distinct = histogram.counts.iter().filter(|&&c| c > 0).count();

    let smooth: Vec<f64> = (0..BINS)
        .map(|i| {
            let near = i.saturating_sub(2)..(i + 3).min(BINS);
            near.clone().map(|k| histogram.counts[k] as f64).sum::<f64>() / near.len() as f64
        })
        .collect();
    let share = |w: &[usize]| histogram.counts[w[0]..w[1]].iter().sum::<u64>() as f64 / total as f64;
    let material = |w: &[usize]| share(w) >= LEAST_SHARE && has_peak(&smooth, w[0], w[1]);
    let mut borders = vec![0, BINS];
    for classes in (2..=4.min(distinct)).rev() {
        borders = otsu_borders(&weights, classes);
        if borders.windows(2).all(|w| (w[0]..w[1]).contains(&background) || material(w)) {
            break;
        }
    }
    let empty = borders.windows(2).position(|w| (w[0]..w[1]).contains(&background)).unwrap_or(0);
    Ok(from_borders(&histogram, &borders, empty, variable))
}

/// The value range of the histogram. An end loses its outermost 1/10,000 of the values if that tail is longer than the
/// rest of the range.
pub(crate) fn robust_range(field: &Field) -> Result<(f64, f64), AutomaticError> {
    let range = field.range();
    if range.non_finite == field.values().len() {
        return Err(AutomaticError::NoValues);
    }
    if range.low >= range.high {
        return Err(AutomaticError::Constant(range.low));
    }
    // A regular subset of at most a million values gives the quantiles.
    let stride = field.values().len().div_ceil(1 << 20);
    let mut some: Vec<f32> = field.values().iter().step_by(stride).copied().filter(|v| v.is_finite()).collect();
    some.sort_by(f32::total_cmp);
    let quantile = |q: f64| {
        let at = (q * (some.len().saturating_sub(1)) as f64).round() as usize;
        some.get(at).map_or(range.low, |&v| field.offset() + f64::from(v))
    };
    let (inner_low, inner_high) = (quantile(1e-4), quantile(1.0 - 1e-4));
    let inner = inner_high - inner_low;
    let mut low = range.low;
    let mut high = range.high;
    if inner > 0.0 {
        if inner_low - low > inner {
            low = inner_low;
        }
        if high - inner_high > inner {
            high = inner_high;
        }
    }
    Ok((low, high))
}

/// The values of the empty space around a subject, noise included: those around the most frequent value on the outer faces, as
/// far as they are frequent in the whole volume. `None` if all values are equal or none is finite.
#[must_use]
pub fn background_values(field: &Field) -> Option<[f64; 2]> {
    let (low, high) = robust_range(field).ok()?;
    Some(background_in(field, &Histogram::of(field, low, high)))
}

/// As [`background_values`], with the histogram of the field.
pub(crate) fn background_in(field: &Field, histogram: &Histogram) -> [f64; 2] {
    let middle = background_bin(field, histogram);
    let least = histogram.counts[middle] / FREQUENT;
    let is_frequent = |bin: &usize| histogram.counts.get(*bin).is_some_and(|count| *count > least);
    let first = (0..=middle).rev().take_while(is_frequent).last().unwrap_or(middle);
    let last = (middle..BINS).take_while(is_frequent).last().unwrap_or(middle);
    // The bins at the ends count what lies beyond them too.
    let low = if first == 0 { f64::NEG_INFINITY } else { histogram.border(first) };
    let high = if last + 1 == BINS { f64::INFINITY } else { histogram.border(last + 1) };
    [low, high]
}

/// The most frequent bin on the outer faces of the volume. In a thin volume all voxels count.
fn background_bin(field: &Field, histogram: &Histogram) -> usize {
    let grid = field.grid();
    let [nx, ny, nz] = grid.dims();
    let factor = BINS as f64 / (histogram.high - histogram.low);
    let mut counts = vec![0_u64; BINS];
    for z in 0..nz {
        for y in 0..ny {
            let on_face = z == 0 || z + 1 == nz || y == 0 || y + 1 == ny;
            let step = if on_face { 1 } else { (nx - 1).max(1) };
            for x in (0..nx).step_by(step) {
                let v = field.raw(grid.index(x, y, z));
                if v.is_finite() {
                    counts[(((v - histogram.low) * factor).max(0.0) as usize).min(BINS - 1)] += 1;
                }
            }
        }
    }
    // The first of equals: the lowest value.
    (0..BINS).rev().max_by_key(|&i| counts[i]).unwrap_or(0)
}

/// Whether the histogram rises from both borders of a class to a peak inside it. A class without a peak holds the partial
/// volumes between two materials. The ends of the histogram count as empty: values may saturate there.
fn has_peak(smooth: &[f64], from: usize, to: usize) -> bool {
    let inside = &smooth[from..to];
    let peak = inside.iter().copied().fold(0.0, f64::max);
    let border = |at: Option<&f64>, end: bool| if end { 0.0 } else { at.copied().unwrap_or(0.0) };
    let higher = border(inside.first(), from == 0).max(border(inside.last(), to == smooth.len()));
    // Three standard deviations of the mean count over five bins are noise.
    peak > 1.15 * higher + 3.0 * (higher / 5.0).sqrt()
}

/// Borders `0 = b₀ < b₁ < … < b_k = BINS` of `classes` classes with the greatest between-class variance. Dynamic programming
/// covers all placements.
fn otsu_borders(weights: &[f64], classes: usize) -> Vec<usize> {
    let n = weights.len();
    let mut mass = vec![0.0; n + 1];
    let mut moment = vec![0.0; n + 1];
    for (i, w) in weights.iter().enumerate() {
        mass[i + 1] = mass[i] + w;
        moment[i + 1] = moment[i] + w * (i as f64 + 0.5);
    }
    // Σ over classes of (first moment)² / mass is the between-class variance up to a constant.
    let gain = |a: usize, b: usize| {
        let m = mass[b] - mass[a];
        if m > 0.0 { (moment[b] - moment[a]).powi(2) / m } else { f64::NEG_INFINITY }
    };
    let mut best: Vec<f64> = (0..=n).map(|b| gain(0, b)).collect();
    let mut choices = Vec::new();
    for _ in 1..classes {
        let mut next = vec![f64::NEG_INFINITY; n + 1];
        let mut choice = vec![0; n + 1];
        for b in 1..=n {
            for (a, before) in best.iter().enumerate().take(b).skip(1) {
                let value = before + gain(a, b);
                if value > next[b] {
                    (next[b], choice[b]) = (value, a);
                }
            }
        }
        best = next;
        choices.push(choice);
    }
    let mut borders = vec![n];
    for choice in choices.iter().rev() {
        let last = borders.last().map_or(0, |&b| choice[b]);
        borders.push(last);
    }
    borders.push(0);
    borders.reverse();
    // Any border in the empty gap between two peaks has the same variance; the middle leaves both the most room.
    for b in &mut borders[1..classes] {
        let empty_before = weights[..*b].iter().rev().take_while(|&&w| w == 0.0).count();
        let empty_after = weights[*b..].iter().take_while(|&&w| w == 0.0).count();
        *b = (2 * *b + empty_after - empty_before) / 2;
    }
    borders
}

/// Colours from the Okabe–Ito set: orange, sky blue, reddish purple, bluish green, yellow, vermilion, blue.
pub(crate) const COLORS: [[f32; 3]; 7] = [
    [0.902, 0.624, 0.0],
    [0.337, 0.706, 0.914],
    [0.8, 0.475, 0.655],
    [0.0, 0.62, 0.451],
    [0.941, 0.894, 0.259],
    [0.835, 0.369, 0.0],
    [0.0, 0.447, 0.698],
];
/// Opacities by number of materials. An outer, less dense material must not hide the inner ones.
const OPACITIES: [&[f32]; 4] = [&[], &[0.5], &[0.08, 0.6], &[0.05, 0.25, 0.8]];
const NAMES: [&[&str]; 4] = [&[], &["material"], &["low", "high"], &["low", "middle", "high"]];

/// Colour, opacity and name of a material, the `m`th of `materials` by increasing value.
fn look(m: usize, materials: usize) -> ([f32; 3], f32, String) {
    let color = COLORS[m % COLORS.len()];
    match (OPACITIES.get(materials).and_then(|of| of.get(m)), NAMES.get(materials).and_then(|of| of.get(m))) {
        (Some(opacity), Some(name)) => (color, *opacity, (*name).to_owned()),
        _ => {
            let share = m as f32 / materials.saturating_sub(1).max(1) as f32;
            (color, 0.04 * 20.0_f32.powf(share), format!("material {}", m + 1))
        }
    }
}

pub(crate) fn from_borders(
    histogram: &Histogram,
    borders: &[usize],
    empty: usize,
    variable: Option<&str>,
) -> TransferFunction {
    let classes = borders.len() - 1;
    let materials = classes - 1;
    let mut material = 0;
    let looks: Vec<Option<usize>> = (0..classes)
        .map(|c| {
            (c != empty).then(|| {
                material += 1;
                material - 1
            })
        })
        .collect();
    let sample = |class: usize, other: usize| match (looks[class], looks[other]) {
        (Some(m), _) => {
            let (color, opacity, _) = look(m, materials);
            (color, opacity)
        }
        // Ramps into the background fade without a change of colour.
        (None, Some(m)) => (look(m, materials).0, 0.0),
        (None, None) => ([0.0; 3], 0.0),
    };
    let mut points = Vec::new();
    let mut push = |value: f64, (color, opacity): ([f32; 3], f32)| points.push(ControlPoint { value, color, opacity });
    push(histogram.low, sample(0, 1.min(classes - 1)));
    let mut starts = vec![histogram.low];
    for c in 1..classes {
        let width = |i: usize| histogram.border(borders[i + 1]) - histogram.border(borders[i]);
        let half = 0.15 * width(c - 1).min(width(c));
        let at = histogram.border(borders[c]);
        push(at - half, sample(c - 1, c));
        push(at + half, sample(c, c - 1));
        // All visible values of a ramp out of the background belong to the material.
        starts.push(match (looks[c - 1], looks[c]) {
            (None, _) => at - half,
            (_, None) => at + half,
            _ => at,
        });
    }
    push(histogram.high, sample(classes - 1, classes.saturating_sub(2)));
    starts.push(histogram.high);
    let base_units = looks
        .iter()
        .enumerate()
        .filter_map(|(c, m)| m.map(|m| (c, m)))
        .map(|(c, m)| BaseUnitRange { name: look(m, materials).2, range: [starts[c], starts[c + 1]] })
        .collect();
    TransferFunction {
        domain: [histogram.low, histogram.high],
        units: Units::Raw,
        scale: Scale::Linear,
        variable: variable.map(str::to_owned),
        points,
        base_units,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;
    use crate::volume::Volume;

    fn field_of(dims: [usize; 3], f: impl Fn(usize) -> f32) -> Field {
        let grid = Grid::unit(dims).unwrap();
        let values: Vec<f32> = (0..grid.len()).map(f).collect();
        Volume::new(grid, values.into(), None).unwrap().to_field()
    }

    /// Nested boxes of values 0, 80, 160, 240 with a little spread.
    fn nested() -> Field {
        field_of([40, 40, 40], |i| {
            let depth = |x: usize| x.min(39 - x);
            let d = depth(i % 40).min(depth(i / 40 % 40)).min(depth(i / 1600));
            [0.0, 80.0, 160.0, 240.0][(d / 5).min(3)] + (i * 7919 % 11) as f32
        })
    }

    #[test]
    fn nested_boxes_become_their_materials() {
        let field = nested();
        let f = automatic_transfer_function(&field, Some("density")).unwrap();
        f.check().unwrap();
        assert_eq!(f, automatic_transfer_function(&field, Some("density")).unwrap());
        assert_eq!(f.base_units.len(), 3);
        let c = f.classifier(field.range()).unwrap();
        assert_eq!(c.opacity(5.0), 0.0, "the outer faces are background");
        for (value, unit) in [(85.0, 0), (165.0, 1), (245.0, 2)] {
            assert!(c.opacity(value) > 0.0);
            assert_eq!(c.unit(value).unit, unit, "{value}");
            assert!(c.unit(value).inside);
        }
        assert!(c.opacity(245.0) > c.opacity(85.0));
    }

    #[test]
    fn a_bright_background_is_the_transparent_one() {
        let field = field_of([20, 20, 20], |i| {
            let inside = |x: usize| (6..14).contains(&x);
            if inside(i % 20) && inside(i / 20 % 20) && inside(i / 400) { 10.0 } else { 200.0 }
        });
        let f = automatic_transfer_function(&field, None).unwrap();
        let c = f.classifier(field.range()).unwrap();
        assert_eq!(c.opacity(200.0), 0.0);
        assert!(c.opacity(10.0) > 0.2);
        assert_eq!(f.base_units.len(), 1);
    }

    #[test]
    fn partial_volumes_between_two_materials_are_none() {
        // A ball of 200 in 10 with a wide, even ramp: every value between occurs, none of them more often than others.
        let field = field_of([48, 48, 48], |i| {
            let d = |x: usize, middle: f32| x as f32 - middle;
            let r = (d(i % 48, 23.13).powi(2) + d(i / 48 % 48, 23.71).powi(2) + d(i / 2304, 24.37).powi(2)).sqrt();
            10.0 + 190.0 * ((18.0 - r) / 6.0).clamp(0.0, 1.0)
        });
        let f = automatic_transfer_function(&field, None).unwrap();
        assert_eq!(f.base_units.len(), 1, "{f:?}");
    }

    #[test]
    fn one_outlier_does_not_widen_the_domain() {
        let field = nested();
        let mut values = field.values().to_vec();
        values[20_000] = 1e9;
        let wild = Volume::new(field.grid().clone(), values.into(), None).unwrap().to_field();
        let f = automatic_transfer_function(&wild, None).unwrap();
        assert!(f.domain[1] < 300.0, "{:?}", f.domain);
    }

    #[test]
    fn the_background_is_the_empty_space_and_its_noise() {
        let [low, high] = background_values(&nested()).unwrap();
        assert!(low == f64::NEG_INFINITY && (10.0..80.0).contains(&high), "{low} to {high}");
        // A bright one, with faint structures inside; noise of both signs.
        let field = field_of([40, 40, 40], |i| {
            let inside = |x: usize| (10..30).contains(&x);
            let is_inside = inside(i % 40) && inside(i / 40 % 40) && inside(i / 1600);
            let noise = (i * 7919 % 13) as f32 - 6.0;
            if is_inside { (i % 200) as f32 } else { 400.0 + noise }
        });
        let [low, high] = background_values(&field).unwrap();
        assert!((200.0..=394.5).contains(&low) && high >= 405.5, "{low} to {high}");
        assert_eq!(background_values(&field_of([3, 3, 3], |_| 7.0)), None);
        assert_eq!(background_values(&field_of([3, 3, 3], |_| f32::NAN)), None);
    }

    #[test]
    fn constant_and_empty_volumes_have_no_automatic_function() {
        assert_eq!(
            automatic_transfer_function(&field_of([3, 3, 3], |_| 7.0), None),
            Err(AutomaticError::Constant(7.0))
        );
        assert_eq!(
            automatic_transfer_function(&field_of([3, 3, 3], |_| f32::NAN), None),
            Err(AutomaticError::NoValues)
        );
    }

    #[test]
    fn otsu_finds_the_best_of_all_placements() {
        let weights: Vec<f64> = (0..24).map(|i| ((i * 37 % 17) as f64) + if i % 8 < 3 { 30.0 } else { 0.0 }).collect();
        let score = |b: &[usize]| -> f64 {
            b.windows(2)
                .map(|w| {
                    let m: f64 = weights[w[0]..w[1]].iter().sum();
                    let s: f64 = (w[0]..w[1]).map(|i| weights[i] * (i as f64 + 0.5)).sum();
                    s * s / m
                })
                .sum()
        };
        let found = otsu_borders(&weights, 3);
        let best = (1..24)
            .flat_map(|a| (a + 1..24).map(move |b| vec![0, a, b, 24]))
            .map(|b| score(&b))
            .fold(f64::NEG_INFINITY, f64::max);
        assert!((score(&found) - best).abs() < 1e-9 * best);
    }
}
