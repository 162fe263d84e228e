//! The eye close to Gaussians: the share of one that lies beyond the near distance, where the affine projection holds, the
//! dilation there, and the order of depth.
//!
//! Graphics devices have the same functions in `ray_project.wgsl` (sg-gpu).

use glam::{DVec2, DVec3};

/// Width of the near distance's own blur, as a share of it (standard deviation).
pub const NEAR_BLUR: f64 = 0.2;

/// Standard deviations to either side within which a Gaussian fades. There the smooth step has the slope of the normal
/// distribution's integral.
pub const FADE_WIDTH: f64 = 2.35;

/// Standard deviations around its centre that a Gaussian is taken to fill where it decides about fading.
pub const FADE_REACH: f64 = 6.0;

/// Size over view depth up to which the affine projection draws a Gaussian. Its rays evaluate a larger one. The size is the
/// root of the covariance's trace.
pub const AFFINE_SIZE: f64 = 0.1;

/// View depth over distance up to which a Gaussian that rays evaluate gets its whole perspective: its center is 84° beside the
/// axis or more. There f32 cannot evaluate less, and nothing of one small for its distance reaches a picture.
pub const STEEP: f64 = 0.1;

/// Near distances within which the affine projection orders and dilates as rays do, and beyond which as 3DGS does.
pub const RAY_RANGE: [f64; 2] = [96.0, 768.0];

/// The share of a Gaussian beyond the near distance. `ahead` is the distance of its densest place on the ray beyond the near
/// distance, in blurred standard deviations along the ray.
///
/// The part of a Gaussian's integral along a ray from there on is Φ(ahead). This is a polynomial within 0.024 of Φ: the
/// smooth step 6y⁵ − 15y⁴ + 10y³, exactly 0 and 1 from [`FADE_WIDTH`] on.
pub(crate) fn share_beyond(ahead: f64) -> f64 {
    let y = (ahead / (2.0 * FADE_WIDTH) + 0.5).clamp(0.0, 1.0);
    y * y * y * (y * (6.0 * y - 15.0) + 10.0)
}

/// Root of the trace of rows·rowsᵀ, in the scene's unit.
pub(crate) fn size_of(rows: &[DVec3; 3]) -> f64 {
    // Scaled, because the squares of very large or small axes leave f64.
    let most = rows.iter().map(|row| row.abs().max_element()).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    most * rows.iter().map(|row| (*row / most).length_squared()).sum::<f64>().sqrt()
}

/// Whether some ray may see less than all of a Gaussian of this size at this distance.
pub(crate) fn may_fade(distance: f64, size: f64, near: f64) -> bool {
    let beyond = distance - (1.0 + NEAR_BLUR * FADE_WIDTH) * near - (FADE_REACH + FADE_WIDTH) * size;
    // What is not a number fades.
    beyond.is_nan() || beyond < 0.0
}

/// Whether no ray sees anything of a Gaussian of this size at this distance: all of it is nearer than the near distance.
pub(crate) fn is_faded(distance: f64, size: f64, near: f64) -> bool {
    distance + FADE_REACH * size + FADE_WIDTH * size.hypot(NEAR_BLUR * near) <= near
}

/// How much of the perspective within a Gaussian its rays get: `None` where the affine projection draws it, else from 0 at the
/// limit of that projection to 1 at twice the limit. So nothing pops at the limit. Beside the eye it is 1 ([`STEEP`]).
pub(crate) fn perspective(center: DVec3, size: f64, near: f64) -> Option<f64> {
    let limit = AFFINE_SIZE * center.z;
    if may_fade(center.length(), size, near) {
        Some(1.0)
    } else if size < limit {
        None
    } else if center.z > STEEP * center.length() {
        Some((size / limit - 1.0).clamp(0.0, 1.0))
    } else {
        Some(1.0)
    }
}

/// How far the affine projection follows rays in its order and its dilation at a distance from the eye: 1 near it, 0 far
/// away or without a near distance.
pub(crate) fn ray_share(distance: f64, near: f64) -> f64 {
    let [begins, ends] = RAY_RANGE.map(|factor| factor * near);
    if distance >= ends {
        return 0.0;
    }
    // In the logarithm, so that the order rises along each ray of a picture up to 140° wide.
    ((ends / distance).ln() / (ends / begins).ln()).clamp(0.0, 1.0)
}

/// The number by which Gaussians are ordered, in the scene's unit: view z, and near the eye the distance, which a turn of the
/// head does not change.
///
/// The densest places of round Gaussians on one ray have the order of the centres' distances. By view z neighbours beside the
/// axis are in a wrong order. From afar view z is the order of 3DGS, the same for two eyes with parallel axes. Between lies a
/// continuous transition.
pub(crate) fn order(center: DVec3, near: f64) -> f64 {
    let distance = center.length();
    match ray_share(distance, near) {
        0.0 => center.z,
        share => center.z + share * (distance - center.z),
    }
}

/// The slope (x/z, y/z) at which the affine projection takes the dilation of a Gaussian at `center`: 0 is that of 3DGS, the
/// center's own slope that of rays.
///
/// The dilation of rays is an angle, the same in every direction. On the picture it is ε·(1 + |s|²)·(I + s·sᵀ) for the slope s,
/// by the Jacobian that the affine projection has for all of the Gaussian. `slopes` are those of the picture's corners. What
/// lies outside has the slope at its edge, because the Jacobian grows there without a bound.
pub(crate) fn dilation_slope(center: DVec3, slopes: [DVec2; 2], near: f64) -> DVec2 {
    let share = ray_share(center.length(), near);
    if share == 0.0 {
        return DVec2::ZERO;
    }
    let [a, b] = slopes;
    share.sqrt() * (center.truncate() / center.z).clamp(a.min(b), a.max(b))
}

/// An unsigned number in the order of an `order` narrowed to f32.
pub(crate) fn order_bits(order: f32) -> u32 {
    let bits = order.to_bits();
    if bits >> 31 == 1 { !bits } else { bits | 1 << 31 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_is_close_to_the_normal_distribution() {
        // Φ by Simpson's rule.
        let density = |x: f64| (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
        let mut phi = 0.0;
        let step = 1e-3;
        for k in 0..12_000 {
            let x = -6.0 + step * f64::from(k);
            assert!((share_beyond(x) - phi).abs() < 0.024, "{x}: {} {phi}", share_beyond(x));
            phi += step / 6.0 * (density(x) + 4.0 * density(x + 0.5 * step) + density(x + step));
        }
        assert_eq!((share_beyond(-FADE_WIDTH), share_beyond(FADE_WIDTH)), (0.0, 1.0));
        assert_eq!((share_beyond(f64::NEG_INFINITY), share_beyond(f64::INFINITY)), (0.0, 1.0));
    }

    #[test]
    fn the_order_is_continuous_and_rises_along_every_ray_of_a_wide_picture() {
        for angle in [0.0, 0.5, 1.0, 1.2_f64] {
            let at = |distance: f64| order(distance * DVec3::new(angle.sin(), 0.0, angle.cos()), 0.05);
            let mut last = at(0.0);
            for k in 1..100_000 {
                let next = at(1e-4 * f64::from(k));
                assert!(next > last && next - last < 4e-4, "{angle} {k}: {last} {next}");
                last = next;
            }
        }
    }

    #[test]
    fn bits_have_the_order_of_the_numbers() {
        let numbers = [f32::NEG_INFINITY, -1e30, -1.0, -1e-40, -0.0, 0.0, 1e-40, 1.0, 1e30, f32::INFINITY];
        assert!(numbers.windows(2).all(|pair| order_bits(pair[0]) < order_bits(pair[1])));
    }
}
