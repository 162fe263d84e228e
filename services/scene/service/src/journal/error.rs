//! Errors of project files.

use std::io;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use rusqlite::ErrorCode;
use sg_proto::bus::Code;

/// A project file that cannot be used, or a record that could not be made durable.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// The file is no project.
    #[error("{path}: not a Super-Gaussian project; name another file, this one is left as it is")]
    NotAProject {
        /// The file.
        path: PathBuf,
    },
    /// The file was written by a newer program.
    #[error("{path}: project schema {found} is newer than this program's {known}; update the program")]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its schema.
        found: i64,
        /// The newest schema that this program knows.
        known: i64,
    },
    /// The file is damaged.
    #[error("{path}: damaged ({reason}); restore a copy or name another project, this one is left as it is")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Place and kind of the damage.
        reason: String,
    },
    /// The project belongs to another scene.
    #[error("{path}: made for another scene ({reason}); name the project of this scene or a new file")]
    OtherScene {
        /// The file.
        path: PathBuf,
        /// The difference.
        reason: String,
    },
    /// The file can be neither opened nor made.
    #[error("{path}: {reason}; name a file in a folder that exists and can be written")]
    Unopenable {
        /// The file.
        path: PathBuf,
        /// The storage's error.
        reason: String,
    },
    /// Another process has the file.
    #[error("{path}: in use by another process; stop that one or name another project")]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// A copy would replace a file.
    #[error("{path}: exists already and is left as it is; name a new file")]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// There is no room left.
    #[error("{path}: the disk or quota is full; nothing was changed: make room and repeat the command")]
    Full {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be made, read or written.
    #[error("{path}: {reason}; nothing was changed")]
    Storage {
        /// The file.
        path: PathBuf,
        /// The storage's error.
        reason: String,
    },
}

impl JournalError {
    /// Its canonical code on the wire.
    #[must_use]
    pub fn code(&self) -> Code {
        match self {
            Self::NotAProject { .. }
            | Self::Newer { .. }
            | Self::OtherScene { .. }
            | Self::Unopenable { .. }
            | Self::Exists { .. } => Code::FailedPrecondition,
            Self::Damaged { .. } | Self::Storage { .. } => Code::DataLoss,
            Self::InUse { .. } => Code::Unavailable,
            Self::Full { .. } => Code::ResourceExhausted,
        }
    }

    /// The same error of another file: what is wrong with a copy is wrong with its original.
    #[must_use]
    pub fn at(mut self, file: &Path) -> Self {
        match &mut self {
            Self::NotAProject { path }
            | Self::Newer { path, .. }
            | Self::Damaged { path, .. }
            | Self::OtherScene { path, .. }
            | Self::Unopenable { path, .. }
            | Self::InUse { path }
            | Self::Exists { path }
            | Self::Full { path }
            | Self::Storage { path, .. } => file.clone_into(path),
        }
        self
    }

    /// Whether the file itself is the wrong one, so that trying again would not help.
    #[must_use]
    pub fn is_input(&self) -> bool {
        matches!(
            self,
            Self::NotAProject { .. }
                | Self::Newer { .. }
                | Self::Damaged { .. }
                | Self::OtherScene { .. }
                | Self::Unopenable { .. }
                | Self::Exists { .. }
        )
    }
}

/// The error behind a code of SQLite.
pub(super) fn failure(path: &Path, error: &rusqlite::Error) -> JournalError {
    let path = path.to_path_buf();
    let reason = error.to_string();
    match error.sqlite_error_code() {
        Some(ErrorCode::DiskFull) => JournalError::Full { path },
        // SQLite knows a full disk, but takes a used-up quota and a limit on the size of files for a defect.
        Some(ErrorCode::SystemIoFailure) if !has_room(&path) => JournalError::Full { path },
        Some(ErrorCode::NotADatabase) => JournalError::NotAProject { path },
        Some(ErrorCode::DatabaseCorrupt) => JournalError::Damaged { path, reason },
        Some(ErrorCode::CannotOpen | ErrorCode::PermissionDenied | ErrorCode::ReadOnly) => {
            JournalError::Unopenable { path, reason }
        }
        Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => JournalError::InUse { path },
        _ => match error {
            // Tables or columns that are not as this schema has them.
            rusqlite::Error::FromSqlConversionFailure(..)
            | rusqlite::Error::InvalidColumnType(..)
            | rusqlite::Error::IntegralValueOutOfRange(..)
            | rusqlite::Error::SqlInputError { .. } => JournalError::Damaged { path, reason },
            _ => JournalError::Storage { path, reason },
        },
    }
}

/// Whether a page could be written where the project's log would grow.
fn has_room(project: &Path) -> bool {
    const PAGE: [u8; 4096] = [0; 4096];
    let mut log = project.as_os_str().to_owned();
    log.push("-wal");
    let end = std::fs::metadata(log).map_or(0, |m| m.len());
    let folder = project.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let written = tempfile::tempfile_in(folder).and_then(|probe| probe.write_all_at(&PAGE, end));
    let full = |e: io::Error| {
        matches!(e.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge)
    };
    !written.is_err_and(full)
}
