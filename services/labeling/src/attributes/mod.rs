//! Visual attributes of a unit, from its Gaussians: colour, size, place, shape, opacity, density.
//!
//! [`Attributes`] holds what is measured on one unit. [`judge`] says how well a word such as "largest", "flat" or "on the left" fits
//! one unit among others. [`words`] gives the words that fit a unit.

pub mod judge;
pub mod likeness;
pub mod quality;
pub mod words;

use glam::{DMat3, DVec3};
use sg_scene::symmetric3::{StopRule, eigen_symmetric_3x3};

/// Least deviation along an axis for a volume, as a share of the greatest: a sheet has a size too.
const LEAST_SHARE: f64 = 0.02;
/// Least area of a Gaussian, in squared scene lengths: in a unit of points alone, each counts by its opacity.
const LEAST_AREA: f64 = 1e-200;

/// One Gaussian of a unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaussian {
    /// Its centre, in scene coordinates.
    pub position: DVec3,
    /// Its displayed colour, RGB from 0 to 1.
    pub color: [f32; 3],
    /// Its opacity, 0 to 1: also how much it counts.
    pub opacity: f32,
    /// Its mean standard deviation, in scene lengths.
    pub deviation: f64,
    /// The area that it covers in a picture, in squared scene lengths. Its colour counts by that and by its opacity.
    pub area: f64,
}

/// What is measured on one unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attributes {
    /// Number of Gaussians that count.
    pub count: usize,
    /// Mean of the centres, weighted by opacity. Scene coordinates.
    pub center: DVec3,
    /// Covariance of the place of a random point of the unit, in squared scene lengths: of the centres, and of each Gaussian.
    pub covariance: DMat3,
    /// Square roots of the covariance's eigenvalues, the greatest first.
    pub deviations: [f64; 3],
    /// Mean colour, weighted by opacity and area: large splats colour more of a picture than small ones.
    pub color: [f32; 3],
    /// Mean opacity.
    pub opacity: f64,
}

/// A unit without attributes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum AttributesError {
    /// No Gaussian counts.
    #[error("no Gaussian of the unit is finite and visible, so it has no attributes")]
    Empty,
}

impl Attributes {
    /// Measures a unit. Gaussians that are not finite or have no opacity do not count.
    ///
    /// # Errors
    /// [`AttributesError::Empty`] if none counts.
    pub fn of(gaussians: impl IntoIterator<Item = Gaussian>) -> Result<Self, AttributesError> {
        let mut counted = gaussians.into_iter().filter(|g| {
            let finite = g.position.is_finite() && g.color.iter().all(|c| c.is_finite());
            finite
                && g.opacity > 0.0
                && g.opacity.is_finite()
                && [g.deviation, g.area].iter().all(|x| *x >= 0.0 && x.is_finite())
        });
        let Some(first) = counted.next() else { return Err(AttributesError::Empty) };
        // Sums relative to the first centre: scenes may lie far from their origin.
        let origin = first.position;
        let (mut count, mut total, mut sum, mut own) = (0_usize, 0.0, DVec3::ZERO, 0.0);
        let mut squares = DMat3::ZERO;
        let (mut covered, mut color) = (0.0, [0.0_f64; 3]);
        for g in std::iter::once(first).chain(counted) {
            let weight = f64::from(g.opacity);
            let p = g.position - origin;
            count += 1;
            total += weight;
            sum += weight * p;
            own += weight * g.deviation * g.deviation;
            squares += DMat3::from_cols(p * p.x, p * p.y, p * p.z) * weight;
            let shown = weight * g.area.max(LEAST_AREA);
            covered += shown;
            for (sum, channel) in color.iter_mut().zip(g.color) {
                *sum += shown * f64::from(channel);
            }
        }
        let mean = sum / total;
        let of_mean = DMat3::from_cols(mean * mean.x, mean * mean.y, mean * mean.z);
        let covariance = squares * (1.0 / total) - of_mean + DMat3::from_diagonal(DVec3::splat(own / total));
        let scale = covariance.to_cols_array().iter().fold(0.0_f64, |most, c| most.max(c.abs()));
        let (values, _) = if scale > 0.0 && scale.is_finite() {
            eigen_symmetric_3x3(covariance * (1.0 / scale), StopRule::SumsOfSquares)
        } else {
            ([0.0; 3], DMat3::IDENTITY)
        };
        let mut deviations = values.map(|v| (v.max(0.0) * scale).sqrt());
        deviations.sort_by(|a, b| b.total_cmp(a));
        let color = color.map(|sum| (sum / covered) as f32);
        Ok(Self { count, center: origin + mean, covariance, deviations, color, opacity: total / count as f64 })
    }

    /// Geometric mean of the deviations, in scene lengths: the cube root of the volume up to a factor. A direction without extent
    /// counts as a fiftieth of the longest.
    #[must_use]
    pub fn size(&self) -> f64 {
        let [longest, middle, shortest] = self.deviations;
        let least = LEAST_SHARE * longest;
        (longest * middle.max(least) * shortest.max(least)).cbrt()
    }

    /// 1 − σ₂/σ₁: 0 for a ball or a disk, 1 for a filament. A point has 0.
    #[must_use]
    pub fn elongation(&self) -> f64 {
        ratio(self.deviations[1], self.deviations[0])
    }

    /// 1 − σ₃/σ₂: 0 for a ball or a rod, 1 for a sheet. A point has 0, and so has a line.
    #[must_use]
    pub fn flatness(&self) -> f64 {
        let [longest, middle, shortest] = self.deviations;
        let least = LEAST_SHARE * longest;
        ratio(shortest.max(least).min(middle.max(least)), middle.max(least))
    }

    /// σ₃/σ₁: 1 for a ball. A point has 1.
    #[must_use]
    pub fn roundness(&self) -> f64 {
        1.0 - ratio(self.deviations[2], self.deviations[0])
    }

    /// Standard deviation along a unit vector, in scene lengths.
    #[must_use]
    pub fn deviation_along(&self, direction: DVec3) -> f64 {
        direction.dot(self.covariance * direction).max(0.0).sqrt()
    }

    /// Gaussians in a cube of [`Attributes::size`]; infinite for a point.
    #[must_use]
    pub fn density(&self) -> f64 {
        self.count as f64 / self.size().powi(3)
    }
}

/// 1 − small/large, 0 where both are 0.
fn ratio(small: f64, large: f64) -> f64 {
    if large > 0.0 { 1.0 - small / large } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use proptest::prelude::*;

    use super::*;

    fn at(position: DVec3) -> Gaussian {
        Gaussian { position, color: [0.5, 0.25, 1.0], opacity: 0.5, deviation: 0.0, area: 0.0 }
    }

    /// The eight corners of a box.
    fn corners(half: DVec3) -> impl Iterator<Item = DVec3> {
        (0..8).map(move |k| {
            let sign = |bit: u32| if k >> bit & 1 == 0 { -1.0 } else { 1.0 };
            half * DVec3::new(sign(0), sign(1), sign(2))
        })
    }

    #[test]
    fn shapes_of_boxes() {
        let of = |half: DVec3| Attributes::of(corners(half).map(at)).unwrap();
        let cube = of(DVec3::splat(2.0));
        assert!(cube.elongation() < 1e-12 && cube.flatness() < 1e-12 && (cube.roundness() - 1.0).abs() < 1e-12);
        assert!((cube.size() - 2.0).abs() < 1e-12);
        let rod = of(DVec3::new(1.0, 10.0, 1.0));
        assert!((rod.elongation() - 0.9).abs() < 1e-12 && rod.flatness() < 1e-12);
        assert!((rod.deviation_along(DVec3::Y) - 10.0).abs() < 1e-12);
        let sheet = of(DVec3::new(10.0, 10.0, 1.0));
        assert!((sheet.flatness() - 0.9).abs() < 1e-12 && sheet.elongation() < 1e-12);
        let flat = of(DVec3::new(10.0, 10.0, 0.0));
        assert!(flat.flatness() > 0.95 && flat.size() > 0.0);
        let line = of(DVec3::new(10.0, 0.0, 0.0));
        assert!(line.elongation() == 1.0 && line.flatness() == 0.0 && line.size() > 0.0, "{line:?}");
        let point = of(DVec3::ZERO);
        assert_eq!((point.elongation(), point.flatness(), point.roundness(), point.size()), (0.0, 0.0, 1.0, 0.0));
    }

    #[test]
    fn means_are_weighted_and_broken_gaussians_do_not_count() {
        let heavy = Gaussian { opacity: 0.9, color: [1.0, 0.0, 0.0], ..at(DVec3::X) };
        let light = Gaussian { opacity: 0.1, color: [0.0, 1.0, 0.0], ..at(DVec3::NEG_X) };
        let broken = [
            at(DVec3::NAN),
            Gaussian { opacity: 0.0, ..heavy },
            Gaussian { opacity: f32::NAN, ..heavy },
            Gaussian { deviation: -1.0, ..heavy },
            Gaussian { area: f64::NAN, ..heavy },
            Gaussian { color: [f32::INFINITY; 3], ..heavy },
        ];
        let unit = Attributes::of(broken.into_iter().chain([heavy, light])).unwrap();
        assert_eq!(unit.count, 2);
        assert!((unit.center.x - 0.8).abs() < 1e-6 && (unit.opacity - 0.5).abs() < 1e-6);
        assert!((unit.color[0] - 0.9).abs() < 1e-6 && (unit.color[1] - 0.1).abs() < 1e-6);
        // The light one covers 27 times the area: three quarters of what is seen.
        let covering = [Gaussian { area: 1.0, ..heavy }, Gaussian { area: 27.0, ..light }];
        let covered = Attributes::of(covering).unwrap();
        assert!((covered.color[1] - 0.75).abs() < 1e-6 && (covered.center.x - 0.8).abs() < 1e-6, "{covered:?}");
        assert_eq!(Attributes::of(broken), Err(AttributesError::Empty));
        let wide = Attributes::of([Gaussian { deviation: 3.0, ..heavy }]).unwrap();
        assert!((wide.size() - 3.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn shape_does_not_depend_on_place_and_direction(
            points in prop::collection::vec(prop::array::uniform3(-1.0_f64..1.0), 4..30),
            axis in prop::array::uniform3(-1.0_f64..1.0),
            angle in 0.0_f64..6.0,
            far in -1e4_f64..1e4,
        ) {
            let turn = DQuat::from_axis_angle(DVec3::from_array(axis).normalize_or(DVec3::X), angle);
            let points: Vec<DVec3> = points.into_iter().map(DVec3::from_array).collect();
            let a = Attributes::of(points.iter().map(|p| at(*p))).unwrap();
            let b = Attributes::of(points.iter().map(|p| at(turn * *p + DVec3::splat(far)))).unwrap();
            prop_assert!(a.deviations.iter().zip(b.deviations).all(|(x, y)| (x - y).abs() < 1e-6), "{a:?} {b:?}");
            prop_assert!((a.size() - b.size()).abs() < 1e-6);
            for share in [a.elongation(), a.flatness(), a.roundness()] {
                prop_assert!((0.0..=1.0).contains(&share));
            }
        }
    }
}
