//! How faint a layer may be to be left out.

use glam::Vec3;

/// The cut-offs of a quality level.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// α below this is not drawn …
    pub cut: f64,
    /// … unless it is above opacity / ratio.
    pub ratio: f64,
    /// Transmittance at which a row of a tile is finished.
    pub stop: f32,
}

impl Limits {
    /// ≥ 50 dB over frame and footprint, coverage error ≤ 1 %, at most 0.1 % of the footprint off by more than 2/255.
    ///
    /// A cut of 1/1024 breaks the bound where hundreds of tails overlap. On white, a trained scene of 46k Gaussians
    /// then has 49.6 dB over the footprint, and 6 % of it differ by more than 2/255. A cut of 1/4096 leaves 0.13 %
    /// of another scene. The present cut costs a third more pixels than 1/1024.
    pub const STANDARD: Self = Self { cut: 1.0 / 8192.0, ratio: 1024.0, stop: 1e-4 };
    /// ≥ 40 dB over frame and footprint, coverage error ≤ 3 %.
    pub const FAST: Self = Self { cut: 1.0 / 512.0, ratio: 64.0, stop: 1.0 / 256.0 };
    /// A picture in motion, drawn by devices alone: ≥ 35 dB over frame and footprint.
    pub const MOTION: Self = Self { cut: 1.0 / 255.0, ratio: 32.0, stop: 1.0 / 128.0 };
}

/// δ for `count` Gaussians with the greatest color component `brightest`.
pub(crate) fn faintest(count: usize, brightest: f64, background: Vec3) -> f64 {
    let brightest = background.as_dvec3().abs().max_element().max(1.0).max(brightest);
    (-33.0_f64).exp2() / (count.max(1) as f64 * brightest)
}

/// Radius in standard deviations at which a Gaussian of peak `opacity` has faded to `faintest`.
pub(crate) fn radius(opacity: f64, faintest: f64) -> f64 {
    (2.0 * (opacity / faintest).ln()).max(0.0).sqrt()
}
