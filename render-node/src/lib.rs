//! Splatting: the shading model, the CPU renderer, the render process.
//!
//! [`render::render`] draws one picture of a scene on the CPU. Every Gaussian is shaded ([`shading`]) and projected once in
//! f64; `exact` then blends in f64 and is the reference, `standard` and `fast` blend in f32 with cut-offs of known error.
//! [`render::Projection::PerRay`] is the same for a head that turns. [`metrics`] says how far a picture is from the reference,
//! [`view`] where to look from, [`pick`] what is in front.
//!
//! What a Gaussian is like or belongs to can be shown in place of its shading: [`structure`] colours clusters, [`attributes`]
//! maps numbers and directions, [`outline`] draws lines where the cluster in front changes.

pub mod attributes;
pub mod backend;
pub mod color_map;
mod depth;
pub mod display;
mod exact;
pub mod gpu;
pub mod hands;
pub mod harmonics;
pub mod image;
pub mod metrics;
pub mod outline;
pub mod panels;
mod per_ray;
pub mod pick;
mod project;
mod raster;
pub mod render;
pub mod report;
#[cfg(feature = "xr")]
pub mod room;
pub mod shading;
mod standard;
pub mod structure;
mod tiles;
pub mod view;
pub mod window;
#[cfg(feature = "xr")]
pub mod xr;

pub use project::{DILATION, NEAR};
