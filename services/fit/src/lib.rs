//! Conversion of scalar volumes and meshes to editable Gaussians.
//!
//! [`direct_start`] classifies the voxels by a transfer function. It computes their importance and places Gaussians by it. Each
//! Gaussian gets the shape, opacity and colour of its part of the volume. [`labels`] transfers voxel labels to the Gaussians.
//! [`series`] does so for the time steps of a series, each from the one before. [`label_units`] makes base units of the labels
//! of a label map.
//!
//! ```
//! use sg_fit::{Options, direct_start};
//! use sg_volume::phantom::{VesselTree, transfer_function};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let field = VesselTree::new().rasterize(32, 0)?.volume()?.to_field();
//! let options = Options { gaussians: 500, ..Options::default() };
//! let start = direct_start(&field, &transfer_function(), &options, |_| {})?;
//! assert!((450..=500).contains(&start.scene.len()));
//! assert_eq!(start.scene.units[0].name, "vessels");
//! # Ok(())
//! # }
//! ```

mod classification;
pub mod direct;
mod importance;
pub mod label_start;
pub mod label_units;
pub mod labels;
mod mesh;
mod options;
mod pieces;
mod placed;
mod placement;
pub mod report;
pub mod series;
mod shape;
pub mod training;
mod visibility;
mod voxels;

pub use direct::{Progress, direct_start};
pub use options::{DirectError, MAX_GAUSSIANS, Options};
pub use placement::PlacementError;
pub use report::{DirectStart, Report};
pub use sg_raster::volume::orientation_of;
