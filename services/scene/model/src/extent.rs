//! The extent of a set of Gaussians: the edges of its box, and the volume that it fills.

use glam::{DMat3, DVec3};

use super::mask::Mask;
use super::model::Scene;

/// Voxels along the longest edge of the box.
const VOXELS: f64 = 96.0;

/// Most voxels that all Gaussians together are compared with: the voxels become larger until that suffices.
const MOST_VISITS: f64 = 3e7;

/// Extent of a set of Gaussians. All within one standard deviation of the centre of one of them counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Edges of its box along x, y and z, in the scene's length unit.
    pub edges: DVec3,
    /// Volume, in the cube of that unit. Gaussians that overlap count once.
    pub volume: f64,
}

/// One Gaussian in scene coordinates.
struct Ellipsoid {
    center: DVec3,
    /// Half the edges of its box.
    half: DVec3,
    /// Inverse covariance; `None` where that is singular.
    precision: Option<DMat3>,
    volume: f64,
}

/// The extent of the members; `None` without a member of finite place and size.
///
/// The volume is that of a grid's voxels whose centres lie within a member, 96 along the longest edge or fewer. A Gaussian
/// that is smaller than a voxel adds its own volume to it.
#[must_use]
pub fn extent(scene: &Scene, members: &Mask) -> Option<Extent> {
    let ellipsoids = ellipsoids(scene, members);
    let low = ellipsoids.iter().map(|e| e.center - e.half).reduce(DVec3::min)?;
    let high = ellipsoids.iter().map(|e| e.center + e.half).reduce(DVec3::max)?;
    let edges = high - low;
    let longest = edges.max_element();
    if longest <= 0.0 {
        return Some(Extent { edges, volume: 0.0 });
    }
    let mut edge = longest / VOXELS;
    let visits = |edge: f64| -> f64 {
        ellipsoids.iter().map(|e| (2.0 * e.half / edge + DVec3::ONE).to_array().iter().product::<f64>()).sum()
    };
    while visits(edge) > MOST_VISITS && edge < longest {
        edge *= 1.26;
    }
    let size = (edges / edge).ceil().max(DVec3::ONE).to_array().map(|n| n as usize);
    // Share of each voxel that is filled.
    let mut filled = vec![0.0_f32; size.iter().product()];
    for ellipsoid in &ellipsoids {
        let mut is_small = true;
        let from = ((ellipsoid.center - ellipsoid.half - low) / edge).floor().max(DVec3::ZERO).to_array();
        let to = ((ellipsoid.center + ellipsoid.half - low) / edge).ceil().to_array();
        let range = |axis: usize| (from[axis] as usize)..(to[axis] as usize).min(size[axis]);
        let mut voxel = |x: usize, y: usize, z: usize, share: f32| {
            if let Some(voxel) = filled.get_mut((z * size[1] + y) * size[0] + x) {
                *voxel = (*voxel + share).min(1.0);
            }
        };
        if let Some(precision) = ellipsoid.precision {
            for z in range(2) {
                for y in range(1) {
                    for x in range(0) {
                        let at = low + edge * (DVec3::new(x as f64, y as f64, z as f64) + 0.5);
                        let d = at - ellipsoid.center;
                        if d.dot(precision * d) <= 1.0 {
                            voxel(x, y, z, 1.0);
                            is_small = false;
                        }
                    }
                }
            }
        }
        if is_small {
            let place = ((ellipsoid.center - low) / edge).floor().to_array();
            let [x, y, z] = [0, 1, 2].map(|axis| (place[axis] as usize).min(size[axis] - 1));
            voxel(x, y, z, (ellipsoid.volume / edge.powi(3)) as f32);
        }
    }
    let voxels: f64 = filled.iter().map(|share| f64::from(*share)).sum();
    Some(Extent { edges, volume: voxels * edge.powi(3) })
}

fn ellipsoids(scene: &Scene, members: &Mask) -> Vec<Ellipsoid> {
    let mut ellipsoids = Vec::new();
    for unit in &scene.units {
        let turn = DMat3::from_mat4(unit.transform);
        for local in (0..unit.gaussians.len()).filter(|local| members.get(unit.first + local)) {
            let Some(position) = unit.gaussians.position.get(local) else { continue };
            let center = unit.transform.transform_point3(position.as_dvec3());
            let covariance = turn * unit.gaussians.covariance(local) * turn.transpose();
            let spread = DVec3::new(covariance.x_axis.x, covariance.y_axis.y, covariance.z_axis.z);
            let half = spread.to_array().map(f64::sqrt);
            let (half, determinant) = (DVec3::from_array(half), covariance.determinant());
            if !center.is_finite() || !half.is_finite() || !determinant.is_finite() {
                continue;
            }
            let precision = Some(covariance.inverse()).filter(|p| determinant > 0.0 && p.is_finite());
            let volume = 4.0 / 3.0 * std::f64::consts::PI * determinant.max(0.0).sqrt();
            ellipsoids.push(Ellipsoid { center, half, precision, volume });
        }
    }
    ellipsoids
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::model::Gaussians;
    use crate::synthetic::unit_of;

    fn scene(gaussians: &[(Vec3, Vec3)]) -> Scene {
        let unit = Gaussians {
            position: gaussians.iter().map(|(center, _)| *center).collect(),
            rotation: vec![[1.0, 0.0, 0.0, 0.0]; gaussians.len()],
            log_scale: gaussians.iter().map(|(_, scale)| scale.to_array().map(f32::ln).into()).collect(),
            opacity_logit: vec![0.0; gaussians.len()],
            ..Gaussians::default()
        };
        Scene::compose(vec![unit_of(unit)], None)
    }

    fn measured(gaussians: &[(Vec3, Vec3)]) -> Extent {
        let scene = scene(gaussians);
        extent(&scene, &Mask::full(scene.len())).unwrap()
    }

    #[test]
    fn an_ellipsoid_has_its_volume_and_counts_once() {
        let one = (Vec3::new(5.0, -3.0, 2.0), Vec3::new(3.0, 2.0, 1.0));
        let ellipsoid = 4.0 / 3.0 * std::f64::consts::PI * 6.0;
        for gaussians in [vec![one], vec![one; 50]] {
            let found = measured(&gaussians);
            assert!((found.edges - DVec3::new(6.0, 4.0, 2.0)).length() < 1e-5, "{found:?}");
            assert!((found.volume / ellipsoid - 1.0).abs() < 0.02, "{found:?}");
        }
        let apart = measured(&[one, (Vec3::new(50.0, 0.0, 0.0), one.1)]);
        assert!((apart.volume / (2.0 * ellipsoid) - 1.0).abs() < 0.15, "{apart:?}");
    }

    #[test]
    fn gaussians_smaller_than_a_voxel_add_their_own_volume() {
        let tiny = Vec3::splat(1e-3);
        let found = measured(&[(Vec3::ZERO, tiny), (Vec3::ONE, tiny)]);
        let each = 4.0 / 3.0 * std::f64::consts::PI * 1e-9;
        assert!((found.volume / (2.0 * each) - 1.0).abs() < 1e-3, "{found:?}");
        assert!((found.edges - DVec3::splat(1.002)).length() < 1e-6);
    }

    #[test]
    fn many_large_gaussians_take_a_coarser_grid() {
        let large: Vec<_> = (0..400).map(|k| (Vec3::splat(0.001 * k as f32), Vec3::splat(10.0))).collect();
        let found = measured(&large);
        let ball = 4.0 / 3.0 * std::f64::consts::PI * 1000.0;
        assert!((found.volume / ball - 1.0).abs() < 0.1, "{found:?}");
    }

    #[test]
    fn nothing_has_no_extent() {
        let scene = scene(&[(Vec3::ZERO, Vec3::ONE), (Vec3::splat(f32::NAN), Vec3::ONE)]);
        assert_eq!(extent(&scene, &Mask::empty(2)), None);
        assert_eq!(extent(&scene, &Mask::from_fn(2, |i| i == 1)), None);
        assert!(extent(&scene, &Mask::full(2)).is_some());
    }
}
