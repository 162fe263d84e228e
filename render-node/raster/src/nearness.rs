//! The eye close to Gaussians: the share of one that lies beyond the near distance, where the affine projection holds, and
//! the order of depth.
//!
//! Graphics devices have the same functions in `ray_project.wgsl` (sg-gpu).

use glam::DVec3;

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

/// Near distances within which the order is by distance, and beyond which it is by view z.
pub const ORDER_RANGE: [f64; 2] = [16.0, 128.0];

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
/// limit of that projection to 1 at twice the limit. So nothing pops at the limit.
pub(crate) fn perspective(center: DVec3, size: f64, near: f64) -> Option<f64> {
    let limit = AFFINE_SIZE * center.z;
    if may_fade(center.length(), size, near) {
        Some(1.0)
    } else if size < limit {
        None
    } else if center.z > 0.0 {
        Some((size / limit - 1.0).clamp(0.0, 1.0))
    } else {
        Some(1.0)
    }
}

/// The number by which Gaussians are ordered, in the scene's unit: view z, and near the eye the distance, which a turn of the
/// head does not change.
///
/// Neighbours on a wall that the eye sees at a grazing angle are in a wrong order by view z. From afar view z is the order of
/// 3DGS, the same for two eyes with parallel axes. Between lies a continuous transition.
pub(crate) fn order(center: DVec3, near: f64) -> f64 {
    let distance = center.length();
    let [begins, ends] = ORDER_RANGE.map(|factor| factor * near);
    if distance >= ends {
        return center.z;
    }
    // In the logarithm, so that the number rises along each ray of a picture up to 140° wide.
    let by_distance = ((ends / distance).ln() / (ends / begins).ln()).clamp(0.0, 1.0);
    center.z + by_distance * (distance - center.z)
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
