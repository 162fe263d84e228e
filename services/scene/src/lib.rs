//! The editable-Gaussian scene: model, file formats, edits, journal.

pub mod appearance;
pub mod camera;
pub mod mask;
pub mod model;
