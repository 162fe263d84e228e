//! Blocks of voxels in which a transfer function shows something, and the distance to them from all others.

use glam::DVec3;
use rayon::prelude::*;

use crate::classifier::Classifier;
use crate::field::Field;

/// Edge of a block in voxels.
const EDGE: usize = 4;

/// The distance of each block of a volume to the nearest one with an opacity above 0.
pub(crate) struct VisibleBlocks {
    counts: [usize; 3],
    /// In blocks, the greatest of the three axes: 0 for a visible block.
    distance: Vec<u8>,
}

impl VisibleBlocks {
    pub(crate) fn of(field: &Field, classifier: &Classifier) -> Self {
        let dims = field.grid().dims();
        let counts = dims.map(|n| n.div_ceil(EDGE));
        let mut distance: Vec<u8> = (0..counts[0] * counts[1] * counts[2])
            .into_par_iter()
            .map(|block| {
                let first = [block % counts[0], block / counts[0] % counts[1], block / (counts[0] * counts[1])];
                // A sample reads the voxels before and after it, so a block ends with the first ones of the next.
                let [x, y, z] = [0, 1, 2].map(|k| EDGE * first[k]..(EDGE * (first[k] + 1) + 1).min(dims[k]));
                let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
                for z in z {
                    for y in y.clone() {
                        let row = field.grid().index(x.start, y, z);
                        // A NaN is transparent, and so is all that it contributes to; the comparisons leave it out.
                        for value in field.values().get(row..row + x.len()).unwrap_or_default() {
                            low = low.min(*value);
                            high = high.max(*value);
                        }
                    }
                }
                let raw = |value: f32| field.offset() + f64::from(value);
                let is_visible = low <= high && classifier.is_visible_between(raw(low), raw(high));
                if is_visible { 0 } else { u8::MAX }
            })
            .collect();
        spread_distances(&mut distance, counts);
        Self { counts, distance }
    }

    /// All blocks, also the empty ones.
    #[cfg(test)]
    pub(crate) fn all(field: &Field) -> Self {
        let counts = field.grid().dims().map(|n| n.div_ceil(EDGE));
        Self { counts, distance: vec![0; counts[0] * counts[1] * counts[2]] }
    }

    /// The blocks around a place in which all is as visible as there. Voxel coordinates.
    pub(crate) fn stretch(&self, at: DVec3) -> Stretch {
        // The outer half voxel belongs to the blocks at the border.
        let block = [0, 1, 2].map(|k| ((at[k].max(0.0) as usize) / EDGE).min(self.counts[k] - 1));
        let index = block[0] + self.counts[0] * (block[1] + self.counts[1] * block[2]);
        let distance = self.distance.get(index).copied().unwrap_or_default();
        let reach = usize::from(distance.max(1)) - 1;
        let (mut low, mut high) = (DVec3::NEG_INFINITY, DVec3::INFINITY);
        for k in 0..3 {
            if block[k] > reach {
                low[k] = (EDGE * (block[k] - reach)) as f64;
            }
            if block[k] + reach + 1 < self.counts[k] {
                high[k] = (EDGE * (block[k] + reach + 1)) as f64;
            }
        }
        Stretch { is_visible: distance == 0, low, high }
    }
}

/// A box of blocks that are all empty, or one block that is visible.
pub(crate) struct Stretch {
    pub(crate) is_visible: bool,
    low: DVec3,
    high: DVec3,
}

impl Stretch {
    /// The way from a place inside to the end of the box, in units of `along`, where `inverse` is 1 / `along` by component.
    pub(crate) fn way_out(&self, at: DVec3, inverse: DVec3) -> f64 {
        let (a, b) = ((self.low - at) * inverse, (self.high - at) * inverse);
        // A ray along the sides has 0·∞, which `max` leaves out.
        let end = |k: usize| f64::NEG_INFINITY.max(a[k]).max(b[k]);
        end(0).min(end(1)).min(end(2)).max(0.0)
    }
}

/// Replaces each distance by the least over all blocks of that block's distance and the way to it. It is a chamfer transform in two
/// passes over the 26 neighbours, which is exact for the greatest of three axes.
fn spread_distances(distance: &mut [u8], counts: [usize; 3]) {
    let [nx, ny, nz] = counts;
    let mut relax = |x: usize, y: usize, z: usize, is_forward: bool| {
        let mut least = distance[x + nx * (y + ny * z)];
        for dz in 0..3 {
            for dy in 0..3 {
                for dx in 0..3 {
                    let is_before = (dz, dy, dx) < (1, 1, 1);
                    let (x, y, z) = ((x + dx).wrapping_sub(1), (y + dy).wrapping_sub(1), (z + dz).wrapping_sub(1));
                    if is_before == is_forward && (dx, dy, dz) != (1, 1, 1) && x < nx && y < ny && z < nz {
                        least = least.min(distance[x + nx * (y + ny * z)].saturating_add(1));
                    }
                }
            }
        }
        distance[x + nx * (y + ny * z)] = least;
    };
    let blocks = nx * ny * nz;
    let place = |i: usize| (i % nx, i / nx % ny, i / (nx * ny));
    for i in 0..blocks {
        let (x, y, z) = place(i);
        relax(x, y, z, true);
    }
    for i in (0..blocks).rev() {
        let (x, y, z) = place(i);
        relax(x, y, z, false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_all_pairs() {
        let counts = [7, 5, 6];
        let place = |i: usize| [i % 7, i / 7 % 5, i / 35];
        for seed in 0..20_usize {
            let visible = |i: usize| (i * 7919 + seed * 104_729).is_multiple_of(61);
            let mut found: Vec<u8> = (0..210).map(|i| if visible(i) { 0 } else { u8::MAX }).collect();
            spread_distances(&mut found, counts);
            for (i, found) in found.iter().enumerate() {
                let apart = |j: usize| (0..3).map(|k| place(i)[k].abs_diff(place(j)[k])).max().unwrap();
                let least = (0..210).filter(|j| visible(*j)).map(apart).min().unwrap();
                assert_eq!(usize::from(*found), least, "block {i}, seed {seed}");
            }
        }
    }
}
