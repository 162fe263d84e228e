//! The lock of a session, and files that are valid only while it is held.

use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::time::{Duration, Instant};

use sg_input::{file, limits};
use sg_runtime::session::SessionDir;

use crate::error::StackError;
use crate::params_file;

/// How long to try the lock. A process that tests the lock holds it for a moment.
const LOCK_TIME: Duration = Duration::from_millis(300);

/// Takes the session's lock and writes this process id into it. The system releases it when this process dies.
pub(super) async fn lock(session: &SessionDir) -> Result<File, StackError> {
    let path = session.lock_file();
    let fail = |e: io::Error| StackError::io(&path, e);
    let mut file = File::options().read(true).write(true).create(true).truncate(false).open(&path).map_err(fail)?;
    let began = Instant::now();
    loop {
        match file.try_lock() {
            Ok(()) => break,
            Err(TryLockError::WouldBlock) if began.elapsed() < LOCK_TIME => {
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
            Err(TryLockError::WouldBlock) => {
                let name = session.name();
                let pid = file::read_text(&path, limits::SMALL_TEXT_BYTES).unwrap_or_default();
                return Err(StackError::SessionRuns { session: name.to_owned(), pid: pid.trim().to_owned() });
            }
            Err(TryLockError::Error(error)) => return Err(fail(error)),
        }
    }
    file.set_len(0).and_then(|()| writeln!(file, "{}", std::process::id())).map_err(fail)?;
    Ok(file)
}

/// Removes the socket, the pictures and the parameters of a session.
pub(super) fn forget(session: &SessionDir) -> Result<(), StackError> {
    let absent = |e: &io::Error| e.kind() == io::ErrorKind::NotFound;
    let socket = session.socket();
    let blobs = session.path().join("blobs");
    for (path, removed) in [(&socket, std::fs::remove_file(&socket)), (&blobs, std::fs::remove_dir_all(&blobs))] {
        if let Err(error) = removed
            && !absent(&error)
        {
            return Err(StackError::io(path, error));
        }
    }
    params_file::remove_all(session.path()).map_err(|e| StackError::io(session.path(), e))
}
