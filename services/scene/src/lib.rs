//! The editable-Gaussian scene: model, file formats, edits, journal.

pub mod appearance;
pub mod camera;
pub mod census;
mod content_hash;
pub mod edit;
pub mod files;
pub mod format;
pub mod journal;
pub mod known;
pub mod load;
pub mod mask;
pub mod model;
pub mod npy;
pub mod project;
pub mod save;
pub mod scene_file;
pub mod staged_file;
pub mod summary;
#[cfg(test)]
pub(crate) mod test_scene;
pub mod view;

pub use load::{LoadError, LoadOptions, Loaded, load};
pub use save::{SaveError, SaveOptions, Saved, save};
