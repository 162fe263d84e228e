//! Values and gradients between voxels in f32, each from one pass over the voxels around.

use glam::Vec3;

use crate::field::Field;

/// A field for reading away from its border.
pub(super) struct Stencil<'a> {
    values: &'a [f32],
    /// Voxels from one row, and from one slice, to the next.
    row: usize,
    slice: usize,
    /// Greatest corner whose cell lies in the volume.
    last: [usize; 3],
}

/// A cell of eight voxels and the place in it.
#[derive(Clone, Copy)]
pub(super) struct Cell {
    corner: usize,
    at: Vec3,
    /// Whether the neighbours of the eight voxels exist.
    has_gradient: bool,
}

impl<'a> Stencil<'a> {
    pub(super) fn new(field: &'a Field) -> Self {
        let [nx, ny, nz] = field.grid().dims();
        // Without two voxels along an axis there is no cell.
        let last = [nx, ny, nz].map(|n| n.wrapping_sub(2));
        Self { values: field.values(), row: nx, slice: nx * ny, last }
    }

    /// The cell of a place in voxel coordinates; `None` in the outer half voxel.
    pub(super) fn cell(&self, place: Vec3) -> Option<Cell> {
        if place.cmplt(Vec3::ZERO).any() {
            return None;
        }
        let [x, y, z] = place.to_array().map(|x| x as usize);
        let [lx, ly, lz] = self.last;
        // `wrapping_sub` of an axis of one voxel gave the greatest number, so its cells are refused by the place itself.
        if x > lx || y > ly || z > lz || lx.max(ly).max(lz) >= usize::MAX - 1 {
            return None;
        }
        let inner = |x: usize, last: usize| x > 0 && x < last;
        Some(Cell {
            corner: x + self.row * y + self.slice * z,
            at: place - Vec3::new(x as f32, y as f32, z as f32),
            has_gradient: inner(x, lx) && inner(y, ly) && inner(z, lz),
        })
    }

    /// The trilinear value; NaN beside one.
    pub(super) fn value(&self, cell: Cell) -> f32 {
        let Vec3 { x, y, z } = cell.at;
        let row = |start: usize| match self.values.get(start..start + 2) {
            Some(&[a, b]) => a + x * (b - a),
            _ => f32::NAN,
        };
        let plane = |start: usize| {
            let a = row(start);
            a + y * (row(start + self.row) - a)
        };
        let a = plane(cell.corner);
        a + z * (plane(cell.corner + self.slice) - a)
    }

    /// Central differences of the trilinear value over one voxel each way, per voxel. `None` at the border.
    pub(super) fn gradient(&self, cell: Cell) -> Option<Vec3> {
        if !cell.has_gradient {
            return None;
        }
        let Vec3 { x, y, z } = cell.at;
        let mix = |t: f32, a: f32, b: f32| a + t * (b - a);
        // The value and the difference along x at one row.
        let four = |start: usize| match self.values.get(start - 1..start + 3) {
            Some(&[a, b, c, d]) => (mix(x, b, c), mix(x, c - a, d - b)),
            _ => (f32::NAN, f32::NAN),
        };
        let two = |start: usize| match self.values.get(start..start + 2) {
            Some(&[a, b]) => mix(x, a, b),
            _ => f32::NAN,
        };
        let (row, slice) = (self.row, self.slice);
        let [near, far] = [cell.corner, cell.corner + slice];
        let [(a, ax), (b, bx), (c, cx), (d, dx)] = [near, near + row, far, far + row].map(four);
        let along_x = mix(z, mix(y, ax, bx), mix(y, cx, dx));
        let across = |a: f32, b: f32, start: usize| mix(y, b - two(start - row), two(start + 2 * row) - a);
        let along_y = mix(z, across(a, b, near), across(c, d, far));
        let beside = |start: usize| mix(y, two(start), two(start + row));
        let along_z = mix(z, mix(y, c, d) - beside(near - slice), beside(far + slice) - mix(y, a, b));
        Some(0.5 * Vec3::new(along_x, along_y, along_z))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::grid::Grid;
    use crate::volume::Volume;

    proptest! {
        #[test]
        fn values_and_gradients_are_those_of_the_field(
            seed in any::<u64>(), dims in prop::array::uniform3(1..7_usize), share in prop::array::uniform3(-0.1..1.1_f32),
        ) {
            let grid = Grid::unit(dims).unwrap();
            let values: Vec<f32> =
                (0..grid.len()).map(|k| (seed.wrapping_mul(2 * k as u64 + 1) >> 40) as f32 * 1e-6).collect();
            let field = Volume::new(grid, values.into(), None).unwrap().to_field();
            let place = Vec3::from_array([0, 1, 2].map(|k| share[k] * (dims[k] - 1) as f32));
            let stencil = Stencil::new(&field);
            let within = (0..3).all(|k| place[k] >= 0.0 && place[k] < (dims[k] - 1) as f32);
            let cell = stencil.cell(place);
            prop_assert_eq!(cell.is_some(), within);
            let Some(cell) = cell else { return Ok(()) };
            let want = field.sample(place.as_dvec3()).unwrap();
            prop_assert!((f64::from(stencil.value(cell)) - want).abs() < 1e-4);
            let is_inner = (0..3).all(|k| place[k] >= 1.0 && place[k] < (dims[k] - 2) as f32);
            let found = stencil.gradient(cell);
            prop_assert_eq!(found.is_some(), is_inner);
            let exact = field.gradient(place.as_dvec3());
            prop_assert!(found.is_none_or(|found| (found - exact).length() < 1e-3), "{found:?} {exact}");
        }
    }
}
