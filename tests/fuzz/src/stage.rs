//! The folder where inputs lie as files.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

/// A temporary folder for the files of one target. The input is written anew for each run; other files stay.
///
/// `TMPDIR` should name a folder in memory: a run then takes microseconds.
#[derive(Debug)]
pub struct Stage(TempDir);

impl Stage {
    /// A new, empty folder.
    ///
    /// # Errors
    /// The system's error.
    pub fn open() -> std::io::Result<Self> {
        tempfile::Builder::new().prefix("sg-fuzz-").tempdir().map(Self)
    }

    pub(crate) fn folder(&self) -> &Path {
        self.0.path()
    }

    /// Writes a file of the input.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.folder().join(name);
        fs::write(&path, bytes).unwrap();
        path
    }

    /// A file beside the input, made once.
    pub(crate) fn keep(&self, name: &str, bytes: impl FnOnce() -> Vec<u8>) -> PathBuf {
        let path = self.folder().join(name);
        if !path.exists() {
            fs::write(&path, bytes()).unwrap();
        }
        path
    }

    /// An executable file beside the input, made once.
    pub(crate) fn keep_executable(&self, name: &str) {
        let path = self.keep(name, Vec::new);
        fs::set_permissions(path, fs::Permissions::from_mode(0o700)).unwrap();
    }

    /// Removes a file; it may be absent.
    pub(crate) fn remove(&self, name: &str) {
        let _ = fs::remove_file(self.folder().join(name));
    }
}
