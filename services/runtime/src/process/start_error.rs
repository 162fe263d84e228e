//! Errors of a process, and their exit status.

use std::process::ExitCode;

use crate::bus::BusError;
use crate::fault::Fault;
use crate::scene_replica::SceneReplicaError;

/// Exit status for wrong parameters or input: a restart is useless.
pub const EXIT_INPUT: u8 = 2;
/// Exit status for a failure at work.
pub const EXIT_FAILED: u8 = 1;

/// A process could not start or serve.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StartError {
    /// Parameters or input are wrong; a restart is useless.
    #[error("{0}")]
    Input(String),
    /// A failure that a restart may repair.
    #[error("{0}")]
    Failed(String),
}

impl From<BusError> for StartError {
    fn from(error: BusError) -> Self {
        Self::Failed(error.to_string())
    }
}

impl From<Fault> for StartError {
    fn from(fault: Fault) -> Self {
        Self::Failed(fault.to_string())
    }
}

impl From<SceneReplicaError> for StartError {
    fn from(error: SceneReplicaError) -> Self {
        Self::Failed(error.to_string())
    }
}

impl From<StartError> for ExitCode {
    fn from(error: StartError) -> Self {
        Self::from(match error {
            StartError::Input(_) => EXIT_INPUT,
            StartError::Failed(_) => EXIT_FAILED,
        })
    }
}
