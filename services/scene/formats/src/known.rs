//! Reading the geometry that a state speaks of.

use std::path::{Path, PathBuf};

use crate::load::{LoadError, LoadOptions, load};
use sg_scene::model::Scene;

/// The geometry of a state could not be read.
#[derive(Debug, thiserror::Error)]
pub enum KnownError {
    /// The file.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The file holds other Gaussians than the state speaks of.
    #[error("{}: the file has changed since the scene was opened; restart the stack", .0.display())]
    Changed(PathBuf),
}

/// The scene of a file, checked against the content hash that the owner of the scene tells ([`Scene::content_hash`],
/// hexadecimal): what a reader draws or clusters is what the owner edits.
///
/// # Errors
/// [`KnownError`].
pub fn read_known(path: &Path, hash: &str) -> Result<Scene, KnownError> {
    let scene = load(path, &LoadOptions::default())?.scene;
    if scene.content_hash().to_hex().as_str() != hash {
        return Err(KnownError::Changed(path.to_owned()));
    }
    Ok(scene)
}
