//! What can go wrong with a voice, and with the texts that it speaks.

use std::time::Duration;

use sg_layers::ModelError;
use sg_speech::error::SpeechError;

/// Name of this synthesizer.
pub(crate) const NAME: &str = "piper";

/// Why a voice was not opened, or a text not spoken. Each message is one line with the place and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum PiperError {
    /// The voice's files do not make a voice, or it computed nothing.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The text is too long, or the program that gives phonemes is not installed or failed.
    #[error(transparent)]
    Speech(#[from] SpeechError),
    /// The text is too long, or its sound would be.
    #[error("{0}")]
    Limit(String),
    /// The deadline passed.
    #[error("{NAME} was ended at its deadline, after {:.1} s", .0.as_secs_f64())]
    Late(Duration),
    /// The caller's flag asked to stop.
    #[error("the speech was cancelled")]
    Cancelled,
}

impl From<candle_core::Error> for PiperError {
    fn from(error: candle_core::Error) -> Self {
        Self::Model(error.into())
    }
}

impl From<PiperError> for SpeechError {
    fn from(error: PiperError) -> Self {
        match error {
            PiperError::Speech(error) => error,
            PiperError::Limit(problem) => Self::Limit(problem),
            PiperError::Late(after) => Self::Late { program: NAME.into(), after },
            PiperError::Cancelled => Self::Cancelled,
            PiperError::Model(error) => Self::Failed { program: NAME.into(), problem: error.to_string() },
        }
    }
}
