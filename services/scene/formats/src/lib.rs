//! Files of Gaussian scenes: splat formats, `scene.toml`, NumPy arrays and masks, and files that appear whole or not at all.

pub mod census;
pub mod files;
pub mod known;
pub mod load;
pub mod npy;
pub mod save;
pub mod splat;
pub mod staged_file;
pub mod summary;

pub use load::{LoadOptions, Loaded, load};
pub use save::{SaveError, Saved, save};
pub use splat::{Format, LoadError, Problem, SaveOptions, UnknownFormat, Warning, WarningCode, scene_file};
