//! Sums over the pixels of one tile: the derivatives of the loss by ellipse, opacity and colour of each Gaussian in it.

use glam::{DVec2, Vec3};
use wide::f32x8;

use crate::lanes::LANES;
use crate::splat_f32::{Drawn, HALVES, Splat};
use crate::tiles::TILE;

/// Numbers for each Gaussian: Σg, Σg·u, Σg·v, Σg·u², Σg·u·v, Σg·v², and Σ ∂L/∂c for red, green and blue. Here g is ∂L/∂ln α at a
/// pixel, and u and v are its distances in standard deviations ([`Ellipse`](crate::project::Ellipse)).
pub(super) const SUMS: usize = 9;

/// Vectors of a tile, row by row.
const VECTORS: usize = HALVES * TILE;

/// Derivatives by R, G, B and A of the pixels of a tile; 0 outside the picture.
pub(super) struct TileDerivatives([[f32x8; 4]; VECTORS]);

impl TileDerivatives {
    pub(super) fn of(by_pixel: &[[f32; 4]], width: usize, [x0, y0]: [usize; 2]) -> Self {
        let lines: Vec<&[[f32; 4]]> = by_pixel.chunks(width.max(1)).skip(y0).take(TILE).collect();
        Self(std::array::from_fn(|at| {
            let x = x0 + at % HALVES * LANES;
            let pixels = lines.get(at / HALVES).and_then(|line| line.get(x..)).unwrap_or_default();
            std::array::from_fn(|channel| {
                f32x8::new(std::array::from_fn(|k| pixels.get(k).map_or(0.0, |pixel| pixel[channel])))
            })
        }))
    }
}

/// One Gaussian at eight pixels.
struct Layer {
    at: usize,
    /// Distances in scaled standard deviations, see [`Splat`].
    u: f32x8,
    v: f32,
    alpha: f32x8,
    /// Transmittance before it.
    transmittance: f32x8,
}

/// The sums of each Gaussian of a list, in its order. `stop` and the background are those of the picture.
pub(super) fn sums_of_tile(
    splats: &[Drawn],
    list: &[u32],
    [x0, y0]: [usize; 2],
    (stop, background): (f32, Vec3),
    derivatives: &TileDerivatives,
) -> Vec<[f32; SUMS]> {
    let first = DVec2::new(x0 as f64 + 0.5, y0 as f64 + 0.5);
    let ellipses: Vec<Option<&Splat>> = list.iter().map(|k| splats.get(*k as usize).and_then(Drawn::ellipse)).collect();
    let (layers, ends) = layers(&ellipses, first, stop);
    let [red, green, blue] = background.to_array().map(f32x8::splat);
    // Colour and coverage of all that lies behind.
    let mut behind = [[red, green, blue, f32x8::ZERO]; VECTORS];
    let mut sums = vec![[0.0; SUMS]; list.len()];
    let starts = std::iter::once(0).chain(ends.iter().copied());
    let spans: Vec<(usize, usize)> = starts.zip(ends.iter().copied()).collect();
    for ((sums, splat), (from, to)) in sums.iter_mut().zip(&ellipses).zip(spans).rev() {
        let (Some(splat), Some(layers)) = (splat, layers.get(from..to).filter(|layers| !layers.is_empty())) else {
            continue;
        };
        let color = splat.color.to_array().map(f32x8::splat);
        let mut total = [f32x8::ZERO; SUMS];
        for layer in layers {
            let (behind, by) = (&mut behind[layer.at], &derivatives.0[layer.at]);
            let weight = layer.alpha * layer.transmittance;
            let mut by_alpha = (f32x8::ONE - behind[3]) * by[3];
            behind[3] += layer.alpha * (f32x8::ONE - behind[3]);
            for channel in 0..3 {
                let contrast = color[channel] - behind[channel];
                by_alpha += contrast * by[channel];
                behind[channel] += layer.alpha * contrast;
                total[6 + channel] += weight * by[channel];
            }
            let g = by_alpha * weight;
            let v = f32x8::splat(layer.v);
            let (gu, gv) = (g * layer.u, g * v);
            total[0] += g;
            total[1] += gu;
            total[2] += gv;
            total[3] += gu * layer.u;
            total[4] += gu * v;
            total[5] += gv * v;
        }
        // From scaled distances to standard deviations.
        let unit = (2.0 * std::f32::consts::LN_2).sqrt();
        let scales = [1.0, unit, unit, unit * unit, unit * unit, unit * unit, 1.0, 1.0, 1.0];
        *sums = std::array::from_fn(|k| total[k].reduce_add() * scales[k]);
    }
    sums
}

/// All layers as [`Tile::blend`](crate::splat_f32::Tile::blend) draws them, and where those of each Gaussian end.
fn layers(ellipses: &[Option<&Splat>], first: DVec2, stop: f32) -> (Vec<Layer>, Vec<usize>) {
    let mut transmittances = [f32x8::ONE; VECTORS];
    let mut finished = [false; TILE];
    let mut layers = Vec::with_capacity(8 * ellipses.len());
    let mut ends = Vec::with_capacity(ellipses.len());
    for (k, splat) in ellipses.iter().enumerate() {
        if k % Drawn::GROUP == 0 && k > 0 {
            for (finished, line) in finished.iter_mut().zip(transmittances.chunks(HALVES)) {
                *finished = line.iter().all(|t| t.simd_lt(f32x8::splat(stop)).all());
            }
        }
        for row in splat.iter().flat_map(|splat| splat.rows(first.to_array())) {
            if finished[row.row] {
                continue;
            }
            for half in 0..HALVES {
                let Some((u, alpha)) = splat.and_then(|splat| splat.alpha(&row, half)) else { continue };
                let at = row.row * HALVES + half;
                let transmittance = transmittances[at];
                layers.push(Layer { at, u, v: row.v, alpha, transmittance });
                transmittances[at] -= alpha * transmittance;
            }
        }
        ends.push(layers.len());
    }
    (layers, ends)
}
