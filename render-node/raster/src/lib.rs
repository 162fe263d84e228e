//! Gaussian splatting on the CPU: projection, shading, rasterizers, picking, images and their error.
//!
//! [`render::render`] draws one picture of a scene. [`shading`] and projection run once for each Gaussian, in f64. The reference
//! quality blends in f64. The other qualities blend in f32 with cut-offs of known error. [`render::Projection::PerRay`] keeps
//! pictures consistent while a camera turns.
//!
//! [`image_error`] compares a picture with a reference. [`pick`] finds the front Gaussian. [`structure`] colors clusters.
//! [`gradient`] has the derivatives of a picture, for training. [`volume`] draws a volume by ray marching. [`counts`] counts the work
//! of a graphics device. [`attributes`] maps numbers and directions to colors. [`outline`] draws cluster boundaries.
//!
//! ```
//! use sg_raster::image_error::Difference;
//! use sg_raster::render::{Quality, render};
//! use sg_scene::appearance::Appearance;
//! use sg_scene::synthetic::test_scene;
//!
//! let scene = test_scene(&[("vessel", 200)]);
//! let appearance = Appearance::of(&scene);
//! let camera = sg_scene::framing::default_camera(&scene, 64, 64);
//! let reference = render(&scene, &appearance, &camera, Quality::Exact)?;
//! let picture = render(&scene, &appearance, &camera, Quality::Standard)?;
//! let error = Difference::between(&picture.image, &reference.image)?;
//! assert!(error.psnr_db >= 50.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod attributes;
pub mod color_map;
pub mod counts;
mod cut;
mod cutoffs;
mod depth;
pub mod finish;
mod footprint;
pub mod foveation;
pub mod gradient;
pub mod harmonics;
pub mod image;
pub mod image_error;
mod lanes;
pub mod nearness;
pub mod occlusion;
pub mod outline;
pub mod pick;
mod project;
mod raster;
mod ray_consistent;
mod reference_f64;
pub mod render;
pub mod report;
pub mod shading;
mod splat_f32;
pub mod structure;
mod tiles;
pub mod volume;

pub use cut::REACH as CUT_REACH;
pub use cutoffs::Limits;
pub use project::{DILATION, NEAR, dilation};
pub use tiles::TILE;
