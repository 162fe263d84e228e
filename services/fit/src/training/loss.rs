//! The loss of a picture against its reference: (1 − λ)·L1 + λ·(1 − SSIM) + μ·L1 of the coverage A.
//!
//! The first two are those of 3DGS (Kerbl et al. 2023, equation 7); SSIM is that of Wang et al. (2004) with a Gaussian window of
//! 11 × 11 pixels, σ = 1.5, zeros outside. The third is the opacity mask of iVR-GS. All are means over pixels and channels.

use std::ops::Range;

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

/// The channels whose structure is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channels {
    /// Red, green and blue.
    All,
    /// One of them, 0 to 2, for all three. The mean over the three choices is [`Channels::All`], for a third of the work.
    One(usize),
}

/// The loss of a picture against a reference of the same size, and its derivatives by R, G, B and A of each pixel. Both have rows
/// from the top, `width` pixels across.
#[must_use]
pub fn loss(
    pixels: &[[f32; 4]],
    reference: &[[f32; 4]],
    width: usize,
    weights: Loss,
    channels: Channels,
) -> (f64, Vec<[f32; 4]>) {
    let area = pixels.len().max(1) as f32;
    let by_color = (1.0 - weights.structure) / (3.0 * area);
    let by_coverage = weights.coverage / area;
    let mut slopes = vec![[0.0; 4]; pixels.len()];
    let mut total: f64 = slopes
        .par_chunks_mut(ROWS * width.max(1))
        .zip(pixels.par_chunks(ROWS * width.max(1)))
        .zip(reference.par_chunks(ROWS * width.max(1)))
        .map(|((slopes, pixels), reference)| {
            let mut sum = 0.0_f32;
            for ((slope, x), y) in slopes.iter_mut().zip(pixels).zip(reference) {
                let off = std::array::from_fn::<f32, 4, _>(|k| x[k] - y[k]);
                sum += by_color * (off[0].abs() + off[1].abs() + off[2].abs()) + by_coverage * off[3].abs();
                let [r, g, b, a] = off.map(sign);
                *slope = [by_color * r, by_color * g, by_color * b, by_coverage * a];
            }
            f64::from(sum)
        })
        // In order, so that the sum does not depend on threads.
        .collect::<Vec<f64>>()
        .iter()
        .sum();
    if weights.structure > 0.0 {
        let (compared, share) = match channels {
            Channels::All => (0..3, 1.0 / 3.0),
            Channels::One(channel) => (channel..channel + 1, 1.0),
        };
        let window = Window::of(pixels, reference, width);
        let by_structure = weights.structure * share;
        for channel in compared {
            let (mean, by_pixel) = window.similarity(pixels, reference, channel);
            total += f64::from(by_structure) * (1.0 - mean);
            window.add(&mut slopes, channel, &by_pixel, -by_structure / area);
        }
    }
    (total, slopes)
}

/// −1, 0 or 1.
fn sign(x: f32) -> f32 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

/// The mean structural similarity of two pictures over R, G and B.
#[must_use]
pub fn similarity(pixels: &[[f32; 4]], reference: &[[f32; 4]], width: usize) -> f64 {
    let window = Window::of(pixels, reference, width);
    (0..3).map(|channel| window.similarity(pixels, reference, channel).0).sum::<f64>() / 3.0
}

/// The part of two pictures beyond which they are equal. There, their similarity is 1, and its derivatives are 0.
struct Window {
    /// Pixels across the whole picture, and of it.
    across: usize,
    pixels: usize,
    /// Columns and rows of the part.
    columns: Range<usize>,
    rows: Range<usize>,
}

impl Window {
    fn of(pixels: &[[f32; 4]], reference: &[[f32; 4]], across: usize) -> Self {
        let across = across.max(1);
        let spans: Vec<Option<(usize, usize)>> = pixels
            .par_chunks(across)
            .zip(reference.par_chunks(across))
            .map(|(x, y)| {
                let is_used = |at: &usize| x[*at][..3] != y[*at][..3];
                let first = (0..x.len().min(y.len())).find(is_used)?;
                Some((first, (first..x.len().min(y.len())).rfind(is_used)? + 1))
            })
            .collect();
        let used = || spans.iter().flatten();
        let (first, last) = (used().map(|s| s.0).min().unwrap_or(0), used().map(|s| s.1).max().unwrap_or(0));
        let top = spans.iter().position(Option::is_some).unwrap_or(0);
        let bottom = spans.iter().rposition(Option::is_some).map_or(0, |row| row + 1);
        // Windows reach beyond, and derivatives by the pixels in those windows.
        let wide = |low: usize, high: usize, most: usize| low.saturating_sub(2 * REACH)..(high + 2 * REACH).min(most);
        Self { across, pixels: pixels.len(), columns: wide(first, last, across), rows: wide(top, bottom, spans.len()) }
    }

    fn plane(&self, pixels: &[[f32; 4]], channel: usize) -> Vec<f32> {
        let rows = pixels.chunks(self.across).skip(self.rows.start).take(self.rows.len());
        rows.flat_map(|row| row.get(self.columns.clone()).unwrap_or_default()).map(|pixel| pixel[channel]).collect()
    }

    /// Adds `factor` times a plane to the slopes of one channel.
    fn add(&self, slopes: &mut [[f32; 4]], channel: usize, plane: &[f32], factor: f32) {
        let rows = slopes.chunks_mut(self.across).skip(self.rows.start);
        for (row, plane) in rows.zip(plane.chunks(self.columns.len().max(1))) {
            let row = row.get_mut(self.columns.clone()).unwrap_or_default();
            row.iter_mut().zip(plane).for_each(|(slope, x)| slope[channel] += factor * x);
        }
    }

    /// The mean of SSIM over the whole picture, and the derivatives of its sum by each pixel of the part.
    fn similarity(&self, pixels: &[[f32; 4]], reference: &[[f32; 4]], channel: usize) -> (f64, Vec<f32>) {
        let width = self.columns.len();
        let (xs, ys) = (self.plane(pixels, channel), self.plane(reference, channel));
        let product = |a: &[f32], b: &[f32]| -> Vec<f32> { a.iter().zip(b).map(|(a, b)| a * b).collect() };
        let [mean_x, mean_y, squares_x, squares_y, products] =
            [xs.clone(), ys.clone(), product(&xs, &xs), product(&ys, &ys), product(&xs, &ys)]
                .map(|plane| blurred(&plane, width));
        let [c1, c2] = STABILIZERS;
        let mut sum = 0.0;
        let n = xs.len();
        // Derivatives by the window's mean, mean square and mean product at each pixel.
        let (mut by_mean, mut by_square, mut by_product) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        for i in 0..n {
            let (mx, my) = (mean_x[i], mean_y[i]);
            let variances = [squares_x[i] - mx * mx, squares_y[i] - my * my];
            let (a1, a2) = (2.0 * mx * my + c1, 2.0 * (products[i] - mx * my) + c2);
            let (b1, b2) = (mx * mx + my * my + c1, variances[0] + variances[1] + c2);
            let similarity = a1 * a2 / (b1 * b2);
            sum += f64::from(similarity);
            by_product[i] = 2.0 * a1 / (b1 * b2);
            by_square[i] = -similarity / b2;
            by_mean[i] =
                2.0 * my * a2 / (b1 * b2) - 2.0 * mx * similarity / b1 - my * by_product[i] - 2.0 * mx * by_square[i];
        }
        // The taps are symmetric, so they are their own transpose.
        let [by_mean, by_square, by_product] = [by_mean, by_square, by_product].map(|map| blurred(&map, width));
        let slopes = (0..n).map(|i| by_mean[i] + 2.0 * xs[i] * by_square[i] + ys[i] * by_product[i]).collect();
        (1.0 - (n as f64 - sum) / self.pixels.max(1) as f64, slopes)
    }
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
            let (value, slopes) = loss(&x, &y, width, weights, Channels::All);
            let turns = [0, 1, 2].map(|k| loss(&x, &y, width, weights, Channels::One(k)));
            assert!((turns.iter().map(|turn| turn.0).sum::<f64>() / 3.0 - value).abs() < 1e-6);
            for (at, all) in slopes.as_flattened().iter().enumerate() {
                let mean = turns.iter().map(|turn| turn.1.as_flattened()[at]).sum::<f32>() / 3.0;
                assert!((mean - all).abs() < 1e-6);
            }
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
        let (value, slopes) = loss(&x, &x, 30, Loss::default(), Channels::All);
        assert!(value.abs() < 1e-6 && slopes.iter().flatten().all(|s| s.abs() < 1e-6), "{value}");
        assert!((similarity(&x, &x, 30) - 1.0).abs() < 1e-5);
        let black = vec![[0.0; 4]; 30 * 20];
        assert_eq!(loss(&black, &black, 30, Loss::default(), Channels::All), (0.0, black.clone()));
    }

    #[test]
    fn equal_borders_are_left_out_without_a_difference() {
        // A part amid grey, and the same with corners that differ a little, which is then taken whole.
        let (width, height) = (60, 50);
        let patch = |seed: u64| {
            let inner = pixels(12 * 9, seed);
            let mut picture = vec![[0.7; 4]; width * height];
            for (k, pixel) in inner.into_iter().enumerate() {
                picture[(20 + k / 12) * width + 31 + k % 12] = pixel;
            }
            picture
        };
        let (x, y) = (patch(4), patch(5));
        let mut whole_x = x.clone();
        for corner in [0, width * height - 1] {
            whole_x[corner] = [0.7 + 1e-7; 4];
        }
        assert_eq!(Window::of(&x, &y, width).columns, 21..53);
        assert_eq!(Window::of(&whole_x, &y, width).columns, 0..width);
        let (value, slopes) = loss(&x, &y, width, Loss::default(), Channels::All);
        let (whole, all) = loss(&whole_x, &y, width, Loss::default(), Channels::All);
        assert!((value - whole).abs() < 1e-6 * whole, "{value} {whole}");
        let off = slopes.as_flattened().iter().zip(all.as_flattened()).map(|(a, b)| (a - b).abs());
        let corners = off.clone().filter(|off| *off > 1e-7).count();
        assert!(corners <= 8, "only the two pixels that differ: {corners}");
    }
}
