//! Errors of supervisors and nodes.

use std::path::{Path, PathBuf};

use sg_runtime::bus::BusError;
use sg_runtime::fault::Fault;
use sg_runtime::session::SessionError;

/// A supervisor or node that cannot start or continue.
#[derive(Debug, thiserror::Error)]
pub enum StackError {
    /// The session's name or folder is unusable.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The bus cannot be opened.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// A file or folder cannot be read or written.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// Another supervisor runs this session.
    #[error(
        "session `{session}` runs already (supervisor {pid}); stop it with `supergaussian down --session {session}` or name this one with --session"
    )]
    SessionRuns {
        /// Name of the session.
        session: String,
        /// Process id of its supervisor.
        pid: String,
    },
    /// Another process has joined the session under this node's name.
    #[error("{}: a node of this name runs on this machine already", .0.display())]
    NodeRuns(PathBuf),
    /// A process of the session's last run cannot be ended.
    #[error("process {0} of the session's last run is still alive; end it and try again")]
    Leftover(u32),
    /// The system's signals cannot be received.
    #[error("signals cannot be received: {0}")]
    Signals(std::io::Error),
    /// The process that cleans up after this one cannot be started.
    #[error("the process that ends leftover processes cannot be started: {0}")]
    Reaper(std::io::Error),
    /// A thread or task of this process has panicked.
    #[error("stopped, because this process {0}")]
    Panicked(String),
    /// The supervisor refuses this node for good.
    #[error(transparent)]
    Refused(Fault),
}

impl StackError {
    pub(crate) fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), source }
    }
}
