//! Eigendecomposition of symmetric 3×3 matrices.

use glam::DMat3;

/// Most sweeps; a few suffice for f64.
const MAX_SWEEPS: usize = 32;

/// Eigenvalues and orthonormal eigenvectors (columns) of a symmetric matrix, by cyclic Jacobi rotations.
///
/// The pairs are not sorted: the order follows the diagonal of the matrix. The lower and the upper triangle must agree.
///
/// ```
/// use glam::{DMat3, DVec3};
/// use sg_scene::symmetric3::eigen_symmetric_3x3;
///
/// let m = DMat3::from_cols(DVec3::new(2.0, 1.0, 0.0), DVec3::new(1.0, 2.0, 0.0), DVec3::new(0.0, 0.0, 5.0));
/// let (values, vectors) = eigen_symmetric_3x3(m);
/// let mut sorted = values;
/// sorted.sort_by(f64::total_cmp);
/// assert!(sorted.iter().zip([1.0, 3.0, 5.0]).all(|(a, b)| (a - b).abs() < 1e-14));
/// let again = vectors * DMat3::from_diagonal(DVec3::from_array(values)) * vectors.transpose();
/// assert!(again.abs_diff_eq(m, 1e-14));
/// ```
#[must_use]
pub fn eigen_symmetric_3x3(m: DMat3) -> ([f64; 3], DMat3) {
    let mut a = m.to_cols_array_2d();
    let mut v = DMat3::IDENTITY.to_cols_array_2d();
    for _ in 0..MAX_SWEEPS {
        let off = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
        if off <= 1e-300 || off <= 1e-16 * (a[0][0].abs() + a[1][1].abs() + a[2][2].abs()) {
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
    use super::*;
    use glam::DVec3;

    #[test]
    fn the_decomposition_reproduces_the_matrix() {
        let square = |m: DMat3| m * m.transpose();
        for m in [
            DMat3::ZERO,
            DMat3::IDENTITY,
            DMat3::from_diagonal(DVec3::new(3.0, -1.0, 1e-12)),
            square(DMat3::from_cols(DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 0.5, 6.0), DVec3::new(7.0, 8.0, -9.0))),
            square(DMat3::from_cols(DVec3::new(1e-6, 0.0, 1e3), DVec3::new(1.0, 1.0, 1.0), DVec3::new(0.0, 1e-9, 2.0))),
        ] {
            let (values, vectors) = eigen_symmetric_3x3(m);
            let scale = m.to_cols_array().iter().fold(1e-300_f64, |a, x| a.max(x.abs()));
            let again = vectors * DMat3::from_diagonal(DVec3::from_array(values)) * vectors.transpose();
            assert!(again.abs_diff_eq(m, 1e-14 * scale), "{again} for {m}");
            assert!((vectors * vectors.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-14));
        }
    }
}
