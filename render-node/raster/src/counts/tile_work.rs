//! The work of one tile: evaluations of each pixel until it is opaque. The opacities are those of the fast rasterizer, in f32.

use std::ops::AddAssign;

use bytemuck::cast;
use glam::DVec2;
use wide::f32x8;

use crate::foveation::{BLOCK, BLOCKS, first_block};
use crate::lanes::{LANES, exp2};
use crate::ray_consistent::splat_f32::Narrow;
use crate::splat_f32::{Drawn, Splat};
use crate::tiles::TILE;

/// Vectors of one row of pixels.
const HALVES: usize = TILE / LANES;

/// Rows of a tile that a device runs in step: 32 pixels.
const ROWS_IN_STEP: usize = 32 / TILE;

/// The same of a tile of blocks.
const BLOCK_ROWS_IN_STEP: usize = 32 / BLOCKS;

/// Work up to the stop.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Visits {
    pub(super) entries: u64,
    pub(super) entries_by_rays: u64,
    pub(super) evaluated: u64,
    pub(super) in_step: u64,
    pub(super) in_step_by_rays: u64,
    pub(super) in_step_in_blocks: u64,
}

impl AddAssign for Visits {
    fn add_assign(&mut self, other: Self) {
        self.entries += other.entries;
        self.entries_by_rays += other.entries_by_rays;
        self.evaluated += other.evaluated;
        self.in_step += other.in_step;
        self.in_step_by_rays += other.in_step_by_rays;
        self.in_step_in_blocks += other.in_step_in_blocks;
    }
}

/// Pixels that the splats of a band cover.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Covered {
    all: u64,
    /// Those that were not opaque at the band's begin.
    open: u64,
}

impl Covered {
    pub(super) fn open_share(&self) -> f64 {
        if self.all == 0 { 1.0 } else { self.open as f64 / self.all as f64 }
    }
}

impl AddAssign for Covered {
    fn add_assign(&mut self, other: Self) {
        self.all += other.all;
        self.open += other.open;
    }
}

/// The pixels of one tile while layers are blended.
pub(super) struct TileWork {
    first: DVec2,
    transmittance: [[f32x8; HALVES]; TILE],
    /// A bit for each pixel of a row that lies in the picture.
    inside: [u32; TILE],
    /// Whether the first rows and columns stand for blocks of pixels.
    has_blocks: bool,
}

impl TileWork {
    /// A tile by its first pixel, in a picture of this size.
    pub(super) fn new([x, y]: [usize; 2], [width, height]: [u32; 2]) -> Self {
        let columns = (width as usize).saturating_sub(x).min(TILE);
        let rows = (height as usize).saturating_sub(y).min(TILE);
        let mut inside = [0; TILE];
        inside.iter_mut().take(rows).for_each(|row| *row = (1 << columns) - 1);
        let first = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        Self { first, transmittance: [[f32x8::ONE; HALVES]; TILE], inside, has_blocks: false }
    }

    /// The same in half resolution: see [`crate::foveation`].
    pub(super) fn in_blocks([x, y]: [usize; 2], [width, height]: [u32; 2]) -> Self {
        let columns = (width as usize).saturating_sub(x).div_ceil(BLOCK).min(BLOCKS);
        let rows = (height as usize).saturating_sub(y).div_ceil(BLOCK).min(BLOCKS);
        let mut inside = [0; TILE];
        inside.iter_mut().take(rows).for_each(|row| *row = (1 << columns) - 1);
        let first = first_block([x, y]);
        Self { first, transmittance: [[f32x8::ONE; HALVES]; TILE], inside, has_blocks: true }
    }

    /// Blends layers from near to far until no pixel lets through `stop` or more: as each pixel of `blend_tiles.wgsl` does on its own.
    pub(super) fn until_stop<'a>(mut self, layers: impl Iterator<Item = &'a Drawn>, stop: f32) -> Visits {
        let mut visits = Visits::default();
        let mut open = Open::new(self.inside, if self.has_blocks { BLOCK_ROWS_IN_STEP } else { ROWS_IN_STEP });
        for layer in layers {
            if open.pixels == 0 {
                break;
            }
            let scaled;
            let layer = if self.has_blocks {
                scaled = layer.in_blocks();
                &scaled
            } else {
                layer
            };
            let by_rays = u64::from(layer.is_by_rays());
            visits.entries += 1;
            visits.entries_by_rays += by_rays;
            visits.evaluated += u64::from(open.pixels);
            visits.in_step += 32 * u64::from(open.groups);
            visits.in_step_by_rays += by_rays * 32 * u64::from(open.groups);
            if self.has_blocks {
                visits.in_step_in_blocks += (1 - by_rays) * 32 * u64::from(open.groups);
            }
            let mut touched = 0_u32;
            self.add(layer, &mut |row, _, _| touched |= 1 << row);
            for row in (0..TILE).filter(|row| touched >> row & 1 == 1) {
                open.set(row, self.open(row, stop));
            }
        }
        visits
    }

    /// Number of pixels or blocks in the picture.
    pub(super) fn samples(&self) -> u64 {
        self.inside.iter().map(|row| u64::from(row.count_ones())).sum()
    }

    /// Blends the layers of bands, each with its band from 0 on. Pixels are closed at the begins of bands alone.
    pub(super) fn by_bands<'a>(
        mut self,
        layers: impl Iterator<Item = (usize, &'a Drawn)>,
        bands: usize,
        stop: f32,
    ) -> Vec<Covered> {
        let mut covered = vec![Covered::default(); bands];
        let (mut open, mut current) = (self.inside, 0);
        for (band, layer) in layers {
            if band != current {
                open = std::array::from_fn(|row| self.open(row, stop));
                current = band;
            }
            let inside = self.inside;
            let mut of_layer = Covered::default();
            self.add(layer, &mut |row, half, drawn| {
                let drawn = drawn << (half * LANES) & inside[row];
                of_layer.all += u64::from(drawn.count_ones());
                of_layer.open += u64::from((drawn & open[row]).count_ones());
            });
            if let Some(sum) = covered.get_mut(band) {
                *sum += of_layer;
            }
        }
        covered
    }

    /// A bit for each pixel of a row that lets through `stop` or more.
    fn open(&self, row: usize, stop: f32) -> u32 {
        let through = |half: usize| self.transmittance[row][half].simd_ge(f32x8::splat(stop)).to_bitmask();
        (0..HALVES).fold(0, |bits, half| bits | through(half) << (half * LANES)) & self.inside[row]
    }

    /// Blends one layer. `drawn` gets each row and half of it with a bit for each drawn pixel.
    fn add(&mut self, layer: &Drawn, drawn: &mut impl FnMut(usize, usize, u32)) {
        match layer {
            Drawn::Ellipse(layer) => self.add_ellipse(layer, drawn),
            Drawn::Rays(ray) => {
                let narrow = Narrow::of(ray, self.first);
                for row in narrow.rows.start.min(TILE)..narrow.rows.end.min(TILE) {
                    for half in 0..HALVES {
                        let Some((_, alphas)) = narrow.meet(row, half * LANES) else { continue };
                        let alphas = f32x8::new(alphas);
                        let through = &mut self.transmittance[row][half];
                        *through -= alphas * *through;
                        drawn(row, half, alphas.simd_gt(f32x8::ZERO).to_bitmask());
                    }
                }
            }
        }
    }

    fn add_ellipse(&mut self, layer: &Splat, drawn: &mut impl FnMut(usize, usize, u32)) {
        let e = &layer.ellipse;
        let dy = self.first.y - e.center.y;
        // u and v at the first pixel, in f64 because the center may be far away.
        let u0 = ((self.first.x - e.center.x - e.slope * dy) * f64::from(layer.per_column)) as f32;
        let v0 = (dy * f64::from(layer.per_row)) as f32;
        let u_per_row = (e.slope * f64::from(layer.per_column)) as f32;
        let reach = f64::from(layer.radius) * e.over_rows;
        let from = (-dy - reach).max(0.0) as usize;
        let to = ((reach - dy).max(-1.0) + 1.0) as usize;
        let column = f32x8::new([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]) * f32x8::splat(layer.per_column);
        let cut = layer.log_opacity - layer.range;
        for (row, line) in self.transmittance.iter_mut().enumerate().take(to).skip(from) {
            let v = v0 + layer.per_row * row as f32;
            let peak = layer.log_opacity - v * v;
            if peak < cut {
                continue;
            }
            let u = u0 - u_per_row * row as f32;
            for (half, through) in line.iter_mut().enumerate() {
                let u = column + f32x8::splat(u + layer.per_column * (half * LANES) as f32);
                let power = f32x8::splat(peak) - u * u;
                let seen = power.simd_ge(f32x8::splat(cut));
                if seen.any() {
                    let alpha: f32x8 = cast(exp2(power).fast_min(f32x8::ONE) & seen);
                    *through -= alpha * *through;
                    drawn(row, half, seen.to_bitmask());
                }
            }
        }
    }
}

/// Pixels of a tile that are not opaque yet.
struct Open {
    rows: [u32; TILE],
    pixels: u32,
    /// Groups of 32 pixels with one of them.
    groups: u32,
    rows_in_step: usize,
}

impl Open {
    fn new(rows: [u32; TILE], rows_in_step: usize) -> Self {
        let pixels = rows.iter().map(|row| row.count_ones()).sum();
        let mut open = Self { rows, pixels, groups: 0, rows_in_step };
        open.groups = open.count_groups();
        open
    }

    fn set(&mut self, row: usize, bits: u32) {
        let before = std::mem::replace(&mut self.rows[row], bits);
        if before != bits {
            self.pixels = self.pixels - before.count_ones() + bits.count_ones();
            self.groups = self.count_groups();
        }
    }

    fn count_groups(&self) -> u32 {
        self.rows.chunks(self.rows_in_step).map(|rows| u32::from(rows.iter().any(|row| *row != 0))).sum()
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::cutoffs::Limits;
    use crate::project::Ellipse;

    /// A splat that covers everything with one opacity.
    fn wall(opacity: f64) -> Drawn {
        let ellipse = Ellipse { center: DVec2::ZERO, slope: 0.0, along_row: 1e9, over_rows: 1e9 };
        Drawn::Ellipse(Splat::of(&ellipse, opacity, DVec3::ONE, Limits::STANDARD))
    }

    #[test]
    fn pixels_stop_when_they_are_opaque() {
        // 0.5^13 > 1e-4 > 0.5^14: fourteen layers make a pixel opaque.
        let layers = vec![wall(0.5); 40];
        let whole = TileWork::new([0, 0], [32, 32]).until_stop(layers.iter(), 1e-4);
        assert_eq!(whole, Visits { entries: 14, evaluated: 14 * 256, in_step: 14 * 256, ..Visits::default() });
        // Three columns and one row of the tile lie in the picture.
        let corner = TileWork::new([16, 16], [19, 17]).until_stop(layers.iter(), 1e-4);
        assert_eq!(corner, Visits { entries: 14, evaluated: 14 * 3, in_step: 14 * 32, ..Visits::default() });
    }

    #[test]
    fn bands_close_pixels_at_their_begins() {
        let layers = vec![wall(0.9); 16];
        let ends = [1, 2, 4, 8, 16];
        let band = |k: usize| ends.partition_point(|end| *end <= k);
        let items = layers.iter().enumerate().map(|(k, layer)| (band(k), layer));
        let covered = TileWork::new([0, 0], [16, 16]).by_bands(items, 5, 1e-4);
        // Four layers leave 1e-4, some rounding more or less; eight leave 1e-8.
        assert_eq!(covered.iter().map(|c| c.all).collect::<Vec<_>>(), [256, 256, 512, 1024, 2048]);
        assert_eq!([0, 1, 2, 4].map(|k| covered[k].open), [256, 256, 512, 0]);
    }
}
