//! Options of a direct start, and its errors.

use sg_volume::ScalarFieldRef;
use sg_volume::transfer::Problem;

use crate::labels::{LabelError, MAX_UNITS};
use crate::placement::PlacementError;

/// Largest allowed number of Gaussians.
pub const MAX_GAUSSIANS: usize = 1 << 26;

/// Options of a direct start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Most Gaussians in all base units together.
    pub gaussians: usize,
    /// Seed of the placement. A seed gives the same scene on any number of threads.
    pub seed: u64,
    /// Thickness of Gaussians along the gradient at clear boundaries, relative to the thickness of their cell, above 0. The
    /// value 1 does not flatten.
    pub flattening: f64,
    /// Importance of what its own unit hides, relative to what is seen, 0 to 1. With 0 nothing is placed there.
    pub interior: f64,
    /// Importance of values that the transfer function hides, relative to what it shows, 0 to 1. With 0 nothing is placed there.
    /// Otherwise other functions can show them ([`sg_reclassify`]).
    pub hidden: f64,
    /// Rounds of relaxation after the sampling of the centres.
    pub relaxation_rounds: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { gaussians: 100_000, seed: 0, flattening: 0.6, interior: 0.1, hidden: 0.0, relaxation_rounds: 1 }
    }
}

impl Options {
    /// The seed of a base unit: its samples are others than those of the next one.
    pub(crate) fn seed_of(&self, unit: usize) -> u64 {
        self.seed.wrapping_add((unit as u64) << 32)
    }
}
/// A direct start is not possible.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DirectError {
    /// The transfer function is invalid.
    #[error("the transfer function's {0}")]
    TransferFunction(#[from] Problem),
    /// The transfer function has too many base units.
    #[error("the transfer function has {0} base units; at most {MAX_UNITS} are possible; join some")]
    TooManyUnits(usize),
    /// No voxel is visible.
    #[error(
        "nothing is visible: all {count} {elements} (values {low} to {high}, {non_finite} not finite) have opacity 0 under the \
         transfer function; raise opacities within that range or check its `units`"
    )]
    NothingVisible {
        /// Number of elements.
        count: usize,
        /// The word for them, as [`ScalarFieldRef::elements_name`] gives it.
        elements: &'static str,
        /// Least finite value.
        low: f64,
        /// Greatest finite value.
        high: f64,
        /// Voxels that are NaN or infinite.
        non_finite: usize,
    },
    /// The label map does not fit the volume.
    #[error("{0}")]
    Labels(#[from] LabelError),
    /// No voxel with a label is visible.
    #[error(
        "nothing of the labels is visible: all {0} voxels with a base unit have opacity 0 under the transfer function; raise \
         opacities for their values, or give the label map alone"
    )]
    LabelsHidden(u64),
    /// The number of Gaussians is 0 or too large.
    #[error("{0} Gaussians; give a number from 1 to {MAX_GAUSSIANS}")]
    Budget(usize),
    /// The flattening is outside its range.
    #[error("flattening {0}; give a number above 0 and at most 1")]
    Flattening(f64),
    /// The importance of the interior is outside its range.
    #[error("an interior of {0}; give a number from 0 to 1")]
    Interior(f64),
    /// The importance of hidden values is outside its range.
    #[error("an importance of {0} for hidden values; give a number from 0 to 1")]
    Hidden(f64),
    /// The nearest-neighbour search could not be set up.
    #[error("the placement failed: {0}")]
    Placement(#[from] PlacementError),
}

impl DirectError {
    /// Nothing of a field is visible.
    pub(crate) fn nothing_visible<'a>(field: impl Into<ScalarFieldRef<'a>>) -> Self {
        let field = field.into();
        let range = field.range();
        Self::NothingVisible {
            count: field.elements(),
            elements: field.elements_name(),
            low: range.low,
            high: range.high,
            non_finite: range.non_finite,
        }
    }
}
