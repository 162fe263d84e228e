//! Classification of voxels by the transfer function: extinction and base unit.

use glam::UVec3;
use rayon::prelude::*;
use sg_volume::opacity::extinction;
use sg_volume::{Classifier, Field};

use crate::label_units::{LEFT_OUT, LabelUnits};

/// Extinction and base unit of every voxel.
pub(crate) struct Classification<'a> {
    pub(crate) field: &'a Field,
    pub(crate) classifier: &'a Classifier,
    /// Extinction per world length, 0 for transparent voxels.
    extinction: Vec<f32>,
    /// Base unit of each voxel.
    unit: Vec<u8>,
    /// Statistics by base unit.
    pub(crate) statistics: Vec<UnitStatistics>,
    /// Importance of each voxel where another function shows its value; `None` if only what is shown counts.
    emphasis: Option<Vec<f32>>,
}

/// Counts and extent of the visible voxels of a base unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct UnitStatistics {
    /// Voxels with an opacity above 0.
    pub(crate) visible: usize,
    /// Visible voxels outside the ranges of all base units; they belong to the nearest one.
    pub(crate) outside_ranges: usize,
    /// Least and greatest voxel along each axis that is visible or can be; `low > high` without any.
    low: UVec3,
    high: UVec3,
}

impl UnitStatistics {
    const NONE: Self = Self { visible: 0, outside_ranges: 0, low: UVec3::MAX, high: UVec3::ZERO };

    fn merged(self, other: Self) -> Self {
        Self {
            visible: self.visible + other.visible,
            outside_ranges: self.outside_ranges + other.outside_ranges,
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }
}

/// Extinction of one base unit in the bounding box of its voxels that are visible or can be. The box has a margin of one transparent
/// voxel, except at the border of the volume.
pub(crate) struct Crop {
    /// The box's first voxel in the volume.
    pub(crate) first: UVec3,
    /// Voxels of the box.
    pub(crate) dims: UVec3,
    /// Extinction per world length, x fastest.
    pub(crate) extinction: Vec<f32>,
    /// Importance of each voxel of the box where another function shows its value; empty if only what is shown counts.
    pub(crate) emphasis: Vec<f32>,
}

impl<'a> Classification<'a> {
    /// Classifies every voxel. The classifier must have at most 255 base units. With `labels`, which must be of the same
    /// grid, voxels belong to the base units of their labels, whatever their values are.
    pub(crate) fn new(
        field: &'a Field,
        classifier: &'a Classifier,
        emphasis: Option<Vec<f32>>,
        labels: Option<&LabelUnits>,
    ) -> Self {
        let grid = field.grid();
        let reference = grid.reference_length();
        let [nx, ny, _] = grid.dims();
        let units = labels.map_or(classifier.unit_count(), |labels| labels.units().len());
        let mut extinctions = vec![0.0_f32; grid.len()];
        let mut unit_of = vec![0_u8; grid.len()];
        let statistics = extinctions
            .par_chunks_mut(nx)
            .zip(unit_of.par_chunks_mut(nx))
            .zip(field.values().par_chunks(nx))
            .enumerate()
            .map(|(row, ((extinctions, unit_of), values))| {
                let mut statistics = vec![UnitStatistics::NONE; units];
                let (y, z) = (row % ny, row / ny);
                // Neighbours are often equal, so the last result is cached.
                let mut last = (f32::NAN, 0.0_f32, 0_usize, true);
                for (x, &value) in values.iter().enumerate() {
                    if value != last.0 {
                        let raw = field.offset() + f64::from(value);
                        let of = classifier.unit(raw);
                        last = (value, extinction(classifier.opacity(raw), reference), of.unit, of.inside);
                    }
                    let (_, sigma, mut unit, mut inside) = last;
                    if let Some(labels) = labels {
                        let own = labels.of_voxels()[row * nx + x];
                        if own == LEFT_OUT {
                            unit_of[x] = LEFT_OUT;
                            continue;
                        }
                        (unit, inside) = (usize::from(own), true);
                    }
                    unit_of[x] = unit as u8;
                    extinctions[x] = sigma;
                    let is_visible = sigma > 0.0;
                    if is_visible || emphasis.as_ref().is_some_and(|of| of[row * nx + x] > 0.0) {
                        let at = UVec3::new(x as u32, y as u32, z as u32);
                        let (visible, outside_ranges) = (usize::from(is_visible), usize::from(is_visible && !inside));
                        statistics[unit] =
                            statistics[unit].merged(UnitStatistics { visible, outside_ranges, low: at, high: at });
                    }
                }
                statistics
            })
            .reduce(
                || vec![UnitStatistics::NONE; units],
                |a, b| a.into_iter().zip(b).map(|(a, b)| a.merged(b)).collect(),
            );
        Self { field, classifier, extinction: extinctions, unit: unit_of, statistics, emphasis }
    }

    /// The part of one base unit that is visible or can be; `None` if there is none.
    pub(crate) fn crop(&self, unit: usize) -> Option<Crop> {
        let statistics = self.statistics.get(unit).filter(|c| c.low.cmple(c.high).all())?;
        let all = UVec3::from_array(self.field.grid().dims().map(|d| d as u32));
        let first = statistics.low.saturating_sub(UVec3::ONE);
        let dims = (statistics.high + UVec3::splat(2)).min(all) - first;
        let (bx, by) = (dims.x as usize, dims.y as usize);
        let cropped = |all: &[f32]| {
            let mut part = vec![0.0_f32; bx * by * dims.z as usize];
            part.par_chunks_mut(bx).enumerate().for_each(|(row, out)| {
                let (y, z) = (row % by + first.y as usize, row / by + first.z as usize);
                let start = self.field.grid().index(first.x as usize, y, z);
                let sources = all[start..start + bx].iter().zip(&self.unit[start..start + bx]);
                for (o, (&x, &u)) in out.iter_mut().zip(sources) {
                    if usize::from(u) == unit {
                        *o = x;
                    }
                }
            });
            part
        };
        let emphasis = self.emphasis.as_deref().map_or_else(Vec::new, cropped);
        Some(Crop { first, dims, extinction: cropped(&self.extinction), emphasis })
    }
}
