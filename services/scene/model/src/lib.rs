//! The scene of editable Gaussians: columns, base units, appearance, masks, camera and framing.
//!
//! Pure data and pure functions: nothing here reads files, knows messages or draws.

pub mod appearance;
pub mod camera;
pub mod camera_motion;
mod content_hash;
pub mod framing;
pub mod mask;
pub mod model;
pub mod synthetic;
pub mod view;
