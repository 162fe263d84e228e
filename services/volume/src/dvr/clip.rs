//! Clipping of rays by half-spaces.

use glam::DVec3;

/// The half-space n·p ≥ offset of the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// Its inward normal n, of any length but zero.
    pub normal: DVec3,
    /// The least n·p inside.
    pub offset: f64,
}

/// An intersection of half-spaces that is kept, or taken away.
#[derive(Debug, Clone, PartialEq)]
pub struct ClipRegion {
    /// One for a plane, six for a box.
    pub sides: Vec<HalfSpace>,
    /// Whether what is inside stays, or all else.
    pub keeps_inside: bool,
}

/// The parts of the ray `eye + t·direction` between `near` and `far` that all regions keep, from near to far.
pub(crate) fn kept_parts(
    regions: &[ClipRegion],
    eye: DVec3,
    direction: DVec3,
    near: f64,
    far: f64,
) -> impl Iterator<Item = (f64, f64)> {
    let mut parts = vec![(near, far)];
    for region in regions {
        let inside = region.inside(eye, direction);
        parts = parts
            .into_iter()
            .flat_map(|(near, far)| {
                let (enter, leave) = inside;
                if region.keeps_inside {
                    [(near.max(enter), far.min(leave)), (0.0, 0.0)]
                } else if enter < leave {
                    [(near, far.min(enter)), (near.max(leave), far)]
                } else {
                    [(near, far), (0.0, 0.0)]
                }
            })
            .filter(|(near, far)| near < far)
            .collect();
    }
    parts.into_iter()
}

impl ClipRegion {
    /// Where a ray enters and leaves the intersection. Empty if it does not enter before it leaves.
    fn inside(&self, eye: DVec3, direction: DVec3) -> (f64, f64) {
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for side in &self.sides {
            let (height, slope) = (side.normal.dot(eye) - side.offset, side.normal.dot(direction));
            if slope > 0.0 {
                enter = enter.max(-height / slope);
            } else if slope < 0.0 {
                leave = leave.min(-height / slope);
            } else if height < 0.0 {
                return (f64::INFINITY, f64::NEG_INFINITY);
            }
        }
        (enter, leave)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0_f64).prop_map(DVec3::from_array)
    }

    fn region() -> impl Strategy<Value = ClipRegion> {
        let side = (vector(), -0.5..0.5_f64).prop_map(|(normal, offset)| HalfSpace { normal, offset });
        (prop::collection::vec(side, 1..7), any::<bool>())
            .prop_map(|(sides, keeps_inside)| ClipRegion { sides, keeps_inside })
    }

    proptest! {
        #[test]
        fn a_point_is_in_a_part_just_if_every_region_keeps_it(
            regions in prop::collection::vec(region(), 0..4), eye in vector(), direction in vector(), t in 0.0..3.0_f64,
        ) {
            let parts: Vec<(f64, f64)> = kept_parts(&regions, eye, direction, 0.0, 3.0).collect();
            prop_assert!(parts.iter().all(|(near, far)| near < far && *near >= 0.0 && *far <= 3.0));
            prop_assert!(parts.windows(2).all(|pair| pair[0].1 <= pair[1].0));
            let point = eye + t * direction;
            let heights = regions.iter().flat_map(|region| &region.sides).map(|s| s.normal.dot(point) - s.offset);
            prop_assume!(heights.into_iter().all(|height| height.abs() > 1e-9));
            let kept = regions.iter().all(|region| {
                region.sides.iter().all(|s| s.normal.dot(point) >= s.offset) == region.keeps_inside
            });
            prop_assert_eq!(parts.iter().any(|(near, far)| (*near..=*far).contains(&t)), kept);
        }
    }
}
