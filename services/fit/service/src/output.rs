//! Files that the command writes.

use std::path::Path;

use sg_formats::{npy, staged_file};

use crate::failure::{Failure, work};

/// Writes the labels of the Gaussians, or where they have a value.
pub(crate) fn write_truth(file: &Path, labels: &[i32], value: Option<i32>) -> Result<(), Failure> {
    match value {
        None => npy::write_array(file, &[labels.len()], labels),
        Some(value) => {
            let mask: Vec<u8> = labels.iter().map(|&l| u8::from(l == value)).collect();
            npy::write_array(file, &[mask.len()], &mask)
        }
    }
    .map_err(work)
}

/// Replaces a file with these bytes, whole or not at all.
pub(crate) fn write(target: &Path, bytes: &[u8]) -> Result<(), Failure> {
    staged_file::replace(target, bytes).map_err(|e| work(format!("{}: {e}; nothing was written", target.display())))
}

/// Creates a folder and those above it.
pub(crate) fn make_folder(out: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(out).map_err(|e| work(format!("{}: {e}; give a writable folder", out.display())))
}
