//! Reading a launch file from disk.

use std::path::{Path, PathBuf};

use sg_input::{file, limits};

use super::executables::ExecutableSearch;
use super::model::{LaunchFile, UnknownService};
use super::read::{Source, read};
use crate::document::Problems;
use crate::snippet;

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
    #[error("{problems}")]
    Problems {
        /// The mistakes.
        problems: Problems,
        /// Text of the file.
        text: String,
    },
    /// `only` names a service that the file does not have.
    #[error(transparent)]
    UnknownService(#[from] UnknownService),
}

impl LoadError {
    /// The error for a terminal: each mistake with its line of the file. Further lines of a mistake are indented.
    #[must_use]
    pub fn report(&self) -> Vec<String> {
        match self {
            Self::Problems { problems, text } => snippet::report(problems, text),
            other => vec![other.to_string()],
        }
    }
}

/// Reads a launch file, applies the overrides, and keeps only the services in `only` unless that list is empty.
///
/// # Errors
/// [`LoadError`] if the file cannot be read, has mistakes, or lacks a service of `only`.
pub fn load(path: &Path, overrides: &[String], only: &[String]) -> Result<LaunchFile, LoadError> {
    let text = file::read_text(path, limits::SMALL_TEXT_BYTES)
        .map_err(|source| LoadError::Read { path: path.to_owned(), source })?;
    let read = read(Source { path, text: &text, overrides }, &ExecutableSearch::here_then_path());
    let file = read.map_err(|problems| LoadError::Problems { problems, text })?;
    Ok(if only.is_empty() { file } else { file.only(only)? })
}
