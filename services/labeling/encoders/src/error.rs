//! What can go wrong with a model's folder and with what it encodes.

use std::path::Path;

use sg_layers::ModelError;

use crate::embedding::EmbeddingError;

/// Why a model was not opened, or an input not encoded. Each message is one line with the file, the place in it and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum EncoderError {
    /// The model's files do not make a model, or it computed nothing.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A text was not encoded.
    #[error("text {index}: {problem}")]
    Text {
        /// Place of the text in the batch, from 0.
        index: usize,
        /// What is wrong with it, and the remedy.
        problem: String,
    },
    /// An image is not one.
    #[error("image: {0}")]
    Image(String),
    /// The model gave a vector without a direction.
    #[error("the model gave no embedding: {0}; its weights may be damaged")]
    Embedding(#[from] EmbeddingError),
}

impl From<candle_core::Error> for EncoderError {
    fn from(error: candle_core::Error) -> Self {
        Self::Model(error.into())
    }
}

impl EncoderError {
    pub(crate) fn file(path: &Path, problem: impl Into<String>) -> Self {
        ModelError::file(path, problem).into()
    }

    pub(crate) fn config(path: &Path, key: &str, problem: impl Into<String>) -> Self {
        ModelError::config(path, key, problem).into()
    }
}
