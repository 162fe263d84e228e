//! The lock of a project file: one process owns it, others may read.

use std::fs::File;
use std::io::{Error, ErrorKind};
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::fcntl::{FcntlArg, fcntl};
use nix::libc;

use super::error::JournalError;

/// How long a new owner waits for the end of the old one.
const PATIENCE: Duration = Duration::from_secs(3);
/// Pause between two attempts.
const PAUSE: Duration = Duration::from_millis(20);
/// The locked byte. SQLite locks others; on a network's file system a lock of the whole file would exclude it.
const PLACE: libc::off_t = 1 << 40;

/// The lock on a project file. The system frees it when its process dies.
///
/// It is not SQLite's own exclusive lock: a copy is made while the owner works. It has to be dropped after the database
/// connection. Its end would also end SQLite's locks on the file.
#[derive(Debug)]
pub struct ProjectLock {
    _file: File,
}

impl ProjectLock {
    /// Locks a project file, and makes an empty one if there is none. Waits a moment for a process that is ending.
    ///
    /// # Errors
    /// [`JournalError::InUse`] if a process has it; [`JournalError::NotAProject`] for anything but a file;
    /// [`JournalError::Unopenable`], [`JournalError::Full`], [`JournalError::Storage`].
    pub fn take(path: &Path) -> Result<Self, JournalError> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            if let Some(lock) = Self::attempt(path, true)? {
                return Ok(lock);
            }
            if Instant::now() >= deadline {
                return Err(JournalError::InUse { path: path.into() });
            }
            std::thread::sleep(PAUSE);
        }
    }

    /// Locks a project file that is there and that no process has.
    ///
    /// # Errors
    /// As [`ProjectLock::take`], without waiting.
    pub fn existing(path: &Path) -> Result<Self, JournalError> {
        Self::attempt(path, false)?.ok_or_else(|| JournalError::InUse { path: path.into() })
    }

    fn attempt(path: &Path, create: bool) -> Result<Option<Self>, JournalError> {
        must_be_file(path)?;
        let file = File::options().read(true).write(true).create(create).truncate(false).open(path);
        let file = file.map_err(|e| unopenable(path, &e))?;
        if !is_granted(&file, libc::F_WRLCK).map_err(|e| storage(path, &e))? {
            return Ok(None);
        }
        // Its name may have been taken away between the opening and the lock.
        let mine = file.metadata().map_err(|e| storage(path, &e))?;
        let is_named =
            std::fs::metadata(path).is_ok_and(|named| (named.dev(), named.ino()) == (mine.dev(), mine.ino()));
        Ok(is_named.then_some(Self { _file: file }))
    }
}

/// Whether another process, or another part of this one, has the project. An unreadable file counts as free.
#[must_use]
pub fn is_in_use(path: &Path) -> bool {
    let Ok(opened) = sg_input::file::open(path) else { return false };
    matches!(is_granted(&opened.file, libc::F_RDLCK), Ok(false))
}

/// Asks for a lock that belongs to the open file. It ends with it, and with the process.
fn is_granted(file: &File, kind: libc::c_int) -> Result<bool, Error> {
    let kind = libc::c_short::try_from(kind).map_err(Error::other)?;
    let whence = libc::c_short::try_from(libc::SEEK_SET).map_err(Error::other)?;
    let region = libc::flock { l_type: kind, l_whence: whence, l_start: PLACE, l_len: 1, l_pid: 0 };
    match fcntl(file, FcntlArg::F_OFD_SETLK(&region)) {
        Ok(_) => Ok(true),
        Err(Errno::EAGAIN | Errno::EACCES) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

/// Refuses folders, pipes and devices before they are opened: some of them would wait or act.
pub(super) fn must_be_file(path: &Path) -> Result<(), JournalError> {
    match std::fs::metadata(path) {
        Ok(metadata) if !metadata.is_file() => Err(JournalError::NotAProject { path: path.into() }),
        Ok(_) => Ok(()),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => Err(unopenable(path, &error)),
    }
}

fn unopenable(path: &Path, error: &Error) -> JournalError {
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => JournalError::Full { path: path.into() },
        _ => JournalError::Unopenable { path: path.into(), reason: error.to_string() },
    }
}

fn storage(path: &Path, error: &Error) -> JournalError {
    JournalError::Storage { path: path.into(), reason: error.to_string() }
}
