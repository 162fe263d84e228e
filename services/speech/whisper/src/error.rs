//! What can go wrong with a model of speech, and with what it hears.

use std::path::Path;

use sg_layers::ModelError;

/// Why a model was not opened, or a sound not recognised. Each message is one line with the place and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum WhisperError {
    /// The model's files do not make a model, or it computed nothing.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The sound is none that the model takes.
    #[error("sound: {0}")]
    Sound(String),
    /// An option is out of bounds, or the model has no such thing.
    #[error("option `{option}`: {problem}")]
    Option {
        /// Name of the option.
        option: &'static str,
        /// What is wrong with its value, and the remedy.
        problem: String,
    },
    /// A sentence of a list is none that can be scored.
    #[error("sentence {index}: {problem}")]
    Sentence {
        /// Place of the sentence in the list, from 0.
        index: usize,
        /// What is wrong with it, and the remedy.
        problem: String,
    },
    /// The caller's flag asked to stop.
    #[error("the recognition was cancelled")]
    Cancelled,
}

impl WhisperError {
    pub(crate) fn file(path: &Path, problem: impl Into<String>) -> Self {
        ModelError::file(path, problem).into()
    }

    pub(crate) fn option(option: &'static str, problem: impl Into<String>) -> Self {
        Self::Option { option, problem: problem.into() }
    }
}

impl From<candle_core::Error> for WhisperError {
    fn from(error: candle_core::Error) -> Self {
        Self::Model(error.into())
    }
}
