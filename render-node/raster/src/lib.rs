//! Splatting on cores: projection, shading, rasterizers, picking, images and their error.
//!
//! [`render::render`] draws one picture of a scene. Every Gaussian is shaded ([`shading`]) and projected once in
//! f64; `exact` then blends in f64 and is the reference, `standard` and `fast` blend in f32 with cut-offs of known error.
//! [`render::Projection::PerRay`] is the same for a head that turns. [`metrics`] says how far a picture is from the reference,
//! [`pick`] what is in front.
//!
//! What a Gaussian is like or belongs to can be shown in place of its shading: [`structure`] colours clusters, [`attributes`]
//! maps numbers and directions, [`outline`] draws lines where the cluster in front changes.

pub mod attributes;
pub mod color_map;
mod depth;
mod exact;
pub mod harmonics;
pub mod image;
pub mod metrics;
pub mod outline;
mod per_ray;
pub mod pick;
mod project;
mod raster;
pub mod render;
pub mod report;
pub mod shading;
mod standard;
pub mod structure;
mod tiles;

pub use project::{DILATION, NEAR};
pub use standard::Limits;
pub use tiles::TILE;
