//! Gaussians moved by an affine map.

use glam::{DMat3, DMat4, DQuat, DVec3, Vec3};
use rayon::prelude::*;

use crate::splat::columns::{is_normal, normal_columns};
use crate::splat::harmonics_rotation::HarmonicsRotation;
use crate::splat::problem::{Warning, WarningCode};
use sg_scene::model::{ExtraValues, Gaussians};

/// Moves Gaussians with an affine map: covariances become A·Σ·Aᵀ.
pub(crate) fn transform(g: &mut Gaussians, map: &DMat4, name: &str, warnings: &mut Vec<Warning>) {
    g.position.par_iter_mut().for_each(|p| *p = map.transform_point3(p.as_dvec3()).as_vec3());
    let linear = DMat3::from_mat4(*map);
    let factor = linear.determinant().abs().cbrt();
    let orthogonal = linear * factor.recip();
    let residue = orthogonal * orthogonal.transpose() - DMat3::IDENTITY;
    let is_similarity = residue.to_cols_array().iter().all(|x| x.abs() < 1e-9);
    let turn = if is_similarity {
        // A point reflection leaves ellipsoids alone, so a mirrored map turns them as its negative does.
        let proper = if orthogonal.determinant() < 0.0 { -orthogonal } else { orthogonal };
        let turn = DQuat::from_mat3(&proper);
        let rotations: Vec<_> = (0..g.len()).into_par_iter().map(|i| wxyz(turn * g.unit_rotation(i))).collect();
        g.rotation = rotations;
        let shift = factor.ln() as f32;
        g.log_scale.par_iter_mut().for_each(|s| *s += shift);
        orthogonal
    } else {
        let bent: Vec<_> = (0..g.len()).into_par_iter().map(|i| bend(g, i, linear)).collect();
        (g.rotation, g.log_scale) = bent.into_iter().unzip();
        polar_factor(linear)
    };
    if let Some(h) = g.harmonics.as_mut().filter(|h| h.degree > 0) {
        HarmonicsRotation::new(turn).apply(h);
        if !is_similarity {
            let message = format!("unit `{name}` is stretched: its view-dependent colours are only turned");
            warnings.push(Warning::new(WarningCode::Lossy, message));
        }
    }
    transform_normals(g, linear.inverse().transpose());
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

fn transform_normals(g: &mut Gaussians, map: DMat3) {
    let columns: Vec<usize> =
        ["nx", "ny", "nz"].iter().filter_map(|n| g.extra.iter().position(|e| e.name == *n)).collect();
    let [x, y, z] = columns.as_slice() else { return };
    let values = |k: &usize| match g.extra.get(*k).map(|e| &e.values) {
        Some(ExtraValues::F32(v)) => Some(v.as_slice()),
        _ => None,
    };
    let (Some(nx), Some(ny), Some(nz)) = (values(x), values(y), values(z)) else { return };
    let turned: Vec<Vec3> = (nx.par_iter(), ny.par_iter(), nz.par_iter())
        .into_par_iter()
        .map(|(x, y, z)| (map * Vec3::new(*x, *y, *z).as_dvec3()).normalize_or_zero().as_vec3())
        .collect();
    g.extra.retain(|e| !is_normal(&e.name));
    g.extra.splice(0..0, normal_columns(&turned));
}

#[cfg(test)]
mod tests {
    use super::*;
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
            transform(&mut after, &affine, "u", &mut Vec::new());
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
}
