//! Files of Gaussian scenes: splat formats, `scene.toml`, NumPy arrays and masks, and files that appear whole or not at all.

pub mod census;
pub mod files;
pub mod format;
pub mod known;
pub mod load;
pub mod npy;
pub mod save;
pub mod scene_file;
pub mod staged_file;
pub mod summary;

pub use load::{LoadError, LoadOptions, Loaded, load};
pub use save::{SaveError, SaveOptions, Saved, save};
