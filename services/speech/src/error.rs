//! What can go wrong between sound and text.

use std::time::Duration;

use crate::audio::AudioError;

/// Why speech was not recognised or synthesised. Each message is one line with the remedy.
#[derive(Debug, thiserror::Error)]
pub enum SpeechError {
    /// A program is not installed.
    #[error("{program} is not installed; on Debian install {package}")]
    Missing {
        /// Its name.
        program: &'static str,
        /// Debian's packages that have it.
        package: &'static str,
    },
    /// A program did not start.
    #[error("{program} does not start: {problem}")]
    Start {
        /// Its name.
        program: String,
        /// The system's error.
        problem: String,
    },
    /// A program ended with an error, or its output is not what it should be.
    #[error("{program} failed: {problem}")]
    Failed {
        /// Its name.
        program: String,
        /// What it said last.
        problem: String,
    },
    /// The deadline passed. The program was ended.
    #[error("{program} was ended at its deadline, after {:.1} s", .after.as_secs_f64())]
    Late {
        /// The program's name.
        program: String,
        /// Time that it ran.
        after: Duration,
    },
    /// The caller cancelled the work.
    #[error("the work was cancelled")]
    Cancelled,
    /// A file of a program's own was not written or read.
    #[error("{0}")]
    File(String),
    /// Sound was not read or converted.
    #[error(transparent)]
    Audio(#[from] AudioError),
    /// A sentence, a name or a sound is beyond a limit.
    #[error("{0}")]
    Limit(String),
}
