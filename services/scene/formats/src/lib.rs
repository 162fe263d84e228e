//! Files of Gaussian scenes: splat formats, `scene.toml`, NumPy arrays and masks, and atomic file replacement.
//!
//! [`load()`] recognises a format by content and name, [`save()`] chooses one by the path's ending; [`splat`] lists the formats.
//!
//! ```
//! use sg_formats::{Format, LoadOptions, SaveOptions, load, save};
//! use sg_scene::synthetic::samples;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("synthetic.ply");
//! let scene = samples::editable(100, 1);
//! let saved = save(&path, &scene, &SaveOptions::default())?;
//! assert_eq!(saved.format, Format::OURS);
//!
//! let loaded = load(&path, &LoadOptions::default())?;
//! assert_eq!(loaded.scene.content_hash(), scene.content_hash());
//! # Ok(())
//! # }
//! ```

pub mod files;
pub mod load;
pub mod load_verified;
pub mod npy;
pub mod save;
pub mod splat;
pub mod staged_file;
pub mod stored_entries;
pub mod summary;
pub mod validation;

pub use load::{LoadOptions, Loaded, load};
pub use save::{SaveError, Saved, joined_format, save};
pub use splat::{
    Format, LoadError, Problem, SaveOptions, UnknownFormat, Warning, WarningCode, check_scene_target, scene_file,
};
