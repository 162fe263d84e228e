//! Normal noise from a seed.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A stream of normally distributed numbers.
pub(crate) struct Noise(ChaCha8Rng);

impl Noise {
    pub(crate) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// The next numbers, times `scale` (Box and Muller 1958).
    pub(crate) fn numbers(&mut self, count: usize, scale: f32) -> Vec<f32> {
        let mut pair = || {
            // 1 − u is above 0, so its logarithm is finite.
            let radius = (-2.0 * (1.0 - self.0.random::<f64>()).ln()).sqrt();
            let (sine, cosine) = (std::f64::consts::TAU * self.0.random::<f64>()).sin_cos();
            [radius * cosine, radius * sine].map(|number| number as f32 * scale)
        };
        let mut numbers: Vec<f32> = (0..count.div_ceil(2)).flat_map(|_| pair()).collect();
        numbers.truncate(count);
        numbers
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_normal_and_those_of_the_seed() {
        let numbers = Noise::new(7).numbers(100_001, 2.0);
        assert_eq!(numbers, Noise::new(7).numbers(100_001, 2.0));
        let mean = numbers.iter().sum::<f32>() / numbers.len() as f32;
        let variance = numbers.iter().map(|x| x * x).sum::<f32>() / numbers.len() as f32;
        assert!(mean.abs() < 0.03 && (variance - 4.0).abs() < 0.08, "{mean} {variance}");
        let within = numbers.iter().filter(|x| x.abs() < 2.0).count() as f32 / numbers.len() as f32;
        assert!((within - 0.6827).abs() < 0.006, "{within}");
    }
}
