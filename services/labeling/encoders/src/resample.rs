//! Resampling of images as Pillow does it: separable, with a filter that widens when the image shrinks.
//!
//! Encoders were trained on images that Pillow made smaller, and other filters move their embeddings. So 8-bit images are
//! resampled with the fixed-point arithmetic of Pillow up to version 12, to the bit. Pillow 13 filters columns before rows where that
//! is cheaper, and single values differ by a level. Float images take the same filter without rounding.

use rayon::prelude::*;

/// A filter of Pillow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Filter {
    /// Triangle.
    Bilinear,
    /// Keys' cubic with a = −0.5.
    Bicubic,
}

impl Filter {
    /// Half the width of the filter, in pixels of the larger of both images.
    fn support(self) -> f64 {
        match self {
            Self::Bilinear => 1.0,
            Self::Bicubic => 2.0,
        }
    }

    fn weight(self, x: f64) -> f64 {
        const A: f64 = -0.5;
        let x = x.abs();
        match self {
            Self::Bilinear => (1.0 - x).max(0.0),
            Self::Bicubic if x < 1.0 => ((A + 2.0) * x - (A + 3.0)) * x * x + 1.0,
            Self::Bicubic if x < 2.0 => (((x - 5.0) * x + 8.0) * x - 4.0) * A,
            Self::Bicubic => 0.0,
        }
    }
}

/// One axis: `from` pixels become `to`, of which `count` are wanted, from `first` on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis {
    pub(crate) from: usize,
    pub(crate) to: usize,
    pub(crate) first: usize,
    pub(crate) count: usize,
}

/// Weights of one output pixel: those of the input pixels from `start` on.
struct Taps<W> {
    start: usize,
    weights: Vec<W>,
}

/// A value of a channel with the arithmetic in which it is resampled.
pub(crate) trait Sample: Copy + Default + Send + Sync {
    type Weight: Copy + Send + Sync;
    fn weight(weight: f64) -> Self::Weight;
    fn sum(terms: impl Iterator<Item = (Self, Self::Weight)>) -> Self;
}

/// Fractional bits of Pillow's weights for 8-bit images.
const PRECISION: u32 = 32 - 8 - 2;

impl Sample for u8 {
    type Weight = i32;

    fn weight(weight: f64) -> i32 {
        (weight * f64::from(1 << PRECISION)).round() as i32
    }

    fn sum(terms: impl Iterator<Item = (u8, i32)>) -> u8 {
        let sum: i64 = terms.map(|(value, weight)| i64::from(value) * i64::from(weight)).sum();
        ((sum + (1 << (PRECISION - 1))) >> PRECISION).clamp(0, 255) as u8
    }
}

impl Sample for f32 {
    type Weight = f32;

    fn weight(weight: f64) -> f32 {
        weight as f32
    }

    fn sum(terms: impl Iterator<Item = (f32, f32)>) -> f32 {
        terms.map(|(value, weight)| value.clamp(0.0, 1.0) * weight).sum::<f32>().clamp(0.0, 1.0)
    }
}

fn taps<S: Sample>(filter: Filter, axis: Axis) -> Vec<Taps<S::Weight>> {
    let scale = axis.from as f64 / axis.to as f64;
    let widened = scale.max(1.0);
    let support = filter.support() * widened;
    let of_pixel = |at: usize| {
        let center = (at as f64 + 0.5) * scale;
        let start = (center - support + 0.5).max(0.0) as usize;
        let end = ((center + support + 0.5) as usize).min(axis.from);
        let weights: Vec<f64> = (start..end).map(|i| filter.weight((i as f64 - center + 0.5) / widened)).collect();
        let sum: f64 = weights.iter().sum();
        Taps { start, weights: weights.iter().map(|weight| S::weight(weight / sum)).collect() }
    };
    (axis.first..axis.first + axis.count).map(of_pixel).collect()
}

/// The wanted rectangle of a resampled RGB image, rows from the top. Rows are filtered first, as in Pillow.
pub(crate) fn resample<S: Sample>(pixels: &[S], filter: Filter, horizontal: Axis, vertical: Axis) -> Vec<S> {
    let columns = taps::<S>(filter, horizontal);
    let rows = taps::<S>(filter, vertical);
    let first = rows.first().map_or(0, |taps| taps.start);
    let end = rows.iter().map(|taps| taps.start + taps.weights.len()).max().unwrap_or(first);

    let width = columns.len();
    let mut between = vec![S::default(); 3 * width * (end - first)];
    between.par_chunks_mut(3 * width).enumerate().for_each(|(y, row)| {
        let from = &pixels[3 * horizontal.from * (first + y)..][..3 * horizontal.from];
        for (to, taps) in row.chunks_exact_mut(3).zip(&columns) {
            for (channel, value) in to.iter_mut().enumerate() {
                let terms = taps.weights.iter().enumerate();
                *value = S::sum(terms.map(|(i, weight)| (from[3 * (taps.start + i) + channel], *weight)));
            }
        }
    });

    let mut result = vec![S::default(); 3 * width * rows.len()];
    result.par_chunks_mut(3 * width).zip(&rows).for_each(|(row, taps)| {
        for (x, value) in row.iter_mut().enumerate() {
            let terms = taps.weights.iter().enumerate();
            *value = S::sum(terms.map(|(i, weight)| (between[3 * width * (taps.start - first + i) + x], *weight)));
        }
    });
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn whole(from: usize, to: usize) -> Axis {
        Axis { from, to, first: 0, count: to }
    }

    proptest! {
        #[test]
        fn a_flat_image_stays_flat(
            from in 1usize..40, to in 1usize..40, level: u8,
            filter in prop_oneof![Just(Filter::Bilinear), Just(Filter::Bicubic)],
        ) {
            let axis = whole(from, to);
            let bytes = resample(&vec![level; 3 * from * from], filter, axis, axis);
            prop_assert!(bytes.iter().all(|value| *value == level));
        }

        #[test]
        fn floats_are_the_twin_of_bytes(pixels in proptest::collection::vec(any::<u8>(), 3 * 11 * 7), to in 1usize..20) {
            let (horizontal, vertical) = (whole(11, to), whole(7, 20 - to + 1));
            let bytes = resample(&pixels, Filter::Bicubic, horizontal, vertical);
            let floats: Vec<f32> = pixels.iter().map(|value| f32::from(*value) / 255.0).collect();
            let floats = resample(&floats, Filter::Bicubic, horizontal, vertical);
            for (byte, float) in bytes.iter().zip(floats) {
                // Pillow rounds twice, and the second filter's weights add up to at most 1.25 in absolute value.
                prop_assert!((f32::from(*byte) - 255.0 * float).abs() < 1.2, "{byte} {}", 255.0 * float);
            }
        }

        #[test]
        fn a_part_is_cut_from_the_whole(first in 0usize..10, count in 1usize..10) {
            let pixels: Vec<u8> = (0..3 * 13 * 9).map(|i| (i * 37 % 256) as u8).collect();
            let all = resample(&pixels, Filter::Bicubic, whole(13, 20), whole(9, 20));
            let part = Axis { from: 13, to: 20, first, count };
            let rows = Axis { from: 9, to: 20, first: count, count: first + 1 };
            let cut = resample(&pixels, Filter::Bicubic, part, rows);
            for (y, row) in cut.chunks(3 * count).enumerate() {
                prop_assert_eq!(row, &all[3 * (20 * (count + y) + first)..][..3 * count]);
            }
        }
    }

    #[test]
    fn an_image_of_the_wanted_size_is_left_alone() {
        let pixels: Vec<u8> = (0..3 * 6 * 4).map(|i| (i * 91 % 256) as u8).collect();
        assert_eq!(resample(&pixels, Filter::Bicubic, whole(6, 6), whole(4, 4)), pixels);
    }
}
