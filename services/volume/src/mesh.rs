//! Meshes of tetrahedra with one scalar quantity, as read.
//!
//! Files with other cells become tetrahedra when they are read. A [`Mesh`] holds them with the values of one quantity. A
//! [`MeshField`] holds the values in f32 for sampling, gradients and pictures.

mod field;
mod marcher;
mod split;

use glam::DVec3;

use crate::scalars::{ScalarType, Scalars};
use crate::world_frame::WorldFrame;

pub use field::{MeshCell, MeshField};
pub use marcher::MeshMarcher;
pub(crate) use split::{CellShape, split_cell};

/// Most points and most tetrahedra of a mesh: indices stay within 32 bits.
pub const MAX_INDEX: usize = u32::MAX as usize;
/// Six times the volume of a tetrahedron over the cube of its longest edge, up to which it counts as flat. A regular one has √2/2.
const FLAT: f64 = 1e-12;

/// A scalar quantity on a mesh of tetrahedra.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    points: Vec<DVec3>,
    cells: Vec<[u32; 4]>,
    values: MeshValues,
    variable: Option<String>,
    frame: WorldFrame,
    left_out: LeftOut,
}

/// The values of a mesh, in the type the file had; those that a reader computes are float64.
#[derive(Debug, Clone, PartialEq)]
pub enum MeshValues {
    /// One for each point: linear within a tetrahedron.
    Points(Scalars),
    /// One for each tetrahedron: constant within it.
    Cells(Scalars),
}

/// Tetrahedra that are not in the mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Those without volume.
    pub flat: usize,
    /// Those with a point that is not finite, or with a volume beyond the numbers of f64.
    pub non_finite: usize,
}

/// The parts do not make a mesh.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MeshError {
    /// Too many points or tetrahedra.
    #[error("{points} points and {cells} tetrahedra; at most {MAX_INDEX} of each are possible")]
    TooLarge {
        /// Points.
        points: usize,
        /// Tetrahedra.
        cells: usize,
    },
    /// A tetrahedron names a point that is not there.
    #[error("tetrahedron {cell} has point {point}, but there are {points} points")]
    Point {
        /// The tetrahedron, from 0.
        cell: usize,
        /// The point, from 0.
        point: u32,
        /// Points of the mesh.
        points: usize,
    },
    /// The number of values fits neither the points nor the tetrahedra.
    #[error("{values} values for {expected} {of}")]
    ValueCount {
        /// Number of values.
        values: usize,
        /// Number of points or tetrahedra.
        expected: usize,
        /// "points" or "tetrahedra".
        of: &'static str,
    },
    /// No tetrahedron has a volume.
    #[error("no cell with a volume among {cells} tetrahedra ({} flat, {} with points that are not finite)", .left_out.flat, .left_out.non_finite)]
    Empty {
        /// Tetrahedra given.
        cells: usize,
        /// Those that were left out.
        left_out: LeftOut,
    },
}

impl Mesh {
    /// A mesh of tetrahedra. `cells` holds the four points of each, in any orientation. `variable` is the name of the quantity.
    ///
    /// Tetrahedra without volume take no part in any picture, so they are left out, with their values if the values are of
    /// cells. The same holds for those with points that are not finite.
    ///
    /// # Errors
    /// [`MeshError`]: indices or counts do not fit, or nothing is left.
    pub fn new(
        points: Vec<DVec3>,
        mut cells: Vec<[u32; 4]>,
        values: MeshValues,
        variable: Option<String>,
    ) -> Result<Self, MeshError> {
        let (point_count, given) = (points.len(), cells.len());
        if point_count > MAX_INDEX || given > MAX_INDEX {
            return Err(MeshError::TooLarge { points: point_count, cells: given });
        }
        let (count, expected, of) = match &values {
            MeshValues::Points(values) => (values.len(), point_count, "points"),
            MeshValues::Cells(values) => (values.len(), given, "tetrahedra"),
        };
        if count != expected {
            return Err(MeshError::ValueCount { values: count, expected, of });
        }
        let mut left_out = LeftOut::default();
        let mut keeps = vec![true; given];
        for (cell, (corners, keeps)) in cells.iter_mut().zip(&mut keeps).enumerate() {
            let mut at = [DVec3::ZERO; 4];
            for (at, &point) in at.iter_mut().zip(corners.iter()) {
                *at = *points.get(point as usize).ok_or(MeshError::Point { cell, point, points: point_count })?;
            }
            if !at.iter().all(|p| p.is_finite()) {
                left_out.non_finite += 1;
                *keeps = false;
                continue;
            }
            let volume = (at[1] - at[0]).cross(at[2] - at[0]).dot(at[3] - at[0]);
            if !volume.is_finite() {
                left_out.non_finite += 1;
                *keeps = false;
            } else if volume.abs() <= FLAT * longest_edge(&at).powi(3) {
                left_out.flat += 1;
                *keeps = false;
            } else if volume < 0.0 {
                corners.swap(2, 3);
            }
        }
        let values = match values {
            MeshValues::Cells(values) if keeps.contains(&false) => MeshValues::Cells(values.filtered(&keeps)),
            other => other,
        };
        let mut kept = keeps.into_iter();
        cells.retain(|_| kept.next().unwrap_or(false));
        if cells.is_empty() {
            return Err(MeshError::Empty { cells: given, left_out });
        }
        Ok(Self { points, cells, values, variable, frame: WorldFrame::default(), left_out })
    }

    /// Positions of the points in the world.
    #[must_use]
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// The points of each tetrahedron, positively oriented: the fourth is on the side of the others' normal.
    #[must_use]
    pub fn cells(&self) -> &[[u32; 4]] {
        &self.cells
    }

    /// The values.
    #[must_use]
    pub fn values(&self) -> &MeshValues {
        &self.values
    }

    /// Name of the quantity, if the file has one.
    #[must_use]
    pub fn variable(&self) -> Option<&str> {
        self.variable.as_deref()
    }

    /// The world frame, as far as the file tells it.
    #[must_use]
    pub fn frame(&self) -> WorldFrame {
        self.frame
    }

    /// Tetrahedra that were left out.
    #[must_use]
    pub fn left_out(&self) -> LeftOut {
        self.left_out
    }

    /// Type of the values.
    #[must_use]
    pub fn scalar_type(&self) -> ScalarType {
        match &self.values {
            MeshValues::Points(values) | MeshValues::Cells(values) => values.scalar_type(),
        }
    }

    /// The values in f32, ready for sampling. Types that f32 cannot hold exactly are stored as the difference from the least
    /// value, as [`crate::Volume::to_field`] does.
    #[must_use]
    pub fn to_field(&self) -> MeshField {
        MeshField::of(self)
    }
}

/// The longest of the six edges.
fn longest_edge(at: &[DVec3; 4]) -> f64 {
    let pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    pairs.into_iter().map(|(i, j)| (at[i] - at[j]).length()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corners() -> Vec<DVec3> {
        vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(0.5, 0.5, 0.0), DVec3::splat(f64::NAN)]
    }

    #[test]
    fn flat_and_damaged_cells_go_and_inverted_ones_turn() {
        let cells = vec![[0, 1, 2, 3], [0, 2, 1, 3], [0, 1, 2, 4], [0, 1, 2, 5], [1, 1, 2, 3]];
        let values = MeshValues::Cells(vec![1_u8, 2, 3, 4, 5].into());
        let mesh = Mesh::new(corners(), cells, values, None).unwrap();
        assert_eq!(mesh.cells(), [[0, 1, 2, 3], [0, 2, 3, 1]]);
        assert_eq!(mesh.values(), &MeshValues::Cells(vec![1_u8, 2].into()));
        assert_eq!(mesh.left_out(), LeftOut { flat: 2, non_finite: 1 });
        for [a, b, c, d] in mesh.cells() {
            let at = [a, b, c, d].map(|&i| mesh.points()[i as usize]);
            assert!((at[1] - at[0]).cross(at[2] - at[0]).dot(at[3] - at[0]) > 0.0);
        }
    }

    #[test]
    fn a_thin_cell_far_from_the_origin_has_a_volume() {
        let far = DVec3::splat(1e6);
        let points: Vec<DVec3> =
            [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(0.2, 0.2, 1e-6)].map(|p| p + far).to_vec();
        let mesh = Mesh::new(points, vec![[0, 1, 2, 3]], MeshValues::Points(vec![0.0_f32; 4].into()), None).unwrap();
        assert_eq!(mesh.left_out(), LeftOut::default());
    }

    #[test]
    fn parts_that_do_not_fit_are_refused() {
        let values = |n: usize| MeshValues::Points(vec![0.0_f32; n].into());
        let error = |cells: Vec<[u32; 4]>, n| Mesh::new(corners(), cells, values(n), None).unwrap_err().to_string();
        assert_eq!(error(vec![[0, 1, 2, 9]], 6), "tetrahedron 0 has point 9, but there are 6 points");
        assert_eq!(error(vec![[0, 1, 2, 3]], 5), "5 values for 6 points");
        assert!(error(vec![[0, 1, 2, 4]], 6).starts_with("no cell with a volume among 1"));
        assert!(error(vec![], 6).starts_with("no cell with a volume among 0"));
    }
}
