//! Importance of voxels for the placement of Gaussians.

use glam::{DVec3, UVec3, Vec3};
use rayon::prelude::*;
use sg_volume::Grid;

use crate::classification::Crop;
use crate::visibility::least_optical_depth;

/// Additional weight of a voxel at an opacity change of 1 across it.
const BOUNDARY_GAIN: f32 = 2.0;
/// Least importance of a candidate, relative to the greatest importance.
const LEAST_SHARE: f32 = 1e-3;

/// A voxel for Gaussians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    /// Index of the voxel in the volume.
    pub(crate) voxel: u32,
    /// Importance, above 0.
    pub(crate) weight: f32,
}

/// The candidates of one base unit along a Morton curve: neighbours in the list are neighbours in space.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Candidates {
    pub(crate) list: Vec<Candidate>,
    /// First voxel of the curve in the volume.
    pub(crate) first: UVec3,
    /// Sum of the weights.
    pub(crate) total: f64,
}

/// Computes the importance of the voxels of a base unit. It is the opacity over one voxel, times the transmittance of the
/// same unit along the clearest direction. Boundaries of the opacity get more weight.
pub(crate) fn candidates(crop: &Crop, grid: &Grid) -> Candidates {
    let step = |d: [i32; 3]| grid.vector_to_world(DVec3::from_array(d.map(f64::from))).length() as f32;
    let mut weights = least_optical_depth(&crop.extinction, crop.dims, step);
    let size = grid.voxel_volume().cbrt() as f32;
    let (nx, ny, nz) = (crop.dims.x as usize, crop.dims.y as usize, crop.dims.z as usize);
    let opacity = |sigma: f32| -(-sigma * size).exp_m1();
    weights.par_chunks_mut(nx).enumerate().for_each(|(row, weights)| {
        let (y, z) = (row % ny, row / ny);
        for (x, w) in weights.iter_mut().enumerate() {
            let at = x + nx * row;
            let sigma = crop.extinction[at];
            if sigma <= 0.0 {
                *w = 0.0;
                continue;
            }
            let change = |k: usize, n: usize, stride: usize| {
                let side = |inside: bool, at: usize| if inside { opacity(crop.extinction[at]) } else { opacity(sigma) };
                side(k + 1 < n, at + stride) - side(k > 0, at.wrapping_sub(stride))
            };
            let boundary = Vec3::new(change(x, nx, 1), change(y, ny, nx), change(z, nz, nx * ny)).length().min(1.0);
            *w = (-*w).exp() * opacity(sigma) * (1.0 + BOUNDARY_GAIN * boundary);
        }
    });
    let greatest = weights.par_iter().copied().reduce(|| 0.0, f32::max);
    let mut list = Vec::new();
    let mut total = 0.0;
    in_morton_order(crop.dims, &mut |x, y, z| {
        let weight = weights[(x + crop.dims.x * (y + crop.dims.y * z)) as usize];
        if weight > LEAST_SHARE * greatest {
            let p = crop.first + UVec3::new(x, y, z);
            // A grid has fewer than 2³² voxels.
            let voxel = grid.index(p.x as usize, p.y as usize, p.z as usize) as u32;
            list.push(Candidate { voxel, weight });
            total += f64::from(weight);
        }
    });
    Candidates { list, first: crop.first, total }
}

/// Visits every voxel of a box along the Morton curve of the smallest enclosing power-of-two cube.
fn in_morton_order(dims: UVec3, visit: &mut impl FnMut(u32, u32, u32)) {
    fn cell(low: UVec3, size: u32, dims: UVec3, visit: &mut impl FnMut(u32, u32, u32)) {
        if low.cmpge(dims).any() {
            return;
        }
        if size == 1 {
            visit(low.x, low.y, low.z);
            return;
        }
        let half = size / 2;
        for octant in 0..8 {
            let offset = UVec3::new(octant & 1, octant >> 1 & 1, octant >> 2 & 1) * half;
            cell(low + offset, half, dims, visit);
        }
    }
    cell(UVec3::ZERO, dims.max_element().next_power_of_two(), dims, visit);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_visits_every_voxel_once_with_short_steps() {
        let dims = UVec3::new(8, 8, 8);
        let mut visited = Vec::new();
        in_morton_order(dims, &mut |x, y, z| visited.push(UVec3::new(x, y, z)));
        let mut sorted: Vec<u32> = visited.iter().map(|p| p.x + 8 * (p.y + 8 * p.z)).collect();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..512));
        let mean = visited.windows(2).map(|w| (w[1].as_vec3() - w[0].as_vec3()).length()).sum::<f32>() / 511.0;
        assert!(mean < 2.0, "{mean}");

        let mut count = 0;
        in_morton_order(UVec3::new(5, 1, 3), &mut |x, y, z| {
            assert!(x < 5 && y < 1 && z < 3);
            count += 1;
        });
        assert_eq!(count, 15);
    }

    #[test]
    fn the_surface_of_an_opaque_block_is_more_important_than_its_core() {
        let grid = Grid::unit([16, 16, 16]).unwrap();
        let dims = UVec3::splat(16);
        let extinction: Vec<f32> = (0..4096_u32)
            .map(|i| {
                let inside = |k: u32| (2..14).contains(&k);
                if inside(i % 16) && inside(i / 16 % 16) && inside(i / 256) { 2.0 } else { 0.0 }
            })
            .collect();
        let c = candidates(&Crop { first: UVec3::ZERO, dims, extinction }, &grid);
        let weight = |x: usize| {
            let voxel = grid.index(x, 8, 8) as u32;
            c.list.iter().find(|c| c.voxel == voxel).map_or(0.0, |c| c.weight)
        };
        assert!(weight(2) > 5.0 * weight(3) && weight(3) > weight(4) && weight(7) == 0.0);
        let sum: f64 = c.list.iter().map(|c| f64::from(c.weight)).sum();
        assert!((sum - c.total).abs() < 1e-9 * sum);
    }
}
