//! Sessions that the supervisor opens beside its own: the interface to the command line.

use std::path::Path;
use std::process::Command;

use sg_runtime::fault::Fault;

/// Most sessions that one supervisor has open at a time.
pub(super) const MAX_OPEN: usize = 4;

/// A command that opens a scene or volume in a session of its own.
#[derive(Debug)]
pub struct OpenCommand {
    /// Name of the new session.
    pub session: String,
    /// Whether the file is a volume, from which Gaussians are made first.
    pub volume: bool,
    /// The command. It must outlive the supervisor (see [`crate::spawn::detached`]).
    pub command: Command,
}

/// Prepares the command that opens a scene or volume.
///
/// The supervisor checks the session, starts the command, logs its lines and reports its failure.
pub trait SessionOpener: Send + Sync {
    /// The command for an absolute path. `spacing` holds the millimetres between the voxels of a raw volume.
    ///
    /// # Errors
    /// `NotFound` if there is no such file, `FailedPrecondition` if it cannot be opened here.
    fn command(&self, path: &Path, spacing: Option<[f64; 3]>) -> Result<OpenCommand, Fault>;
}
