//! A volume becomes editable Gaussians.

pub mod direct;
mod importance;
mod optics;
mod placement;
mod shape;
pub mod truth;
mod visibility;

pub use direct::{DirectError, DirectStart, Options, Progress, Report, direct_start};
