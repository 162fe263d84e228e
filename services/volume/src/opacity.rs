//! Opacity and extinction of a medium, for any sampling distance.

/// Largest opacity in a conversion to extinction; opacity 1 would have an infinite extinction.
pub const MAX_OPACITY: f32 = 0.999_999;

/// Opacity over `step` of a medium with `opacity` over `reference`: 1 − (1 − a)^(step/reference).
///
/// The computation uses logarithms in f64. The direct form loses every digit of an opacity below 1e-8.
#[must_use]
pub fn correct_opacity(opacity: f64, step: f64, reference: f64) -> f64 {
    let ratio = step / reference;
    if !(opacity > 0.0 && ratio > 0.0) {
        return 0.0;
    }
    -((-opacity.min(1.0)).ln_1p() * ratio).exp_m1()
}

/// Extinction per length of a medium with `opacity` over `reference`, finite also at opacity 1 (see [`MAX_OPACITY`]).
#[must_use]
pub fn extinction(opacity: f32, reference: f64) -> f32 {
    (-f64::from(-opacity.clamp(0.0, MAX_OPACITY)).ln_1p() / reference) as f32
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn two_steps_compose_to_their_sum(a in 0.0..=1.0_f64, s in 0.0..3.0_f64, t in 0.0..3.0_f64) {
            let transmit = |step| 1.0 - correct_opacity(a, step, 1.5);
            prop_assert!((transmit(s) * transmit(t) - transmit(s + t)).abs() < 1e-12);
            prop_assert!((0.0..=1.0).contains(&correct_opacity(a, s, 1.5)));
            prop_assert!((correct_opacity(a, 1.5, 1.5) - a).abs() < 1e-12);
        }

        #[test]
        fn tiny_opacities_keep_their_digits(exponent in -15.0..-9.0_f64) {
            let a = 10.0_f64.powf(exponent);
            let exact = a / 2.0 + a * a / 8.0;
            let direct = 1.0 - (1.0 - a).powf(0.5);
            prop_assert!((correct_opacity(a, 0.5, 1.0) / exact - 1.0).abs() < 1e-12);
            // The direct form rounds 1 − a to 2⁻⁵³ and keeps almost nothing at 1e-15.
            prop_assert!(exponent > -14.0 || (direct / exact - 1.0).abs() > 1e-6);
        }

        #[test]
        fn extinction_and_correction_agree(a in 0.0..0.99_f32, step in 0.01..3.0_f64) {
            let through = 1.0 - (-f64::from(extinction(a, 1.7)) * step).exp();
            prop_assert!((through - correct_opacity(f64::from(a), step, 1.7)).abs() < 1e-5);
        }
    }
}
