//! Signs for normals without one: rays that see out of the scene vote, and the votes spread over the neighbour graph.
//!
//! From a surface, the side on which more rays leave the scene without meeting a Gaussian is the outside. Each of some
//! Gaussians casts 24 rays. The votes then spread to neighbours whose normals agree up to the sign. Work is bounded:
//! at most 40,000 Gaussians vote, each ray ends at the grid's border, and the number of sweeps is fixed.

use glam::DVec3;
use rayon::prelude::*;

use crate::features::median;
use crate::neighbours::Graph;

/// Rays of a voter, over all directions.
const RAYS: usize = 24;
/// Most Gaussians that cast rays.
const MAX_VOTERS: usize = 40_000;
/// Cells of the longest edge of the grid.
const CELLS: f64 = 96.0;
/// Rays within this cosine of the surface belong to neither side.
const GRAZING: f64 = 0.3;
/// Sweeps over the graph, forwards and backwards.
const SWEEPS: usize = 12;
/// Weight of a Gaussian's own vote beside its neighbours'.
const OWN: f64 = 0.02;

/// Gives each of the normals the sign that points outwards. Zero and broken normals stay as they are.
///
/// `positions` are those of the graph's vertices, and `normals` are unit vectors of either sign. The result does not depend
/// on their signs, except where the two sides are alike.
#[must_use]
pub fn oriented(positions: &[[f64; 3]], graph: &Graph, mut normals: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
    let n = normals.len();
    let mut lengths =
        graph.lengths().data().iter().copied().step_by(graph.lengths().nnz() / 10_000 + 1).collect::<Vec<_>>();
    let Some(grid) = Grid::new(positions, median(&mut lengths).unwrap_or(0.0)) else { return normals };
    let stride = n.div_ceil(MAX_VOTERS).max(1);
    let directions = directions();
    let votes: Vec<f64> = (0..n)
        .into_par_iter()
        .with_min_len(256)
        .map(|v| if v % stride == 0 { grid.vote(&directions, positions[v], normals[v]) } else { 0.0 })
        .collect();
    let mut sums = votes.clone();
    let sweep = |v: usize, sums: &mut [f64]| {
        let (mut sum, mut weight) = (0.0, 0.0);
        for (w, length) in graph.neighbours(v as u32) {
            let own = agreement([positions[v], positions[w as usize]], [normals[v], normals[w as usize]], length);
            sum += own * sums[w as usize];
            weight += own.abs();
        }
        let around = if weight > 0.0 { sum / weight } else { 0.0 };
        sums[v] = OWN * votes[v] + (1.0 - OWN) * around;
    };
    for _ in 0..SWEEPS {
        (0..n).for_each(|v| sweep(v, &mut sums));
        (0..n).rev().for_each(|v| sweep(v, &mut sums));
    }
    for (normal, sum) in normals.iter_mut().zip(&sums) {
        if *sum < 0.0 {
            *normal = normal.map(|x| -x);
        }
    }
    normals
}

/// How far two neighbours' normals agree, with the sign of their dot product. Near 0 across a thin wall, where one lies in
/// front of the other.
fn agreement(positions: [[f64; 3]; 2], normals: [[f32; 3]; 2], length: f64) -> f64 {
    let [a, b] = normals.map(|n| DVec3::from_array(n.map(f64::from)));
    let along = if length > 0.0 {
        (DVec3::from_array(positions[0]) - DVec3::from_array(positions[1])) / length
    } else {
        DVec3::ZERO
    };
    let beside = |n: DVec3| 1.0 - n.dot(along).abs().min(1.0);
    let agreed = a.dot(b) * beside(a) * beside(b);
    if agreed.is_finite() { agreed } else { 0.0 }
}

/// Directions spread evenly over the sphere (a Fibonacci lattice).
fn directions() -> [DVec3; RAYS] {
    std::array::from_fn(|i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / RAYS as f64;
        let angle = i as f64 * std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let ring = (1.0 - z * z).sqrt();
        DVec3::new(ring * angle.cos(), ring * angle.sin(), z)
    })
}

/// Which cells of a box hold a Gaussian.
struct Grid {
    low: DVec3,
    cell: f64,
    size: [i64; 3],
    full: Vec<bool>,
}

impl Grid {
    /// The grid over the middle 99 % of the positions along each axis. A cell is no smaller than the spacing of the
    /// Gaussians, so that no ray slips between them. `None` where the positions have no extent.
    fn new(positions: &[[f64; 3]], spacing: f64) -> Option<Self> {
        let (mut low, mut high) = (DVec3::ZERO, DVec3::ZERO);
        for axis in 0..3 {
            let mut values: Vec<f64> = positions.iter().map(|p| p[axis]).collect();
            let cut = values.len() / 200;
            let last = values.len().checked_sub(1 + cut)?;
            low[axis] = *values.select_nth_unstable_by(cut, f64::total_cmp).1;
            high[axis] = *values.select_nth_unstable_by(last, f64::total_cmp).1;
        }
        let extent = high - low;
        let cell = f64::max(extent.max_element() / CELLS, spacing);
        if !(cell > 0.0 && cell.is_finite()) {
            return None;
        }
        let size = extent.to_array().map(|e| (e / cell) as i64 + 1);
        let mut grid = Self { low, cell, size, full: vec![false; size.iter().product::<i64>() as usize] };
        for p in positions {
            if let Some(at) = grid.at(DVec3::from_array(*p)) {
                grid.full[at] = true;
            }
        }
        Some(grid)
    }

    /// Index of the cell of a place inside the box.
    fn at(&self, p: DVec3) -> Option<usize> {
        let place = ((p - self.low) / self.cell).floor();
        let mut index = 0;
        for axis in [2, 1, 0] {
            let (x, size) = (place[axis], self.size[axis]);
            if !(x >= 0.0 && x < size as f64) {
                return None;
            }
            index = index * size as usize + x as usize;
        }
        Some(index)
    }

    /// The share of rays that see out on the side of the normal, less that on the other side.
    fn vote(&self, directions: &[DVec3; RAYS], position: [f64; 3], normal: [f32; 3]) -> f64 {
        let (position, normal) = (DVec3::from_array(position), DVec3::from_array(normal.map(f64::from)));
        let (mut seen, mut cast) = ([0.0; 2], [0.0; 2]);
        for direction in directions {
            let across = direction.dot(normal);
            if across.abs() > GRAZING {
                let side = usize::from(across < 0.0);
                cast[side] += 1.0;
                // Own cell and its neighbours are left before the ray counts.
                seen[side] += f64::from(u8::from(self.sees_out(position + 2.5 * self.cell * *direction, *direction)));
            }
        }
        if cast.contains(&0.0) { 0.0 } else { seen[0] / cast[0] - seen[1] / cast[1] }
    }

    fn sees_out(&self, from: DVec3, direction: DVec3) -> bool {
        let step = self.cell * direction;
        let mut place = from;
        for _ in 0..(2.0 * CELLS) as usize {
            match self.at(place) {
                None => return true,
                Some(at) if self.full[at] => return false,
                Some(_) => place += step,
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neighbours::neighbour_graph;
    use crate::vertices::Vertices;
    use rand::RngExt;
    use sg_scene::synthetic::generator;

    /// Share of the normals that point outwards after random signs.
    fn right(points: &[([f64; 3], [f32; 3])], seed: u64) -> f64 {
        let vertices = Vertices::ordered((0..).zip(points.iter().map(|p| p.0)).collect());
        let graph = neighbour_graph(&vertices, 10).unwrap();
        let mut r = generator(seed);
        let truth: Vec<[f32; 3]> = vertices.gaussian.iter().map(|g| points[*g as usize].1).collect();
        let scrambled: Vec<[f32; 3]> =
            truth.iter().map(|n| if r.random_bool(0.5) { *n } else { n.map(|x| -x) }).collect();
        let found = oriented(&vertices.position, &graph, scrambled);
        let agree = found.iter().zip(&truth).filter(|(a, b)| a == b).count();
        agree as f64 / points.len() as f64
    }

    fn ball(centre: [f64; 3], radius: f64, n: usize, seed: u64) -> Vec<([f64; 3], [f32; 3])> {
        let mut r = generator(seed);
        (0..n)
            .map(|_| {
                let z = r.random_range(-1.0..1.0_f64);
                let angle = r.random_range(0.0..std::f64::consts::TAU);
                let ring = (1.0 - z * z).sqrt();
                let d = [ring * angle.cos(), ring * angle.sin(), z];
                (std::array::from_fn(|a| centre[a] + radius * d[a]), d.map(|x| x as f32))
            })
            .collect()
    }

    #[test]
    fn scrambled_normals_of_touching_balls_point_outwards_again() {
        let mut points = ball([0.0; 3], 1.0, 6000, 1);
        points.extend(ball([1.5, 0.0, 0.0], 0.5, 2000, 2));
        let share = right(&points, 3);
        println!("two balls: {share:.4} right");
        assert!(share > 0.98, "{share}");
    }

    #[test]
    fn missing_and_broken_normals_and_points_without_extent_are_left_alone() {
        let (graph, none) = (neighbour_graph(&Vertices::default(), 10).unwrap(), Vec::new());
        assert!(oriented(&[], &graph, none).is_empty());
        let mut points = ball([0.0; 3], 1.0, 300, 4);
        points[7].1 = [0.0; 3];
        points[8].1 = [f32::NAN; 3];
        points[9].0 = [1e30, 0.0, 0.0];
        let vertices = Vertices::ordered((0..).zip(points.iter().map(|p| p.0)).collect());
        let graph = neighbour_graph(&vertices, 10).unwrap();
        let normals: Vec<[f32; 3]> = vertices.gaussian.iter().map(|g| points[*g as usize].1).collect();
        let found = oriented(&vertices.position, &graph, normals.clone());
        let same =
            |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).all(|(x, y)| x.abs() == y.abs() || x.is_nan() && y.is_nan());
        assert!(found.iter().zip(&normals).all(|(a, b)| same(a, b)));
        let one = Vertices::ordered((0..9).map(|i| (i, [0.5; 3])).collect());
        let graph = neighbour_graph(&one, 4).unwrap();
        assert_eq!(oriented(&one.position, &graph, vec![[0.0, 0.0, -1.0]; 9]), vec![[0.0, 0.0, -1.0]; 9]);
    }
}
