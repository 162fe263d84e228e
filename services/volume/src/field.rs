//! The values of a volume in f32: sampling, gradients, smoothing.

use glam::{DVec3, Mat3, Vec3};
use rayon::prelude::*;

use crate::grid::Grid;
use crate::scalars::ValueRange;

/// The values of a volume in f32 on its grid: `raw value = offset + stored value`.
#[derive(Debug, Clone)]
pub struct Field {
    grid: Grid,
    values: Vec<f32>,
    offset: f64,
    range: ValueRange,
    gradient_to_world: Mat3,
}

impl Field {
    /// `values` must have one entry for each voxel of `grid`.
    pub(crate) fn from_parts(grid: Grid, values: Vec<f32>, offset: f64, range: ValueRange) -> Self {
        debug_assert_eq!(grid.len(), values.len());
        let gradient_to_world = grid.gradient_to_world();
        Self { grid, values, offset, range, gradient_to_world }
    }

    /// The grid of the voxels.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Stored values (raw value − offset), x fastest.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The raw value of a stored 0.
    #[must_use]
    pub fn offset(&self) -> f64 {
        self.offset
    }

    /// Range of the finite raw values, and the number of other values.
    #[must_use]
    pub fn range(&self) -> ValueRange {
        self.range
    }

    /// The same values as a part of a series with this range of raw values. What refers to the range is then the same in all
    /// steps: normalized transfer functions, and rises of boundaries.
    #[must_use]
    pub fn with_range(self, [low, high]: [f64; 2]) -> Self {
        Self { range: ValueRange { low, high, ..self.range }, ..self }
    }

    /// From differences per voxel to a gradient per world length.
    pub(crate) fn gradient_to_world(&self) -> Mat3 {
        self.gradient_to_world
    }

    /// Raw value of voxel `index`; NaN past the end.
    #[must_use]
    pub fn raw(&self, index: usize) -> f64 {
        self.values.get(index).map_or(f64::NAN, |&v| self.offset + f64::from(v))
    }

    /// Raw value at a point in voxel coordinates: trilinear between centres, constant over the outer half voxel. `None`
    /// outside the volume. NaN if a contributing voxel is NaN.
    #[must_use]
    pub fn sample(&self, voxel: DVec3) -> Option<f64> {
        self.stored(voxel).map(|v| self.offset + f64::from(v))
    }

    /// As [`Field::sample`], without the offset.
    pub(crate) fn stored(&self, voxel: DVec3) -> Option<f32> {
        let dims = self.grid.dims();
        let axis = |x: f64, n: usize| -> Option<(usize, usize, f32)> {
            let last = n as f64 - 1.0;
            if !(-0.5..=last + 0.5).contains(&x) {
                return None;
            }
            let x = x.clamp(0.0, last);
            let low = x as usize;
            let t = (x - low as f64) as f32;
            // With weight 0 the neighbour is not read: 0 · NaN would spoil a sample on a voxel centre.
            Some((low, if t > 0.0 { (low + 1).min(n - 1) } else { low }, t))
        };
        let (x0, x1, tx) = axis(voxel.x, dims[0])?;
        let (y0, y1, ty) = axis(voxel.y, dims[1])?;
        let (z0, z1, tz) = axis(voxel.z, dims[2])?;
        let row = |y: usize, z: usize| {
            let base = dims[0] * (y + dims[1] * z);
            let (a, b) = (self.values[base + x0], self.values[base + x1]);
            a + tx * (b - a)
        };
        let plane = |z: usize| {
            let a = row(y0, z);
            if y1 == y0 { a } else { a + ty * (row(y1, z) - a) }
        };
        let a = plane(z0);
        Some(if z1 == z0 { a } else { a + tz * (plane(z1) - a) })
    }

    /// Gradient at voxel (x, y, z) by central differences, in raw units per world length, in world axes. Differences are
    /// one-sided at the border and beside NaN. An axis of one voxel adds nothing.
    #[must_use]
    pub fn gradient_at(&self, x: usize, y: usize, z: usize) -> Vec3 {
        let dims = self.grid.dims();
        let i = self.grid.index(x, y, z);
        let axis = |at: usize, n: usize, stride: usize| {
            let here = self.values[i];
            let finite = |v: f32| v.is_finite().then_some(v);
            let low = if at > 0 { finite(self.values[i - stride]) } else { None };
            let high = if at + 1 < n { finite(self.values[i + stride]) } else { None };
            match (low, high) {
                (Some(l), Some(h)) => 0.5 * (h - l),
                (Some(l), None) if here.is_finite() => here - l,
                (None, Some(h)) if here.is_finite() => h - here,
                _ => 0.0,
            }
        };
        let per_voxel = Vec3::new(axis(x, dims[0], 1), axis(y, dims[1], dims[0]), axis(z, dims[2], dims[0] * dims[1]));
        self.gradient_to_world * per_voxel
    }

    /// Gradient at a point in voxel coordinates, in raw units per world length, in world axes. It takes central differences
    /// of the trilinear interpolant over one voxel each way. It is zero outside the volume and beside NaN.
    #[must_use]
    pub fn gradient(&self, voxel: DVec3) -> Vec3 {
        let dims = self.grid.dims();
        let axis = |k: usize| {
            let last = dims[k] as f64 - 1.0;
            let at = voxel[k].clamp(0.0, last);
            let (low, high) = ((at - 1.0).max(0.0), (at + 1.0).min(last));
            let along = |x: f64| {
                let mut p = voxel;
                p[k] = x;
                self.stored(p)
            };
            match (along(low), along(high)) {
                (Some(l), Some(h)) if high > low && l.is_finite() && h.is_finite() => (h - l) / (high - low) as f32,
                _ => 0.0,
            }
        };
        self.gradient_to_world * Vec3::new(axis(0), axis(1), axis(2))
    }

    /// The field convolved with a Gaussian of `sigma` voxels along each axis (support ±3σ). The weights leave out NaN and
    /// voxels outside the volume. NaN voxels stay NaN.
    #[must_use]
    pub fn smoothed(&self, sigma: f32) -> Self {
        let radius = (3.0 * sigma).ceil() as usize;
        if !sigma.is_finite() || radius == 0 {
            return self.clone();
        }
        let kernel: Vec<f32> = (0..=radius).map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp()).collect();
        let dims = self.grid.dims();
        let plane = dims[0] * dims[1];
        let mut values = self.values.clone();
        values.par_chunks_mut(plane).for_each(|slice| {
            let mut scratch = vec![0.0; dims[0].max(dims[1])];
            for row in slice.chunks_mut(dims[0]) {
                smooth_line(row, 0, 1, dims[0], &kernel, &mut scratch);
            }
            for x in 0..dims[0] {
                smooth_line(slice, x, dims[0], dims[1], &kernel, &mut scratch);
            }
        });
        if dims[2] > 1 {
            values = smooth_across_planes(&values, plane, &kernel);
        }
        Self { values, ..self.clone_without_values() }
    }

    fn clone_without_values(&self) -> Self {
        Self {
            grid: self.grid.clone(),
            values: Vec::new(),
            offset: self.offset,
            range: self.range,
            gradient_to_world: self.gradient_to_world,
        }
    }
}

/// Convolves `n` values that stand `stride` apart, in place.
fn smooth_line(values: &mut [f32], start: usize, stride: usize, n: usize, kernel: &[f32], scratch: &mut [f32]) {
    let line = &mut scratch[..n];
    for (k, v) in line.iter_mut().enumerate() {
        *v = values[start + k * stride];
    }
    for at in 0..n {
        let low = at.saturating_sub(kernel.len() - 1);
        let high = (at + kernel.len() - 1).min(n - 1);
        let (mut sum, mut weight) = (0.0, 0.0);
        for (k, &v) in line.iter().enumerate().take(high + 1).skip(low) {
            if v.is_finite() {
                let w = kernel[k.abs_diff(at)];
                sum += w * v;
                weight += w;
            }
        }
        if line[at].is_finite() {
            values[start + at * stride] = sum / weight;
        }
    }
}

/// Convolves along z, one output slice at a time.
fn smooth_across_planes(values: &[f32], plane: usize, kernel: &[f32]) -> Vec<f32> {
    let slices = values.len() / plane;
    let mut out = vec![0.0; values.len()];
    out.par_chunks_mut(plane).enumerate().for_each(|(z, slice)| {
        let low = z.saturating_sub(kernel.len() - 1);
        let high = (z + kernel.len() - 1).min(slices - 1);
        let mut weight = vec![0.0_f32; plane];
        for k in low..=high {
            let w = kernel[k.abs_diff(z)];
            let source = &values[k * plane..(k + 1) * plane];
            for ((o, s), &v) in slice.iter_mut().zip(&mut weight).zip(source) {
                if v.is_finite() {
                    *o += w * v;
                    *s += w;
                }
            }
        }
        let centre = &values[z * plane..(z + 1) * plane];
        for ((o, s), &v) in slice.iter_mut().zip(&weight).zip(centre) {
            *o = if v.is_finite() { *o / s } else { v };
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use proptest::prelude::*;

    use super::*;
    use crate::scalars::Scalars;

    fn field(dims: [usize; 3], f: impl Fn(f64, f64, f64) -> f32) -> Field {
        let grid = Grid::unit(dims).unwrap();
        let values: Vec<f32> = (0..grid.len())
            .map(|i| {
                let v = grid.voxel(i);
                f(v.x as f64, v.y as f64, v.z as f64)
            })
            .collect();
        on_grid(grid, values)
    }

    fn on_grid(grid: Grid, values: Vec<f32>) -> Field {
        let range = Scalars::from(values.clone()).range();
        Field::from_parts(grid, values, 0.0, range)
    }

    #[test]
    fn nan_affects_only_the_samples_that_use_it() {
        let f = field([3, 1, 1], |x, _, _| if x == 1.0 { f32::NAN } else { x as f32 });
        assert_eq!(f.sample(DVec3::ZERO), Some(0.0));
        assert_eq!(f.sample(DVec3::new(2.0, 0.0, 0.0)), Some(2.0));
        assert!(f.sample(DVec3::new(0.5, 0.0, 0.0)).unwrap().is_nan());
        assert_eq!(f.gradient_at(0, 0, 0), Vec3::ZERO);
        assert_eq!(f.gradient_at(1, 0, 0), Vec3::new(1.0, 0.0, 0.0), "from the two finite neighbours");
        assert_eq!(f.range().non_finite, 1);
    }

    #[test]
    fn outside_is_nothing_and_the_outer_half_voxel_is_constant() {
        let f = field([4, 4, 4], |x, _, _| x as f32);
        assert_eq!(f.sample(DVec3::new(-0.5, 1.0, 1.0)), Some(0.0));
        assert_eq!(f.sample(DVec3::new(3.5, 1.0, 1.0)), Some(3.0));
        assert_eq!(f.sample(DVec3::new(3.51, 1.0, 1.0)), None);
        assert_eq!(f.sample(DVec3::new(f64::NAN, 1.0, 1.0)), None);
    }

    #[test]
    fn a_gradient_is_per_world_length_in_world_axes() {
        // x of the voxels points along world −y with spacing 2, so a rise of 1 per voxel is −½ along y.
        let direction = DMat3::from_cols(DVec3::NEG_Y, DVec3::X, DVec3::Z);
        let grid = Grid::new([4, 4, 4], DVec3::new(2.0, 1.0, 1.0), DVec3::ZERO, direction).unwrap();
        let values: Vec<f32> = (0..grid.len()).map(|i| grid.voxel(i).x as f32).collect();
        let f = on_grid(grid, values);
        assert!((f.gradient_at(1, 1, 1) - Vec3::new(0.0, -0.5, 0.0)).length() < 1e-6);
        assert!((f.gradient(DVec3::new(1.3, 2.0, 0.7)) - Vec3::new(0.0, -0.5, 0.0)).length() < 1e-6);
    }

    #[test]
    fn smoothing_keeps_constants_and_means() {
        let f = field([9, 8, 7], |_, _, _| 5.0).smoothed(1.0);
        assert!(f.values().iter().all(|v| (v - 5.0).abs() < 1e-5));
        let spike =
            field([15, 15, 15], |x, y, z| if x == 7.0 && y == 7.0 && z == 7.0 { 1.0 } else { 0.0 }).smoothed(1.0);
        let sum: f32 = spike.values().iter().sum();
        assert!((sum - 1.0).abs() < 1e-4, "{sum}");
        let peak = spike.raw(spike.grid().index(7, 7, 7));
        // The sampled kernel's centre weight is 1 / Σ exp(−k²/2) = 0.3990 for |k| ≤ 3.
        assert!((peak - 0.3990_f64.powi(3)).abs() < 1e-3, "{peak}");
    }

    proptest! {
        #[test]
        fn trilinear_is_exact_on_trilinear_functions_and_bounded(
            c in prop::array::uniform8(-5.0..5.0_f64),
            p in prop::array::uniform3(0.0..5.0_f64),
        ) {
            let g = |x: f64, y: f64, z: f64| {
                c[0] + c[1] * x + c[2] * y + c[3] * z + c[4] * x * y + c[5] * y * z + c[6] * x * z + c[7] * x * y * z
            };
            let f = field([6, 6, 6], |x, y, z| g(x, y, z) as f32);
            let p = DVec3::from_array(p);
            let got = f.sample(p).unwrap();
            prop_assert!((got - g(p.x, p.y, p.z)).abs() < 2e-3, "{got}");
            let (low, high) = (f.range().low, f.range().high);
            prop_assert!(got >= low - 1e-3 && got <= high + 1e-3);
        }

        #[test]
        fn both_gradients_agree_on_voxels(seed in any::<u64>(), x in 0..5_usize, y in 0..5_usize, z in 0..5_usize) {
            let f = field([5, 5, 5], |x, y, z| {
                let k = (x + 5.0 * y + 25.0 * z) as u64;
                (seed.wrapping_mul(k * 2 + 1) >> 40) as f32 * 1e-4
            });
            let a = f.gradient_at(x, y, z);
            let b = f.gradient(DVec3::new(x as f64, y as f64, z as f64));
            prop_assert!((a - b).length() <= 1e-3 * (1.0 + a.length()), "{a} {b}");
        }
    }
}
