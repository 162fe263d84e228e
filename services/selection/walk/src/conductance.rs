//! Conductances with a wide range: an f64 mantissa and a separate exponent.
//!
//! exp(−x²) is 0 in f64 for x > 27.2. Consider a cluster at 20σ from one seed and 30σ from another. It belongs to the first
//! seed. With both weights 0 it would belong to neither, and with both clamped it would be a tie.

use std::iter::Sum;
use std::ops::{Add, Div, Mul};

/// A number of at least 0: `mantissa · 2^exponent`, with the mantissa in [1, 2), or 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conductance {
    mantissa: f64,
    exponent: i64,
}

impl Conductance {
    /// Zero.
    pub const ZERO: Self = Self { mantissa: 0.0, exponent: i64::MIN / 4 };

    /// One.
    pub const ONE: Self = Self { mantissa: 1.0, exponent: 0 };

    /// Exactly `x`, if it is finite and at least 0.
    #[must_use]
    pub fn new(x: f64) -> Option<Self> {
        (x >= 0.0 && x.is_finite()).then(|| Self::normalized(x, 0))
    }

    /// e^x.
    #[must_use]
    pub fn exp(x: f64) -> Self {
        if x == f64::NEG_INFINITY || x.is_nan() {
            return Self::ZERO;
        }
        // The exponent would overflow beyond this limit. Real weights are far below it.
        let x = x.clamp(-1e15, 1e15);
        let exponent = (x * std::f64::consts::LOG2_E).floor();
        // ln 2 in two parts. Trailing zeros in the first part avoid cancellation.
        const HIGH: f64 = 0.693_147_180_369_123_8;
        const LOW: f64 = 1.908_214_929_270_587_7e-10;
        Self::normalized(((x - exponent * HIGH) - exponent * LOW).exp(), exponent as i64)
    }

    fn normalized(x: f64, exponent: i64) -> Self {
        if x == 0.0 {
            return Self::ZERO;
        }
        // Denormals first become normal.
        let (x, exponent) = if x < f64::MIN_POSITIVE { (x * 2.0_f64.powi(64), exponent - 64) } else { (x, exponent) };
        let bits = x.to_bits();
        let own = (bits >> 52) as i64 - 1023;
        Self { mantissa: f64::from_bits((bits & !(0x7ff << 52)) | (1023 << 52)), exponent: exponent + own }
    }

    /// Whether it is 0.
    #[must_use]
    pub fn is_zero(self) -> bool {
        self.mantissa == 0.0
    }

    /// Exponent of the largest power of two that does not exceed it. For 0 the exponent is below all others.
    #[must_use]
    pub fn exponent(self) -> i64 {
        self.exponent
    }

    /// The value times 2^−shift as f64: exact in the normal range, rounded for denormals, 0 or infinity beyond.
    #[must_use]
    pub fn scaled(self, shift: i64) -> f64 {
        let power = self.exponent.saturating_sub(shift);
        if self.mantissa == 0.0 || power < -1080 {
            0.0
        } else if power > 1023 {
            f64::INFINITY
        } else if power >= -1022 {
            self.mantissa * power_of_two(power)
        } else {
            self.mantissa * power_of_two(power + 100) * power_of_two(-100)
        }
    }
}

/// 2^n for −1022 ≤ n ≤ 1023.
fn power_of_two(n: i64) -> f64 {
    f64::from_bits(((n + 1023) as u64) << 52)
}

impl Add for Conductance {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let (large, small) = if self.exponent >= other.exponent { (self, other) } else { (other, self) };
        let gap = large.exponent.saturating_sub(small.exponent);
        if small.mantissa == 0.0 || gap > 60 {
            return large;
        }
        Self::normalized(large.mantissa + small.mantissa * power_of_two(-gap), large.exponent)
    }
}

impl Mul for Conductance {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        Self::normalized(self.mantissa * other.mantissa, self.exponent.saturating_add(other.exponent))
    }
}

impl Div for Conductance {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        Self::normalized(self.mantissa / other.mantissa, self.exponent.saturating_sub(other.exponent))
    }
}

impl Sum for Conductance {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        terms.fold(Self::ZERO, Add::add)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn magnitude() -> impl Strategy<Value = f64> {
        (0.5..2.0_f64, -300..300_i32).prop_map(|(m, e)| m * 2.0_f64.powi(e))
    }

    proptest! {
        #[test]
        fn arithmetic_is_that_of_f64_where_both_reach(a in magnitude(), b in magnitude()) {
            let (x, y) = (Conductance::new(a).unwrap(), Conductance::new(b).unwrap());
            prop_assert_eq!(x.scaled(0), a);
            prop_assert_eq!((x * y).scaled(0), a * b);
            prop_assert_eq!((x / y).scaled(0), a / b);
            prop_assert_eq!((x + y).scaled(0), a + b);
        }

        #[test]
        fn exponentials_of_sums_are_products(a in -1e5..0.0_f64, b in -1e5..0.0_f64) {
            let product = Conductance::exp(a) * Conductance::exp(b);
            let ratio = (product / Conductance::exp(a + b)).scaled(0);
            // The argument itself is rounded, by |a + b| · 2⁻⁵³.
            prop_assert!((ratio - 1.0).abs() < 2e-15 + 3e-16 * (a + b).abs(), "{ratio}");
        }
    }

    #[test]
    fn small_numbers_keep_their_order_beyond_the_range_of_f64() {
        let near = Conductance::exp(-400.0);
        let far = Conductance::exp(-900.0);
        assert_eq!((far / near).scaled(0), (-500.0_f64).exp());
        assert_eq!(far.scaled(0), 0.0);
        assert_eq!(Conductance::exp(-500.0).scaled(0), (-500.0_f64).exp());
    }

    #[test]
    fn denormals_zero_and_refused_numbers() {
        for x in [5e-324, 1e-310, f64::MIN_POSITIVE, f64::MAX, 0.0] {
            assert_eq!(Conductance::new(x).unwrap().scaled(0), x);
        }
        for x in [-1e-300, f64::NAN, f64::INFINITY] {
            assert!(Conductance::new(x).is_none());
        }
        let zero = Conductance::ZERO;
        let one = Conductance::new(1.0).unwrap();
        assert_eq!((zero + one, zero * one, zero + zero), (one, zero, zero));
        assert!((zero / one).is_zero());
    }
}
