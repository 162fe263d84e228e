//! Bulk data of a session by content: files named after their BLAKE3 hash, bounded in number and size.

use std::collections::VecDeque;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Most bytes one process keeps in the session's folder before it removes its oldest files.
const MAX_BYTES: u64 = 1 << 30;

/// A folder of content-addressed files. Each process removes only what it wrote itself.
#[derive(Debug, Clone)]
pub struct Blobs {
    folder: PathBuf,
    written: Arc<Mutex<Written>>,
}

#[derive(Debug, Default)]
struct Written {
    files: VecDeque<(PathBuf, u64)>,
    bytes: u64,
}

/// A file that could not be kept or read.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {source}; is the disk full?")]
pub struct BlobError {
    /// The file or folder.
    pub path: PathBuf,
    /// What the system said.
    pub source: io::Error,
}

impl Blobs {
    /// Opens, making it if need be, a folder of blobs.
    ///
    /// # Errors
    /// [`BlobError`] if the folder cannot be made.
    pub fn open(folder: &Path) -> Result<Self, BlobError> {
        std::fs::create_dir_all(folder).map_err(|source| BlobError { path: folder.to_owned(), source })?;
        Ok(Self { folder: folder.to_owned(), written: Arc::default() })
    }

    /// Keeps bytes under their hash (hexadecimal) with an extension such as `npy`; the same bytes are kept once.
    ///
    /// # Errors
    /// [`BlobError`]; no half file stays behind.
    pub fn put(&self, bytes: &[u8], extension: &str) -> Result<(String, PathBuf), BlobError> {
        let hash = blake3::hash(bytes).to_hex().to_string();
        let path = self.folder.join(format!("{hash}.{extension}"));
        if !path.exists() {
            let part = self.folder.join(format!(".{hash}.{extension}.{}", std::process::id()));
            let written = std::fs::write(&part, bytes).and_then(|()| std::fs::rename(&part, &path));
            if let Err(source) = written {
                // The part file may not exist; what matters is the error that led here.
                let _ = std::fs::remove_file(&part);
                return Err(BlobError { path, source });
            }
            self.remember(&path, bytes.len() as u64);
        }
        Ok((hash, path))
    }

    fn remember(&self, path: &Path, bytes: u64) {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        written.files.push_back((path.to_owned(), bytes));
        written.bytes += bytes;
        while written.bytes > MAX_BYTES && written.files.len() > 1 {
            if let Some((old, size)) = written.files.pop_front() {
                written.bytes -= size;
                // Somebody may have removed it already; the aim is that it is gone.
                let _ = std::fs::remove_file(old);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_bytes_are_kept_once_under_their_hash() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::open(folder.path()).unwrap();
        let (hash, path) = blobs.put(b"gaussian", "bin").unwrap();
        assert_eq!(hash, blake3::hash(b"gaussian").to_hex().to_string());
        assert_eq!(blobs.put(b"gaussian", "bin").unwrap().1, path);
        assert_eq!(std::fs::read(&path).unwrap(), b"gaussian");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
