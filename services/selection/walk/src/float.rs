//! Plain floating point: the arithmetic of the solvers that subtract.

use std::ops::{Add, Div, Mul, Sub};

/// Plain floating point.
pub trait Float:
    Copy + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + PartialOrd
{
    /// Name in messages.
    const NAME: &'static str;
    /// Rounded from f64.
    fn of(x: f64) -> Self;
    /// Converted to f64.
    fn value(self) -> f64;
}

impl Float for f64 {
    const NAME: &'static str = "f64";

    fn of(x: f64) -> Self {
        x
    }

    fn value(self) -> f64 {
        self
    }
}

impl Float for f32 {
    const NAME: &'static str = "f32";

    fn of(x: f64) -> Self {
        x as Self
    }

    fn value(self) -> f64 {
        f64::from(self)
    }
}
