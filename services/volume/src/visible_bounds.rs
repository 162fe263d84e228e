//! The box of what a transfer function shows.

use glam::{BVec3, DVec3};
use rayon::prelude::*;

use crate::classifier::Classifier;
use crate::field::Field;
use crate::grid::Bounds;

/// The box, along the axes of the world, of the voxels with an opacity above 0. That of all voxels if there are none.
#[must_use]
pub fn visible_bounds(field: &Field, classifier: &Classifier) -> Bounds {
    let grid = field.grid();
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (min, max) = (0..grid.len())
        .into_par_iter()
        .filter(|i| classifier.opacity(field.raw(*i)) > 0.0)
        .fold(
            || none,
            |(min, max), i| {
                let voxel = grid.voxel(i).as_dvec3();
                (min.min(voxel), max.max(voxel))
            },
        )
        .reduce(|| none, |a, b| (a.0.min(b.0), a.1.max(b.1)));
    if !min.is_finite() {
        return grid.bounds();
    }
    let corners = (0..8).map(|k| {
        let corner = DVec3::select(BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), max + 0.5, min - 0.5);
        grid.to_world(corner)
    });
    let (min, max) = corners.fold(none, |(min, max), corner| (min.min(corner), max.max(corner)));
    Bounds { min, max }
}
