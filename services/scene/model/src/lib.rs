//! The scene of editable Gaussians: columns, base units, appearance, masks, camera and framing.
//!
//! Pure data and pure functions, without messages and drawing. Only files of cameras and their paths are read here.
//!
//! ```
//! use glam::{DVec3, Vec3};
//! use sg_scene::model::{Gaussians, Scene};
//! use sg_scene::synthetic::unit_of;
//!
//! // Two base units of one Gaussian each.
//! let gaussian = |center: Vec3| Gaussians {
//!     position: vec![center],
//!     rotation: vec![[1.0, 0.0, 0.0, 0.0]],
//!     log_scale: vec![Vec3::splat(-2.0)],
//!     opacity_logit: vec![0.0],
//!     ..Gaussians::default()
//! };
//! let units = vec![unit_of(gaussian(Vec3::ZERO)), unit_of(gaussian(Vec3::new(1.0, 2.0, 3.0)))];
//!
//! // The scene numbers all Gaussians one after another; its box holds all centres.
//! let scene = Scene::compose(units, None);
//! assert_eq!(scene.len(), 2);
//! assert_eq!(scene.units[1].range(), 1..2);
//! assert_eq!((scene.bounds.min, scene.bounds.max), (DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0)));
//! ```

pub mod affine;
pub mod appearance;
pub mod camera;
pub mod camera_motion;
pub mod camera_path;
mod content_hash;
pub mod framing;
mod harmonics_rotation;
pub mod mask;
pub mod model;
pub mod orientation;
pub mod recolor;
mod rows;
pub mod similarity;
pub mod size;
pub mod subject;
pub mod symmetric3;
pub mod synthetic;
pub mod tone;
pub mod view;
