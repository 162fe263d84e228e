//! How far a walk reaches and how sure of a node it has to be: what is scrubbed after a stroke.

use serde::{Deserialize, Serialize};

/// The largest leak that a step may ask for: nothing but seeds is left long before it.
pub const MOST_LEAK: f64 = 1000.0;

/// What the walk of a selection is done with. The last one among a selection's steps counts, wherever it stands.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tuning {
    /// ε: what every unseeded node leaks to the background, in units of its degree; 0 to [`MOST_LEAK`]. A larger one selects
    /// less.
    pub leak: f64,
    /// The p − q that a selected node exceeds, at least -1 and below 1. A larger one selects less.
    pub threshold: f64,
}

impl Tuning {
    /// Checks that a walk can be done with it.
    ///
    /// # Errors
    /// What is wrong and what would be right, in words.
    pub fn check(&self) -> Result<(), String> {
        let Self { leak, threshold } = *self;
        if !(0.0..=MOST_LEAK).contains(&leak) {
            return Err(format!("the leak is {leak}; it must be from 0 to {MOST_LEAK}"));
        }
        if !(-1.0..1.0).contains(&threshold) {
            return Err(format!("the threshold is {threshold}; it must be at least -1 and below 1"));
        }
        Ok(())
    }
}
