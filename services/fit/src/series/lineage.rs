//! Which Gaussian of the time step before each one continues, and masks that follow.

use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use sg_scene::mask::Mask;
use sg_scene::model::{BaseUnit, Scene};

use crate::placement::PlacementError;

/// Distance to the nearest Gaussian of the step before, in mean standard deviations of a new one, up to which it continues that one.
const REACH: f64 = 6.0;

/// Gaussians of one base unit by their places.
pub(super) struct Neighbours {
    tree: Option<ImmutableKdTree<f32, 3>>,
    origin: DVec3,
}

impl Neighbours {
    /// Of places in the world around `origin`.
    pub(super) fn new(places: &[DVec3], origin: DVec3) -> Result<Self, PlacementError> {
        let near: Vec<[f32; 3]> = places.iter().map(|place| (*place - origin).as_vec3().to_array()).collect();
        let tree = (!near.is_empty()).then(|| ImmutableKdTree::new_from_slice(&near)).transpose();
        Ok(Self { tree: tree.map_err(|e| PlacementError { reason: e.to_string() })?, origin })
    }

    /// The nearest place and its distance; `None` if there is no place.
    pub(super) fn nearest(&self, place: DVec3) -> Option<(usize, f64)> {
        let tree = self.tree.as_ref()?;
        let near = (place - self.origin).as_vec3().to_array();
        let found = tree.query(&near).nearest_one::<SquaredEuclidean<f32>>().execute();
        Some((found.item as usize, f64::from(found.distance).sqrt()))
    }
}

/// Places of the Gaussians of a base unit in the world.
pub(super) fn places(unit: &BaseUnit) -> Vec<DVec3> {
    unit.gaussians.position.iter().map(|p| unit.transform.transform_point3(p.as_dvec3())).collect()
}

/// For each Gaussian of a scene the one of the step before that it continues, or −1: the nearest of the same base unit, after
/// `moved`, within six of its mean standard deviations.
pub(super) fn nearest_before(
    scene: &Scene,
    before: &Scene,
    moved: &(dyn Fn(DVec3) -> DVec3 + Sync),
) -> Result<Vec<i32>, PlacementError> {
    let origin = 0.5 * (scene.bounds.min + scene.bounds.max);
    let mut previous = Vec::with_capacity(scene.len());
    for unit in &scene.units {
        let Some(earlier) = before.units.iter().find(|earlier| earlier.name == unit.name) else {
            previous.extend(std::iter::repeat_n(-1, unit.gaussians.len()));
            continue;
        };
        let there: Vec<DVec3> = places(earlier).into_par_iter().map(moved).collect();
        let neighbours = Neighbours::new(&there, origin)?;
        let own = places(unit);
        previous.par_extend(own.par_iter().enumerate().with_min_len(512).map(|(i, place)| {
            let reach = REACH * f64::from((unit.gaussians.log_scale[i].element_sum() / 3.0).exp());
            match neighbours.nearest(*place) {
                Some((nearest, distance)) if distance <= reach => (earlier.first + nearest) as i32,
                _ => -1,
            }
        }));
    }
    Ok(previous)
}

/// A mask of the step before, carried to the next step: a Gaussian is in it if the one that it continues is.
///
/// `previous` has the index of that one for each Gaussian of the next step, or −1.
#[must_use]
pub fn carried(mask: &Mask, previous: &[i32]) -> Mask {
    Mask::from_fn(previous.len(), |i| {
        usize::try_from(previous[i]).is_ok_and(|earlier| earlier < mask.len() && mask.get(earlier))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_follows_what_continues() {
        let mask = Mask::from_fn(3, |i| i != 1);
        let next = carried(&mask, &[2, 2, 1, -1, 0, 7, i32::MIN]);
        assert_eq!(next.ones().collect::<Vec<_>>(), [0, 1, 4]);
        assert!(carried(&mask, &[]).is_empty());
    }
}
