//! Blocks of voxels in which a transfer function shows something.

use glam::DVec3;
use rayon::prelude::*;

use crate::classifier::Classifier;
use crate::field::Field;

/// Edge of a block in voxels.
const EDGE: usize = 4;

/// Whether each block of a volume has a value of opacity above 0.
pub(crate) struct VisibleBlocks {
    counts: [usize; 3],
    visible: Vec<bool>,
}

impl VisibleBlocks {
    pub(crate) fn of(field: &Field, classifier: &Classifier) -> Self {
        let dims = field.grid().dims();
        let counts = dims.map(|n| n.div_ceil(EDGE));
        let visible = (0..counts[0] * counts[1] * counts[2])
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
                low <= high && classifier.is_visible_between(raw(low), raw(high))
            })
            .collect();
        Self { counts, visible }
    }

    /// All blocks, also the empty ones.
    #[cfg(test)]
    pub(crate) fn all(field: &Field) -> Self {
        let counts = field.grid().dims().map(|n| n.div_ceil(EDGE));
        Self { counts, visible: vec![true; counts[0] * counts[1] * counts[2]] }
    }

    /// The way along `along` from a place to the end of its block, in units of `along`. `None` in a visible block. Both are in voxel
    /// coordinates.
    pub(crate) fn way_out(&self, at: DVec3, along: DVec3) -> Option<f64> {
        let edge = EDGE as f64;
        // The outer half voxel belongs to the blocks at the border.
        let block = [0, 1, 2].map(|k| ((at[k].max(0.0) / edge) as usize).min(self.counts[k] - 1));
        if self.visible.get(block[0] + self.counts[0] * (block[1] + self.counts[1] * block[2])).copied().unwrap_or(true)
        {
            return None;
        }
        let way = |k: usize| {
            let (first, last) = (block[k] == 0, block[k] + 1 == self.counts[k]);
            let end = match along[k] {
                a if a > 0.0 && !last => edge * (block[k] + 1) as f64,
                a if a < 0.0 && !first => edge * block[k] as f64,
                _ => return f64::INFINITY,
            };
            (end - at[k]) / along[k]
        };
        Some(way(0).min(way(1)).min(way(2)).max(0.0))
    }
}
