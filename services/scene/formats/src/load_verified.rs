//! Loading the geometry of a state, verified by its hash.

use std::path::{Path, PathBuf};

use crate::load::{LoadError, LoadOptions, load};
use sg_scene::model::Scene;

/// The geometry of a state could not be read.
#[derive(Debug, thiserror::Error)]
pub enum VerifiedLoadError {
    /// The file.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The file's content hash differs from the state's.
    #[error("{}: the file changed after the scene was opened; restart the stack", .0.display())]
    Changed(PathBuf),
}

/// Loads a scene and verifies its content hash ([`Scene::content_hash`], hexadecimal) against the owner's. So readers
/// draw and cluster the Gaussians that the owner edits.
///
/// # Errors
/// [`VerifiedLoadError`].
pub fn load_verified(path: &Path, hash: &str) -> Result<Scene, VerifiedLoadError> {
    let scene = load(path, &LoadOptions::default())?.scene;
    if scene.content_hash().to_hex().as_str() != hash {
        return Err(VerifiedLoadError::Changed(path.to_owned()));
    }
    Ok(scene)
}
