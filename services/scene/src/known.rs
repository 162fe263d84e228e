//! Reading the geometry that a state speaks of.

use std::path::{Path, PathBuf};

use crate::edit::Geometry;
use crate::load::{LoadError, LoadOptions, load};
use crate::model::Scene;

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

/// The scene that `geometry` names, checked against its content hash: what a reader draws or clusters is what the owner
/// of the scene edits.
///
/// # Errors
/// [`KnownError`].
pub fn read_known(geometry: &Geometry) -> Result<Scene, KnownError> {
    let path = Path::new(&geometry.path);
    let scene = load(path, &LoadOptions::default())?.scene;
    if scene.content_hash().to_hex().as_str() != geometry.hash {
        return Err(KnownError::Changed(path.to_owned()));
    }
    Ok(scene)
}
