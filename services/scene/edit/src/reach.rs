//! The reach of a walk: its leak as people see it, on panels and in the history.

/// The least and the greatest leak that a hand reaches; equal ways are equal factors.
pub const LEAK_RANGE: (f64, f64) = (1e-4, 1.0);

/// The reach of a leak, 0 to 1: a greater reach selects more. Equal differences are equal factors of the leak.
#[must_use]
pub fn reach_of(leak: f64) -> f64 {
    let (least, greatest) = LEAK_RANGE;
    1.0 - (leak.clamp(least, greatest) / least).ln() / (greatest / least).ln()
}

/// The leak of a reach from 0 to 1, the inverse of [`reach_of`].
#[must_use]
pub fn leak_of(reach: f64) -> f64 {
    let (least, greatest) = LEAK_RANGE;
    (least * (greatest / least).powf(1.0 - reach)).clamp(least, greatest)
}
