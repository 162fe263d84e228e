//! Opacity of a Gaussian from the integral of its optical depth.
//!
//! A Gaussian of peak opacity o has the optical depth −ln(1 − o·exp(−r²/2)) at r standard deviations. Over its image that
//! integrates to 2π·s₁·s₂·Li₂(o), with the dilogarithm Li₂.

use std::f64::consts::PI;
use std::sync::LazyLock;

/// Largest opacity of a Gaussian: 1 has no logit.
const MAX_OPACITY: f64 = 0.995;

/// Logit of the opacity of Gaussians that a transfer function hides: 2·10⁻⁹, which no picture shows.
const LEAST_LOGIT: f64 = -20.0;

/// Integrals below which the opacity is a short series.
const SERIES: f64 = 0.01;

/// Steps of the table of opacities.
const STEPS: usize = 1 << 14;

/// The opacity o with Li₂(o) = x, at most 0.995; 0 for x below 0 and NaN.
#[must_use]
pub fn opacity_of(x: f64) -> f64 {
    if x.is_nan() || x <= 0.0 {
        return 0.0;
    }
    if x >= dilogarithm(MAX_OPACITY) {
        return MAX_OPACITY;
    }
    // Li₂ is convex and above the identity on [0, 1], so Newton steps from the right end stay inside.
    let mut o = x.min(MAX_OPACITY);
    for _ in 0..32 {
        let step = (dilogarithm(o) - x) / (-(-o).ln_1p() / o.max(1e-300));
        let next = (o - step).clamp(0.0, MAX_OPACITY);
        if (next - o).abs() <= 1e-12 * o {
            break;
        }
        o = next;
    }
    o
}

/// Li₂(x) = Σ xᵏ/k² for 0 ≤ x < 1: the integral of the optical depth −ln(1 − x·e^−u) over u from 0 to ∞.
#[must_use]
pub fn dilogarithm(x: f64) -> f64 {
    if x > 0.5 {
        return PI * PI / 6.0 - x.ln() * (-x).ln_1p() - dilogarithm(1.0 - x);
    }
    let mut power = x;
    let mut sum = 0.0;
    for k in 1..60 {
        let term = power / f64::from(k * k);
        sum += term;
        if term < 1e-17 * sum {
            break;
        }
        power *= x;
    }
    sum
}

/// [`opacity_of`] from a table, within 10⁻⁵ of the opacity: a frame has a million Gaussians.
#[must_use]
pub(crate) fn fast_opacity_of(x: f64) -> f64 {
    static TABLE: LazyLock<(f64, Vec<f64>)> = LazyLock::new(|| {
        let step = dilogarithm(MAX_OPACITY) / STEPS as f64;
        (step, (0..=STEPS).map(|i| opacity_of(i as f64 * step)).collect())
    });
    // Below, the table's first steps are too coarse for the ratio. This is the inverse of Li₂(o) = o + o²/4 + o³/9 + ….
    if x < SERIES {
        let x = x.max(0.0);
        return x * (1.0 - x / 4.0 + x * x / 72.0);
    }
    let (step, table) = &*TABLE;
    let place = (x / step).max(0.0);
    let at = place as usize;
    match (table.get(at), table.get(at + 1)) {
        (Some(low), Some(high)) => low + (place - at as f64) * (high - low),
        _ => MAX_OPACITY,
    }
}

/// The logit of an opacity; that of 2·10⁻⁹ for less, and for NaN.
#[must_use]
pub fn logit_of(opacity: f64) -> f32 {
    (opacity.ln() - (-opacity).ln_1p()).max(LEAST_LOGIT) as f32
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_dilogarithm_is_the_integral_of_the_optical_depth() {
        for o in [0.0, 0.1, 0.5, 0.9, 0.995] {
            let (mut sum, h) = (0.0, 1e-4);
            for i in 0..400_000 {
                let u = (f64::from(i) + 0.5) * h;
                sum -= (-o * (-u).exp()).ln_1p() * h;
            }
            assert!((dilogarithm(o) - sum).abs() < 1e-6, "{o}: {} {sum}", dilogarithm(o));
        }
    }

    #[test]
    fn logits_of_hidden_gaussians_are_finite() {
        assert_eq!([0.0, f64::NAN, 0.5].map(logit_of), [-20.0, -20.0, 0.0]);
        assert!((logit_of(0.9) - 9.0_f32.ln()).abs() < 1e-6);
    }

    #[test]
    fn the_table_keeps_the_digits_of_faint_gaussians() {
        // Below the first step of the table.
        let x = 4.166_459_164_228_656e-5;
        assert!((fast_opacity_of(x) / opacity_of(x) - 1.0).abs() <= 1e-5);
    }

    proptest! {
        #[test]
        fn opacity_inverts_the_dilogarithm(o in 1e-9..MAX_OPACITY) {
            prop_assert!((opacity_of(dilogarithm(o)) / o - 1.0).abs() < 1e-6);
        }

        #[test]
        fn the_table_is_its_exact_twin(x in prop_oneof![0.0..1e-3_f64, 0.0..0.02_f64, 0.0..2.0_f64]) {
            let (fast, exact) = (fast_opacity_of(x), opacity_of(x));
            prop_assert!((fast - exact).abs() <= 1e-5 * exact, "{x}: {fast} {exact}");
        }
    }
}
