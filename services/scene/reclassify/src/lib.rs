//! New transfer functions for Gaussians of a volume, without a new fit.
//!
//! Gaussians keep what they stand for: the mean and the spread of the values in their part of the volume, its gradient, and how an
//! optical depth of the volume becomes their opacity. Those are columns of their file. A new function then gives new colours and
//! opacities in one pass. Volume Encoding Gaussians (Dyken et al. 2025) keep a value for the same purpose, trained on pictures
//! of many functions. Here the values are the volume's own, so no picture is needed.

pub mod optical_depth;
mod reclassify;
pub mod sources;
mod volume_of_scene;

pub use reclassify::{ReclassifyError, add_surfaceness, check_scene, reclassify, reclassify_scene};
pub use volume_of_scene::{VolumeOfScene, functions};
