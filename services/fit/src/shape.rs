//! The Gaussian of a cell: position, axes, opacity, colour and normal.

use std::f64::consts::TAU;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use rayon::prelude::*;
use sg_reclassify::optical_depth::opacity_of;
use sg_reclassify::sources::Source;
use sg_scene::symmetric3::{StopRule, eigen_symmetric_3x3};
use sg_volume::opacity::extinction;
use sg_volume::{Classifier, Surfaceness};

use crate::pieces::Pieces;
use crate::placement::Cells;

/// Standard deviation of a Gaussian relative to that of its cell, for a nearly clear cell. A cell of a regular tiling has
/// h/√12, so the Gaussian has about 0.45 h.
const OVERLAP_CLEAR: f64 = 1.55;
/// The ratio for an opaque cell: an opaque Gaussian covers more than one standard deviation.
const OVERLAP_OPAQUE: f64 = 1.35;
/// Further optical depth at a clear boundary, relative to that of its cell. One layer of Gaussians is uneven, and an uneven
/// layer of the same mean depth lets more light through.
const SURFACE_DEPTH: f64 = 0.2;
/// Least length of an axis, relative to the middle one.
const LEAST_RATIO: f64 = 0.2;
/// Largest length of an axis, relative to the next one.
const MOST_RATIO: f64 = 3.0;
/// One Gaussian, in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Splat {
    pub(crate) position: DVec3,
    /// Standard deviations along the rotated axes, the shortest last.
    pub(crate) scale: DVec3,
    pub(crate) rotation: DQuat,
    pub(crate) opacity: f64,
    pub(crate) color: Vec3,
    /// Unit normal towards falling values, or zero.
    pub(crate) normal: Vec3,
    /// Surfaceness: 0 homogeneous or noise, 1 a clear boundary.
    pub(crate) surfaceness: f32,
    /// Importance of its cell.
    pub(crate) weight: f64,
    /// Share of that importance within two standard deviations.
    pub(crate) captured: f64,
    /// What it keeps of the volume.
    pub(crate) source: Source,
}

/// Builds the Gaussians of cells.
pub(crate) struct GaussianBuilder<'a, P> {
    pub(crate) pieces: &'a P,
    pub(crate) classifier: &'a Classifier,
    /// The rule for the length of a gradient.
    pub(crate) surfaceness: &'a Surfaceness,
    /// Thickness along the gradient at a clear boundary, relative to that of the cell.
    pub(crate) flattening: f64,
    /// Whether cells without visible opacity become Gaussians too.
    pub(crate) keeps_hidden: bool,
    /// One colour for all of them, in place of those of the transfer function.
    pub(crate) color: Option<Vec3>,
}

/// Sums over the pieces of a cell.
#[derive(Default)]
struct Moments {
    weight: f64,
    /// ∫ extinction dV.
    integrated_extinction: f64,
    position: DVec3,
    color: DVec3,
    gradient: DVec3,
    gradient_length: f64,
    /// Relative rise of the value across one voxel.
    rise: f64,
    /// Volume in shares, and the mean and the sum of squared deviations of the raw values in it (Welford 1962).
    volume: f64,
    value: f64,
    squares: f64,
}

impl Moments {
    /// Length of the mean gradient over the mean length of the gradients.
    fn consistency(&self) -> f64 {
        self.gradient.length() / self.gradient_length.max(f64::MIN_POSITIVE)
    }
}

impl<P: Pieces> GaussianBuilder<'_, P> {
    /// The Gaussians of all cells that have one, in their order.
    pub(crate) fn splats(&self, cells: &Cells) -> Vec<Splat> {
        let each = (0..cells.len()).into_par_iter().with_min_len(64);
        each.filter_map(|i| self.splat(cells.points(i))).collect()
    }

    /// The Gaussian of the cell with the sample points `members`; `None` for a transparent cell.
    fn splat(&self, members: &[u32]) -> Option<Splat> {
        let (unit_volume, reference) = (self.pieces.unit_volume(), self.pieces.reference_length());
        let mut sums = Moments::default();
        for &point in members {
            self.pieces.for_each(point, |piece| {
                let (raw, gradient) = self.pieces.value_and_gradient(&piece);
                let (color, opacity) = self.classifier.evaluate(raw);
                let color = self.color.unwrap_or(color);
                let w = f64::from(piece.weight);
                sums.weight += w;
                sums.integrated_extinction += f64::from(extinction(opacity, reference)) * piece.share * unit_volume;
                sums.position += w * piece.place;
                sums.color += w * color.as_dvec3();
                sums.gradient += w * gradient.as_dvec3();
                sums.gradient_length += w * f64::from(gradient.length());
                sums.rise += w * f64::from(self.surfaceness.rise(raw, gradient.length()));
                if raw.is_finite() && piece.share > 0.0 {
                    sums.volume += piece.share;
                    let step = raw - sums.value;
                    sums.value += step * piece.share / sums.volume;
                    sums.squares += piece.share * step * (raw - sums.value);
                }
            });
        }
        if !(sums.weight > 0.0 && (sums.integrated_extinction > 0.0 || self.keeps_hidden)) {
            return None;
        }
        let to_world = self.pieces.to_world();
        let mean = sums.position / sums.weight;
        let covariance = self.covariance(members, mean, sums.weight, to_world.matrix3);
        let (normal, surfaceness) = self.normal_and_surfaceness(&sums);
        let flat = 1.0 - surfaceness * (1.0 - self.flattening);
        let squeeze = DMat3::IDENTITY - outer(normal) * (1.0 - flat);
        let (lengths, axes) = principal_axes(squeeze * covariance * squeeze);
        let lengths = limited(lengths.map(|l| l.max(0.0).sqrt()));
        let density = sums.integrated_extinction / (TAU * lengths.x * lengths.y);
        let scale = lengths * (OVERLAP_CLEAR + (OVERLAP_OPAQUE - OVERLAP_CLEAR) * smoothstep(1.0, 5.0, density));
        // Along its shortest axis, the optical depth of a Gaussian of opacity o integrates to 2π·s₁·s₂·Li₂(o) over the
        // image. Away from surfaces this integral must equal the integrated extinction of the cell.
        let depth_factor = 1.0 + SURFACE_DEPTH * surfaceness;
        let depth = sums.integrated_extinction * depth_factor;
        let opacity = opacity_of(depth / (TAU * scale.x * scale.y));
        let rotation = DQuat::from_mat3(&oriented(axes, normal));
        let captured = self.captured(members, mean, to_world, rotation, scale) / sums.weight;
        Some(Splat {
            position: to_world.transform_point3(self.held_place(members, mean)),
            scale,
            rotation,
            opacity,
            color: (sums.color / sums.weight).as_vec3(),
            normal: normal.as_vec3(),
            surfaceness: surfaceness as f32,
            weight: sums.weight,
            captured,
            source: Source {
                value: sums.value,
                spread: (sums.squares / sums.volume.max(f64::MIN_POSITIVE)).sqrt(),
                gradient: sums.gradient.length() / sums.weight * unit_volume.cbrt(),
                consistency: sums.consistency(),
                surfaceness,
                depth: sums.volume * unit_volume / reference * depth_factor / (TAU * scale.x * scale.y),
            },
        })
    }

    /// A place for the Gaussian of a cell with this centroid: the centroid, or the nearest piece if other data lie there.
    fn held_place(&self, members: &[u32], mean: DVec3) -> DVec3 {
        if self.pieces.holds(mean) {
            return mean;
        }
        let mut best = (f64::INFINITY, mean);
        for &point in members {
            self.pieces.for_each(point, |piece| {
                let distance = piece.place.distance_squared(mean);
                if distance < best.0 {
                    best = (distance, piece.place);
                }
            });
        }
        best.1
    }

    /// Covariance of a cell's importance in world space, with the extent of its pieces.
    fn covariance(&self, members: &[u32], mean: DVec3, weight: f64, to_world: DMat3) -> DMat3 {
        let mut sum = DMat3::ZERO;
        for &point in members {
            self.pieces.for_each(point, |piece| {
                sum += (outer(piece.place - mean) + self.pieces.extent(&piece)) * f64::from(piece.weight);
            });
        }
        to_world * (sum * (1.0 / weight)) * to_world.transpose()
    }

    /// Importance of a cell within two standard deviations of its Gaussian.
    fn captured(&self, members: &[u32], mean: DVec3, to_world: DAffine3, rotation: DQuat, scale: DVec3) -> f64 {
        let mut inside = 0.0;
        for &point in members {
            self.pieces.for_each(point, |piece| {
                let local = rotation.inverse() * to_world.transform_vector3(piece.place - mean);
                if (local / scale).length_squared() <= 4.0 {
                    inside += f64::from(piece.weight);
                }
            });
        }
        inside
    }

    /// The unit normal towards falling values, and the surfaceness of the cell.
    fn normal_and_surfaceness(&self, sums: &Moments) -> (DVec3, f64) {
        let normal = (-sums.gradient).normalize_or_zero();
        // For a constant field the gradient is rounding noise of the smoothing.
        if normal == DVec3::ZERO || sums.rise <= 0.0 {
            return (DVec3::ZERO, 0.0);
        }
        let consistency = sums.consistency();
        (normal, Surfaceness::of_part(consistency, consistency * sums.rise / sums.weight))
    }
}

fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// v·vᵀ.
pub(crate) fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Limits the ratios of axis lengths, longest first, by [`LEAST_RATIO`] and [`MOST_RATIO`].
fn limited(lengths: [f64; 3]) -> DVec3 {
    let middle = lengths[1].max(lengths[0] / (MOST_RATIO * MOST_RATIO));
    DVec3::new(lengths[0].min(MOST_RATIO * middle), middle, lengths[2].max(LEAST_RATIO * middle))
}

/// A right-handed rotation with the axes as columns. The last axis is on the side of the normal, and the largest component of
/// the first axis is positive. Similar cells therefore get similar rotations.
fn oriented(axes: DMat3, normal: DVec3) -> DMat3 {
    let mut last = axes.z_axis;
    let side = if normal == DVec3::ZERO { largest(last) } else { last.dot(normal) };
    if side < 0.0 {
        last = -last;
    }
    let first = if largest(axes.x_axis) < 0.0 { -axes.x_axis } else { axes.x_axis };
    DMat3::from_cols(first, last.cross(first), last)
}

fn largest(v: DVec3) -> f64 {
    v.to_array().into_iter().fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a })
}

/// Eigenvalues, largest first, and unit eigenvectors (columns) of a symmetric matrix.
fn principal_axes(m: DMat3) -> ([f64; 3], DMat3) {
    let (values, vectors) = eigen_symmetric_3x3(m, StopRule::SumsOfSquares);
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| values[j].total_cmp(&values[i]));
    let [x, y, z] = order.map(|k| vectors.col(k));
    (order.map(|k| values[k]), DMat3::from_cols(x, y, z))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn axes_are_limited() {
        assert_eq!(limited([1.0, 1.0, 0.0]), DVec3::new(1.0, 1.0, 0.2));
        let needle = limited([9.0, 0.1, 0.1]);
        assert!(needle.x <= 3.0 * needle.y && needle.z >= 0.2 * needle.y, "{needle}");
        assert_eq!(limited([1.2, 1.0, 0.5]), DVec3::new(1.2, 1.0, 0.5));
    }

    proptest! {
        #[test]
        fn principal_axes_rebuild_the_matrix(
            q in prop::array::uniform4(-1.0..1.0_f64),
            l in prop::array::uniform3(1e-6..10.0_f64),
        ) {
            let q = DQuat::from_array(q);
            prop_assume!(q.length() > 0.1);
            let r = DMat3::from_quat(q.normalize());
            let m = r * DMat3::from_diagonal(DVec3::from_array(l)) * r.transpose();
            let (values, axes) = principal_axes(m);
            prop_assert!(values[0] >= values[1] && values[1] >= values[2]);
            let again = axes * DMat3::from_diagonal(DVec3::from_array(values)) * axes.transpose();
            let error = (again - m).to_cols_array().into_iter().fold(0.0_f64, |a, b| a.max(b.abs()));
            prop_assert!(error < 1e-9 * values[0], "{error}");
            let turned = oriented(axes, DVec3::new(0.3, -0.2, 0.9));
            prop_assert!((turned.determinant() - 1.0).abs() < 1e-9);
            prop_assert!(turned.z_axis.dot(DVec3::new(0.3, -0.2, 0.9)) >= 0.0);
        }
    }
}
