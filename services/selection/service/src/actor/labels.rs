//! The cluster of each Gaussian as a file for other processes.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sg_edit::{Duplicate, EditState};
use sg_formats::npy;
use sg_runtime::blobs::Blobs;

/// The published labels: one file for the Gaussians of a state.
pub(super) struct PublishedLabels {
    blobs: Blobs,
    /// Duplicates that the labels are for.
    duplicates: Arc<[Duplicate]>,
    hash: String,
    path: PathBuf,
    /// The file before, for a reader that is late.
    former: Option<PathBuf>,
    count: u32,
}

impl PublishedLabels {
    /// Publishes the labels of a first state.
    ///
    /// # Errors
    /// One line for a file that could not be written.
    pub(super) fn publish(blobs: Blobs, state: &EditState, labels: &[i32]) -> Result<Self, String> {
        let path = blobs.folder().join("labels.npy");
        let hash = written(&blobs, &path, labels)?;
        Ok(Self { blobs, duplicates: Arc::clone(state.duplicates()), hash, path, former: None, count: 0 })
    }

    /// Publishes the labels of a state, unless it has the Gaussians of the former one.
    ///
    /// # Errors
    /// As [`Self::publish`]; the former labels stay published.
    pub(super) fn update(&mut self, state: &EditState, labels: &[i32]) -> Result<(), String> {
        if self.duplicates == *state.duplicates() {
            return Ok(());
        }
        let path = self.blobs.folder().join(format!("labels-{}.npy", self.count + 1));
        self.hash = written(&self.blobs, &path, labels)?;
        self.count += 1;
        self.duplicates = Arc::clone(state.duplicates());
        let former = self.former.replace(std::mem::replace(&mut self.path, path));
        if let Some(former) = former {
            // Without success it goes with the folder of the process.
            let _ = std::fs::remove_file(former);
        }
        Ok(())
    }

    /// BLAKE3 of the file, hexadecimal.
    pub(super) fn hash(&self) -> &str {
        &self.hash
    }

    /// The file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

fn written(blobs: &Blobs, path: &Path, labels: &[i32]) -> Result<String, String> {
    npy::write_labels(path, labels).map_err(|e| e.to_string())?;
    blobs.offer(path).map(|(hash, _)| hash).map_err(|e| e.to_string())
}
