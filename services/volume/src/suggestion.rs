//! Base units suggested by the values of a volume and their gradients.
//!
//! Materials are clusters in the plane of value and gradient (Kindlmann and Durkin 1998, "Semi-automatic generation of transfer
//! functions for direct volume rendering"; Kniss et al. 2002). The inside of a material has few values and no gradient. A boundary is
//! an arc between two of them. So each voxel counts by how homogeneous it is. The histogram of what is left has a
//! peak for each material, without the values between two of them. A peak counts by its prominence over the deeper of the
//! valleys beside it, on a logarithmic scale: a rare dense material matters as much as a frequent one.

use rayon::prelude::*;
use serde::Serialize;

use crate::field::Field;
use crate::histogram::{AutomaticError, BINS, Histogram, background_in, from_borders, robust_range};
use crate::surfaceness::Surfaceness;
use crate::transfer::TransferFunction;

/// Standard deviation in voxels of the smoothing before gradients.
const SMOOTHING: f32 = 1.0;
/// Standard deviation in bins of the smoothing of the histogram.
const BLUR: f64 = 2.0;
/// Least prominence: a peak is at least e^0.7 = twice as high as the valley beside it.
const LEAST_PROMINENCE: f64 = 0.7;
/// Least number of homogeneous voxels at a peak, a bin.
const LEAST_HEIGHT: f64 = 4.0;

/// Voxels that are counted together.
const PART: usize = 1 << 18;

/// Most base units that can be suggested.
pub const MOST_UNITS: usize = 7;

/// A suggested base unit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SuggestedUnit {
    /// Its name in the transfer function.
    pub name: String,
    /// Its least and greatest value, raw.
    pub range: [f64; 2],
    /// The most frequent value inside the material, raw.
    pub value: f64,
    /// Voxels with a value in its range.
    pub voxels: u64,
    /// Logarithm of the ratio of the peak's height and that of the deeper valley beside it.
    pub prominence: f64,
}

/// A transfer function with suggested base units.
#[derive(Debug, Clone, PartialEq)]
pub struct Suggestion {
    /// The function, with a colour for each unit and the empty space transparent.
    pub function: TransferFunction,
    /// Its base units, by increasing value.
    pub units: Vec<SuggestedUnit>,
}

/// A peak of a histogram.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Peak {
    bin: usize,
    prominence: f64,
}

/// Suggests at most `most` base units (1 to [`MOST_UNITS`]), the most prominent ones. Without a peak beside the empty space the
/// rest of the values is one unit.
///
/// # Errors
/// [`AutomaticError`] if all values are equal or none is finite.
pub fn suggest_base_units(field: &Field, most: usize, variable: Option<&str>) -> Result<Suggestion, AutomaticError> {
    let (low, high) = robust_range(field)?;
    let histogram = Histogram::of(field, low, high);
    let [first, last] = background_in(field, &histogram);
    let is_background = |bin: usize| {
        let middle = 0.5 * (histogram.border(bin) + histogram.border(bin + 1));
        first <= middle && middle <= last
    };
    let homogeneous = homogeneous_counts(field, &histogram);
    let heights: Vec<f64> = blurred(&homogeneous).into_iter().map(f64::ln_1p).collect();
    let mut peaks = peaks(&heights);
    peaks.retain(|peak| {
        let is_high = heights[peak.bin] >= LEAST_HEIGHT.ln_1p();
        !is_background(peak.bin) && is_high && peak.prominence >= LEAST_PROMINENCE
    });
    peaks.sort_by(|a, b| b.prominence.total_cmp(&a.prominence).then(a.bin.cmp(&b.bin)));
    peaks.truncate(most.clamp(1, MOST_UNITS));
    if peaks.is_empty() {
        let rest = (0..BINS).filter(|bin| !is_background(*bin));
        let bin = rest.max_by(|a, b| heights[*a].total_cmp(&heights[*b])).unwrap_or(BINS / 2);
        peaks.push(Peak { bin, prominence: 0.0 });
    }
    // The empty space is a class too: its own peak, or the end of the histogram.
    let empty = (0..BINS).filter(|bin| is_background(*bin)).max_by(|a, b| heights[*a].total_cmp(&heights[*b]));
    let mut classes: Vec<(usize, Option<Peak>)> = peaks.iter().map(|peak| (peak.bin, Some(*peak))).collect();
    classes.push((empty.unwrap_or(0), None));
    classes.sort_by_key(|class| class.0);
    let mut borders = vec![0];
    for pair in classes.windows(2) {
        let (from, to) = (pair[0].0, pair[1].0);
        borders.push(valley(&heights, from, to));
    }
    borders.push(BINS);
    let empty = classes.iter().position(|class| class.1.is_none()).unwrap_or(0);
    let function = from_borders(&histogram, &borders, empty, variable);
    let materials = classes.iter().filter_map(|class| class.1);
    let units = materials.zip(&function.base_units).map(|(peak, unit)| {
        let inside = |bin: &usize| (unit.range[0]..unit.range[1]).contains(&histogram.border(*bin));
        SuggestedUnit {
            name: unit.name.clone(),
            range: unit.range,
            value: 0.5 * (histogram.border(peak.bin) + histogram.border(peak.bin + 1)),
            voxels: (0..BINS).filter(inside).map(|bin| histogram.counts[bin]).sum(),
            prominence: peak.prominence,
        }
    });
    Ok(Suggestion { units: units.collect(), function })
}

/// The histogram of voxels by how homogeneous their surroundings are, 0 to 1 for each.
fn homogeneous_counts(field: &Field, histogram: &Histogram) -> Vec<f64> {
    let smooth = field.smoothed(SMOOTHING);
    let grid = field.grid();
    let edge = grid.voxel_volume().cbrt();
    let factor = BINS as f64 / (histogram.high - histogram.low);
    let slope = edge / (histogram.high - histogram.low);
    let of_part = |part: usize| {
        let mut counts = vec![0.0; BINS];
        for i in part * PART..((part + 1) * PART).min(grid.len()) {
            let raw = field.raw(i);
            let bin = (raw - histogram.low) * factor;
            if raw.is_finite() && (0.0..=BINS as f64).contains(&bin) {
                let at = grid.voxel(i);
                let rise = f64::from(smooth.gradient_at(at.x, at.y, at.z).length()) * slope;
                counts[(bin as usize).min(BINS - 1)] += 1.0 - f64::from(Surfaceness::of_rise(rise as f32));
            }
        }
        counts
    };
    // Sums of fractions depend on their order, so the parts are added in theirs, on any number of threads.
    let parts: Vec<Vec<f64>> = (0..grid.len().div_ceil(PART)).into_par_iter().map(of_part).collect();
    let mut all = vec![0.0; BINS];
    for part in parts {
        all.iter_mut().zip(part).for_each(|(sum, count)| *sum += count);
    }
    all
}

/// The heights with a Gaussian of [`BLUR`] bins; the ends repeat nothing.
fn blurred(counts: &[f64]) -> Vec<f64> {
    let reach = (3.0 * BLUR).ceil() as usize;
    let weight = |d: usize| (-0.5 * (d as f64 / BLUR).powi(2)).exp();
    (0..counts.len())
        .map(|i| {
            let near = i.saturating_sub(reach)..(i + reach + 1).min(counts.len());
            let sum: f64 = near.clone().map(|k| counts[k] * weight(i.abs_diff(k))).sum();
            sum / near.map(|k| weight(i.abs_diff(k))).sum::<f64>()
        })
        .collect()
}

/// The local maxima with their prominence: the height over the higher one of the lowest places on the way to a higher maximum, on
/// either side. Beyond the ends the height is 0.
fn peaks(heights: &[f64]) -> Vec<Peak> {
    let least_on_the_way = |way: &mut dyn Iterator<Item = usize>, height: f64| {
        let mut least = height;
        for bin in way {
            if heights[bin] > height {
                return least;
            }
            least = least.min(heights[bin]);
        }
        0.0
    };
    let mut found = Vec::new();
    for (bin, height) in heights.iter().enumerate() {
        let before = bin.checked_sub(1).map_or(0.0, |k| heights[k]);
        let after = heights.get(bin + 1).copied().unwrap_or(0.0);
        // The first bin of a plateau stands for it.
        if *height > before && *height >= after {
            let left = least_on_the_way(&mut (0..bin).rev(), *height);
            let right = least_on_the_way(&mut (bin + 1..heights.len()), *height);
            found.push(Peak { bin, prominence: height - left.max(right) });
        }
    }
    found
}

/// The border between the materials of two peaks. Where their boundary lies, values are halfway between them. So it is the bin next to
/// the middle of both, of those that are about as low as the lowest one.
fn valley(heights: &[f64], from: usize, to: usize) -> usize {
    let between = from + 1..to.max(from + 2);
    let least = between.clone().filter_map(|k| heights.get(k)).copied().fold(f64::INFINITY, f64::min);
    let is_low = |k: &usize| heights.get(*k).is_some_and(|h| *h <= least + 0.5 * LEAST_PROMINENCE);
    between.filter(is_low).min_by_key(|k| (2 * k).abs_diff(from + to)).unwrap_or(to)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;
    use crate::volume::Volume;

    /// Balls about the middle: a radius and the value inside of it, the largest first, with a ramp of three voxels between and noise.
    fn balls(parts: &[(f32, f32)]) -> Field {
        let n = 64;
        let grid = Grid::unit([n; 3]).unwrap();
        let value = |i: usize| {
            let at = grid.voxel(i).as_vec3() - (n as f32 - 1.0) / 2.0;
            let r = at.length();
            let noise = (i * 7919 % 11) as f32 / 5.0 - 1.0;
            let mut value = 0.0;
            for (radius, inside) in parts {
                let t = ((radius + 1.5 - r) / 3.0).clamp(0.0, 1.0);
                value += t * (inside - value);
            }
            value + noise
        };
        let values: Vec<f32> = (0..grid.len()).map(value).collect();
        Volume::new(grid, values.into(), None).unwrap().to_field()
    }

    #[test]
    fn rare_materials_are_found_and_ramps_are_none() {
        // A core of 0.2 % of the voxels, and two shells.
        let field = balls(&[(28.0, 60.0), (14.0, 120.0), (5.0, 250.0)]);
        let Suggestion { function, units } = suggest_base_units(&field, 6, Some("density")).unwrap();
        assert!(function.check().is_ok());
        let found: Vec<f64> = units.iter().map(|unit| unit.value).collect();
        assert_eq!(found.len(), 3, "{units:?}");
        for (value, expected) in found.iter().zip([60.0, 120.0, 250.0]) {
            assert!((value - expected).abs() < 4.0, "{units:?}");
        }
        let classifier = function.classifier(field.range()).unwrap();
        assert_eq!(classifier.opacity(0.0), 0.0, "the empty space is transparent");
        for (unit, value) in [60.0, 120.0, 250.0].into_iter().enumerate() {
            assert_eq!(classifier.unit(value).unit, unit);
            assert!(classifier.opacity(value) > 0.0);
        }
        assert!(units[2].voxels < units[1].voxels && units[1].voxels < units[0].voxels, "{units:?}");
        assert_eq!(
            suggest_base_units(&field, 6, Some("density")).unwrap().units,
            units,
            "the same for the same values"
        );
    }

    #[test]
    fn the_most_prominent_ones_are_kept() {
        let field = balls(&[(28.0, 60.0), (14.0, 120.0), (5.0, 250.0)]);
        let all = suggest_base_units(&field, 6, None).unwrap().units;
        let two = suggest_base_units(&field, 2, None).unwrap().units;
        assert_eq!(two.len(), 2);
        let least = two.iter().map(|unit| unit.prominence).fold(f64::INFINITY, f64::min);
        assert!(all.iter().filter(|unit| unit.prominence > least).count() < 2);
        // One material has all values beside the empty space.
        let one = suggest_base_units(&balls(&[(20.0, 100.0)]), 6, None).unwrap();
        assert_eq!((one.units.len(), one.function.base_units.len()), (1, 1), "{one:?}");
    }

    #[test]
    fn values_without_a_peak_are_one_unit() {
        let grid = Grid::unit([32; 3]).unwrap();
        let values: Vec<f32> = (0..grid.len()).map(|i| i as f32).collect();
        let even = Volume::new(grid.clone(), values.into(), None).unwrap().to_field();
        let found = suggest_base_units(&even, 6, None).unwrap();
        assert!(!found.units.is_empty() && found.function.check().is_ok(), "{found:?}");
        let flat = Volume::new(grid.clone(), vec![5.0_f32; grid.len()].into(), None).unwrap().to_field();
        assert_eq!(suggest_base_units(&flat, 6, None), Err(AutomaticError::Constant(5.0)));
    }

    #[test]
    fn prominences_are_those_of_the_definition() {
        let heights = [0.0, 3.0, 1.0, 5.0, 2.0, 4.0, 0.0];
        let found = peaks(&heights);
        let of = |bin| found.iter().find(|peak| peak.bin == bin).map(|peak| peak.prominence);
        assert_eq!((of(1), of(3), of(5)), (Some(2.0), Some(5.0), Some(2.0)));
        assert_eq!(found.len(), 3);
        assert_eq!(peaks(&[2.0, 2.0, 2.0]), [Peak { bin: 0, prominence: 2.0 }]);
        assert_eq!((valley(&heights, 1, 3), valley(&[1.0, 0.0, 0.0, 0.0, 1.0], 0, 4)), (2, 2));
        // The lowest bin is beside the upper peak, but the boundary is halfway.
        assert_eq!(valley(&[9.0, 0.4, 0.3, 0.2, 0.1, 5.0], 0, 5), 2);
    }
}
