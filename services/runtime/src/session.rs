//! Sessions on this machine: where they keep socket, logs and pictures, and how one is found.

use std::io;
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::path::{Path, PathBuf};

use sg_proto::limits::MAX_NAME_BYTES;

use crate::bus::endpoint_of;

/// Environment variable that names the folder of all sessions.
pub const RUN_ROOT: &str = "SUPERGAUSSIAN_RUN_ROOT";

/// The longest path that a unix socket may have on the systems we know.
const MAX_SOCKET_PATH: usize = 107;

/// The folder of one session, mode 0700.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionDir {
    name: String,
    path: PathBuf,
}

/// A session that cannot be made or found.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The name cannot be part of a key expression or path.
    #[error("session name `{0}`: use 1 to {MAX_NAME_BYTES} letters, digits, `-` or `_`")]
    Name(String),
    /// The folder cannot be used.
    #[error("{path}: {source}")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Somebody else could read or write the folder.
    #[error("{0} belongs to somebody else or is open to others; remove it or set {RUN_ROOT} to a folder of your own")]
    Open(PathBuf),
    /// The socket's path would be too long.
    #[error("{0}: too long for a socket; set {RUN_ROOT} to a shorter folder")]
    Long(PathBuf),
    /// No session runs.
    #[error("no stack is running; start one with `supergaussian up FILE.toml`")]
    None,
    /// The session asked for does not run.
    #[error("no stack of session `{name}` is running; running: {running}")]
    Unknown {
        /// Asked for.
        name: String,
        /// Sessions that run.
        running: String,
    },
    /// More than one runs.
    #[error("several stacks are running: {0}; pick one with --session NAME")]
    Many(String),
}

impl SessionDir {
    /// The folder of a session by name, whether it exists or not.
    ///
    /// # Errors
    /// [`SessionError::Name`], [`SessionError::Long`].
    pub fn named(name: &str) -> Result<Self, SessionError> {
        let ok = (1..=MAX_NAME_BYTES).contains(&name.len())
            && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
        if !ok {
            return Err(SessionError::Name(name.to_owned()));
        }
        let dir = Self { name: name.to_owned(), path: run_root().join(name) };
        if dir.socket().as_os_str().len() > MAX_SOCKET_PATH {
            return Err(SessionError::Long(dir.socket()));
        }
        Ok(dir)
    }

    /// The folder of what a machine runs that has joined a session of another one. It is no session of this machine's own.
    ///
    /// # Errors
    /// As [`SessionDir::named`], for the session's name and the machine's.
    pub fn on_node(session: &str, node: &str) -> Result<Self, SessionError> {
        let (session, node) = (Self::named(session)?, Self::named(node)?);
        // No session's name has a dot.
        let path = run_root().join(format!("{}.{}", session.name, node.name));
        Ok(Self { name: session.name, path })
    }

    /// Makes the folder, readable by its owner alone, or checks that it is so.
    ///
    /// # Errors
    /// [`SessionError::Folder`], [`SessionError::Open`].
    pub fn create(&self) -> Result<(), SessionError> {
        for path in [&run_root(), &self.path] {
            let fail = |source| SessionError::Folder { path: path.clone(), source };
            std::fs::DirBuilder::new().recursive(true).mode(0o700).create(path).map_err(fail)?;
            let metadata = std::fs::symlink_metadata(path).map_err(fail)?;
            let private = metadata.is_dir() && metadata.permissions().mode() & 0o077 == 0;
            if !private {
                return Err(SessionError::Open(path.clone()));
            }
        }
        Ok(())
    }

    /// Name of the session.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The bus's unix socket.
    #[must_use]
    pub fn socket(&self) -> PathBuf {
        self.path.join("bus.sock")
    }

    /// The bus's endpoint.
    #[must_use]
    pub fn endpoint(&self) -> String {
        endpoint_of(&self.socket())
    }

    /// The file that the supervisor holds locked while it lives; its text is the supervisor's process id.
    #[must_use]
    pub fn lock_file(&self) -> PathBuf {
        self.path.join("supervisor.lock")
    }

    /// Where services' logs go.
    #[must_use]
    pub fn logs(&self) -> PathBuf {
        self.path.join("logs")
    }

    /// Whether a supervisor lives in this session.
    #[must_use]
    pub fn is_running(&self) -> bool {
        let Ok(file) = std::fs::File::open(self.lock_file()) else { return false };
        // A lock that cannot be had is held by a living process: the system drops locks of dead ones.
        matches!(file.try_lock_shared(), Err(std::fs::TryLockError::WouldBlock))
    }
}

/// The folder of all sessions: `SUPERGAUSSIAN_RUN_ROOT`, else one for this user under the system's run-time folder.
#[must_use]
pub fn run_root() -> PathBuf {
    if let Some(root) = std::env::var_os(RUN_ROOT).filter(|r| !r.is_empty()) {
        return PathBuf::from(root);
    }
    match std::env::var_os("XDG_RUNTIME_DIR").filter(|r| !r.is_empty()) {
        Some(dir) => PathBuf::from(dir).join("supergaussian"),
        None => std::env::temp_dir().join(format!("supergaussian-{}", nix::unistd::getuid())),
    }
}

/// All sessions whose supervisor lives, by name.
#[must_use]
pub fn running() -> Vec<SessionDir> {
    let Ok(entries) = std::fs::read_dir(run_root()) else { return Vec::new() };
    let mut sessions: Vec<_> = entries
        .flatten()
        .filter_map(|e| SessionDir::named(&e.file_name().to_string_lossy()).ok())
        .filter(SessionDir::is_running)
        .collect();
    sessions.sort_by(|a, b| a.name.cmp(&b.name));
    sessions
}

/// The running session of this name, or the only one that runs.
///
/// # Errors
/// [`SessionError::None`], [`SessionError::Unknown`], [`SessionError::Many`].
pub fn find(name: Option<&str>) -> Result<SessionDir, SessionError> {
    let running = running();
    let names = || running.iter().map(SessionDir::name).collect::<Vec<_>>().join(", ");
    match name {
        Some(name) => match running.iter().find(|s| s.name == name) {
            Some(session) => Ok(session.clone()),
            None if running.is_empty() => Err(SessionError::None),
            None => Err(SessionError::Unknown { name: name.to_owned(), running: names() }),
        },
        None => match running.as_slice() {
            [] => Err(SessionError::None),
            [only] => Ok(only.clone()),
            _ => Err(SessionError::Many(names())),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_would_leave_the_folder_or_break_a_key_are_refused() {
        for bad in ["", "..", "a/b", "a*", "a b", "$x", "@alive"] {
            assert!(matches!(SessionDir::named(bad), Err(SessionError::Name(_))), "{bad}");
        }
        assert!(SessionDir::named("demo-1_b").is_ok());
    }
}
