//! The values of a mesh in f32: corners, gradients, resampling.

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::{Mesh, MeshValues};
use crate::classifier::Classifier;
use crate::field::Field;
use crate::grid::{Bounds, Grid, GridError};
use crate::scalars::ValueRange;

/// The values of a mesh in f32: `raw value = offset + stored value`. Positions are in the world, in lengths from
/// [`MeshField::middle`], so that a mesh far from the origin loses no digits.
#[derive(Debug, Clone)]
pub struct MeshField {
    points: Vec<DVec3>,
    cells: Vec<[u32; 4]>,
    /// Stored values of the points; those of a point with values of cells only are the means of its cells.
    at_points: Vec<f32>,
    /// Stored values of the tetrahedra, if the values are constant within each.
    of_cells: Option<Vec<f32>>,
    /// Gradients at the points, in raw units per world length.
    gradients: Vec<Vec3>,
    offset: f64,
    range: ValueRange,
    /// In the world.
    bounds: Bounds,
}

/// A tetrahedron with its values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshCell {
    /// Corners, from the middle of the mesh.
    pub corners: [DVec3; 4],
    /// Raw values at the corners; NaN where the file has none.
    pub values: [f64; 4],
}

impl MeshCell {
    /// The mean of its corners.
    #[must_use]
    pub fn middle(&self) -> DVec3 {
        self.corners.iter().sum::<DVec3>() / 4.0
    }

    /// Its volume in cubic lengths.
    #[must_use]
    pub fn volume(&self) -> f64 {
        self.edges().determinant() / 6.0
    }

    /// Least and greatest value; NaN if one of its values is NaN.
    #[must_use]
    pub fn range(&self) -> [f64; 2] {
        if self.values.iter().any(|v| v.is_nan()) {
            return [f64::NAN; 2];
        }
        ends(self.values)
    }

    /// The gradients of the four barycentric coordinates, per length: constant within the tetrahedron.
    #[must_use]
    pub fn coordinate_gradients(&self) -> [DVec3; 4] {
        let rows = self.edges().inverse().transpose();
        [-(rows.x_axis + rows.y_axis + rows.z_axis), rows.x_axis, rows.y_axis, rows.z_axis]
    }

    /// The barycentric coordinates of a position.
    #[must_use]
    pub fn coordinates(&self, at: DVec3) -> [f64; 4] {
        self.coordinates_by(&self.coordinate_gradients(), at)
    }

    /// As [`Self::coordinates`], with the gradients of this tetrahedron: they cost an inverse matrix.
    pub(super) fn coordinates_by(&self, [_, x, y, z]: &[DVec3; 4], at: DVec3) -> [f64; 4] {
        let from_first = at - self.corners[0];
        let [x, y, z] = [x, y, z].map(|gradient| gradient.dot(from_first));
        [1.0 - x - y - z, x, y, z]
    }

    fn edges(&self) -> DMat3 {
        let [a, b, c, d] = self.corners;
        DMat3::from_cols(b - a, c - a, d - a)
    }
}

impl MeshField {
    pub(super) fn of(mesh: &Mesh) -> Self {
        let (scalars, of_points) = match &mesh.values {
            MeshValues::Points(values) => (values, true),
            MeshValues::Cells(values) => (values, false),
        };
        let (stored, offset, range) = scalars.narrowed();
        // Points that no cell uses do not count: files may hold millions for another part of the mesh.
        let mut bounds = Bounds { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };
        for point in mesh.cells.iter().flatten().filter_map(|&i| mesh.points.get(i as usize)) {
            bounds.min = bounds.min.min(*point);
            bounds.max = bounds.max.max(*point);
        }
        let middle = 0.5 * (bounds.min + bounds.max);
        let points = mesh.points.iter().map(|p| *p - middle).collect();
        let (at_points, of_cells) = if of_points { (stored, None) } else { (Vec::new(), Some(stored)) };
        let cells = mesh.cells.clone();
        let mut field = Self { points, cells, at_points, of_cells, gradients: Vec::new(), offset, range, bounds };
        if let Some(of_cells) = &field.of_cells {
            field.at_points = field.averaged_at_points(of_cells);
        }
        field.gradients = field.gradients_at_points();
        field
    }

    /// Means over the tetrahedra around each point, weighted by their volumes. NaN does not count.
    fn averaged_at_points(&self, of_cells: &[f32]) -> Vec<f32> {
        let mut sums = vec![(0.0_f64, 0.0_f64); self.points.len()];
        let finite = self.cells.iter().zip(of_cells).enumerate().filter(|(_, (_, value))| value.is_finite());
        for (k, (corners, &value)) in finite {
            let volume = self.cell(k).volume();
            for &point in corners {
                if let Some((sum, weight)) = sums.get_mut(point as usize) {
                    *sum += volume * f64::from(value);
                    *weight += volume;
                }
            }
        }
        sums.into_iter().map(|(sum, weight)| if weight > 0.0 { (sum / weight) as f32 } else { f32::NAN }).collect()
    }

    /// Gradients of the tetrahedra around each point, weighted by their volumes.
    fn gradients_at_points(&self) -> Vec<Vec3> {
        let of_cell = |k: usize| {
            let cell = self.cell(k);
            let values = self.cells[k].map(|point| f64::from(self.at_points[point as usize]));
            let gradient: DVec3 =
                cell.coordinate_gradients().into_iter().zip(values).map(|(slope, value)| slope * value).sum();
            if gradient.is_finite() { (gradient, cell.volume()) } else { (DVec3::ZERO, 0.0) }
        };
        let found: Vec<(DVec3, f64)> = (0..self.cells.len()).into_par_iter().with_min_len(1024).map(of_cell).collect();
        let mut sums = vec![(DVec3::ZERO, 0.0_f64); self.points.len()];
        for (corners, (gradient, volume)) in self.cells.iter().zip(found) {
            for &point in corners {
                if let Some((sum, weight)) = sums.get_mut(point as usize) {
                    *sum += gradient * volume;
                    *weight += volume;
                }
            }
        }
        let mean = |(sum, weight): (DVec3, f64)| if weight > 0.0 { (sum / weight).as_vec3() } else { Vec3::ZERO };
        sums.into_iter().map(mean).collect()
    }

    /// The middle of the bounds, in the world.
    #[must_use]
    pub fn middle(&self) -> DVec3 {
        0.5 * (self.bounds.min + self.bounds.max)
    }

    /// The box of all tetrahedra, along the axes of the world.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Range of the finite raw values, and the number of other values.
    #[must_use]
    pub fn range(&self) -> ValueRange {
        self.range
    }

    /// The same values as a part of a series with this range of raw values ([`Field::with_range`]).
    #[must_use]
    pub fn with_range(self, [low, high]: [f64; 2]) -> Self {
        Self { range: ValueRange { low, high, ..self.range }, ..self }
    }

    /// The raw value of a stored 0.
    #[must_use]
    pub fn offset(&self) -> f64 {
        self.offset
    }

    /// Length of the diagonal of the bounds.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        (self.bounds.max - self.bounds.min).length()
    }

    /// The length that opacities of a transfer function refer to: 1/256 of the diagonal.
    #[must_use]
    pub fn reference_length(&self) -> f64 {
        self.diagonal() / 256.0
    }

    /// Positions of the points, from [`Self::middle`].
    #[must_use]
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// The points of each tetrahedron.
    #[must_use]
    pub fn cells(&self) -> &[[u32; 4]] {
        &self.cells
    }

    /// Stored values: of the tetrahedra if the values are constant within each, else of the points.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        self.of_cells.as_deref().unwrap_or(&self.at_points)
    }

    /// Tetrahedron `index`, which must be below the number of [`Self::cells`].
    #[must_use]
    pub fn cell(&self, index: usize) -> MeshCell {
        let corners = self.cells[index].map(|point| point as usize);
        let raw = |stored: f32| self.offset + f64::from(stored);
        let values = match &self.of_cells {
            Some(of_cells) => [raw(of_cells[index]); 4],
            None => corners.map(|point| raw(self.at_points[point])),
        };
        MeshCell { corners: corners.map(|point| self.points[point]), values }
    }

    /// Gradients at the corners of a tetrahedron, in raw units per world length: means over all tetrahedra around each corner.
    #[must_use]
    pub fn corner_gradients(&self, index: usize) -> [Vec3; 4] {
        self.cells[index].map(|point| self.gradients[point as usize])
    }

    /// The tetrahedra of which a transfer function shows some part.
    #[must_use]
    pub fn visible_cells(&self, classifier: &Classifier) -> Vec<u32> {
        let is_visible = |k: &usize| {
            let [low, high] = self.cell(*k).range();
            low <= high && classifier.is_visible_between(low, high)
        };
        (0..self.cells.len()).into_par_iter().with_min_len(1024).filter(is_visible).map(|k| k as u32).collect()
    }

    /// The box, along the axes of the world, of the tetrahedra of which the transfer function shows some part. That of all
    /// if there are none.
    #[must_use]
    pub fn visible_bounds(&self, classifier: &Classifier) -> Bounds {
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let corners = self.visible_cells(classifier).into_iter().flat_map(|k| self.cells[k as usize]);
        let (min, max) = corners.fold(none, |(min, max), point| {
            let at = self.points[point as usize];
            (min.min(at), max.max(at))
        });
        if min.is_finite() { Bounds { min: self.middle() + min, max: self.middle() + max } } else { self.bounds }
    }

    /// The values at the centres of cubic voxels, `edge` of them along the longest side of the bounds; NaN outside the mesh.
    /// This is for statistics and overviews: details between the centres are lost.
    ///
    /// # Errors
    /// [`GridError`] for bounds without a finite size.
    pub fn resampled(&self, edge: usize) -> Result<Field, GridError> {
        let size = self.bounds.max - self.bounds.min;
        let spacing = size.max_element() / edge.max(1) as f64;
        let dims = size.to_array().map(|length| ((length / spacing).ceil() as usize).clamp(1, edge.max(1)));
        let extent = DVec3::from_array(dims.map(|n| n as f64)) * spacing;
        let first = 0.5 * (DVec3::splat(spacing) - extent);
        let grid = Grid::new(dims, DVec3::splat(spacing), self.middle() + first, DMat3::IDENTITY)?;
        let mut values = vec![f32::NAN; grid.len()];
        let places = |corners: &[DVec3; 4], axis: usize| {
            let [low, high] = ends(corners.map(|corner| (corner[axis] - first[axis]) / spacing));
            // An empty range where no centre is between the ends.
            low.ceil().max(0.0) as usize..(high.floor() + 1.0).clamp(0.0, dims[axis] as f64) as usize
        };
        for k in 0..self.cells.len() {
            let cell = self.cell(k);
            let slopes = cell.coordinate_gradients();
            let origin = cell.coordinates_by(&slopes, first);
            for z in places(&cell.corners, 2) {
                for y in places(&cell.corners, 1) {
                    for x in places(&cell.corners, 0) {
                        let way = spacing * DVec3::new(x as f64, y as f64, z as f64);
                        let within = [0, 1, 2, 3].map(|i| origin[i] + slopes[i].dot(way));
                        if within.iter().all(|c| *c >= -1e-9) {
                            let value: f64 = within.iter().zip(cell.values).map(|(c, v)| c * (v - self.offset)).sum();
                            values[grid.index(x, y, z)] = value as f32;
                        }
                    }
                }
            }
        }
        let non_finite = values.iter().filter(|value| !value.is_finite()).count();
        Ok(Field::from_parts(grid, values, self.offset, ValueRange { non_finite, ..self.range }))
    }
}

/// The least and the greatest of four numbers.
pub(super) fn ends(of: [f64; 4]) -> [f64; 2] {
    [of.into_iter().fold(f64::INFINITY, f64::min), of.into_iter().fold(f64::NEG_INFINITY, f64::max)]
}
