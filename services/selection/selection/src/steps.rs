//! The steps of a selection.

use sg_scene::mask::Mask;

use crate::operations::{Operation, OperationError};
use crate::strokes::{Stroke, StrokeError};
use crate::tuning::{Tuning, TuningError};

/// One step.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// A brush stroke.
    Stroke(Stroke),
    /// An operation on the mask.
    Operation(Operation),
    /// Adds a fixed mask, for example a selection by name.
    FixedMask(Mask),
    /// Takes a fixed mask away, such as the Gaussians that were hidden.
    Exclude(Mask),
    /// Sets the walk parameters.
    Tuning(Tuning),
}

/// A step with an impossible value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StepError {
    /// In a stroke.
    #[error(transparent)]
    Stroke(#[from] StrokeError),
    /// In an operation.
    #[error(transparent)]
    Operation(#[from] OperationError),
    /// In the walk parameters.
    #[error(transparent)]
    Tuning(#[from] TuningError),
}

impl From<Stroke> for Step {
    fn from(stroke: Stroke) -> Self {
        Self::Stroke(stroke)
    }
}

impl From<Operation> for Step {
    fn from(operation: Operation) -> Self {
        Self::Operation(operation)
    }
}

impl From<Tuning> for Step {
    fn from(tuning: Tuning) -> Self {
        Self::Tuning(tuning)
    }
}

impl Step {
    /// Checks the values of the step. A fixed mask is not checked.
    ///
    /// # Errors
    /// [`StepError`] with the first wrong value.
    pub fn check(&self) -> Result<(), StepError> {
        match self {
            Self::Stroke(stroke) => stroke.check()?,
            Self::Operation(operation) => operation.check()?,
            Self::FixedMask(_) | Self::Exclude(_) => {}
            Self::Tuning(tuning) => tuning.check()?,
        }
        Ok(())
    }

    /// The stroke of the step; `None` for other steps.
    #[must_use]
    pub fn stroke(&self) -> Option<&Stroke> {
        if let Self::Stroke(stroke) = self { Some(stroke) } else { None }
    }
}
