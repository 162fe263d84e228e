//! Errors in a file's content, and warnings of readers and writers.

use std::fmt;
use std::path::PathBuf;

use serde::Serialize;

/// An error in a file's content: its place, the finding and the remedy.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {what}; {remedy}")]
pub struct Problem {
    /// Header line, element and property, or row.
    pub place: String,
    /// The finding.
    pub what: String,
    /// The remedy.
    pub remedy: String,
}

impl Problem {
    pub(crate) fn new(place: impl Into<String>, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { place: place.into(), what: what.into(), remedy: remedy.into() }
    }
}

/// A reader's assumption, or a writer's loss.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// The file it is about, if any.
    pub file: Option<PathBuf>,
    /// Its kind.
    pub code: WarningCode,
    /// One line for people.
    pub message: String,
}

/// The kinds of [`Warning`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum WarningCode {
    /// The convention of the shading columns was guessed.
    Convention,
    /// The palette colour is not stored and was assumed.
    Palette,
    /// The file was trained with another shading model than the one it is drawn with.
    Shading,
    /// NaN or infinite values.
    NonFinite,
    /// Quaternions of length zero.
    ZeroRotation,
    /// Parts of the file that are not kept.
    Ignored,
    /// Values narrowed from `double` to `float`.
    Narrowed,
    /// Flat (2D) Gaussians were given a thickness.
    Flattened,
    /// Columns stood under other names than their content.
    Remapped,
    /// The written format cannot hold all of the scene.
    Lossy,
    /// The written file has its Gaussians in another order.
    Reordered,
    /// The scene holds no Gaussian.
    Empty,
}

impl Warning {
    pub(crate) fn new(code: WarningCode, message: impl Into<String>) -> Self {
        Self { file: None, code, message: message.into() }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.file {
            Some(file) => write!(f, "{}: {}", file.display(), self.message),
            None => f.write_str(&self.message),
        }
    }
}
