//! The grid of a volume in world space.

use glam::{DMat3, DVec3, Mat3, USizeVec3};

/// Largest number of voxels along one axis.
pub const MAX_DIM: usize = 1 << 20;
/// Largest number of voxels in a volume: indices stay within 32 bits.
pub const MAX_VOXELS: u64 = u32::MAX as u64;

/// A regular grid of voxels in world space.
///
/// In voxel coordinates the centre of the first voxel is (0, 0, 0) and the centre of the last one is `dims − 1`. In memory x
/// varies fastest. `world = origin + direction · (spacing ∘ voxel)`, in the world frame and length unit of the file. A voxel
/// is a cell of one spacing around its centre, so the volume reaches from −½ to `dims − ½` in voxel coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    dims: [usize; 3],
    spacing: DVec3,
    origin: DVec3,
    direction: DMat3,
    voxel_to_world: DMat3,
    world_to_voxel: DMat3,
}

/// The numbers do not form a grid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GridError {
    /// An axis has no voxels, or too many.
    #[error("dimensions {dims:?}: each axis takes 1 to {MAX_DIM} voxels and the whole at most {MAX_VOXELS}")]
    Dims {
        /// Requested voxels along x, y and z.
        dims: [usize; 3],
    },
    /// A spacing is zero, negative or not finite.
    #[error("spacing {0}: three finite lengths above 0 are needed")]
    Spacing(DVec3),
    /// The origin is not finite.
    #[error("origin {0}: three finite numbers are needed")]
    Origin(DVec3),
    /// The axes are not finite or lie in one plane.
    #[error("axis directions {0}: three finite axes that do not lie in one plane are needed")]
    Direction(DMat3),
}

/// An axis-aligned box in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Least corner.
    pub min: DVec3,
    /// Greatest corner.
    pub max: DVec3,
}

impl Grid {
    /// A grid of `dims` voxels. `spacing` holds the lengths between centres, and `origin` is the centre of the first voxel.
    /// The columns of `direction` are the world directions of the x, y and z axes; [`Grid::new`] normalizes them.
    ///
    /// # Errors
    /// [`GridError`] if a number is out of its range.
    pub fn new(dims: [usize; 3], spacing: DVec3, origin: DVec3, direction: DMat3) -> Result<Self, GridError> {
        let voxels = dims.iter().try_fold(1_u64, |n, &d| n.checked_mul(d as u64));
        let fits = voxels.is_some_and(|n| n <= MAX_VOXELS);
        if !fits || dims.iter().any(|&d| d == 0 || d > MAX_DIM) {
            return Err(GridError::Dims { dims });
        }
        if !(spacing.is_finite() && spacing.min_element() > 0.0) {
            return Err(GridError::Spacing(spacing));
        }
        if !origin.is_finite() {
            return Err(GridError::Origin(origin));
        }
        let axes = [direction.x_axis, direction.y_axis, direction.z_axis].map(DVec3::normalize_or_zero);
        let unit = DMat3::from_cols(axes[0], axes[1], axes[2]);
        let usable = direction.is_finite() && unit.determinant().abs() > 1e-9;
        if !usable {
            return Err(GridError::Direction(direction));
        }
        let voxel_to_world = unit * DMat3::from_diagonal(spacing);
        Ok(Self {
            dims,
            spacing,
            origin,
            direction: unit,
            voxel_to_world,
            world_to_voxel: DMat3::from_diagonal(spacing.recip()) * unit.inverse(),
        })
    }

    /// A grid of unit spacing with its first voxel at the world's origin.
    ///
    /// # Errors
    /// [`GridError::Dims`].
    pub fn unit(dims: [usize; 3]) -> Result<Self, GridError> {
        Self::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY)
    }

    /// Voxels along x, y and z.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Lengths between neighbouring centres along x, y and z.
    #[must_use]
    pub fn spacing(&self) -> DVec3 {
        self.spacing
    }

    /// World position of the first voxel's centre.
    #[must_use]
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Unit world directions of the axes, as columns.
    #[must_use]
    pub fn direction(&self) -> DMat3 {
        self.direction
    }

    /// Number of voxels.
    #[must_use]
    pub fn len(&self) -> usize {
        self.dims.iter().product()
    }

    /// Whether the grid has no voxel. [`Grid::new`] refuses such a grid.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Place in memory of voxel (x, y, z).
    #[must_use]
    pub fn index(&self, x: usize, y: usize, z: usize) -> usize {
        x + self.dims[0] * (y + self.dims[1] * z)
    }

    /// Voxel (x, y, z) at a place in memory.
    #[must_use]
    pub fn voxel(&self, index: usize) -> USizeVec3 {
        let row = index / self.dims[0];
        USizeVec3::new(index % self.dims[0], row % self.dims[1], row / self.dims[1])
    }

    /// World position of a point in voxel coordinates.
    #[must_use]
    pub fn to_world(&self, voxel: DVec3) -> DVec3 {
        self.origin + self.voxel_to_world * voxel
    }

    /// Voxel coordinates of a world position.
    #[must_use]
    pub fn to_voxel(&self, world: DVec3) -> DVec3 {
        self.world_to_voxel * (world - self.origin)
    }

    /// A world vector (no translation) in voxel coordinates.
    #[must_use]
    pub fn vector_to_voxel(&self, world: DVec3) -> DVec3 {
        self.world_to_voxel * world
    }

    /// A vector in voxel coordinates (no translation) in world units.
    #[must_use]
    pub fn vector_to_world(&self, voxel: DVec3) -> DVec3 {
        self.voxel_to_world * voxel
    }

    /// The matrix from a gradient per voxel to a gradient per world length: the inverse transpose of voxel → world.
    #[must_use]
    pub fn gradient_to_world(&self) -> Mat3 {
        self.world_to_voxel.transpose().as_mat3()
    }

    /// The index of the voxel at a world position; for a position outside, the nearest voxel.
    #[must_use]
    pub fn nearest(&self, world: DVec3) -> usize {
        let v = self.to_voxel(world);
        let axis = |x: f64, n: usize| (x.round().max(0.0) as usize).min(n - 1);
        self.index(axis(v.x, self.dims[0]), axis(v.y, self.dims[1]), axis(v.z, self.dims[2]))
    }

    /// Volume of one voxel in cubic length units.
    #[must_use]
    pub fn voxel_volume(&self) -> f64 {
        self.voxel_to_world.determinant().abs()
    }

    /// Length of the diagonal of the whole volume, whole voxels counted.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        (self.spacing * DVec3::from_array(self.dims.map(|d| d as f64))).length()
    }

    /// The length that opacities of a transfer function refer to: 1/256 of the diagonal.
    #[must_use]
    pub fn reference_length(&self) -> f64 {
        self.diagonal() / 256.0
    }

    /// The axis-aligned world box of all voxel cells.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let high = DVec3::from_array(self.dims.map(|d| d as f64 - 0.5));
        let low = DVec3::splat(-0.5);
        let mut bounds = Bounds { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };
        for corner in 0..8_u32 {
            let pick = |axis: u32, l: f64, h: f64| if corner >> axis & 1 == 0 { l } else { h };
            let p = DVec3::new(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z));
            let world = self.to_world(p);
            bounds.min = bounds.min.min(world);
            bounds.max = bounds.max.max(world);
        }
        bounds
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn bounds_of_a_unit_grid_hold_whole_voxels() {
        let grid = Grid::unit([4, 5, 1]).unwrap();
        assert_eq!(grid.bounds(), Bounds { min: DVec3::splat(-0.5), max: DVec3::new(3.5, 4.5, 0.5) });
        assert_eq!(grid.voxel(grid.index(3, 2, 0)), USizeVec3::new(3, 2, 0));
        assert!((grid.diagonal() - 42.0_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn numbers_that_make_no_grid_are_refused() {
        assert!(matches!(Grid::unit([0, 1, 1]), Err(GridError::Dims { .. })));
        assert!(matches!(Grid::unit([MAX_DIM, MAX_DIM, MAX_DIM]), Err(GridError::Dims { .. })));
        let with = |spacing, direction| Grid::new([2; 3], spacing, DVec3::ZERO, direction);
        assert!(matches!(with(DVec3::new(1.0, 0.0, 1.0), DMat3::IDENTITY), Err(GridError::Spacing(_))));
        assert!(matches!(with(DVec3::splat(f64::NAN), DMat3::IDENTITY), Err(GridError::Spacing(_))));
        let flat = DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z);
        assert!(matches!(with(DVec3::ONE, flat), Err(GridError::Direction(_))));
    }

    proptest! {
        #[test]
        fn world_and_voxel_are_inverse(
            spacing in prop::array::uniform3(1e-3..1e3_f64),
            origin in prop::array::uniform3(-1e6..1e6_f64),
            axis in prop::array::uniform3(-1.0..1.0_f64),
            angle in 0.0..6.0_f64,
            point in prop::array::uniform3(-10.0..300.0_f64),
            mirror in any::<bool>(),
        ) {
            let axis = DVec3::from_array(axis).try_normalize().unwrap_or(DVec3::X);
            let flip = DMat3::from_diagonal(DVec3::new(if mirror { -1.0 } else { 1.0 }, 1.0, 1.0));
            let direction = DMat3::from_quat(DQuat::from_axis_angle(axis, angle)) * flip;
            let grid = Grid::new([100; 3], DVec3::from_array(spacing), DVec3::from_array(origin), direction).unwrap();
            let point = DVec3::from_array(point);
            let back = grid.to_voxel(grid.to_world(point));
            // World coordinates of size 1e6 with spacings of 1e-3 leave 1e-16 · 1e6 / 1e-3 = 1e-7 voxels.
            prop_assert!((back - point).abs().max_element() < 1e-5, "{point} {back}");
            let inside = point.clamp(DVec3::splat(-0.5), DVec3::splat(99.5));
            let world = grid.to_world(inside);
            let bounds = grid.bounds();
            let slack = 1e-9 * (1.0 + world.abs().max_element());
            prop_assert!((world + slack).cmpge(bounds.min).all() && (world - slack).cmple(bounds.max).all());
        }
    }
}
