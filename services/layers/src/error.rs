//! What can go wrong with the files of a model and with its computation.

use std::path::{Path, PathBuf};

/// Why a model was not opened or computed nothing. Each message is one line with the file, the place in it and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// A file of the model's folder is absent, too long, truncated or not what its name says.
    #[error("{}: {problem}", .path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, and the remedy.
        problem: String,
    },
    /// A value of a configuration is out of bounds or not supported.
    #[error("{}: `{key}`: {problem}", .path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// The key in it, with dots between its parts.
        key: String,
        /// What is wrong with its value, and the remedy.
        problem: String,
    },
    /// A tensor that the configuration asks for is not among the weights.
    #[error(
        "{}: no tensor `{tensor}` of shape {expected:?}; take weights and configuration from the same model, whole",
        .path.display()
    )]
    NoTensor {
        /// The file of weights.
        path: PathBuf,
        /// Name of the tensor.
        tensor: String,
        /// Shape by the configuration.
        expected: Vec<usize>,
    },
    /// A tensor has another shape than the configuration says.
    #[error(
        "{}: tensor `{tensor}` has shape {found:?}, but the configuration asks for {expected:?}; take both from the same model",
        .path.display()
    )]
    Shape {
        /// The file of weights.
        path: PathBuf,
        /// Name of the tensor.
        tensor: String,
        /// Shape by the configuration.
        expected: Vec<usize>,
        /// Shape in the file.
        found: Vec<usize>,
    },
    /// The tensor library refused an operation.
    #[error("the computation of a model failed: {0}")]
    Computation(#[from] candle_core::Error),
}

impl ModelError {
    /// A problem of a file.
    #[must_use]
    pub fn file(path: &Path, problem: impl Into<String>) -> Self {
        Self::File { path: path.to_owned(), problem: problem.into() }
    }

    /// A problem of a value in a configuration.
    #[must_use]
    pub fn config(path: &Path, key: &str, problem: impl Into<String>) -> Self {
        Self::Config { path: path.to_owned(), key: key.to_owned(), problem: problem.into() }
    }
}
