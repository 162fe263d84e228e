//! Scalar volumes, transfer functions and direct volume rendering.
//!
//! A [`Volume`] holds the values of a file in their own type, on a [`Grid`] in world space. A [`Field`] holds them in f32 for
//! sampling, gradients and ray marching. A [`TransferFunction`] maps values to colours and opacities. Bound to a value
//! range, it becomes a [`Classifier`].
//!
//! ```
//! use glam::{DMat4, DVec3, Vec3};
//! use sg_volume::automatic_transfer_function;
//! use sg_volume::dvr::{self, Lighting, Pinhole};
//! use sg_volume::phantom::VesselTree;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let field = VesselTree::new().rasterize(32, 0)?.volume()?.to_field();
//! let function = automatic_transfer_function(&field, Some("intensity"))?;
//! let classifier = function.classifier(field.range())?;
//!
//! // One ray along z through a vessel at the centre of the volume.
//! let world_to_camera = DMat4::from_translation(DVec3::new(-16.0, -16.0, 100.0));
//! let camera = Pinhole { width: 1, height: 1, focal: [1.0; 2], center: [0.5; 2], world_to_camera };
//! let image = dvr::render(&field, &classifier, &camera, Lighting::Unlit, Vec3::ZERO, 0.5);
//! assert!(image.pixels[0][3] > 0.5, "the vessel is visible");
//! # Ok(())
//! # }
//! ```

mod adjust;
pub mod averages;
pub mod classifier;
mod classifier_table;
pub mod dataset;
pub mod dvr;
pub mod field;
pub mod grid;
pub mod histogram;
pub mod label_table;
pub mod mesh;
pub mod opacity;
pub mod phantom;
pub mod pooled;
pub mod read;
pub mod scalars;
pub mod suggestion;
mod surfaceness;
pub mod transfer;
mod visible_blocks;
mod visible_bounds;
pub mod volume;
pub mod world_frame;

pub use adjust::AdjustError;
pub use classifier::{BaseUnitMatch, Classifier};
pub use dataset::{Dataset, Marcher, ScalarField, ScalarFieldRef};
pub use field::Field;
pub use grid::{Bounds, Grid};
pub use histogram::{automatic_transfer_function, background_values};
pub use label_table::{LabelEntry, LabelTable, LabelTableError};
pub use mesh::{Mesh, MeshField};
pub use read::{
    ENDINGS, Limits, ReadError, ReadOptions, SERIES_ENDINGS, SeriesStep, WriteError, formats_help, is_dicom,
    is_series_path, is_volume, is_volume_path, lacks_spacing, raw_file_name, read_dataset, read_series,
    read_spaced_volume, read_volume, read_volume_within, reads_beside, write_raw, write_volume,
};
pub use scalars::{ScalarType, Scalars, ValueRange};
pub use surfaceness::Surfaceness;
pub use transfer::TransferFunction;
pub use visible_bounds::visible_bounds;
pub use volume::Volume;
pub use world_frame::{LengthUnit, PatientFrame, WorldFrame};
