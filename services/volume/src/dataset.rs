//! Data sets of either kind, and their fields: voxels of a grid, or tetrahedra of a mesh.

use glam::{DVec3, Vec3};

use crate::classifier::Classifier;
use crate::dvr::{ClipRegion, Image, Lighting, Pinhole, RayMarcher, VolumeRenderer};
use crate::field::Field;
use crate::grid::{Bounds, GridError};
use crate::histogram::{AutomaticError, automatic_transfer_function};
use crate::mesh::{Mesh, MeshField, MeshMarcher};
use crate::scalars::{ScalarType, ValueRange};
use crate::transfer::TransferFunction;
use crate::visible_bounds::visible_bounds;
use crate::volume::Volume;
use crate::world_frame::WorldFrame;

/// Voxels along the longest edge of a mesh for its histogram.
const HISTOGRAM_EDGE: usize = 128;

/// What a file holds.
#[expect(clippy::large_enum_variant, reason = "a process holds one or two")]
#[derive(Debug, Clone, PartialEq)]
pub enum Dataset {
    /// Voxels on a grid.
    Volume(Volume),
    /// Tetrahedra.
    Mesh(Mesh),
}

/// The values of a data set in f32.
#[derive(Debug, Clone)]
pub enum ScalarField {
    /// Of voxels.
    Grid(Field),
    /// Of tetrahedra.
    Mesh(MeshField),
}

/// A [`ScalarField`] of somebody else.
#[derive(Debug, Clone, Copy)]
pub enum ScalarFieldRef<'a> {
    /// Of voxels.
    Grid(&'a Field),
    /// Of tetrahedra.
    Mesh(&'a MeshField),
}

/// A data set under a transfer function, ready for any number of pictures.
#[expect(clippy::large_enum_variant, reason = "a process holds one or two")]
pub enum Marcher<'a> {
    /// Of voxels.
    Grid(RayMarcher<'a>),
    /// Of tetrahedra.
    Mesh(MeshMarcher<'a>),
}

impl Dataset {
    /// The values in f32.
    #[must_use]
    pub fn to_field(&self) -> ScalarField {
        match self {
            Self::Volume(volume) => ScalarField::Grid(volume.to_field()),
            Self::Mesh(mesh) => ScalarField::Mesh(mesh.to_field()),
        }
    }

    /// Name of the quantity, if the file has one.
    #[must_use]
    pub fn variable(&self) -> Option<&str> {
        match self {
            Self::Volume(volume) => volume.variable(),
            Self::Mesh(mesh) => mesh.variable(),
        }
    }

    /// The world frame, as far as the file tells it.
    #[must_use]
    pub fn frame(&self) -> WorldFrame {
        match self {
            Self::Volume(volume) => volume.frame(),
            Self::Mesh(mesh) => mesh.frame(),
        }
    }

    /// Type of the values.
    #[must_use]
    pub fn scalar_type(&self) -> ScalarType {
        match self {
            Self::Volume(volume) => volume.scalars().scalar_type(),
            Self::Mesh(mesh) => mesh.scalar_type(),
        }
    }
}

impl From<Volume> for Dataset {
    fn from(volume: Volume) -> Self {
        Self::Volume(volume)
    }
}

impl From<Mesh> for Dataset {
    fn from(mesh: Mesh) -> Self {
        Self::Mesh(mesh)
    }
}

impl ScalarField {
    /// The same without ownership.
    #[must_use]
    pub fn as_ref(&self) -> ScalarFieldRef<'_> {
        match self {
            Self::Grid(field) => ScalarFieldRef::Grid(field),
            Self::Mesh(field) => ScalarFieldRef::Mesh(field),
        }
    }
}

impl ScalarField {
    /// The same values as a part of a series with this range of raw values ([`Field::with_range`]).
    #[must_use]
    pub fn with_range(self, range: [f64; 2]) -> Self {
        match self {
            Self::Grid(field) => Self::Grid(field.with_range(range)),
            Self::Mesh(field) => Self::Mesh(field.with_range(range)),
        }
    }
}

impl<'a> From<&'a ScalarField> for ScalarFieldRef<'a> {
    fn from(field: &'a ScalarField) -> Self {
        field.as_ref()
    }
}

impl<'a> From<&'a Field> for ScalarFieldRef<'a> {
    fn from(field: &'a Field) -> Self {
        Self::Grid(field)
    }
}

impl<'a> From<&'a MeshField> for ScalarFieldRef<'a> {
    fn from(field: &'a MeshField) -> Self {
        Self::Mesh(field)
    }
}

impl<'a> ScalarFieldRef<'a> {
    /// Range of the finite raw values, and the number of other values.
    #[must_use]
    pub fn range(self) -> ValueRange {
        match self {
            Self::Grid(field) => field.range(),
            Self::Mesh(field) => field.range(),
        }
    }

    /// The box of the data in the world.
    #[must_use]
    pub fn bounds(self) -> Bounds {
        match self {
            Self::Grid(field) => field.grid().bounds(),
            Self::Mesh(field) => field.bounds(),
        }
    }

    /// Number of voxels or tetrahedra.
    #[must_use]
    pub fn elements(self) -> usize {
        match self {
            Self::Grid(field) => field.values().len(),
            Self::Mesh(field) => field.cells().len(),
        }
    }

    /// The word for voxels or tetrahedra, for a person.
    #[must_use]
    pub fn elements_name(self) -> &'static str {
        match self {
            Self::Grid(_) => "voxels",
            Self::Mesh(_) => "tetrahedra",
        }
    }

    /// The middle of a voxel or tetrahedron in the world, and the raw value there; NaN past the end.
    #[must_use]
    pub fn element(self, index: usize) -> (DVec3, f64) {
        match self {
            Self::Grid(field) => (field.grid().to_world(field.grid().voxel(index).as_dvec3()), field.raw(index)),
            Self::Mesh(field) if index < field.cells().len() => {
                let cell = field.cell(index);
                (field.middle() + cell.middle(), cell.values.iter().sum::<f64>() / 4.0)
            }
            Self::Mesh(_) => (DVec3::NAN, f64::NAN),
        }
    }

    /// The box of what a transfer function shows, along the axes of the world. That of everything if it shows nothing.
    #[must_use]
    pub fn visible_bounds(self, classifier: &Classifier) -> Bounds {
        match self {
            Self::Grid(field) => visible_bounds(field, classifier),
            Self::Mesh(field) => field.visible_bounds(classifier),
        }
    }

    /// The data under a transfer function. `step` is the distance of samples in units of the smallest voxel spacing, or in
    /// units of 1/256 of a mesh's diagonal.
    #[must_use]
    pub fn marcher(self, classifier: Classifier, step: f64) -> Marcher<'a> {
        match self {
            Self::Grid(field) => Marcher::Grid(RayMarcher::new(field, classifier, step)),
            Self::Mesh(field) => Marcher::Mesh(MeshMarcher::new(field, classifier, step)),
        }
    }

    /// The automatic transfer function ([`automatic_transfer_function`]). That of a mesh is by volume: of values at even distances.
    ///
    /// # Errors
    /// [`AutomaticError`] if all values are equal or none is finite.
    pub fn automatic_transfer_function(self, variable: Option<&str>) -> Result<TransferFunction, AutomaticError> {
        match self {
            Self::Grid(field) => automatic_transfer_function(field, variable),
            Self::Mesh(field) => {
                let even = field.resampled(HISTOGRAM_EDGE).map_err(|_: GridError| AutomaticError::NoValues)?;
                automatic_transfer_function(&even, variable)
            }
        }
    }
}

impl Marcher<'_> {
    /// Shows only what all these regions keep.
    #[must_use]
    pub fn clipped(self, clips: Vec<ClipRegion>) -> Self {
        match self {
            Self::Grid(marcher) => Self::Grid(marcher.clipped(clips)),
            Self::Mesh(marcher) => Self::Mesh(marcher.clipped(clips)),
        }
    }
}

impl VolumeRenderer for Marcher<'_> {
    fn picture(&self, camera: &Pinhole, lighting: Lighting, background: Vec3) -> Image {
        match self {
            Self::Grid(marcher) => marcher.picture(camera, lighting, background),
            Self::Mesh(marcher) => marcher.picture(camera, lighting, background),
        }
    }

    fn fast_picture(&self, camera: &Pinhole, lighting: Lighting, background: Vec3) -> Image {
        match self {
            Self::Grid(marcher) => marcher.fast_picture(camera, lighting, background),
            Self::Mesh(marcher) => marcher.fast_picture(camera, lighting, background),
        }
    }
}
