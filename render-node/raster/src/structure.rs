//! Views of the structure: Super-Gaussians in colours of their own. Labels are given; nothing is clustered here.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

use glam::{DMat3, DVec3, IVec3, Vec3};
use sg_scene::model::Scene;

use crate::color_map::ColorMap;

/// Label of a Gaussian that belongs to no cluster; shown in [`ColorMap::MISSING`].
pub const NO_CLUSTER: u32 = u32::MAX;

/// Coloring of Super-Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClusterColoring {
    /// Colours of the palette at random, unlike those of all neighbours. The same seed gives the same colours.
    Random {
        /// Seed.
        seed: u64,
    },
    /// The position of the cluster's centre along the first principal axis of all centres. The axis' greatest component counts
    /// upwards, so that a scene does not change its colours end for end.
    FirstComponent(ColorMap),
}

/// Labels of another scene.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there are labels for {found} Gaussians, the scene has {expected}; cluster this scene")]
pub struct LabelCount {
    /// Labels given.
    pub found: usize,
    /// Gaussians in the scene.
    pub expected: usize,
}

/// One colour a Gaussian by scene-wide index, for [`sg_scene::appearance::Appearance::colors`]; all Gaussians with one label
/// have one colour.
///
/// # Errors
/// [`LabelCount`] unless there is one label a Gaussian.
pub fn cluster_colors(scene: &Scene, labels: &[u32], coloring: ClusterColoring) -> Result<Arc<[Vec3]>, LabelCount> {
    check_labels(scene, labels)?;
    let clusters = Clusters::of(scene, labels);
    let colors = match coloring {
        ClusterColoring::Random { seed } => clusters.random_colors(seed),
        ClusterColoring::FirstComponent(map) => clusters.along_first_axis().into_iter().map(|t| map.at(t)).collect(),
    };
    let of = |dense: &Option<u32>| dense.and_then(|k| colors.get(k as usize).copied()).unwrap_or(ColorMap::MISSING);
    Ok(clusters.dense.iter().map(of).collect())
}

/// Labels as files hold them, -1 for none, as one a Gaussian of a scene of so many.
///
/// # Errors
/// [`LabelCount`] unless there is one label a Gaussian.
pub fn labels_of(file: Vec<i32>, gaussians: usize) -> Result<Vec<u32>, LabelCount> {
    if file.len() != gaussians {
        return Err(LabelCount { found: file.len(), expected: gaussians });
    }
    Ok(file.into_iter().map(|label| u32::try_from(label).unwrap_or(NO_CLUSTER)).collect())
}

pub(crate) fn check_labels(scene: &Scene, labels: &[u32]) -> Result<(), LabelCount> {
    let (found, expected) = (labels.len(), scene.len());
    if found == expected { Ok(()) } else { Err(LabelCount { found, expected }) }
}

/// Clusters under numbers without gaps, in the order of their labels.
struct Clusters {
    /// Cluster of each Gaussian.
    dense: Vec<Option<u32>>,
    /// Finite centres of members, in the scene frame, with their cluster.
    members: Vec<(u32, DVec3)>,
    /// Mean of the members of each cluster; the origin where none is finite.
    centers: Vec<DVec3>,
}

impl Clusters {
    fn of(scene: &Scene, labels: &[u32]) -> Self {
        let mut known: Vec<u32> = labels.iter().copied().filter(|l| *l != NO_CLUSTER).collect();
        known.sort_unstable();
        known.dedup();
        let dense: Vec<Option<u32>> = labels.iter().map(|l| known.binary_search(l).ok().map(|k| k as u32)).collect();
        let members: Vec<(u32, DVec3)> = dense
            .iter()
            .enumerate()
            .filter_map(|(i, cluster)| Some(((*cluster)?, scene.position(i).filter(|p| p.is_finite())?)))
            .collect();
        let mut sums = vec![(DVec3::ZERO, 0.0_f64); known.len()];
        for (cluster, center) in &members {
            if let Some((sum, count)) = sums.get_mut(*cluster as usize) {
                *sum += center;
                *count += 1.0;
            }
        }
        Self { dense, members, centers: sums.into_iter().map(|(sum, count)| sum / count.max(1.0)).collect() }
    }

    fn center(&self, cluster: u32) -> DVec3 {
        self.centers.get(cluster as usize).copied().unwrap_or_default()
    }

    /// 0 to 1 for each cluster.
    fn along_first_axis(&self) -> Vec<f64> {
        let axis = first_axis(&self.centers);
        let along: Vec<f64> = self.centers.iter().map(|c| axis.dot(*c)).collect();
        let (low, high) = along.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        along.into_iter().map(|x| if high > low { (x - low) / (high - low) } else { 0.5 }).collect()
    }

    /// Pairs of clusters that have members in one cell or in cells side by side, both ways. A cell is half as wide as
    /// clusters typically reach from their centres.
    fn neighbours(&self) -> Vec<Vec<u32>> {
        let mut spread = vec![(0.0_f64, 0.0_f64); self.centers.len()];
        for (cluster, point) in &self.members {
            if let Some((sum, count)) = spread.get_mut(*cluster as usize) {
                *sum += point.distance_squared(self.center(*cluster));
                *count += 1.0;
            }
        }
        let mut reach: Vec<f64> =
            spread.into_iter().map(|(sum, count)| (sum / count.max(1.0)).sqrt()).filter(|r| *r > 0.0).collect();
        reach.sort_unstable_by(f64::total_cmp);
        let mut lists = vec![Vec::new(); self.centers.len()];
        let Some(typical) = reach.get(reach.len() / 2) else { return lists };
        let mut cells: HashMap<IVec3, Vec<u32>> = HashMap::new();
        for (cluster, point) in &self.members {
            // The cast saturates: points 10⁹ cells out share a cell. That only makes more neighbours.
            match cells.entry((*point / (0.5 * typical)).floor().as_ivec3().clamp(IVec3::MIN / 2, IVec3::MAX / 2)) {
                Entry::Occupied(mut cell) => {
                    if !cell.get().contains(cluster) {
                        cell.get_mut().push(*cluster);
                    }
                }
                Entry::Vacant(cell) => drop(cell.insert(vec![*cluster])),
            }
        }
        for (place, here) in &cells {
            let around = (0..27).map(|k| IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1));
            for other in around.filter_map(|step| cells.get(&(*place + step))).flatten() {
                for cluster in here.iter().filter(|c| *c != other) {
                    if let Some(list) = lists.get_mut(*cluster as usize) {
                        list.push(*other);
                    }
                }
            }
        }
        for list in &mut lists {
            list.sort_unstable();
            list.dedup();
        }
        lists
    }

    fn random_colors(&self, seed: u64) -> Vec<Vec3> {
        let neighbours = self.neighbours();
        let palette = palette();
        let between: Vec<Vec<f64>> =
            palette.iter().map(|a| palette.iter().map(|b| least_difference(*a, *b)).collect()).collect();
        let mut taken: Vec<Option<usize>> = vec![None; self.centers.len()];
        for cluster in 0..taken.len() {
            let around: Vec<usize> = neighbours
                .get(cluster)
                .into_iter()
                .flatten()
                .filter_map(|other| taken.get(*other as usize).copied().flatten())
                .collect();
            let nearest = |row: &Vec<f64>| {
                around.iter().filter_map(|k| row.get(*k)).fold(f64::INFINITY, |least, d| least.min(*d))
            };
            let scores: Vec<f64> = between.iter().map(nearest).collect();
            let best = scores.iter().copied().fold(0.0, f64::max);
            let wanted = best.min(UNLIKE);
            let fitting: Vec<usize> = (0..palette.len()).filter(|k| scores.get(*k) >= Some(&wanted)).collect();
            let draw = mixed(seed ^ mixed(cluster as u64)) % fitting.len().max(1) as u64;
            if let Some(slot) = taken.get_mut(cluster) {
                *slot = fitting.get(draw as usize).copied();
            }
        }
        taken.into_iter().map(|k| k.and_then(|k| palette.get(k).copied()).unwrap_or(ColorMap::MISSING)).collect()
    }
}

/// Unit vector along which points spread most, its greatest component positive; +x if they do not spread.
fn first_axis(points: &[DVec3]) -> DVec3 {
    let mean = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let mut power =
        points.iter().map(|p| *p - mean).fold(DMat3::ZERO, |sum, d| sum + DMat3::from_cols(d * d.x, d * d.y, d * d.z));
    // Powers of two of the covariance: the remainder lies along the axis.
    for _ in 0..40 {
        let trace = power.x_axis.x + power.y_axis.y + power.z_axis.z;
        if !(trace > 0.0 && trace.is_finite()) {
            return DVec3::X;
        }
        power *= 1.0 / trace;
        power *= power;
    }
    let columns = [power.x_axis, power.y_axis, power.z_axis];
    let longest = columns.into_iter().fold(DVec3::ZERO, |a, b| if b.length() > a.length() { b } else { a });
    let axis = longest.try_normalize().unwrap_or(DVec3::X);
    let greatest = axis.to_array().into_iter().fold(0.0_f64, |a, b| if b.abs() > a.abs() { b } else { a });
    if greatest < 0.0 { -axis } else { axis }
}

/// Okabe and Ito's colors without black and grey: distinct for every kind of color vision.
const BASE: [[f32; 3]; 7] = [
    [0.902, 0.624, 0.0],
    [0.337, 0.706, 0.914],
    [0.0, 0.620, 0.451],
    [0.941, 0.894, 0.259],
    [0.0, 0.447, 0.698],
    [0.835, 0.369, 0.0],
    [0.800, 0.475, 0.655],
];

/// OKLab distance at which touching areas are clearly different. The palette prefers such colors.
const UNLIKE: f64 = 0.12;

/// Each base colour, darker, and lighter.
fn palette() -> Vec<Vec3> {
    let base = BASE.map(Vec3::from_array);
    let darker = base.map(|c| 0.55 * c);
    let lighter = base.map(|c| c.lerp(Vec3::ONE, 0.55));
    [base, darker, lighter].concat()
}

/// Distance of two colours in OKLab (Ottosson 2020), the least of ordinary vision and of the three dichromacies (Machado,
/// Oliveira and Fernandes 2009, severity 1).
fn least_difference(a: Vec3, b: Vec3) -> f64 {
    VISIONS.iter().map(|v| oklab(seen_with(v, a)).distance(oklab(seen_with(v, b)))).fold(f64::INFINITY, f64::min)
}

/// Rows from linear RGB to linear RGB.
const VISIONS: [[[f64; 3]; 3]; 4] = [
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    [[0.152_286, 1.052_583, -0.204_868], [0.114_503, 0.786_281, 0.099_216], [-0.003_882, -0.048_116, 1.051_998]],
    [[0.367_322, 0.860_646, -0.227_968], [0.280_085, 0.672_501, 0.047_413], [-0.011_820, 0.042_940, 0.968_881]],
    [[1.255_528, -0.076_749, -0.178_779], [-0.078_411, 0.930_809, 0.147_602], [0.004_733, 0.691_367, 0.303_900]],
];

fn seen_with(vision: &[[f64; 3]; 3], color: Vec3) -> DVec3 {
    let linear = color.as_dvec3().map(|x| if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) });
    let [r, g, b] = vision.map(DVec3::from_array);
    DVec3::new(r.dot(linear), g.dot(linear), b.dot(linear)).max(DVec3::ZERO)
}

fn oklab(linear: DVec3) -> DVec3 {
    let cone = |r: f64, g: f64, b: f64| DVec3::new(r, g, b).dot(linear).cbrt();
    let long = cone(0.412_221_470_8, 0.536_332_536_3, 0.051_445_992_9);
    let middle = cone(0.211_903_498_2, 0.680_699_545_1, 0.107_396_956_6);
    let short = cone(0.088_302_461_9, 0.281_718_837_6, 0.629_978_700_5);
    let cones = DVec3::new(long, middle, short);
    DVec3::new(
        DVec3::new(0.210_454_255_3, 0.793_617_785_0, -0.004_072_046_8).dot(cones),
        DVec3::new(1.977_998_495_1, -2.428_592_205_0, 0.450_593_709_9).dot(cones),
        DVec3::new(0.025_904_037_1, 0.782_771_766_2, -0.808_675_766_0).dot(cones),
    )
}

/// A well mixed 64-bit number (the finaliser of SplitMix64, Steele et al. 2014).
fn mixed(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_palette_is_told_apart_by_everybody() {
        for (k, a) in BASE.iter().enumerate() {
            for b in BASE.iter().skip(k + 1) {
                let d = least_difference(Vec3::from_array(*a), Vec3::from_array(*b));
                assert!(d > 0.04, "{a:?} {b:?}: {d}");
            }
        }
        // White and black are one apart, and OKLab of a grey has no colour.
        let (white, black) = (oklab(DVec3::ONE), oklab(DVec3::ZERO));
        assert!((white - DVec3::X).length() < 1e-3 && black.length() < 1e-9, "{white} {black}");
        assert!(palette().iter().all(|c| c.min_element() >= 0.0 && c.max_element() <= 1.0));
    }

    #[test]
    fn the_first_axis_is_the_longest_and_points_up() {
        let axis = DVec3::new(0.3, -0.9, 0.2).normalize();
        let (side, other) = axis.any_orthonormal_pair();
        let points: Vec<DVec3> = (0..200)
            .map(f64::from)
            .map(|k| axis * (k - 99.5) + side * (7.0 * k).sin() * 20.0 + other * (3.0 * k).cos() * 5.0)
            .collect();
        let got = first_axis(&points);
        assert!(got.dot(axis) < -0.99 && got.y > 0.0, "{got}");
        assert_eq!(first_axis(&[]), DVec3::X);
        assert_eq!(first_axis(&[DVec3::ONE; 3]), DVec3::X);
    }
}
