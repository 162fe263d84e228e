//! One-dimensional codebooks of at most 256 half-precision centres, as iVR-GS's quantised files use them.
//!
//! Deterministic: the centres start at equal shares of the cube root of the density, as in an optimal scalar quantiser
//! of many levels (Panter and Dite 1951). Lloyd's iteration (1982) improves them and never raises the mean squared
//! error. Sums are taken in f64 over the sorted values, so that threads change nothing.

use half::f16;
use rayon::prelude::*;

/// Centres of a codebook.
pub(crate) const SIZE: usize = 256;
/// Bins of the density that the start is taken from.
const BINS: usize = 1 << 14;
/// Rounds of improvement; the error changes by less than a per mille after about twenty.
const ROUNDS: usize = 40;

/// Centres, padded to [`SIZE`] with the last one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Codebook {
    /// Ascending finite centres; the first `finite` of them are in use.
    centres: Vec<f16>,
    finite: usize,
    /// NaN and the infinities, if they occur, stand behind the finite centres.
    special: Vec<f16>,
}

impl Codebook {
    /// The codebook of some values. NaN and infinities get centres of their own.
    pub(crate) fn of(values: &[f32]) -> Self {
        let mut special = Vec::new();
        for (is, as_half) in [
            (values.par_iter().any(|x| x.is_nan()), f16::NAN),
            (values.par_iter().any(|x| *x == f32::INFINITY), f16::INFINITY),
            (values.par_iter().any(|x| *x == f32::NEG_INFINITY), f16::NEG_INFINITY),
        ] {
            if is {
                special.push(as_half);
            }
        }
        let mut sorted: Vec<f32> = values.par_iter().copied().filter(|x| x.is_finite()).collect();
        sorted.par_sort_unstable_by(f32::total_cmp);
        let budget = SIZE - special.len();
        let mut centres = distinct_halves(&sorted, budget).unwrap_or_else(|| optimise(&sorted, budget));
        let finite = centres.len();
        let filler = centres.last().copied().unwrap_or(f16::ZERO);
        centres.extend_from_slice(&special);
        centres.resize(SIZE, filler);
        Self { centres, finite, special }
    }

    /// The bit patterns of the centres, as the file holds them in columns of `short`.
    pub(crate) fn bits(&self) -> Vec<i16> {
        self.centres.iter().map(|c| c.to_bits().cast_signed()).collect()
    }

    /// The index of the nearest centre of each value, the lower one where two are equally near.
    pub(crate) fn encode(&self, values: &[f32]) -> Vec<u8> {
        let centres: Vec<f32> = self.centres.iter().take(self.finite).map(|c| c.to_f32()).collect();
        let find_special = |is: fn(&f16) -> bool| self.special.iter().position(is).map_or(0, |k| self.finite + k);
        let nan = find_special(|c| c.is_nan());
        let high = find_special(|c| *c == f16::INFINITY);
        let low = find_special(|c| *c == f16::NEG_INFINITY);
        values
            .par_iter()
            .with_min_len(4096)
            .map(|&x| {
                let index = if x.is_nan() {
                    nan
                } else if x == f32::INFINITY {
                    high
                } else if x == f32::NEG_INFINITY {
                    low
                } else {
                    nearest(&centres, x)
                };
                u8::try_from(index).unwrap_or(u8::MAX)
            })
            .collect()
    }
}

fn nearest(centres: &[f32], x: f32) -> usize {
    let above = centres.partition_point(|&c| c < x);
    let distance = |k: usize| centres.get(k).map_or(f32::INFINITY, |c| (c - x).abs());
    match above.checked_sub(1) {
        Some(below) if distance(below) <= distance(above) => below,
        _ => above.min(centres.len().saturating_sub(1)),
    }
}

/// The values themselves if they are few enough: then only the rounding to half precision is lost.
fn distinct_halves(sorted: &[f32], budget: usize) -> Option<Vec<f16>> {
    let mut out: Vec<f16> = Vec::new();
    for &x in sorted {
        let half = to_half(f64::from(x));
        if out.last() != Some(&half) {
            if out.len() == budget {
                return None;
            }
            out.push(half);
        }
    }
    Some(out)
}

/// The nearest half-precision number, never an infinite one.
fn to_half(x: f64) -> f16 {
    f16::from_f64(x.clamp(f16::MIN.to_f64(), f16::MAX.to_f64()))
}

fn optimise(sorted: &[f32], budget: usize) -> Vec<f16> {
    let (Some(&low), Some(&high)) = (sorted.first(), sorted.last()) else { return Vec::new() };
    let (low, high) = (f64::from(low), f64::from(high));
    let mut sums = Vec::with_capacity(sorted.len() + 1);
    let mut sum = 0.0_f64;
    sums.push(sum);
    for &x in sorted {
        sum += f64::from(x) - low;
        sums.push(sum);
    }
    let mut centres = start(sorted, budget, low, high);
    for _ in 0..ROUNDS {
        let mut from = 0;
        let mut next = Vec::with_capacity(centres.len());
        for (k, &centre) in centres.iter().enumerate() {
            let to = match centres.get(k + 1) {
                Some(&above) => sorted.partition_point(|&x| f64::from(x) <= 0.5 * (centre + above)).max(from),
                None => sorted.len(),
            };
            let total = sums.get(to).zip(sums.get(from)).map_or(0.0, |(a, b)| a - b);
            next.push(if to > from { low + total / (to - from) as f64 } else { centre });
            from = to;
        }
        if next == centres {
            break;
        }
        centres = next;
    }
    let mut halves: Vec<f16> = centres.into_iter().map(to_half).collect();
    halves.sort_unstable_by(f16::total_cmp);
    halves.dedup();
    halves
}

fn start(sorted: &[f32], budget: usize, low: f64, high: f64) -> Vec<f64> {
    let width = (high - low) / BINS as f64;
    let mut shares = vec![0.0_f64; BINS];
    let mut from = 0;
    for (bin, share) in shares.iter_mut().enumerate() {
        let edge = low + (bin + 1) as f64 * width;
        let to =
            if bin + 1 == BINS { sorted.len() } else { sorted.partition_point(|&x| f64::from(x) < edge).max(from) };
        *share = ((to - from) as f64).cbrt();
        from = to;
    }
    let total: f64 = shares.iter().sum();
    let mut centres = Vec::with_capacity(budget);
    let mut passed = 0.0;
    for (bin, share) in shares.into_iter().enumerate() {
        while centres.len() < budget
            && (centres.len() as f64 + 0.5) * total / budget as f64 <= passed + share
            && share > 0.0
        {
            let inside = ((centres.len() as f64 + 0.5) * total / budget as f64 - passed) / share;
            centres.push(low + (bin as f64 + inside.clamp(0.0, 1.0)) * width);
        }
        passed += share;
    }
    centres
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};

    fn decode(codebook: &Codebook, values: &[f32]) -> Vec<f32> {
        let centres: Vec<f32> = codebook.centres.iter().map(|c| c.to_f32()).collect();
        codebook.encode(values).into_iter().map(|i| centres[usize::from(i)]).collect()
    }

    fn rms(a: &[f32], b: &[f32]) -> f64 {
        let sum: f64 = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
        (sum / a.len() as f64).sqrt()
    }

    #[test]
    fn a_uniform_density_is_as_good_as_even_steps() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let values: Vec<f32> = (0..100_000).map(|_| random.random_range(-8.0..8.0)).collect();
        let error = rms(&values, &decode(&Codebook::of(&values), &values));
        let even_steps = 16.0 / 256.0 / 12.0_f64.sqrt();
        assert!(error < 1.03 * even_steps, "{error} against {even_steps}");
    }

    #[test]
    fn outliers_keep_centres_of_their_own() {
        let mut values: Vec<f32> = (0..100_000).map(|i| (i as f32 * 0.37).sin() * 0.01).collect();
        values.extend([40.0, -55.0, 41.0]);
        let got = decode(&Codebook::of(&values), &values);
        for (want, got) in values.iter().zip(&got).skip(100_000) {
            assert!((want - got).abs() < 0.6, "{want} became {got}");
        }
        // Even steps would be 96/256 = 0.375 wide.
        assert!(rms(&values, &got) < 0.003);
    }

    /// Whether a number is as near to a value as any half-precision one. A value between two may become either.
    fn is_nearest_half(value: f32, got: f32) -> bool {
        let half = f16::from_f32(value).to_f32();
        f16::from_f32(got).to_f32().to_bits() == got.to_bits()
            && (half.to_bits() == got.to_bits() || (half - value).abs() == (got - value).abs())
    }

    /// 59,888 stands between 59,872 and 59,904; both are centres here, and the lower one is taken.
    #[test]
    fn a_value_between_two_centres_goes_to_the_lower_one() {
        let values = [59_876.723, 59_888.0];
        assert_eq!(decode(&Codebook::of(&values), &values), [59_872.0, 59_872.0]);
    }

    #[test]
    fn no_values_make_a_codebook_of_zeros() {
        assert_eq!(Codebook::of(&[]).bits(), vec![0; SIZE]);
    }

    proptest! {
        #[test]
        fn few_values_are_kept_to_half_precision_and_special_ones_exactly(
            palette in proptest::collection::vec(-60_000.0_f32..60_000.0, 1..250),
            picks in proptest::collection::vec(any::<usize>(), 1..2000),
        ) {
            let mut values: Vec<f32> = picks.iter().map(|p| palette[p % palette.len()]).collect();
            values.extend([f32::NAN, f32::INFINITY, f32::NEG_INFINITY]);
            let got = decode(&Codebook::of(&values), &values);
            for (want, got) in values.iter().zip(got) {
                prop_assert!(is_nearest_half(*want, got), "{want} became {got}");
            }
        }

        #[test]
        fn each_value_goes_to_its_nearest_centre(values in proptest::collection::vec(-100.0_f32..100.0, 300..600)) {
            let codebook = Codebook::of(&values);
            let centres: Vec<f32> = codebook.centres.iter().map(|c| c.to_f32()).collect();
            for (x, got) in values.iter().zip(decode(&codebook, &values)) {
                let best = centres.iter().map(|c| (c - x).abs()).fold(f32::INFINITY, f32::min);
                prop_assert_eq!((got - x).abs(), best);
            }
        }
    }
}
