//! Walk parameters that a user changes after a stroke: leak and threshold.

/// Largest leak of a step. Far below it, only the seeds remain selected.
pub const MAX_LEAK: f64 = 1000.0;

/// Parameters of the walk of a selection. The last tuning among the steps counts, at any position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tuning {
    /// ε: leak of every unseeded node to the background, in units of its degree; 0 to [`MAX_LEAK`]. A larger leak selects
    /// less.
    pub leak: f64,
    /// A node is selected if p − q exceeds this number; at least -1 and below 1. A larger threshold selects less.
    pub threshold: f64,
}

/// A walk parameter outside its range.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum TuningError {
    /// The leak is negative, too large or no number.
    #[error("the leak is {0}; it must be from 0 to {MAX_LEAK}")]
    Leak(f64),
    /// The threshold is outside \[-1, 1).
    #[error("the threshold is {0}; it must be at least -1 and below 1")]
    Threshold(f64),
}

impl Tuning {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`TuningError`] with the first wrong number.
    pub fn check(&self) -> Result<(), TuningError> {
        let Self { leak, threshold } = *self;
        if !(0.0..=MAX_LEAK).contains(&leak) {
            return Err(TuningError::Leak(leak));
        }
        if !(-1.0..1.0).contains(&threshold) {
            return Err(TuningError::Threshold(threshold));
        }
        Ok(())
    }
}
