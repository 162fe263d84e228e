//! The loss of a picture against its reference: (1 − λ)·L1 + λ·(1 − SSIM) + μ·L1 of the coverage A.
//!
//! The first two are those of 3DGS (Kerbl et al. 2023, equation 7); SSIM is that of Wang et al. (2004) with a Gaussian window of
//! 11 × 11 pixels, σ = 1.5, zeros outside. The third is the opacity mask of iVR-GS. All are means over pixels and channels.

use rayon::prelude::*;

/// Taps of the window to either side.
const REACH: usize = 5;
/// Standard deviation of the window in pixels.
const SIGMA: f64 = 1.5;
/// (0.01·range)² and (0.03·range)² for a range of 1.
const STABILIZERS: [f32; 2] = [1e-4, 9e-4];
/// Rows that one task handles.
const ROWS: usize = 16;

/// Weights of the parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loss {
    /// λ, the share of 1 − SSIM, 0 to 1.
    pub structure: f32,
    /// μ, the weight of the coverage, at least 0.
    pub coverage: f32,
}

impl Default for Loss {
    fn default() -> Self {
        Self { structure: 0.2, coverage: 0.1 }
    }
}

/// A reference picture with the parts of SSIM that depend on it alone.
#[derive(Debug, Clone)]
pub struct Target {
    width: usize,
    channels: [TargetChannel; 3],
    coverage: Vec<f32>,
}

#[derive(Debug, Clone)]
struct TargetChannel {
    values: Vec<f32>,
    mean: Vec<f32>,
    variance: Vec<f32>,
}

impl Target {
    /// From RGBA, rows from the top, `width` pixels across.
    #[must_use]
    pub fn new(pixels: &[[f32; 4]], width: usize) -> Self {
        let plane = |channel: usize| pixels.iter().map(|pixel| pixel[channel]).collect::<Vec<f32>>();
        let channels = [0, 1, 2].map(|channel| {
            let values = plane(channel);
            let mean = blurred(&values, width);
            let squares: Vec<f32> = values.iter().map(|y| y * y).collect();
            let variance = blurred(&squares, width).iter().zip(&mean).map(|(s, m)| s - m * m).collect();
            TargetChannel { values, mean, variance }
        });
        Self { width, channels, coverage: plane(3) }
    }

    /// The loss of a picture of the same size, and its derivatives by R, G, B and A of each pixel.
    #[must_use]
    pub fn loss(&self, pixels: &[[f32; 4]], weights: Loss) -> (f64, Vec<[f32; 4]>) {
        let count = (3 * pixels.len().max(1)) as f32;
        let by_channel: Vec<(f64, Vec<f32>)> = self
            .channels
            .par_iter()
            .enumerate()
            .map(|(k, target)| {
                let values: Vec<f32> = pixels.iter().map(|pixel| pixel[k]).collect();
                let (similarity, mut slopes) = if weights.structure > 0.0 {
                    target.similarity(&values, self.width)
                } else {
                    (0.0, vec![0.0; values.len()])
                };
                let mut sum = f64::from(weights.structure) * (values.len() as f64 - similarity);
                for ((slope, x), y) in slopes.iter_mut().zip(&values).zip(&target.values) {
                    let off = x - y;
                    sum += f64::from((1.0 - weights.structure) * off.abs());
                    *slope = ((1.0 - weights.structure) * sign(off) - weights.structure * *slope) / count;
                }
                (sum, slopes)
            })
            .collect();
        let mut total: f64 = by_channel.iter().map(|(sum, _)| sum / f64::from(count)).sum();
        let area = pixels.len().max(1) as f32;
        let slopes = pixels
            .iter()
            .zip(&self.coverage)
            .enumerate()
            .map(|(i, (pixel, want))| {
                let off = pixel[3] - want;
                total += f64::from(weights.coverage * off.abs() / area);
                let slope =
                    |k: usize| by_channel.get(k).and_then(|(_, slopes)| slopes.get(i)).copied().unwrap_or_default();
                [slope(0), slope(1), slope(2), weights.coverage * sign(off) / area]
            })
            .collect();
        (total, slopes)
    }
}

/// −1, 0 or 1.
fn sign(x: f32) -> f32 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

impl TargetChannel {
    /// The sum of SSIM over the pixels, and its derivatives by each.
    fn similarity(&self, values: &[f32], width: usize) -> (f64, Vec<f32>) {
        let product = |f: &dyn Fn(f32, f32) -> f32| -> Vec<f32> {
            values.iter().zip(&self.values).map(|(x, y)| f(*x, *y)).collect()
        };
        let mean = blurred(values, width);
        let squares = blurred(&product(&|x, _| x * x), width);
        let products = blurred(&product(&|x, y| x * y), width);
        let [c1, c2] = STABILIZERS;
        let mut sum = 0.0;
        let n = values.len();
        // Derivatives by the window's mean, mean square and mean product at each pixel.
        let (mut by_mean, mut by_square, mut by_product) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        for i in 0..n {
            let (mx, my) = (mean[i], self.mean[i]);
            let (variance, shared) = (squares[i] - mx * mx, products[i] - mx * my);
            let (a1, a2) = (2.0 * mx * my + c1, 2.0 * shared + c2);
            let (b1, b2) = (mx * mx + my * my + c1, variance + self.variance[i] + c2);
            let similarity = a1 * a2 / (b1 * b2);
            sum += f64::from(similarity);
            by_product[i] = 2.0 * a1 / (b1 * b2);
            by_square[i] = -similarity / b2;
            by_mean[i] =
                2.0 * my * a2 / (b1 * b2) - 2.0 * mx * similarity / b1 - my * by_product[i] - 2.0 * mx * by_square[i];
        }
        // The window is symmetric, so it is its own transpose.
        let [by_mean, by_square, by_product] = [by_mean, by_square, by_product].map(|map| blurred(&map, width));
        let slopes =
            (0..n).map(|i| by_mean[i] + 2.0 * values[i] * by_square[i] + self.values[i] * by_product[i]).collect();
        (sum, slopes)
    }
}

/// The mean structural similarity of two pictures over R, G and B.
#[must_use]
pub fn similarity(pixels: &[[f32; 4]], target: &Target) -> f64 {
    let count = (3 * pixels.len().max(1)) as f64;
    let channel = |(k, target): (usize, &TargetChannel), width| {
        let values: Vec<f32> = pixels.iter().map(|pixel| pixel[k]).collect();
        target.similarity(&values, width).0
    };
    target.channels.iter().enumerate().map(|pair| channel(pair, target.width)).sum::<f64>() / count
}

/// Means under the window, zeros outside the picture.
fn blurred(values: &[f32], width: usize) -> Vec<f32> {
    let width = width.max(1);
    let taps: [f32; 2 * REACH + 1] = {
        let weight = |k: usize| (-0.5 * ((k as f64 - REACH as f64) / SIGMA).powi(2)).exp();
        let sum: f64 = (0..2 * REACH + 1).map(weight).sum();
        std::array::from_fn(|k| (weight(k) / sum) as f32)
    };
    let mut rows = vec![0.0; values.len()];
    rows.par_chunks_mut(ROWS * width).zip(values.par_chunks(ROWS * width)).for_each(|(rows, values)| {
        let mut padded = vec![0.0; width + 2 * REACH];
        for (row, values) in rows.chunks_mut(width).zip(values.chunks(width)) {
            padded[REACH..REACH + values.len()].copy_from_slice(values);
            for (k, tap) in taps.iter().enumerate() {
                row.iter_mut().zip(&padded[k..]).for_each(|(sum, value)| *sum += tap * value);
            }
        }
    });
    let height = values.len().div_ceil(width);
    let mut both = vec![0.0; values.len()];
    both.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (k, tap) in taps.iter().enumerate() {
            let from = (y + k).wrapping_sub(REACH);
            if from < height {
                row.iter_mut().zip(&rows[from * width..]).for_each(|(sum, value)| *sum += tap * value);
            }
        }
    });
    both
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn pixels(n: usize, seed: u64) -> Vec<[f32; 4]> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        (0..n).map(|_| std::array::from_fn(|_| random.random_range(0.0..1.0))).collect()
    }

    /// SSIM of one channel by its definition, in f64.
    fn reference(x: &[f64], y: &[f64], width: usize) -> f64 {
        let height = x.len() / width;
        let weight = |d: i64| (-0.5 * (d as f64 / SIGMA).powi(2)).exp();
        let sum: f64 = (-5..=5).map(weight).sum();
        let window = |f: &dyn Fn(usize) -> f64, at: usize| {
            let (cx, cy) = ((at % width) as i64, (at / width) as i64);
            let mut total = 0.0;
            for dy in -5..=5 {
                for dx in -5..=5 {
                    let (px, py) = (cx + dx, cy + dy);
                    if (0..width as i64).contains(&px) && (0..height as i64).contains(&py) {
                        total += weight(dx) * weight(dy) / (sum * sum) * f(py as usize * width + px as usize);
                    }
                }
            }
            total
        };
        (0..x.len())
            .map(|at| {
                let (mx, my) = (window(&|i| x[i], at), window(&|i| y[i], at));
                let (sx, sy) = (window(&|i| x[i] * x[i], at) - mx * mx, window(&|i| y[i] * y[i], at) - my * my);
                let shared = window(&|i| x[i] * y[i], at) - mx * my;
                (2.0 * mx * my + 1e-4) * (2.0 * shared + 9e-4) / ((mx * mx + my * my + 1e-4) * (sx + sy + 9e-4))
            })
            .sum()
    }

    fn reference_loss(pixels: &[[f64; 4]], target: &[[f32; 4]], width: usize, weights: Loss) -> f64 {
        let n = pixels.len() as f64;
        let plane = |channel: usize| pixels.iter().map(|p| p[channel]).collect::<Vec<f64>>();
        let wanted = |channel: usize| target.iter().map(|p| f64::from(p[channel])).collect::<Vec<f64>>();
        let mean =
            |channel: usize| plane(channel).iter().zip(wanted(channel)).map(|(x, y)| (x - y).abs()).sum::<f64>() / n;
        let (structure, coverage) = (f64::from(weights.structure), f64::from(weights.coverage));
        let color: f64 = (0..3)
            .map(|k| (1.0 - structure) * mean(k) + structure * (1.0 - reference(&plane(k), &wanted(k), width) / n))
            .sum();
        color / 3.0 + coverage * mean(3)
    }

    #[test]
    fn the_loss_and_its_derivatives_are_those_of_the_definition() {
        let (width, height) = (17, 13);
        let (x, y) = (pixels(width * height, 1), pixels(width * height, 2));
        for weights in [Loss::default(), Loss { structure: 1.0, coverage: 0.0 }, Loss { structure: 0.0, coverage: 2.0 }]
        {
            let (value, slopes) = Target::new(&y, width).loss(&x, weights);
            let exact: Vec<[f64; 4]> = x.iter().map(|p| p.map(f64::from)).collect();
            let want = reference_loss(&exact, &y, width, weights);
            assert!((value - want).abs() < 1e-5 * want, "{value} {want}");
            for (at, channel) in [(0, 0), (8, 1), (100, 2), (111, 3), (220, 0), (37, 3), (150, 1)] {
                let moved = |step: f64| {
                    let mut moved = exact.clone();
                    moved[at][channel] += step;
                    reference_loss(&moved, &y, width, weights)
                };
                let want = (moved(1e-5) - moved(-1e-5)) / 2e-5;
                let got = f64::from(slopes[at][channel]);
                assert!((got - want).abs() < 2e-4 * want.abs() + 1e-7, "{at} {channel}: {got} {want}");
            }
        }
    }

    #[test]
    fn equal_pictures_have_no_loss() {
        let x = pixels(30 * 20, 3);
        let target = Target::new(&x, 30);
        let (value, slopes) = target.loss(&x, Loss::default());
        assert!(value.abs() < 1e-6 && slopes.iter().flatten().all(|s| s.abs() < 1e-6), "{value}");
        assert!((similarity(&x, &target) - 1.0).abs() < 1e-5);
    }
}
