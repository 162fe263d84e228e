//! Feature vectors of Gaussians. Their Euclidean distance measures similarity.
//!
//! A Gaussian has 24 parametrisations (order and signs of its axes, ±q, ±n). The `oriented` and `invariant` forms do not
//! depend on the parametrisation in the file. The `printed` form is the literal vector of the paper and depends on it.

use std::ops::Range;

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sg_scene::model::BaseUnit;
use sg_scene::symmetric3::{StopRule, eigen_symmetric_3x3};

use crate::vertices::Vertices;

/// Columns of a feature row. Shorter forms are padded with zeros.
pub const WIDTH: usize = 16;

/// One feature vector.
pub type Row = [f32; WIDTH];

/// Form of the feature vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FeatureKind {
    /// `[½z, n, vech(Σ/tr Σ)]`, 1 + 3 + 6. The sign of the normal separates the two sides of a thin wall.
    Oriented,
    /// `[½z, vech(n nᵀ), vech(Σ/tr Σ)]`, 1 + 6 + 6. For normals without a meaningful sign.
    Invariant,
    /// `[s̄, n, aˣ, aʸ, aᶻ]`, 1 + 3 + 9. The literal form of the paper, with the raw mean scale in scene units.
    Printed,
}

impl FeatureKind {
    /// The default of a unit: `oriented` if its normals are oriented, else `invariant`.
    #[must_use]
    pub fn for_unit(unit: &BaseUnit) -> Self {
        if unit.oriented_normals && unit.gaussians.shading.is_some() { Self::Oriented } else { Self::Invariant }
    }

    /// Columns of the scale, of the normal and of the shape.
    #[must_use]
    pub fn blocks(self) -> [Range<usize>; 3] {
        match self {
            Self::Oriented => [0..1, 1..4, 4..10],
            Self::Invariant => [0..1, 1..7, 7..13],
            Self::Printed => [0..1, 1..4, 4..13],
        }
    }
}

/// Feature rows of the vertices of one unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Features {
    /// The form.
    pub kind: FeatureKind,
    /// One row per vertex.
    pub rows: Vec<Row>,
}

/// Squared Euclidean distance of two feature rows.
///
/// Four partial sums in f32 are joined in f64. The order of the additions is fixed, so results are reproducible to the bit.
#[inline]
#[must_use]
pub fn distance_squared(a: &Row, b: &Row) -> f64 {
    let mut sums = [0.0_f32; 4];
    for (a, b) in a.chunks_exact(4).zip(b.chunks_exact(4)) {
        for lane in 0..4 {
            let d = a[lane] - b[lane];
            sums[lane] += d * d;
        }
    }
    sums.iter().map(|&s| f64::from(s)).sum()
}

/// Smallest spread of log s̄. Smaller differences are rounding errors of the stored f32 scales.
const MIN_SPREAD: f64 = 1e-5;

/// The linear part of a unit's transform.
struct Frame {
    linear: DMat3,
    /// Scale factor of a similarity transform; `None` for other transforms.
    similarity: Option<f64>,
    /// Inverse transpose, for normals; `None` for a singular transform.
    normal: Option<DMat3>,
}

impl Frame {
    fn of(linear: DMat3) -> Self {
        let gram = linear.transpose() * linear;
        let factor_squared = (gram.x_axis.x + gram.y_axis.y + gram.z_axis.z) / 3.0;
        let off = (gram - DMat3::from_diagonal(DVec3::splat(factor_squared)))
            .to_cols_array()
            .iter()
            .fold(0.0_f64, |m, x| m.max(x.abs()));
        let similarity = (factor_squared > 0.0 && off <= 1e-9 * factor_squared).then(|| factor_squared.sqrt());
        let inverse = linear.inverse();
        Self { linear, similarity, normal: inverse.is_finite().then(|| inverse.transpose()) }
    }
}

/// Intermediate values of the features of one Gaussian.
struct Shape {
    /// Natural logarithm of the mean standard deviation; NaN for invalid scales.
    log_mean_scale: f64,
    /// Σ / tr Σ in the scene frame.
    covariance: DMat3,
    /// n nᵀ, of trace one.
    normal_projector: DMat3,
    /// The stored unit normal in the scene frame; zero without a normal.
    normal: DVec3,
    /// The axes in the stored order and with the stored signs, as columns in the scene frame.
    axes: DMat3,
    /// The axis of smallest scale.
    shortest: DVec3,
}

/// Features of a unit's vertices in the scene frame.
#[must_use]
pub fn features(unit: &BaseUnit, vertices: &Vertices, kind: FeatureKind) -> Features {
    let frame = Frame::of(DMat3::from_mat4(unit.transform));
    // Shapes are much larger than rows, so they are not stored.
    let (mut rows, log_mean_scales): (Vec<Row>, Vec<f64>) = vertices
        .gaussian
        .par_iter()
        .map(|&i| {
            let s = shape_of(unit, &frame, i as usize - unit.first);
            let mut row = [0.0; WIDTH];
            match kind {
                FeatureKind::Oriented => {
                    fill(&mut row, &[&[0.0], &s.normal.to_array(), &vech(&s.covariance)]);
                }
                FeatureKind::Invariant => {
                    fill(&mut row, &[&[0.0], &vech(&s.normal_projector), &vech(&s.covariance)]);
                }
                FeatureKind::Printed => {
                    let scale = s.log_mean_scale.exp();
                    let scale = if scale.is_finite() { scale.min(f64::from(f32::MAX)) } else { 0.0 };
                    let normal = if s.normal == DVec3::ZERO { s.shortest } else { s.normal };
                    fill(&mut row, &[&[scale], &normal.to_array(), &s.axes.to_cols_array()]);
                }
            }
            (row, s.log_mean_scale)
        })
        .unzip();
    if kind != FeatureKind::Printed {
        let (median, spread) = robust_spread(log_mean_scales.iter().copied().filter(|x| x.is_finite()).collect());
        rows.par_iter_mut().zip(&log_mean_scales).for_each(|(row, log)| {
            let z = if log.is_finite() { (log - median) / spread } else { 0.0 };
            row[0] = (0.5 * z.clamp(-4.0, 4.0)) as f32;
        });
    }
    Features { kind, rows }
}

fn fill(row: &mut Row, parts: &[&[f64]]) {
    for (to, from) in row.iter_mut().zip(parts.iter().flat_map(|p| p.iter())) {
        *to = *from as f32;
    }
}

/// Diagonal, then off-diagonals times √2. Its Euclidean distance is the Frobenius distance of the matrices.
fn vech(m: &DMat3) -> [f64; 6] {
    let r = std::f64::consts::SQRT_2;
    [m.x_axis.x, m.y_axis.y, m.z_axis.z, r * m.x_axis.y, r * m.x_axis.z, r * m.y_axis.z]
}

fn shape_of(unit: &BaseUnit, frame: &Frame, i: usize) -> Shape {
    let gaussians = &unit.gaussians;
    let axes = DMat3::from_quat(gaussians.unit_rotation(i));
    let log_scale = gaussians.log_scale[i].as_dvec3().to_array();
    // A scale of zero (logarithm −∞) is a flat Gaussian. NaN, +∞ and three zeros are invalid.
    let largest = log_scale.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let valid = log_scale.iter().all(|s| !s.is_nan()) && largest.is_finite();
    let relative = if valid { DVec3::from_array(log_scale.map(|s| (s - largest).exp())) } else { DVec3::ONE };
    let shortest_column = [relative.y < relative.x.min(relative.z), relative.z < relative.x.min(relative.y)];
    let linear = frame.linear;
    let turned = |axis: DVec3| (linear * axis).try_normalize().unwrap_or(axis);
    let scene_axes = DMat3::from_cols(turned(axes.x_axis), turned(axes.y_axis), turned(axes.z_axis));
    let shortest = match shortest_column {
        [true, _] => scene_axes.y_axis,
        [_, true] => scene_axes.z_axis,
        _ => scene_axes.x_axis,
    };

    let half = linear * axes * DMat3::from_diagonal(relative);
    let raw = half * half.transpose();
    let trace = raw.x_axis.x + raw.y_axis.y + raw.z_axis.z;
    let usable = valid && trace.is_finite() && trace > 0.0;
    let third = DMat3::from_diagonal(DVec3::splat(1.0 / 3.0));
    let covariance = if usable { raw * (1.0 / trace) } else { third };

    let log_mean_scale = if !usable {
        f64::NAN
    } else if let Some(factor) = frame.similarity {
        factor.ln() + largest + ((relative.x + relative.y + relative.z) / 3.0).ln()
    } else {
        let (values, _) = eigen_symmetric_3x3(covariance, StopRule::AbsoluteSums);
        let mean = values.iter().map(|v| v.max(0.0).sqrt()).sum::<f64>() / 3.0;
        largest + 0.5 * trace.ln() + mean.ln()
    };

    let stored = gaussians.shading.as_ref().map_or(DVec3::ZERO, |s| s.normal[i].as_dvec3());
    let normal = frame
        .normal
        .map(|n| n * stored)
        .filter(|n| n.is_finite())
        .and_then(DVec3::try_normalize)
        .unwrap_or(DVec3::ZERO);
    let normal_projector = if normal == DVec3::ZERO {
        if usable { shortest_projector(frame, &axes, relative, covariance) } else { third }
    } else {
        outer(normal)
    };
    Shape { log_mean_scale, covariance, normal_projector, normal, axes: scene_axes, shortest }
}

fn outer(n: DVec3) -> DMat3 {
    DMat3::from_cols(n * n.x, n * n.y, n * n.z)
}

/// Projector on the shortest axis, of trace one. Tied axes are averaged, so the order of the axes has no effect.
fn shortest_projector(frame: &Frame, axes: &DMat3, relative: DVec3, covariance: DMat3) -> DMat3 {
    let (values, vectors) = match frame.similarity {
        Some(factor) => {
            let squares = (relative * relative).to_array();
            (squares, frame.linear * *axes * (1.0 / factor))
        }
        None => eigen_symmetric_3x3(covariance, StopRule::AbsoluteSums),
    };
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let limit = least + 1e-6 * values.iter().copied().fold(0.0, f64::max);
    let mut sum = DMat3::ZERO;
    let mut count = 0.0;
    for (value, axis) in values.iter().zip([vectors.x_axis, vectors.y_axis, vectors.z_axis]) {
        if *value <= limit {
            sum += outer(axis);
            count += 1.0;
        }
    }
    sum * (1.0 / count)
}

/// Median and robust spread: the median absolute deviation, scaled to the standard deviation of a normal distribution.
///
/// The spread is at least [`MIN_SPREAD`], so a column of equal values stays zero.
fn robust_spread(mut values: Vec<f64>) -> (f64, f64) {
    let Some(middle) = median(&mut values) else { return (0.0, MIN_SPREAD) };
    for v in &mut values {
        *v = (*v - middle).abs();
    }
    (middle, (1.4826 * median(&mut values).unwrap_or(0.0)).max(MIN_SPREAD))
}

/// The median of finite values, with the mean of the middle two for an even count. `None` for an empty slice.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let half = values.len() / 2;
    let even = values.len().is_multiple_of(2);
    let (below, &mut upper, _) = values.select_nth_unstable_by(half, f64::total_cmp);
    let lower = if even { below.iter().copied().fold(f64::NEG_INFINITY, f64::max) } else { upper };
    Some(0.5 * lower + 0.5 * upper)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat4, DQuat, Vec3};
    use sg_scene::model::{Gaussians, ShadingColumns};
    use sg_scene::synthetic::{random_unit, unit_of};

    fn rows(unit: &BaseUnit, kind: FeatureKind) -> Vec<Row> {
        let (vertices, _) = Vertices::of_unit(unit);
        let f = features(unit, &vertices, kind);
        // In the order of the file.
        let mut out = vec![[0.0; WIDTH]; unit.gaussians.len()];
        for (&g, row) in vertices.gaussian.iter().zip(&f.rows) {
            out[g as usize] = *row;
        }
        out
    }

    fn worst(a: &[Row], b: &[Row]) -> f64 {
        a.iter().zip(b).map(|(a, b)| distance_squared(a, b).sqrt()).fold(0.0, f64::max)
    }

    /// Same ellipsoids, axes permuted and signs flipped, quaternions negated and rescaled.
    fn reparametrised(unit: &BaseUnit) -> BaseUnit {
        let mut other = unit.clone();
        for i in 0..unit.gaussians.len() {
            let axes = DMat3::from_quat(unit.gaussians.unit_rotation(i));
            let s = unit.gaussians.log_scale[i];
            // Cyclic permutation keeps the handedness; flipping two columns does too.
            let (m, s) = if i % 2 == 0 {
                (DMat3::from_cols(axes.y_axis, axes.z_axis, axes.x_axis), Vec3::new(s.y, s.z, s.x))
            } else {
                (DMat3::from_cols(-axes.x_axis, -axes.y_axis, axes.z_axis), s)
            };
            let q = DQuat::from_mat3(&m) * if i % 3 == 0 { -1.0 } else { 1.0 };
            let k = [1.0, 1e-3, 50.0][i % 3];
            other.gaussians.rotation[i] = [q.w * k, q.x * k, q.y * k, q.z * k].map(|x| x as f32);
            other.gaussians.log_scale[i] = s;
        }
        other
    }

    #[test]
    fn a_reparametrised_scene_has_the_same_features_but_not_in_the_printed_form() {
        let unit = random_unit(500, 7);
        let other = reparametrised(&unit);
        let invariant = worst(&rows(&unit, FeatureKind::Invariant), &rows(&other, FeatureKind::Invariant));
        let printed = worst(&rows(&unit, FeatureKind::Printed), &rows(&other, FeatureKind::Printed));
        println!("moved by re-parametrisation: invariant {invariant:.2e}, printed {printed:.2}");
        assert!(invariant < 1e-5, "{invariant}");
        assert!(printed > 1.0, "the test scene must be one where the literal form moves");
    }

    #[test]
    fn distances_survive_a_rigid_motion_given_as_transform() {
        let unit = random_unit(200, 3);
        let mut moved = unit.clone();
        let q = DQuat::from_xyzw(0.2, -0.5, 0.3, 0.7).normalize();
        moved.transform = DMat4::from_scale_rotation_translation(DVec3::splat(2.5), q, DVec3::new(1e7, -3.0, 4.0));
        for kind in [FeatureKind::Oriented, FeatureKind::Invariant] {
            let (a, b) = (rows(&unit, kind), rows(&moved, kind));
            let mut error = 0.0_f64;
            for i in 1..a.len() {
                error = error.max((distance_squared(&a[0], &a[i]) - distance_squared(&b[0], &b[i])).abs());
            }
            assert!(error < 1e-5, "{kind:?}: {error}");
        }
    }

    #[test]
    fn a_sheared_unit_uses_the_transformed_covariance() {
        let unit = random_unit(50, 4);
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.8, 1.0, 0.0), DVec3::new(0.0, 0.3, 2.0));
        let mut moved = unit.clone();
        moved.transform = DMat4::from_mat3(shear);
        let frame = Frame::of(shear);
        assert!(frame.similarity.is_none());
        for i in 0..unit.gaussians.len() {
            let want = shear * unit.gaussians.covariance(i) * shear.transpose();
            let got = shape_of(&moved, &frame, i);
            let trace = want.x_axis.x + want.y_axis.y + want.z_axis.z;
            let error =
                (got.covariance - want * (1.0 / trace)).to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            assert!(error < 1e-12, "{error}");
            let (values, vectors) = eigen_symmetric_3x3(want, StopRule::AbsoluteSums);
            let again = vectors * DMat3::from_diagonal(DVec3::from_array(values)) * vectors.transpose();
            let error = (again - want).to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            assert!(error < 1e-12 * trace, "{error}");
            let mean = values.iter().map(|v| v.sqrt()).sum::<f64>() / 3.0;
            assert!((got.log_mean_scale - mean.ln()).abs() < 1e-9);
        }
    }

    #[test]
    fn unusable_scales_and_rotations_give_finite_features() {
        let n = 8;
        let ls = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -13.8, 6.9, 300.0, -300.0];
        let g = Gaussians {
            position: (0..n).map(|i| Vec3::splat(i as f32)).collect(),
            rotation: vec![
                [0.0; 4],
                [f32::NAN; 4],
                [1e-42, 0.0, 1e-42, 0.0],
                [3e38, 3e38, 0.0, 0.0],
                [1.0, 0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0, 0.0],
                [1.0, 1.0, 0.0, 0.0],
                [1.0, 0.0, 1.0, 0.0],
            ],
            log_scale: ls.iter().map(|&s| Vec3::new(s, s - 1.0, s)).collect(),
            opacity_logit: vec![f32::NAN; n],
            ..Gaussians::default()
        };
        let unit = unit_of(g);
        for kind in [FeatureKind::Oriented, FeatureKind::Invariant, FeatureKind::Printed] {
            for row in rows(&unit, kind) {
                assert!(row.iter().all(|x| x.is_finite()), "{kind:?}: {row:?}");
            }
        }
    }

    #[test]
    fn equal_scales_give_a_zero_column_not_noise() {
        let mut unit = random_unit(64, 5);
        for (i, s) in unit.gaussians.log_scale.iter_mut().enumerate() {
            // The same three numbers in another order: their sum rounds differently.
            let t = [0.1, 0.7, 0.3];
            *s = Vec3::new(t[i % 3], t[(i + 1) % 3], t[(i + 2) % 3]);
        }
        let worst = rows(&unit, FeatureKind::Invariant).iter().map(|r| r[0].abs()).fold(0.0, f32::max);
        assert!(worst < 1e-4, "{worst}");
    }

    #[test]
    fn a_missing_normal_is_the_shortest_axis_without_sign() {
        let mut unit = random_unit(1, 1);
        unit.gaussians.rotation[0] = [1.0, 0.0, 0.0, 0.0];
        unit.gaussians.log_scale[0] = Vec3::new(0.0, -2.0, 0.5);
        unit.gaussians.shading = None;
        let row = rows(&unit, FeatureKind::Invariant)[0];
        assert_eq!(row[1..7], [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
        // All axes equal: no direction is preferred.
        unit.gaussians.log_scale[0] = Vec3::ZERO;
        let row = rows(&unit, FeatureKind::Invariant)[0];
        assert!(row[1..4].iter().all(|x| (x - 1.0 / 3.0).abs() < 1e-6));
        // A zero normal among oriented ones is no direction at all.
        unit.gaussians.shading = Some(ShadingColumns { normal: vec![Vec3::ZERO], ..ShadingColumns::default() });
        assert_eq!(rows(&unit, FeatureKind::Oriented)[0][1..4], [0.0; 3]);
    }

    #[test]
    fn medians_are_those_of_numpy() {
        assert_eq!(median(&mut []), None);
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), Some(2.5));
    }
}
