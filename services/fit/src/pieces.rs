//! The pieces that Voronoi cells are made of: voxels and parts of them, or samples of tetrahedra.

use glam::{DAffine3, DMat3, DVec3, Vec3};

/// A piece of a cell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece {
    /// Its middle, in the coordinates of the data: voxels, or lengths from the middle of a mesh.
    pub(crate) place: DVec3,
    /// Importance.
    pub(crate) weight: f32,
    /// Its volume in units of [`Pieces::unit_volume`].
    pub(crate) share: f64,
    /// Its sample point.
    pub(crate) point: u32,
}

/// The sample points of Voronoi cells. Each one stands for one piece or several.
pub(crate) trait Pieces: Sync {
    /// Calls `f` for each piece of a sample point.
    fn for_each(&self, point: u32, f: impl FnMut(Piece));

    /// Raw value and gradient (raw units per world length) of a piece.
    fn value_and_gradient(&self, piece: &Piece) -> (f64, Vec3);

    /// Whether a place, in the coordinates of the data, can have a Gaussian of these data.
    fn holds(&self, _place: DVec3) -> bool {
        true
    }

    /// Covariance of a piece around its middle, in the coordinates of the data.
    fn extent(&self, piece: &Piece) -> DMat3;

    /// From the coordinates of the data to the world.
    fn to_world(&self) -> DAffine3;

    /// The volume that shares refer to, in cubic world lengths. The edge of its cube stands for a voxel.
    fn unit_volume(&self) -> f64;

    /// Length that the opacities of the transfer function refer to.
    fn reference_length(&self) -> f64;
}
