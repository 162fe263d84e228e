//! Importance of voxels for the placement of Gaussians.

use glam::{DVec3, UVec3, Vec3};
use rayon::prelude::*;
use sg_volume::{Grid, Surfaceness};

use crate::classification::Crop;
use crate::visibility::least_optical_depth;

/// Additional weight of a voxel at an opacity change of 1 across it.
pub(crate) const BOUNDARY_GAIN: f32 = 2.0;
/// Importance of homogeneous values that another transfer function shows, relative to that of a clear boundary.
const HOMOGENEOUS: f32 = 0.3;
/// Least importance of a candidate, relative to the greatest importance.
const LEAST_SHARE: f32 = 1e-3;

/// A voxel for Gaussians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    /// Index of the voxel in the volume.
    pub(crate) voxel: u32,
    /// Importance, above 0.
    pub(crate) weight: f32,
    /// What of it is for other transfer functions: the least importance of each part of the voxel.
    pub(crate) least: f32,
}

/// The candidates of one base unit along a Morton curve: neighbours in the list are neighbours in space.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Candidates {
    pub(crate) list: Vec<Candidate>,
    /// First voxel of the curve in the volume.
    pub(crate) first: UVec3,
    /// Sum of the weights.
    pub(crate) total: f64,
    /// Importance of each voxel of the box from `first` relative to its opacity, x fastest. Transparent voxels have one too.
    emphasis: Vec<f32>,
    /// Size of the box.
    dims: UVec3,
    /// Side of a cube with the volume of a voxel.
    voxel_side: f32,
}

impl Candidates {
    /// Importance of a voxel of the extinction `sigma` (per length) around a position in voxel coordinates of the volume. The
    /// emphasis is interpolated. Positions outside of the box are clamped.
    pub(crate) fn importance_at(&self, voxel: DVec3, sigma: f32) -> f32 {
        self.emphasis_at(voxel) * opacity_over(sigma, self.voxel_side)
    }

    fn emphasis_at(&self, voxel: DVec3) -> f32 {
        let last = self.dims - UVec3::ONE;
        let p = (voxel - self.first.as_dvec3()).clamp(DVec3::ZERO, last.as_dvec3());
        let low = p.floor();
        let t = (p - low).as_vec3();
        let low = low.as_uvec3();
        let at = |x, y, z| {
            let q = (low + UVec3::new(x, y, z)).min(last);
            self.emphasis[(q.x + self.dims.x * (q.y + self.dims.y * q.z)) as usize]
        };
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let along_x = |y, z| lerp(at(0, y, z), at(1, y, z), t.x);
        let along_y = |z| lerp(along_x(0, z), along_x(1, z), t.y);
        lerp(along_y(0), along_y(1), t.z)
    }
}

/// Computes the importance of the voxels of a base unit. It is the opacity over one voxel, times the transmittance of the
/// same unit along the clearest direction, which counts as at least `interior`. Boundaries of the opacity get more weight. Values of
/// which another function may show more have at least their emphasis times `hidden`.
pub(crate) fn candidates(crop: &Crop, grid: &Grid, interior: f32, hidden: f32) -> Candidates {
    let step = |d: [i32; 3]| grid.vector_to_world(DVec3::from_array(d.map(f64::from))).length() as f32;
    let mut emphasis = least_optical_depth(&crop.extinction, crop.dims, step);
    let voxel_side = grid.voxel_volume().cbrt() as f32;
    let (nx, ny, nz) = (crop.dims.x as usize, crop.dims.y as usize, crop.dims.z as usize);
    let opacity = |at: usize| opacity_over(crop.extinction[at], voxel_side);
    emphasis.par_chunks_mut(nx).enumerate().for_each(|(row, emphasis)| {
        let (y, z) = (row % ny, row / ny);
        for (x, e) in emphasis.iter_mut().enumerate() {
            let at = x + nx * row;
            let change = |k: usize, n: usize, stride: usize| {
                let side = |inside: bool, neighbour: usize| opacity(if inside { neighbour } else { at });
                side(k + 1 < n, at + stride) - side(k > 0, at.wrapping_sub(stride))
            };
            let boundary = Vec3::new(change(x, nx, 1), change(y, ny, nx), change(z, nz, nx * ny)).length().min(1.0);
            *e = (-*e).exp().max(interior) * (1.0 + BOUNDARY_GAIN * boundary);
        }
    });
    let least = |at: usize| hidden * crop.emphasis.get(at).copied().unwrap_or(0.0);
    let weights: Vec<f32> = emphasis.par_iter().enumerate().map(|(at, e)| (e * opacity(at)).max(least(at))).collect();
    let greatest = weights.par_iter().copied().reduce(|| 0.0, f32::max);
    let mut list = Vec::new();
    let mut total = 0.0;
    in_morton_order(crop.dims, &mut |x, y, z| {
        let at = (x + crop.dims.x * (y + crop.dims.y * z)) as usize;
        let weight = weights[at];
        if weight > LEAST_SHARE * greatest {
            let p = crop.first + UVec3::new(x, y, z);
            // A grid has fewer than 2³² voxels.
            let voxel = grid.index(p.x as usize, p.y as usize, p.z as usize) as u32;
            list.push(Candidate { voxel, weight, least: least(at) });
            total += f64::from(weight);
        }
    });
    Candidates { list, first: crop.first, total, emphasis, dims: crop.dims, voxel_side }
}

/// Importance of a place where another transfer function shows its value, 0 to 1: boundaries count most, and the values of the empty
/// space around the subject do not count. `gradient` is the length of the gradient.
pub(crate) fn importance_of_value(
    raw: f64,
    gradient: f32,
    background: Option<[f64; 2]>,
    surfaceness: &Surfaceness,
) -> f32 {
    if !raw.is_finite() {
        return 0.0;
    }
    let is_empty = background.is_some_and(|[low, high]| low <= raw && raw <= high);
    let inside = if is_empty { 0.0 } else { HOMOGENEOUS };
    inside + (1.0 - HOMOGENEOUS) * surfaceness.at(raw, gradient)
}

/// Opacity of an extinction (per length) over a length.
pub(crate) fn opacity_over(sigma: f32, length: f32) -> f32 {
    -(-sigma.max(0.0) * length).exp_m1()
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
        let crop = Crop { first: UVec3::ZERO, dims, extinction, emphasis: Vec::new() };
        let c = candidates(&crop, &grid, 0.0, 0.0);
        let weight = |x: usize| {
            let voxel = grid.index(x, 8, 8) as u32;
            c.list.iter().find(|c| c.voxel == voxel).map_or(0.0, |c| c.weight)
        };
        assert!(weight(2) > 5.0 * weight(3) && weight(3) > weight(4) && weight(7) == 0.0);
        let at = |x: f64| c.importance_at(DVec3::new(x, 8.0, 8.0), 2.0);
        assert_eq!(at(3.0), weight(3));
        assert!((at(2.25) - (0.75 * weight(2) + 0.25 * weight(3))).abs() < 1e-6);
        assert_eq!(at(-9.0), at(0.0));
        assert_eq!(c.importance_at(DVec3::splat(99.0), 0.0), 0.0);
        let sum: f64 = c.list.iter().map(|c| f64::from(c.weight)).sum();
        assert!((sum - c.total).abs() < 1e-9 * sum);
        // What is hidden keeps the share that is asked for.
        let c = candidates(&crop, &grid, 0.1, 0.0);
        let core = c.list.iter().find(|c| c.voxel == grid.index(7, 8, 8) as u32).unwrap();
        assert!((core.weight - 0.1 * (1.0 - (-2.0_f32).exp())).abs() < 1e-6, "{}", core.weight);
    }
}
