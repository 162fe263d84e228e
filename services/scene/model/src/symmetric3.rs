//! Eigendecomposition of symmetric 3×3 matrices.

use glam::DMat3;

/// The end of the iteration: the size of the remaining off-diagonal entries, relative to the diagonal.
///
/// Both rules reach the precision of f64. They differ in the last bits of a result, so a stored result depends on its rule.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopRule {
    /// Σ|off-diagonal| ≤ 10⁻¹⁶·Σ|diagonal|, after at most 32 sweeps. The largest entry must lie between 10⁻²⁸⁰ and 10³⁰⁰ in size.
    AbsoluteSums,
    /// Σ off-diagonal² ≤ 10⁻³⁰·Σ diagonal², after at most 16 sweeps; it often saves a sweep. The squares must neither overflow
    /// nor underflow, so the largest entry must lie between 10⁻¹³⁰ and 10¹⁵⁰ in size.
    SumsOfSquares,
}

impl StopRule {
    /// Largest number of sweeps; a few suffice for f64.
    fn max_sweeps(self) -> usize {
        match self {
            Self::AbsoluteSums => 32,
            Self::SumsOfSquares => 16,
        }
    }

    fn is_met(self, a: &[[f64; 3]; 3]) -> bool {
        match self {
            Self::AbsoluteSums => {
                let off = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
                off <= 1e-300 || off <= 1e-16 * (a[0][0].abs() + a[1][1].abs() + a[2][2].abs())
            }
            Self::SumsOfSquares => {
                let off = a[0][1].powi(2) + a[0][2].powi(2) + a[1][2].powi(2);
                let on = a[0][0].powi(2) + a[1][1].powi(2) + a[2][2].powi(2);
                off <= 1e-30 * on
            }
        }
    }
}

/// Eigenvalues and orthonormal eigenvectors (columns) of a symmetric matrix, by cyclic Jacobi rotations.
///
/// The pairs are not sorted: the order follows the diagonal of the matrix. The lower and the upper triangle must agree. Errors
/// are relative to the largest eigenvalue, so an eigenvalue 10¹⁶ times smaller has no correct digit.
///
/// ```
/// use glam::{DMat3, DVec3};
/// use sg_scene::symmetric3::{StopRule, eigen_symmetric_3x3};
///
/// let m = DMat3::from_cols(DVec3::new(2.0, 1.0, 0.0), DVec3::new(1.0, 2.0, 0.0), DVec3::new(0.0, 0.0, 5.0));
/// let (values, vectors) = eigen_symmetric_3x3(m, StopRule::AbsoluteSums);
/// let mut sorted = values;
/// sorted.sort_by(f64::total_cmp);
/// assert!(sorted.iter().zip([1.0, 3.0, 5.0]).all(|(a, b)| (a - b).abs() < 1e-14));
/// let again = vectors * DMat3::from_diagonal(DVec3::from_array(values)) * vectors.transpose();
/// assert!(again.abs_diff_eq(m, 1e-14));
/// ```
#[must_use]
pub fn eigen_symmetric_3x3(m: DMat3, stop: StopRule) -> ([f64; 3], DMat3) {
    let mut a = m.to_cols_array_2d();
    let mut v = DMat3::IDENTITY.to_cols_array_2d();
    for _ in 0..stop.max_sweeps() {
        if stop.is_met(&a) {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            for k in 0..3 {
                (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
                (v[p][k], v[q][k]) = (c * v[p][k] - s * v[q][k], s * v[p][k] + c * v[q][k]);
            }
        }
    }
    ([a[0][0], a[1][1], a[2][2]], DMat3::from_cols_array_2d(&v))
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3, Vec3};
    use proptest::prelude::*;

    use super::*;
    use crate::model::Gaussians;

    const RULES: [StopRule; 2] = [StopRule::AbsoluteSums, StopRule::SumsOfSquares];

    /// Largest absolute entry.
    fn size(m: DMat3) -> f64 {
        m.to_cols_array().iter().fold(0.0, |largest: f64, x| largest.max(x.abs()))
    }

    /// The symmetric matrix of an upper triangle.
    fn symmetric([xx, yy, zz, xy, xz, yz]: [f64; 6]) -> DMat3 {
        DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz))
    }

    /// Checks the defining properties: finite values, VᵀV = 1, and A·v = λ·v to rounding of the largest entry.
    fn check(m: DMat3, stop: StopRule) -> Result<[f64; 3], TestCaseError> {
        let (values, vectors) = eigen_symmetric_3x3(m, stop);
        prop_assert!(values.iter().all(|v| v.is_finite()), "{:?} for {}", values, m);
        let product = vectors.transpose() * vectors;
        prop_assert!(product.abs_diff_eq(DMat3::IDENTITY, 4e-15), "{} for {}", product, m);
        let residual = m * vectors - vectors * DMat3::from_diagonal(DVec3::from_array(values));
        prop_assert!(size(residual) <= 8e-15 * size(m), "{:?}: residual {} for {}", stop, residual, m);
        Ok(values)
    }

    fn sorted(mut values: [f64; 3]) -> [f64; 3] {
        values.sort_by(f64::total_cmp);
        values
    }

    fn any_rotation() -> impl Strategy<Value = DQuat> {
        prop::array::uniform4(-1.0..1.0_f64)
            .prop_map(DQuat::from_array)
            .prop_filter("long enough", |q| q.length() > 0.1)
            .prop_map(DQuat::normalize)
    }

    proptest! {
        #[test]
        fn eigenpairs_of_any_matrix(entries in prop::array::uniform6(-1.0..1.0_f64), exponent in -30..=30) {
            for stop in RULES {
                check(symmetric(entries) * 10.0_f64.powi(exponent), stop)?;
            }
        }

        /// Rows and columns of very different size, so that entries span 60 orders of magnitude.
        #[test]
        fn eigenpairs_of_badly_scaled_matrices(
            entries in prop::array::uniform6(-1.0..1.0_f64),
            exponents in prop::array::uniform3(-15..=15),
        ) {
            let scale = DMat3::from_diagonal(DVec3::from_array(exponents.map(|e| 10.0_f64.powi(e))));
            for stop in RULES {
                check(scale * symmetric(entries) * scale, stop)?;
            }
        }

        /// Values that coincide, almost coincide, vanish or are negative.
        #[test]
        fn degenerate_matrices_keep_their_values(
            rotation in any_rotation(),
            value in -1.0..1.0_f64,
            gap in prop::sample::select(vec![0.0, 1e-300, 1e-17, 1e-15, 1e-12, 1e-6]),
            pattern in 0..5,
            exponent in -30..=30,
        ) {
            let unit = 10.0_f64.powi(exponent);
            let values = match pattern {
                0 => [value, value, value + gap],
                1 => [value, value + gap, 1.0],
                2 => [0.0, gap, value],
                3 => [value, -value, gap],
                _ => [0.0, 0.0, 0.0],
            }.map(|v| v * unit);
            let turn = DMat3::from_quat(rotation);
            let m = turn * DMat3::from_diagonal(DVec3::from_array(values)) * turn.transpose();
            let m = (m + m.transpose()) * 0.5;
            for stop in RULES {
                let found = check(m, stop)?;
                let largest = values.iter().fold(0.0, |a: f64, v| a.max(v.abs()));
                for (a, b) in sorted(found).iter().zip(sorted(values)) {
                    prop_assert!((a - b).abs() <= 8e-15 * largest, "{:?}: {:?} for {:?}", stop, found, values);
                }
            }
        }

        /// Both rules agree to rounding, whatever the last bits are.
        #[test]
        fn stop_rules_agree(entries in prop::array::uniform6(-1.0..1.0_f64)) {
            let m = symmetric(entries);
            let [a, b] = RULES.map(|stop| eigen_symmetric_3x3(m, stop).0);
            for (a, b) in a.iter().zip(b) {
                prop_assert!((a - b).abs() <= 4e-15 * size(m), "{} and {}", a, b);
            }
        }

        /// Columns of a scene are f32. The covariance and its eigenvalues are f64, so that the scales are recovered.
        #[test]
        fn the_covariance_of_an_f32_gaussian_has_its_scales(
            rotation in prop::array::uniform4(-1.0..1.0_f32),
            log_scale in prop::array::uniform3(-6.0..3.0_f32),
        ) {
            prop_assume!(rotation.iter().map(|x| x * x).sum::<f32>() > 0.01);
            let gaussians = Gaussians {
                position: vec![Vec3::ZERO],
                rotation: vec![rotation],
                log_scale: vec![Vec3::from_array(log_scale)],
                opacity_logit: vec![0.0],
                ..Gaussians::default()
            };
            let squares = log_scale.map(|s| (2.0 * f64::from(s)).exp());
            let largest = squares.iter().fold(0.0, |a: f64, b| a.max(*b));
            for stop in RULES {
                let found = check(gaussians.covariance(0), stop)?;
                for (a, b) in sorted(found).iter().zip(sorted(squares)) {
                    prop_assert!((a - b).abs() <= 2e-14 * largest, "{:?} for {:?}", found, squares);
                }
            }
        }
    }

    #[test]
    fn f32_would_lose_the_thickness_of_a_flat_gaussian() {
        let turn = DMat3::from_quat(DQuat::from_xyzw(0.3, -0.5, 0.1, 0.8).normalize());
        let squares = DVec3::new(1.0, 0.5, 1e-8);
        let m = turn * DMat3::from_diagonal(squares) * turn.transpose();
        let rounded = m.as_mat3().as_dmat3();
        for stop in RULES {
            let least = |m| sorted(eigen_symmetric_3x3(m, stop).0)[0];
            assert!((least(m) / squares.z - 1.0).abs() < 1e-6, "{}", least(m));
            assert!((least(rounded) / squares.z - 1.0).abs() > 0.1, "{}", least(rounded));
        }
    }

    #[test]
    fn diagonal_matrices_are_returned_as_they_are() {
        for diagonal in [DVec3::ZERO, DVec3::ONE, DVec3::new(3.0, -1.0, 1e-12), DVec3::new(1e30, 1e-30, 0.0)] {
            for stop in RULES {
                let found = eigen_symmetric_3x3(DMat3::from_diagonal(diagonal), stop);
                assert_eq!(found, (diagonal.to_array(), DMat3::IDENTITY));
            }
        }
    }

    #[test]
    fn matrices_that_are_not_finite_end_after_the_last_sweep() {
        for entry in [f64::NAN, f64::INFINITY] {
            for stop in RULES {
                let (values, _) = eigen_symmetric_3x3(symmetric([1.0, 2.0, 3.0, entry, 0.5, 0.25]), stop);
                assert!(values.iter().any(|v| !v.is_finite()), "{values:?}");
            }
        }
    }
}
