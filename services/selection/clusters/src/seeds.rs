//! Seeds of clusters: one Gaussian in each occupied voxel of a grid. A search finds the voxel edge.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::features::{Row, distance_squared as feature_distance_squared};
use crate::neighbours::Graph;
use crate::vertices::{Vertices, distance_squared};

/// Seeds and their spacing S.
#[derive(Debug, Clone, PartialEq)]
pub struct Seeds {
    /// Seed vertices.
    pub sources: Vec<u32>,
    /// Voxel edge in the scene's length unit: S of the clustering distance.
    pub cell: f64,
}

/// Components of at least this share of the mean cluster size get their own seeds. Smaller ones join the nearest cluster.
pub const MIN_SHARE: f64 = 0.25;

/// At most `most` seeds, one per occupied voxel and connected component.
///
/// The voxel edge is the smallest one with at most `most` occupied voxels. The seed of a voxel is the vertex nearest to the
/// mean of its vertices. Components that are too small for a cluster get no seed, unless all are too small. If there are
/// more than `most` components, only the largest get one.
#[must_use]
pub fn voxel_seeds(vertices: &Vertices, component: &[u32], components: usize, most: usize) -> Seeds {
    let n = vertices.len();
    let most = most.max(1);
    if n == 0 {
        return Seeds { sources: Vec::new(), cell: 1.0 };
    }
    let seeded = seeded_components(component, components, MIN_SHARE * n as f64 / most as f64, most);
    let grid = Grid::new(vertices, component, &seeded);
    let cell = grid.search(most);
    Seeds { sources: grid.seeds(cell), cell }
}

/// The components that get seeds.
fn seeded_components(component: &[u32], components: usize, least: f64, most: usize) -> Vec<bool> {
    let mut sizes = vec![0_usize; components];
    for &c in component {
        sizes[c as usize] += 1;
    }
    let mut by_size: Vec<usize> = (0..components).collect();
    by_size.sort_by_key(|&c| (std::cmp::Reverse(sizes[c]), c));
    let large = by_size.iter().filter(|&&c| sizes[c] as f64 >= least).count();
    let kept = if large == 0 { components } else { large };
    let mut seeded = vec![false; components];
    for &c in by_size.iter().take(kept.min(most)) {
        seeded[c] = true;
    }
    seeded
}

/// Contrast quantile up to which a voxel has twice the middle edge. Tuned on synthetic shapes outside all reports.
const LOW_CONTRAST_QUANTILE: f64 = 0.3;
/// Contrast quantile up to which a voxel has the middle edge.
const HIGH_CONTRAST_QUANTILE: f64 = 0.8;

/// Adaptive seeds: dense where neighbours differ, sparse elsewhere.
///
/// Voxels start with the edge 2S. A voxel is divided into eight if its mean contrast exceeds the low quantile of all
/// vertices. The children are divided again above the high quantile. S is searched as in [`voxel_seeds`] and is the length
/// unit of the clustering distance.
///
/// `contrast` has one finite entry per vertex (see [`contrast`]).
#[must_use]
pub fn adaptive_seeds(
    vertices: &Vertices,
    component: &[u32],
    components: usize,
    most: usize,
    contrast: &[f64],
) -> Seeds {
    let n = vertices.len();
    let most = most.max(1);
    let uniform = voxel_seeds(vertices, component, components, most);
    if n == 0 || uniform.sources.len() < 8 {
        return uniform;
    }
    let seeded = seeded_components(component, components, MIN_SHARE * n as f64 / most as f64, most);
    let grid = Grid::new(vertices, component, &seeded);
    let mut sorted = contrast.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let quantile = |q: f64| sorted[(q * (n - 1) as f64) as usize];
    let octree = Octree {
        grid: &grid,
        contrast,
        calm: quantile(LOW_CONTRAST_QUANTILE),
        lively: quantile(HIGH_CONTRAST_QUANTILE),
    };
    // The middle edge is near the uniform one: leaves have half of it, the same, or twice as much.
    let (mut too_small, mut enough) = (0.25 * uniform.cell, 4.0 * uniform.cell);
    let mut leaves = octree.leaves(enough);
    if leaves.count > most {
        return uniform;
    }
    for _ in 0..14 {
        let middle = (enough * too_small).sqrt();
        let tried = octree.leaves(middle);
        if tried.count > most {
            too_small = middle;
            continue;
        }
        enough = middle;
        leaves = tried;
        if leaves.count * 100 >= most * 99 {
            break;
        }
    }
    Seeds { sources: grid.nearest_to_means(&leaves.of, leaves.count), cell: enough }
}

/// Local contrast of each vertex: the mean squared feature distance to its neighbours, smoothed over the neighbourhood.
///
/// It is high on curved surfaces, at edges and between parts of different shape.
#[must_use]
pub fn contrast(graph: &Graph, rows: &[Row]) -> Vec<f64> {
    let mean = |(sum, count): (f64, u32)| if count > 0 { sum / f64::from(count) } else { 0.0 };
    let own: Vec<f64> = (0..graph.len() as u32)
        .into_par_iter()
        .map(|v| {
            let differences =
                graph.neighbours(v).map(|(w, _)| feature_distance_squared(&rows[v as usize], &rows[w as usize]));
            mean(differences.fold((0.0, 0), |(s, n), d| (s + d, n + 1)))
        })
        .collect();
    (0..graph.len() as u32)
        .into_par_iter()
        .map(|v| {
            let around = graph.neighbours(v).map(|(w, _)| own[w as usize]);
            mean(around.fold((own[v as usize], 1), |(s, n), d| (s + d, n + 1)))
        })
        .collect()
}

/// Voxels of three sizes, chosen by contrast.
struct Octree<'a> {
    grid: &'a Grid<'a>,
    contrast: &'a [f64],
    calm: f64,
    lively: f64,
}

/// The leaf of each member of a grid, in the grid's order.
struct Leaves {
    of: Vec<(u32, usize)>,
    count: usize,
}

impl Octree<'_> {
    fn leaves(&self, middle: f64) -> Leaves {
        type Key = (u32, u8, [i64; 3]);
        let places: Vec<(u32, u32, [i64; 3])> =
            self.grid.members().map(|(v, c, p)| (v, c, self.grid.voxel(p, 0.5 * middle))).collect();
        let key = |c: u32, size: u8, fine: [i64; 3]| -> Key { (c, size, fine.map(|x| x >> size)) };
        let mut sums: HashMap<Key, (f64, f64)> = HashMap::new();
        for &(v, c, fine) in &places {
            for size in [2, 1] {
                let entry = sums.entry(key(c, size, fine)).or_default();
                entry.0 += self.contrast[v as usize];
                entry.1 += 1.0;
            }
        }
        let is = |k: &Key, limit: f64| sums.get(k).is_some_and(|(sum, count)| *sum <= limit * count);
        let mut number: HashMap<Key, usize> = HashMap::new();
        let of = places
            .iter()
            .map(|&(v, c, fine)| {
                let (large, medium) = (key(c, 2, fine), key(c, 1, fine));
                let leaf = if is(&large, self.calm) {
                    large
                } else if is(&medium, self.lively) {
                    medium
                } else {
                    key(c, 0, fine)
                };
                let next = number.len();
                (v, *number.entry(leaf).or_insert(next))
            })
            .collect();
        Leaves { of, count: number.len() }
    }
}

struct Grid<'a> {
    vertices: &'a Vertices,
    component: &'a [u32],
    seeded: &'a [bool],
    origin: [f64; 3],
    extent: f64,
}

impl<'a> Grid<'a> {
    fn new(vertices: &'a Vertices, component: &'a [u32], seeded: &'a [bool]) -> Self {
        let mut min = [f64::INFINITY; 3];
        let mut max = [f64::NEG_INFINITY; 3];
        for (p, _) in vertices.position.iter().zip(component).filter(|(_, c)| seeded[**c as usize]) {
            for a in 0..3 {
                min[a] = min[a].min(p[a]);
                max[a] = max[a].max(p[a]);
            }
        }
        let extent = (0..3).map(|a| max[a] - min[a]).fold(0.0, f64::max);
        Self { vertices, component, seeded, origin: min, extent }
    }

    fn members(&self) -> impl Iterator<Item = (u32, u32, &[f64; 3])> + '_ {
        (0..)
            .zip(self.component)
            .zip(&self.vertices.position)
            .filter(|((_, c), _)| self.seeded[**c as usize])
            .map(|((v, &c), p)| (v, c, p))
    }

    /// Voxel of a point. The conversion saturates, so a far outlier gets a far voxel.
    fn voxel(&self, p: &[f64; 3], cell: f64) -> [i64; 3] {
        std::array::from_fn(|a| ((p[a] - self.origin[a]) / cell).floor() as i64)
    }

    /// The smallest edge found with at most `most` occupied voxels.
    fn search(&self, most: usize) -> f64 {
        if self.extent.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
            // A single point, or only coincident points: any edge is valid.
            return 1.0;
        }
        let distinct = self.vertices.coincident_runs().len() - 1;
        let mut enough = self.extent * (1.0 + 1e-9);
        let mut too_small = enough;
        loop {
            too_small *= 0.5;
            match self.occupied(too_small, most) {
                None => break,
                Some(count) => {
                    enough = too_small;
                    if count == distinct || too_small < 1e-15 * self.extent {
                        return enough;
                    }
                }
            }
        }
        for _ in 0..24 {
            let middle = (enough * too_small).sqrt();
            match self.occupied(middle, most) {
                None => too_small = middle,
                Some(count) => {
                    enough = middle;
                    if count * 100 >= most * 99 {
                        break;
                    }
                }
            }
        }
        enough
    }

    /// Number of occupied voxels; `None` above `most`.
    fn occupied(&self, cell: f64, most: usize) -> Option<usize> {
        // Voxels are counted by 64-bit hashes. A collision is very unlikely and would only add one seed before the merge.
        let mask = (2 * most + 2).next_power_of_two() - 1;
        let mut table = vec![0_u64; mask + 1];
        let mut count = 0;
        let mut last = ([i64::MIN; 3], u32::MAX);
        for (_, c, p) in self.members() {
            let voxel = self.voxel(p, cell);
            if (voxel, c) == last {
                continue;
            }
            last = (voxel, c);
            let hash = mix(voxel, c).max(1);
            let mut slot = hash as usize & mask;
            while table[slot] != 0 && table[slot] != hash {
                slot = (slot + 1) & mask;
            }
            if table[slot] == 0 {
                count += 1;
                if count > most {
                    return None;
                }
                table[slot] = hash;
            }
        }
        Some(count)
    }

    fn seeds(&self, cell: f64) -> Vec<u32> {
        let mut number: HashMap<(u32, [i64; 3]), usize> = HashMap::new();
        let of: Vec<(u32, usize)> = self
            .members()
            .map(|(v, c, p)| {
                let next = number.len();
                (v, *number.entry((c, self.voxel(p, cell))).or_insert(next))
            })
            .collect();
        self.nearest_to_means(&of, number.len())
    }

    /// The vertex nearest to the mean position of each of `count` groups. Ties go to the smaller scene-wide index.
    fn nearest_to_means(&self, of: &[(u32, usize)], count: usize) -> Vec<u32> {
        let mut sums: Vec<([f64; 3], f64)> = vec![([0.0; 3], 0.0); count];
        for &(v, id) in of {
            for (sum, x) in sums[id].0.iter_mut().zip(&self.vertices.position[v as usize]) {
                *sum += x;
            }
            sums[id].1 += 1.0;
        }
        let mut best: Vec<Option<(f64, u32, u32)>> = vec![None; sums.len()];
        for &(v, id) in of {
            let (sum, count) = sums[id];
            let d = distance_squared(&self.vertices.position[v as usize], &sum.map(|x| x / count));
            let candidate = (d, self.vertices.gaussian[v as usize], v);
            if best[id].is_none_or(|b| candidate < b) {
                best[id] = Some(candidate);
            }
        }
        best.into_iter().flatten().map(|b| b.2).collect()
    }
}

/// SplitMix64 hash of the voxel and its component.
fn mix(voxel: [i64; 3], component: u32) -> u64 {
    let mut h = u64::from(component);
    for x in voxel {
        h = (h ^ x as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
        h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        h ^= h >> 31;
    }
    h
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_scene::synthetic::random_points_f64;

    fn vertices(points: Vec<[f64; 3]>) -> Vertices {
        Vertices::ordered((0..).zip(points).collect())
    }

    #[test]
    fn the_number_of_seeds_is_just_below_the_limit() {
        let v = vertices(random_points_f64(20_000, 1));
        for most in [1, 2, 50, 999] {
            let seeds = voxel_seeds(&v, &vec![0; v.len()], 1, most);
            assert!(
                seeds.sources.len() <= most && seeds.sources.len() * 2 >= most,
                "{} of {most}",
                seeds.sources.len()
            );
        }
    }

    #[test]
    fn few_points_are_seeds_each() {
        let v = vertices(random_points_f64(100, 2));
        assert_eq!(voxel_seeds(&v, &[0; 100], 1, 999).sources.len(), 100);
        let v = vertices(vec![[3.0; 3]; 100]);
        assert_eq!(voxel_seeds(&v, &[0; 100], 1, 999).sources, [0]);
        assert!(voxel_seeds(&vertices(Vec::new()), &[], 0, 999).sources.is_empty());
    }

    #[test]
    fn a_large_component_gets_a_seed_and_a_small_one_does_not() {
        let mut points = random_points_f64(2000, 3);
        points.extend((0..3).map(|i| [0.5, 0.5, 0.5 + 1e-4 * f64::from(i)]));
        points.extend((0..900).map(|i| [0.51 + 1e-5 * f64::from(i), 0.5, 0.5]));
        let v = vertices(points);
        let component: Vec<u32> = v.gaussian.iter().map(|&g| u32::from(g >= 2000) + u32::from(g >= 2003)).collect();
        let seeds = voxel_seeds(&v, &component, 3, 50);
        let of: Vec<u32> = seeds.sources.iter().map(|&s| component[s as usize]).collect();
        assert!(!of.contains(&1) && of.contains(&0) && of.contains(&2), "{of:?}");
    }

    #[test]
    fn more_components_than_seeds_keep_the_largest() {
        let v = vertices(random_points_f64(60, 4));
        let component: Vec<u32> = (0..60).map(|i| i / 2).collect();
        assert_eq!(voxel_seeds(&v, &component, 30, 7).sources.len(), 7);
    }

    #[test]
    fn seeds_stand_closer_where_contrast_is_high() {
        let v = vertices(random_points_f64(30_000, 6));
        let lively = |p: &[f64; 3]| p[0] > 0.8;
        let contrast: Vec<f64> = v.position.iter().map(|p| if lively(p) { 1.0 } else { 0.01 * p[1] }).collect();
        let component = vec![0; v.len()];
        for most in [50, 500, 999] {
            let seeds = adaptive_seeds(&v, &component, 1, most, &contrast);
            let own = seeds.sources.iter().filter(|s| lively(&v.position[**s as usize])).count();
            let share = own as f64 / seeds.sources.len() as f64;
            println!("{} of {most} seeds, {share:.2} of them in the lively fifth", seeds.sources.len());
            assert!(seeds.sources.len() <= most && seeds.sources.len() * 10 >= most * 7);
            assert!(most < 100 || share > 0.28, "{share}");
        }
        // Nothing differs: the voxels of the calm size are all there are.
        let flat = adaptive_seeds(&v, &component, 1, 300, &vec![0.5; v.len()]);
        assert!(flat.sources.len() <= 300 && flat.sources.len() >= 200);
        assert!(adaptive_seeds(&vertices(Vec::new()), &[], 0, 9, &[]).sources.is_empty());
    }

    #[test]
    fn an_outlier_does_not_starve_the_rest() {
        let mut points = random_points_f64(5000, 5);
        points.push([1e12, 0.0, 0.0]);
        let v = vertices(points);
        let seeds = voxel_seeds(&v, &vec![0; v.len()], 1, 200);
        assert!(seeds.sources.len() > 100, "{}", seeds.sources.len());
    }
}
