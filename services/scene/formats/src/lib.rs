//! Files of Gaussian scenes: splat formats, `scene.toml`, NumPy arrays and masks, and atomic file replacement.

pub mod files;
pub mod load;
pub mod load_verified;
pub mod npy;
pub mod save;
pub mod splat;
pub mod staged_file;
pub mod summary;
pub mod validation;

pub use load::{LoadOptions, Loaded, load};
pub use save::{SaveError, Saved, save};
pub use splat::{Format, LoadError, Problem, SaveOptions, UnknownFormat, Warning, WarningCode, scene_file};
