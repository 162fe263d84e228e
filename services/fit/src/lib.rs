//! Conversion of scalar volumes to editable Gaussians.

mod classification;
pub mod direct;
mod importance;
pub mod labels;
mod placement;
mod shape;
mod visibility;

pub use direct::{DirectError, DirectStart, Options, Progress, Report, direct_start};
pub use placement::PlacementError;
