//! Sessions on this machine: their folders, sockets and discovery.

use std::io;
use std::os::unix::fs::{DirBuilderExt, FileTypeExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use nix::fcntl::OFlag;
use sg_proto::limits::MAX_NAME_BYTES;

use crate::bus::endpoint_of;

/// Environment variable with the folder of all sessions.
pub const RUN_ROOT: &str = "SUPERGAUSSIAN_RUN_ROOT";

/// Longest path of a unix socket on Linux, bytes.
const MAX_SOCKET_PATH: usize = 107;

/// The folder of one session, mode 0700.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionDir {
    name: String,
    path: PathBuf,
}

/// A session cannot be created or found.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The name is not valid in a key expression or path.
    #[error("session name `{0}`: use 1 to {MAX_NAME_BYTES} letters, digits, `-` or `_`")]
    InvalidName(String),
    /// The folder is unusable.
    #[error("{path}: {source}")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// Another user could read or write the folder, or it is a link.
    #[error(
        "{0} is a link, belongs to another user or is open to others; remove it or set {RUN_ROOT} to a private folder"
    )]
    NotPrivate(PathBuf),
    /// Something in the folder is neither a file, a folder nor a socket.
    #[error("{0} is {1}; a session's folder holds only files, folders and sockets: remove it")]
    Foreign(PathBuf, &'static str),
    /// The path of the socket is too long.
    #[error("{0}: too long for a socket; set {RUN_ROOT} to a shorter folder")]
    SocketPathTooLong(PathBuf),
    /// No session is running.
    #[error("no stack is running; start one with `supergaussian up FILE.toml`")]
    NoneRunning,
    /// The requested session is not running.
    #[error("no stack of session `{name}` is running; running: {running}")]
    NotRunning {
        /// Requested name.
        name: String,
        /// Running sessions, separated by commas.
        running: String,
    },
    /// Several sessions are running and none was named.
    #[error("several stacks are running: {0}; pick one with --session NAME")]
    Ambiguous(String),
}

impl SessionDir {
    /// Folder of a session by name. The folder may not exist yet.
    ///
    /// # Errors
    /// [`SessionError::InvalidName`], [`SessionError::SocketPathTooLong`].
    pub fn named(name: &str) -> Result<Self, SessionError> {
        let ok = (1..=MAX_NAME_BYTES).contains(&name.len())
            && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
        if !ok {
            return Err(SessionError::InvalidName(name.to_owned()));
        }
        let dir = Self { name: name.to_owned(), path: run_root().join(name) };
        if dir.socket().as_os_str().len() > MAX_SOCKET_PATH {
            return Err(SessionError::SocketPathTooLong(dir.socket()));
        }
        Ok(dir)
    }

    /// Folder of the processes that a joined machine runs for a session of another machine.
    ///
    /// # Errors
    /// As in [`SessionDir::named`], for the names of the session and of the machine.
    pub fn for_node(session: &str, node: &str) -> Result<Self, SessionError> {
        let (session, node) = (Self::named(session)?, Self::named(node)?);
        // A session name contains no dot, so the folder is not that of a session.
        let path = run_root().join(format!("{}.{}", session.name, node.name));
        Ok(Self { name: session.name, path })
    }

    /// Creates the folder with mode 0700, or checks an existing one: it and the folder of all sessions must belong to this
    /// user alone, and links and pipes in it are refused.
    ///
    /// # Errors
    /// [`SessionError::Folder`], [`SessionError::NotPrivate`], [`SessionError::Foreign`].
    pub fn create(&self) -> Result<(), SessionError> {
        for path in [&run_root(), &self.path] {
            let fail = |source| SessionError::Folder { path: path.clone(), source };
            std::fs::DirBuilder::new().recursive(true).mode(0o700).create(path).map_err(fail)?;
            check_private(path)?;
        }
        for folder in [self.path.clone(), self.logs(), self.path.join("blobs")] {
            check_entries(&folder)?;
        }
        Ok(())
    }

    /// Name of the session.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Path of the bus's unix socket.
    #[must_use]
    pub fn socket(&self) -> PathBuf {
        self.path.join("bus.sock")
    }

    /// Endpoint of the bus.
    #[must_use]
    pub fn endpoint(&self) -> String {
        endpoint_of(&self.socket())
    }

    /// Lock file of the supervisor. Its text is the supervisor's process id.
    #[must_use]
    pub fn lock_file(&self) -> PathBuf {
        self.path.join("supervisor.lock")
    }

    /// Folder of the services' logs.
    #[must_use]
    pub fn logs(&self) -> PathBuf {
        self.path.join("logs")
    }

    /// Whether the supervisor of this session is running.
    #[must_use]
    pub fn is_running(&self) -> bool {
        // Non-blocking: a pipe of that name must not stop the search.
        let flags = OFlag::O_NONBLOCK | OFlag::O_NOFOLLOW;
        let file = std::fs::File::options().read(true).custom_flags(flags.bits()).open(self.lock_file());
        let Ok(file) =
            file.and_then(|f| if f.metadata()?.is_file() { Ok(f) } else { Err(io::ErrorKind::Other.into()) })
        else {
            return false;
        };
        // The system releases the locks of dead processes, so a held lock means a running supervisor.
        matches!(file.try_lock_shared(), Err(std::fs::TryLockError::WouldBlock))
    }
}

/// Checks that an existing folder belongs to this user alone.
///
/// # Errors
/// [`SessionError::Folder`], [`SessionError::NotPrivate`].
pub fn check_private(folder: &Path) -> Result<(), SessionError> {
    let fail = |source| SessionError::Folder { path: folder.to_owned(), source };
    let metadata = std::fs::symlink_metadata(folder).map_err(fail)?;
    let own = metadata.uid() == nix::unistd::geteuid().as_raw();
    let private = metadata.is_dir() && own && metadata.permissions().mode() & 0o077 == 0;
    if private { Ok(()) } else { Err(SessionError::NotPrivate(folder.to_owned())) }
}

/// Checks that a folder, if it exists, holds only files, folders and sockets. A link could lead writes elsewhere, and a pipe
/// would block a reader.
fn check_entries(folder: &Path) -> Result<(), SessionError> {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let Ok(kind) = entry.file_type() else { continue };
        let what = match () {
            () if kind.is_file() || kind.is_dir() || kind.is_socket() => continue,
            () if kind.is_symlink() => "a symbolic link",
            () if kind.is_fifo() => "a named pipe",
            () => "a device",
        };
        return Err(SessionError::Foreign(entry.path(), what));
    }
    Ok(())
}

/// Folder of all sessions: `SUPERGAUSSIAN_RUN_ROOT`, else a folder of this user below the system's runtime folder.
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

/// All running sessions, sorted by name.
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

/// Finds the running session of this name, or the only running one.
///
/// # Errors
/// [`SessionError::NoneRunning`], [`SessionError::NotRunning`], [`SessionError::Ambiguous`].
pub fn find(name: Option<&str>) -> Result<SessionDir, SessionError> {
    let running = running();
    let names = || running.iter().map(SessionDir::name).collect::<Vec<_>>().join(", ");
    match name {
        Some(name) => match running.iter().find(|s| s.name == name) {
            Some(session) => Ok(session.clone()),
            None if running.is_empty() => Err(SessionError::NoneRunning),
            None => Err(SessionError::NotRunning { name: name.to_owned(), running: names() }),
        },
        None => match running.as_slice() {
            [] => Err(SessionError::NoneRunning),
            [only] => Ok(only.clone()),
            _ => Err(SessionError::Ambiguous(names())),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_with_path_or_key_characters_are_refused() {
        for bad in ["", "..", "a/b", "a*", "a b", "$x", "@alive"] {
            assert!(matches!(SessionDir::named(bad), Err(SessionError::InvalidName(_))), "{bad}");
        }
        assert!(SessionDir::named("demo-1_b").is_ok());
    }
}
