//! Scenes that were made from volumes, beside the projects in the user's data folder.
//!
//! `supergaussian fit --keep-in` makes them: `KEY/NAME/scene.toml`.

use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Name of a scene's file.
const SCENE: &str = "scene.toml";

/// The folder of kept scenes; it may not exist.
#[derive(Debug)]
pub(crate) struct KeptScenes(PathBuf);

/// A kept scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct KeptScene {
    /// The name of its volume and its key.
    pub(crate) name: String,
    /// Its `scene.toml`.
    pub(crate) path: PathBuf,
    /// The folder of its key. Nothing else is in it.
    pub(crate) folder: PathBuf,
}

impl KeptScenes {
    pub(crate) fn new(folder: PathBuf) -> Self {
        Self(folder)
    }

    pub(crate) fn folder(&self) -> &Path {
        &self.0
    }

    /// All kept scenes.
    pub(crate) fn list(&self) -> Result<Vec<KeptScene>, std::io::Error> {
        let entries = match std::fs::read_dir(&self.0) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(error),
        };
        let mut all = Vec::new();
        for entry in entries {
            let inner = std::fs::read_dir(entry?.path()).into_iter().flatten().flatten();
            all.extend(inner.map(|scene| scene.path().join(SCENE)).find_map(|path| self.at(&path)));
        }
        all.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(all)
    }

    /// The kept scene of this file; `None` for a scene that lies elsewhere, and for one that is gone.
    pub(crate) fn at(&self, path: &Path) -> Option<KeptScene> {
        // A scene's process knows its file by its real name.
        let root = std::fs::canonicalize(&self.0).ok()?;
        let path = std::fs::canonicalize(path).ok()?;
        let mut parts = path.strip_prefix(&root).ok()?.components();
        let (Some(Component::Normal(key)), Some(Component::Normal(name)), Some(Component::Normal(file)), None) =
            (parts.next(), parts.next(), parts.next(), parts.next())
        else {
            return None;
        };
        let (key, name) = (key.to_str()?, name.to_str()?);
        // A scene that is being written belongs to its process.
        let is_kept = file == SCENE && !key.starts_with('.');
        is_kept.then(|| KeptScene { name: format!("{name}-{key}"), folder: root.join(key), path: path.clone() })
    }
}

impl KeptScene {
    /// Size on disk, bytes.
    pub(crate) fn bytes(&self) -> u64 {
        let files = self.path.parent().and_then(|folder| std::fs::read_dir(folder).ok());
        files.into_iter().flatten().flatten().filter_map(|file| file.metadata().ok()).map(|file| file.len()).sum()
    }

    /// When it was made.
    pub(crate) fn made(&self) -> SystemTime {
        std::fs::metadata(&self.path).and_then(|file| file.modified()).unwrap_or(UNIX_EPOCH)
    }

    /// Deletes its files.
    pub(crate) fn delete(&self) -> Result<(), std::io::Error> {
        std::fs::remove_dir_all(&self.folder)
    }
}
