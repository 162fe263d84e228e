//! The ball around a region.

use glam::DVec3;

/// Share of the weight that is taken for strays: Gaussians farthest from the middle.
const STRAYS: f64 = 0.01;
/// Iterations of the enclosing ball. Its radius is at most (1 + 1/√n) times the least, and nearer in practice.
const ITERATIONS: u32 = 200;

/// A ball that holds a region without its strays. Scene coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// The middle of the ball.
    pub center: DVec3,
    /// The radius of the ball, above 0.
    pub radius: f64,
    /// Whether the Gaussians have so little extent that the radius is the least one instead.
    pub is_tiny: bool,
}

/// A region without a ball.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RegionError {
    /// The columns have different lengths.
    #[error("{positions} positions come with {weights} weights and {extents} extents; give one of each for a Gaussian")]
    Lengths {
        /// Number of positions.
        positions: usize,
        /// Number of weights.
        weights: usize,
        /// Number of extents.
        extents: usize,
    },
    /// No Gaussian is finite and visible.
    #[error("no Gaussian of the region is finite and visible; select something that is")]
    Empty,
    /// The least radius is not usable.
    #[error("the least radius is {0}; it must be finite and above 0")]
    LeastRadius(f64),
}

impl Region {
    /// The ball around Gaussians.
    ///
    /// `positions` are centres. `weights` say how much each counts, such as opacity; those of 0 are ignored. `extents` are radii
    /// of the Gaussians, such as twice the largest standard deviation. Gaussians that are not finite are ignored, and so is the
    /// hundredth of the weight that is farthest from the mean. The ball is at least `least_radius` large: a small share of the
    /// scene, so that a camera around one point keeps its distance. All lengths are in scene units.
    ///
    /// The ball is that of Bădoiu and Clarkson (2003). It turns and moves with the Gaussians, which a box would not.
    ///
    /// # Errors
    /// [`RegionError`].
    pub fn of_gaussians(
        positions: &[DVec3],
        weights: &[f64],
        extents: &[f64],
        least_radius: f64,
    ) -> Result<Self, RegionError> {
        if positions.len() != weights.len() || positions.len() != extents.len() {
            let (positions, weights, extents) = (positions.len(), weights.len(), extents.len());
            return Err(RegionError::Lengths { positions, weights, extents });
        }
        if !(least_radius > 0.0 && least_radius.is_finite()) {
            return Err(RegionError::LeastRadius(least_radius));
        }
        let kept = without_strays(positions, weights, extents)?;
        let mut center = kept.iter().map(|m| m.position).sum::<DVec3>() / kept.len() as f64;
        for step in 1..=ITERATIONS {
            let Some(farthest) = kept.iter().max_by(|a, b| a.reach(center).total_cmp(&b.reach(center))) else { break };
            center += (farthest.position - center) / f64::from(step + 1);
        }
        let radius = kept.iter().map(|m| m.reach(center)).fold(0.0, f64::max);
        if !(radius.is_finite() && center.is_finite()) {
            return Err(RegionError::Empty);
        }
        Ok(Self { center, radius: radius.max(least_radius), is_tiny: radius <= least_radius })
    }
}

struct Member {
    position: DVec3,
    weight: f64,
    extent: f64,
}

impl Member {
    fn reach(&self, center: DVec3) -> f64 {
        self.position.distance(center) + self.extent
    }
}

/// The members with weight, without the strays.
fn without_strays(positions: &[DVec3], weights: &[f64], extents: &[f64]) -> Result<Vec<Member>, RegionError> {
    let mut members: Vec<Member> = positions
        .iter()
        .zip(weights)
        .zip(extents)
        .filter(|((p, w), e)| p.is_finite() && w.is_finite() && **w > 0.0 && e.is_finite() && **e >= 0.0)
        .map(|((p, w), e)| Member { position: *p, weight: *w, extent: *e })
        .collect();
    let total: f64 = members.iter().map(|m| m.weight).sum();
    if !(total > 0.0 && total.is_finite()) {
        return Err(RegionError::Empty);
    }
    let mean = members.iter().map(|m| m.weight * m.position).sum::<DVec3>() / total;
    members.sort_by(|a, b| a.position.distance(mean).total_cmp(&b.position.distance(mean)));
    let mut passed = 0.0;
    let within = members.iter().take_while(|m| {
        let before = passed;
        passed += m.weight;
        before < (1.0 - STRAYS) * total
    });
    let kept = within.count().max(1);
    members.truncate(kept);
    Ok(members)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ball(positions: &[DVec3]) -> Result<Region, RegionError> {
        let ones = vec![1.0; positions.len()];
        let none = vec![0.0; positions.len()];
        Region::of_gaussians(positions, &ones, &none, 1e-3)
    }

    #[test]
    fn known_balls() {
        let corners: Vec<DVec3> =
            (0..8).map(|k| DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2 & 1))).collect();
        let cube = ball(&corners).unwrap();
        assert!((cube.radius - 0.75_f64.sqrt()).abs() < 0.01 * cube.radius, "{cube:?}");
        let one = ball(&[DVec3::ONE]).unwrap();
        assert_eq!((one.center, one.radius, one.is_tiny), (DVec3::ONE, 1e-3, true));
        let line = ball(&[DVec3::ZERO, DVec3::X * 10.0, DVec3::X * 2.0]).unwrap();
        assert!((line.radius - 5.0).abs() < 0.06 && (line.center.x - 5.0).abs() < 0.06, "{line:?}");
        let wide = Region::of_gaussians(&[DVec3::ZERO], &[0.5], &[2.0], 1e-3).unwrap();
        assert_eq!((wide.radius, wide.is_tiny), (2.0, false));
    }

    #[test]
    fn strays_and_broken_gaussians_do_not_count() {
        let mut points: Vec<DVec3> =
            (0..500).map(|i| DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), 0.0)).collect();
        let before = ball(&points).unwrap();
        points.push(DVec3::splat(1e9));
        points.push(DVec3::NAN);
        let after = ball(&points).unwrap();
        assert!((after.radius - before.radius).abs() < 0.1 * before.radius, "{before:?} {after:?}");
        assert_eq!(ball(&[]), Err(RegionError::Empty));
        assert_eq!(ball(&[DVec3::NAN]), Err(RegionError::Empty));
        assert_eq!(Region::of_gaussians(&[DVec3::ZERO], &[0.0], &[1.0], 1.0), Err(RegionError::Empty));
        assert!(matches!(Region::of_gaussians(&[DVec3::ZERO], &[], &[1.0], 1.0), Err(RegionError::Lengths { .. })));
        assert_eq!(Region::of_gaussians(&[DVec3::ZERO], &[1.0], &[1.0], 0.0), Err(RegionError::LeastRadius(0.0)));
    }

    proptest! {
        #[test]
        fn the_ball_turns_and_moves_with_the_region(
            points in prop::collection::vec(prop::array::uniform3(-10.0_f64..10.0), 1..40),
            axis in prop::array::uniform3(-1.0_f64..1.0),
            angle in 0.0_f64..6.0,
        ) {
            let turn = glam::DQuat::from_axis_angle(DVec3::from_array(axis).normalize_or(DVec3::X), angle);
            let shift = DVec3::new(3.0, -7.0, 11.0);
            let points: Vec<DVec3> = points.into_iter().map(DVec3::from_array).collect();
            let turned: Vec<DVec3> = points.iter().map(|p| turn * *p + shift).collect();
            let (a, b) = (ball(&points).unwrap(), ball(&turned).unwrap());
            // Two farthest points at nearly one distance may change places by rounding; the ball then differs by a step's share.
            prop_assert!((a.radius - b.radius).abs() <= 0.02 * a.radius + 1e-9, "{a:?} {b:?}");
            prop_assert!((turn * a.center + shift).distance(b.center) <= 0.05 * a.radius + 1e-9, "{a:?} {b:?}");
            let all_inside = points.iter().all(|p| p.distance(a.center) <= a.radius * (1.0 + 1e-12));
            prop_assert!(all_inside);
        }
    }
}
