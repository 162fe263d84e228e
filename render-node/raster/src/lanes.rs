//! Eight numbers at a time.

use bytemuck::cast;
use wide::{f32x8, u32x8};

/// Numbers of one vector.
pub(crate) const LANES: usize = 8;

/// Near-minimax coefficients of 2^f on [−½, ½], highest power first; relative error 1e-7.
const EXP2: [f32; 6] =
    [0.001_339_086_3, 0.009_676_032, 0.055_503_57, 0.240_221_07, std::f32::consts::LN_2, 1.000_000_1];

/// 2^x for x ≤ 1, relative error below 3e-7; below 2⁻¹²⁶ it stays there.
pub(crate) fn exp2(x: f32x8) -> f32x8 {
    // Adding 1.5·2²³ rounds to the nearest integer and leaves it in the low bits. A shift moves it to the exponent.
    const ROUND: f32 = 12_582_912.0;
    let x = x.fast_max(f32x8::splat(-126.0));
    let shifted = x + f32x8::splat(ROUND);
    let f = x - (shifted - f32x8::splat(ROUND));
    let [first, rest @ ..] = EXP2;
    let p = rest.into_iter().fold(f32x8::splat(first), |p, c| p * f + f32x8::splat(c));
    let exponent = cast::<f32x8, u32x8>(shifted) << 23_u32;
    cast(cast::<f32x8, u32x8>(p) + exponent)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_two_are_right_to_the_last_bits() {
        for k in 0..40_000 {
            let x = -125.9 + 126.9 * (k as f32 / 40_000.0);
            let [got, ..] = exp2(f32x8::splat(x)).to_array();
            let want = f64::from(x).exp2();
            assert!((f64::from(got) / want - 1.0).abs() < 3e-7, "2^{x} = {got}, not {want}");
        }
        let [tiny, ..] = exp2(f32x8::splat(-1e30)).to_array();
        assert_eq!(tiny.log2(), -126.0);
    }
}
