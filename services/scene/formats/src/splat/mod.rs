//! The formats of Gaussian scenes, in the order of the registry.
//!
//! | format | endings | read | written | keeps |
//! | --- | --- | --- | --- | --- |
//! | `ours` | `.ply` | ✓ | ✓ | everything of one base unit, bit for bit |
//! | `3dgs` | `.ply` | ✓ | ✓ | columns of a scene drawn from harmonics, bit for bit |
//! | `compressed` (SuperSplat, PlayCanvas) | `.compressed.ply` | ✓ | ✓ | the same to 8 to 11 bits a number |
//! | `ivrgs` (float) | `.ply`, folder | ✓ | ✓ | one base unit; shading columns to the rounding of their activation |
//! | `ivrgs-quantised` | `.ply`, folder | ✓ | ✓ | the same to 256 values a column, positions to half precision |
//! | `scene` (`scene.toml`) | `.toml`, folder | ✓ | ✓ | everything, with one PLY for each base unit |
//! | `splat` (antimatter15) | `.splat` | ✓ | ✓ | one unlit unit: `f32` centres and scales, the rest to 8 bits |
//!
//! Also read: 2D Gaussian Splatting, iVR-GS's misaligned first-stage file, iVR-GS's folder of transfer functions.
//!
//! To add a format, write a file of its own and add a row to the table in `registry.rs`. The file holds a `PlyFormat` for units
//! in PLY files, else a type that implements `SplatFormat`. Names, endings, help texts and error messages come from the table.

mod activation;
mod antimatter15;
mod codebook;
mod codebook_columns;
mod columns;
mod compressed;
pub(crate) mod decode;
mod editable;
mod editable_columns;
mod editable_ply;
pub(crate) mod format;
mod ivrgs;
pub(crate) mod ivrgs_folder;
mod ivrgs_quantised;
mod morton;
mod ours;
pub(crate) mod palette;
mod pickle;
mod ply;
mod ply_format;
mod problem;
mod registry;
pub mod scene_file;
mod scene_toml;
#[cfg(test)]
mod tests;
mod three_dgs;
pub(crate) mod toml_number;
mod unit_comments;
mod unlit;

pub use format::{Format, LoadError, SaveOptions};
pub use problem::{Problem, Warning, WarningCode};
pub use registry::UnknownFormat;
pub use scene_toml::check_target as check_scene_target;
