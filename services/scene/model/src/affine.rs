//! Gaussians moved by an affine map.

use glam::{DMat3, DMat4, DQuat, DVec3, Vec3};
use rayon::prelude::*;

use crate::harmonics_rotation::HarmonicsRotation;
use crate::model::{ExtraValues, Gaussians};

/// Names of a normal's columns in point clouds.
const NORMAL_COLUMNS: [&str; 3] = ["nx", "ny", "nz"];

/// Normals of an affinely transformed surface: the inverse transpose up to length, in a form that a singular transform
/// does not break.
#[derive(Debug, Clone, Copy)]
pub struct NormalTransform(DMat3);

impl NormalTransform {
    /// The transform for normals under a linear map: its inverse transpose.
    #[must_use]
    pub fn of(linear: DMat3) -> Self {
        // The cofactor matrix is det·A⁻ᵀ: finite for every A; a mirror's sign is taken out again.
        let DMat3 { x_axis: a, y_axis: b, z_axis: c } = linear;
        let cofactor = DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b));
        Self(if linear.determinant() < 0.0 { -1.0 * cofactor } else { cofactor })
    }

    /// Keeps the normal's length: a reader may have stored less than unit length if a file barely determines it.
    #[must_use]
    pub fn apply(&self, normal: DVec3) -> DVec3 {
        (self.0 * normal).normalize_or_zero() * normal.length()
    }

    /// Derivatives of a number by `normal`, from those by the result of [`Self::apply`]; 0 where the result is 0.
    #[must_use]
    pub fn gradient(&self, normal: DVec3, by_result: DVec3) -> DVec3 {
        let moved = self.0 * normal;
        let (length, moved_length) = (normal.length(), moved.length());
        if length == 0.0 || moved_length == 0.0 {
            return DVec3::ZERO;
        }
        let direction = moved / moved_length;
        let along = direction.dot(by_result);
        // The direction turns with the map; the length is that of the normal itself.
        self.0.transpose() * (by_result - along * direction) * (length / moved_length) + along * normal / length
    }
}

impl Gaussians {
    /// Moves the Gaussians of these indices, each once, by an affine map of the local frame: centres, covariances (A·Σ·Aᵀ),
    /// normals and view-dependent colours. Indices past the end are left out. The others keep their bits.
    ///
    /// Returns whether all columns are exact up to rounding. `false` says that the map stretches, and that view-dependent colours
    /// are only turned with it.
    pub fn transform(&mut self, rows: &[usize], map: &DMat4) -> bool {
        let rows: Vec<usize> = rows.iter().copied().filter(|i| *i < self.len()).collect();
        let linear = DMat3::from_mat4(*map);
        let factor = linear.determinant().abs().cbrt();
        let orthogonal = linear * factor.recip();
        let residue = orthogonal * orthogonal.transpose() - DMat3::IDENTITY;
        let is_similarity = residue.to_cols_array().iter().all(|x| x.abs() < 1e-9);
        replace(&mut self.position, &rows, |p| map.transform_point3(p.as_dvec3()).as_vec3());
        let turn = if is_similarity {
            // A point reflection leaves ellipsoids alone, so a mirrored map turns them as its negative does.
            let proper = if orthogonal.determinant() < 0.0 { -orthogonal } else { orthogonal };
            let turn = DQuat::from_mat3(&proper);
            let rotations: Vec<_> = rows.par_iter().map(|&i| wxyz(turn * self.unit_rotation(i))).collect();
            put(&mut self.rotation, &rows, rotations);
            let shift = factor.ln() as f32;
            replace(&mut self.log_scale, &rows, |s| s + shift);
            orthogonal
        } else {
            let bent: Vec<_> = rows.par_iter().map(|&i| bend(self, i, linear)).collect();
            let (rotations, scales) = bent.into_iter().unzip();
            put(&mut self.rotation, &rows, rotations);
            put(&mut self.log_scale, &rows, scales);
            polar_factor(linear)
        };
        let harmonics = self.harmonics.as_mut().filter(|h| h.degree > 0);
        let is_exact = is_similarity || harmonics.is_none();
        if let Some(harmonics) = harmonics {
            HarmonicsRotation::new(turn).apply(harmonics, &rows);
        }
        let normals = NormalTransform::of(linear);
        if let Some(shading) = &mut self.shading {
            replace(&mut shading.normal, &rows, |n| normals.apply(n.as_dvec3()).as_vec3());
        }
        self.transform_normal_columns(&rows, normals);
        is_exact
    }

    fn transform_normal_columns(&mut self, rows: &[usize], normals: NormalTransform) {
        let column = |name: &str| self.extra.iter().position(|e| e.name == name);
        let [Some(x), Some(y), Some(z)] = NORMAL_COLUMNS.map(column) else { return };
        let floats = |k: usize| match self.extra.get(k).map(|e| &e.values) {
            Some(ExtraValues::F32(values)) => Some(values),
            _ => None,
        };
        let (Some(nx), Some(ny), Some(nz)) = (floats(x), floats(y), floats(z)) else { return };
        let turned: Vec<Vec3> =
            rows.par_iter().map(|&i| normals.apply(Vec3::new(nx[i], ny[i], nz[i]).as_dvec3()).as_vec3()).collect();
        for (axis, column) in [x, y, z].into_iter().enumerate() {
            if let Some(ExtraValues::F32(values)) = self.extra.get_mut(column).map(|e| &mut e.values) {
                put(values, rows, turned.iter().map(|n| n[axis]).collect());
            }
        }
    }
}

/// Replaces the values of some rows by functions of them.
fn replace<T: Copy + Send + Sync>(values: &mut [T], rows: &[usize], new: impl Fn(T) -> T + Sync) {
    let replaced = rows.par_iter().map(|&i| new(values[i])).collect();
    put(values, rows, replaced);
}

/// Replaces the values of some rows.
fn put<T>(values: &mut [T], rows: &[usize], new: Vec<T>) {
    for (&i, value) in rows.iter().zip(new) {
        values[i] = value;
    }
}

fn wxyz(q: DQuat) -> [f32; 4] {
    [q.w as f32, q.x as f32, q.y as f32, q.z as f32]
}

/// Rotation and logarithm of the scale of A·Σ·Aᵀ.
fn bend(g: &Gaussians, i: usize, linear: DMat3) -> ([f32; 4], Vec3) {
    let scale = g.log_scale.get(i).copied().unwrap_or_default().as_dvec3().exp();
    let half = linear * DMat3::from_quat(g.unit_rotation(i)) * DMat3::from_diagonal(scale);
    let (columns, _) = one_sided_jacobi(half);
    let lengths = DVec3::new(columns.x_axis.length(), columns.y_axis.length(), columns.z_axis.length());
    let log_scale = DVec3::from_array(lengths.to_array().map(f64::ln));
    (wxyz(DQuat::from_mat3(&proper_axes(columns))), log_scale.as_vec3())
}

/// The rotation or reflection nearest to a map: U·Vᵀ of A = U·Σ·Vᵀ.
fn polar_factor(linear: DMat3) -> DMat3 {
    let (columns, v) = one_sided_jacobi(linear);
    DMat3::from_cols(
        columns.x_axis.normalize_or_zero(),
        columns.y_axis.normalize_or_zero(),
        columns.z_axis.normalize_or_zero(),
    ) * v.transpose()
}

/// U·Σ and V of M = U·Σ·Vᵀ (Hestenes 1958). Works on the factor of a covariance, so that flat Gaussians keep the digits
/// of their thickness.
fn one_sided_jacobi(mut m: DMat3) -> (DMat3, DMat3) {
    let mut v = DMat3::IDENTITY;
    for _ in 0..32 {
        let mut is_done = true;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (a, b) = (m.col(p), m.col(q));
            let overlap = a.dot(b);
            let is_apart = overlap.abs() > 1e-15 * a.length() * b.length();
            if !is_apart {
                continue;
            }
            is_done = false;
            let zeta = (b.length_squared() - a.length_squared()) / (2.0 * overlap);
            let t = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
            let c = t.hypot(1.0).recip();
            for matrix in [&mut m, &mut v] {
                let (a, b) = (matrix.col(p), matrix.col(q));
                *matrix.col_mut(p) = c * a - t * c * b;
                *matrix.col_mut(q) = t * c * a + c * b;
            }
        }
        if is_done {
            break;
        }
    }
    (m, v)
}

/// A right-handed orthonormal frame along orthogonal columns. Some columns may be zero.
fn proper_axes(columns: DMat3) -> DMat3 {
    let mut axes = [columns.x_axis, columns.y_axis, columns.z_axis].map(DVec3::normalize_or_zero);
    for k in 0..3 {
        if axes[k] == DVec3::ZERO {
            let (a, b) = (axes[(k + 1) % 3], axes[(k + 2) % 3]);
            axes[k] = match (a == DVec3::ZERO, b == DVec3::ZERO) {
                (false, false) => a.cross(b),
                (false, true) => a.any_orthonormal_vector(),
                (true, false) => b.any_orthonormal_vector(),
                (true, true) => DVec3::X,
            };
        }
    }
    let [x, y, z] = axes;
    DMat3::from_cols(x, y, if x.cross(y).dot(z) < 0.0 { -z } else { z })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{ExtraColumn, Harmonics, ShadingColumns};
    use proptest::prelude::*;

    fn gaussian(q: [f32; 4], log_scale: [f32; 3]) -> Gaussians {
        Gaussians {
            position: vec![Vec3::new(1.0, 2.0, 3.0)],
            rotation: vec![q],
            log_scale: vec![Vec3::from_array(log_scale)],
            opacity_logit: vec![0.5],
            ..Gaussians::default()
        }
    }

    fn relative_difference(a: DMat3, b: DMat3) -> f64 {
        let size = b.to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        (a - b).to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs())) / size
    }

    proptest! {
        #[test]
        fn a_moved_gaussian_has_the_moved_covariance(
            q in proptest::array::uniform4(-1.0_f32..1.0),
            log_scale in proptest::array::uniform3(-4.0_f32..2.0),
            map in proptest::array::uniform9(-2.0_f64..2.0),
            similar in any::<bool>(),
        ) {
            prop_assume!(q.iter().map(|x| x * x).sum::<f32>() > 0.01);
            let mut linear = DMat3::from_cols_array(&map);
            prop_assume!(linear.determinant().abs() > 0.05);
            if similar {
                linear = polar_factor(linear) * 1.7;
            }
            let before = gaussian(q, log_scale);
            let mut after = before.clone();
            let affine = DMat4::from_translation(DVec3::new(5.0, 6.0, 7.0)) * DMat4::from_mat3(linear);
            after.transform(&[0], &affine);
            let want = linear * before.covariance(0) * linear.transpose();
            prop_assert!(relative_difference(after.covariance(0), want) < 1e-5);
            let want = linear * DVec3::new(1.0, 2.0, 3.0) + DVec3::new(5.0, 6.0, 7.0);
            prop_assert!((after.position[0].as_dvec3() - want).length() < 1e-5 * want.length().max(1.0));
        }
    }

    #[test]
    fn flat_gaussians_keep_their_thickness_when_bent() {
        let flat = gaussian([0.3, 0.5, -0.2, 0.7], [0.0, 0.3, -20.0]);
        let (_, log_scale) = bend(&flat, 0, DMat3::from_diagonal(DVec3::new(1.0, 1.0, 1.0 + 1e-6)));
        let least = log_scale.min_element();
        assert!((least + 20.0).abs() < 1e-4, "{least}");
        // Through the covariance the thickness is lost: its square is below the rounding of the squared extent.
        let covariance = flat.covariance(0);
        let through_square = 0.5 * (covariance.determinant().abs() / (0.6_f64).exp()).ln();
        assert!((through_square + 20.0).abs() > 1.0, "{through_square}");
    }

    #[test]
    fn a_point_like_gaussian_stays_finite() {
        let point = gaussian([1.0, 0.0, 0.0, 0.0], [f32::NEG_INFINITY; 3]);
        let (q, _) = bend(&point, 0, DMat3::from_diagonal(DVec3::new(1.0, 2.0, 3.0)));
        assert!(q.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn normals_turn_shear_and_mirror_with_their_surface() {
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.5, 1.0, 0.0), DVec3::new(0.0, 0.0, 4.0));
        for linear in [DMat3::from_rotation_y(0.7), shear, DMat3::from_diagonal(DVec3::new(-1.0, 2.0, 3.0))] {
            let n = DVec3::new(0.3, -0.5, 0.8).normalize();
            let (s, t) = n.any_orthonormal_pair();
            let got = NormalTransform::of(linear).apply(n);
            assert!(got.dot(linear * s).abs() < 1e-12 && got.dot(linear * t).abs() < 1e-12);
            assert!((got.length() - 1.0).abs() < 1e-12);
            assert!(got.dot(linear * n) > 0.0, "the same side stays outside");
        }
        assert_eq!(NormalTransform::of(DMat3::ZERO).apply(DVec3::Z), DVec3::ZERO);
    }

    /// Four Gaussians with every kind of column that has a direction.
    fn with_directions() -> Gaussians {
        let normal = Vec3::new(0.6, 0.0, 0.8);
        let column = |name: &str, x| ExtraColumn { name: name.to_owned(), values: ExtraValues::F32(vec![x; 4]) };
        Gaussians {
            position: vec![Vec3::new(1.0, 2.0, 3.0); 4],
            rotation: vec![[0.3, 0.5, -0.2, 0.7]; 4],
            log_scale: vec![Vec3::new(-1.0, -2.0, -3.0); 4],
            opacity_logit: vec![0.5; 4],
            shading: Some(ShadingColumns {
                normal: vec![normal, normal, normal, Vec3::ZERO],
                ..ShadingColumns::default()
            }),
            harmonics: Some(Harmonics { degree: 1, dc: vec![[0.1; 3]; 4], rest: vec![[0.0, 1.0, 0.0]; 12] }),
            extra: vec![column("nx", 0.6), column("other", 7.0), column("ny", 0.0), column("nz", 0.8)],
            antialiased: false,
        }
    }

    #[test]
    fn only_the_given_rows_move_and_all_that_has_a_direction_turns() {
        let before = with_directions();
        let mut after = before.clone();
        let map = DMat4::from_scale_rotation_translation(
            DVec3::splat(2.0),
            DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2),
            DVec3::new(5.0, 0.0, 0.0),
        );
        assert!(after.transform(&[1, 3, 99], &map));
        for still in [0, 2] {
            assert_eq!(after.rows(&[still]), before.rows(&[still]), "{still}");
        }
        assert!((after.position[1] - Vec3::new(1.0, 2.0, 6.0)).length() < 1e-6, "{}", after.position[1]);
        assert!((after.log_scale[1] - before.log_scale[1] - Vec3::splat(2.0_f32.ln())).length() < 1e-6);
        let normals = after.shading.as_ref().map(|s| s.normal.clone()).unwrap_or_default();
        assert!((normals[1] - Vec3::new(0.0, 0.6, 0.8)).length() < 1e-6 && normals[3] == Vec3::ZERO, "{normals:?}");
        let column = |name: &str| match &after.extra.iter().find(|e| e.name == name).unwrap().values {
            ExtraValues::F32(values) => values.clone(),
            other => panic!("{other:?}"),
        };
        assert!((column("nx")[1]).abs() < 1e-6 && (column("ny")[1] - 0.6).abs() < 1e-6);
        assert_eq!((column("nx")[0], column("other")), (0.6, vec![7.0; 4]));
        // Coefficients of degree 1 are (-y, z, -x) of a vector: a quarter turn makes (1, -1, 1) of (-1, -1, 1).
        let turned = &after.harmonics.as_ref().unwrap().rest[3..6];
        let greens: Vec<f32> = turned.iter().map(|c| c[1]).collect();
        assert!((greens[0] - 1.0).abs() < 1e-6 && (greens[1] - 1.0).abs() < 1e-6 && (greens[2] + 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_stretching_map_says_that_view_dependent_colours_are_not_exact() {
        let stretch = DMat4::from_scale(DVec3::new(1.0, 1.0, 3.0));
        assert!(!with_directions().transform(&[0], &stretch));
        let plain = Gaussians { harmonics: None, ..with_directions() };
        assert!(plain.clone().transform(&[0], &stretch));
    }
}
