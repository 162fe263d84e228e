//! A stalled disk under the project, from outside of its process and without a privilege.
//!
//! Each commit to a project takes SQLite's write lock first: a lock on one byte of the log's index, the file that ends in
//! `-shm` (<https://sqlite.org/walformat.html>, "WAL Locks"). A process that holds it stalls the journal like a disk that takes
//! no write: the commit waits, and is refused after three seconds. A stall in the middle of a commit is not covered.

use std::fs::File;
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::fcntl::{FcntlArg, fcntl};
use nix::libc;

use super::stack::POLL_PERIOD;
use crate::terminal::Failure;

/// The byte of the write lock in the log's index.
const WRITE_LOCK: libc::off_t = 120;
/// Longest wait for the end of a commit that is under way.
const COMMIT_TIME: Duration = Duration::from_secs(10);

/// A stall, until it is dropped.
pub(super) struct StalledDisk {
    _index: File,
}

impl StalledDisk {
    /// Begins once no commit is under way.
    pub(super) async fn begin(project: &Path) -> Result<Self, Failure> {
        let mut path = project.as_os_str().to_owned();
        path.push("-shm");
        let fail = |e: io::Error| Failure::Work(format!("{}: {e}", path.display()));
        let index = File::options().read(true).write(true).open(&path).map_err(fail)?;
        let began = Instant::now();
        while !is_granted(&index).map_err(fail)? {
            if began.elapsed() > COMMIT_TIME {
                return Err(Failure::Work(format!("{}: its write lock is not to be had", path.display())));
            }
            tokio::time::sleep(POLL_PERIOD).await;
        }
        Ok(Self { _index: index })
    }
}

/// Asks for the write lock. It belongs to the open file and ends with it.
fn is_granted(index: &File) -> Result<bool, io::Error> {
    let kind = libc::c_short::try_from(libc::F_WRLCK).map_err(io::Error::other)?;
    let whence = libc::c_short::try_from(libc::SEEK_SET).map_err(io::Error::other)?;
    let region = libc::flock { l_type: kind, l_whence: whence, l_start: WRITE_LOCK, l_len: 1, l_pid: 0 };
    match fcntl(index, FcntlArg::F_OFD_SETLK(&region)) {
        Ok(_) => Ok(true),
        Err(Errno::EAGAIN | Errno::EACCES) => Ok(false),
        Err(error) => Err(error.into()),
    }
}
