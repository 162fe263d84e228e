//! Reading a launch file from disk.

use std::path::{Path, PathBuf};

use super::executables::ExecutableSearch;
use super::model::{LaunchFile, UnknownService};
use super::read::{Source, read};
use crate::document::Problems;

/// A launch file that cannot be loaded.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file cannot be read.
    #[error("{}: {source}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// The file has mistakes.
    #[error(transparent)]
    Problems(#[from] Problems),
    /// A service was selected that the file does not have.
    #[error(transparent)]
    UnknownService(#[from] UnknownService),
}

/// Reads a launch file, applies the overrides, and keeps only the services in `only` unless that list is empty.
///
/// # Errors
/// [`LoadError`] if the file cannot be read, has mistakes, or lacks a service of `only`.
pub fn load(path: &Path, overrides: &[String], only: &[String]) -> Result<LaunchFile, LoadError> {
    let text = std::fs::read_to_string(path).map_err(|source| LoadError::Read { path: path.to_owned(), source })?;
    let file = read(Source { path, text: &text, overrides }, &ExecutableSearch::here_then_path())?;
    Ok(if only.is_empty() { file } else { file.only(only)? })
}
