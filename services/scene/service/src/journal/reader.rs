//! Reading a project without owning it: its description, and a copy of it.

use std::path::{Path, PathBuf};
use std::time::Duration;

use rusqlite::config::DbConfig;
use rusqlite::{Connection, OpenFlags, OptionalExtension};
use sg_formats::staged_file::sync_folder;

use super::error::{JournalError, failure};
use super::lock::must_be_file;
use super::rows::{damaged, revision_of};
use super::schema::{APPLICATION, SCHEMA};

/// Time limit for a lock of the owner.
const PATIENCE: Duration = Duration::from_secs(3);

/// What a project says about itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Description {
    /// Path of the scene's file when the project was last opened.
    pub scene: PathBuf,
    /// Number of accepted commands.
    pub revision: u64,
}

/// Reads the description of a project, also while a process has it.
///
/// # Errors
/// [`JournalError`]; the file stays as it is.
pub fn describe(path: &Path) -> Result<Description, JournalError> {
    let (connection, schema) = open(path)?;
    let failed = |e: rusqlite::Error| failure(path, &e);
    let scene =
        connection.query_row("SELECT value FROM meta WHERE key = 'scene_path'", [], |row| row.get(0)).optional();
    let scene: Option<String> = scene.map_err(failed)?;
    let scene = scene.ok_or_else(|| damaged(path, "it does not say which scene it is of".to_owned()))?;
    let newest = if schema == 1 { "SELECT max(revision) FROM commands" } else { "SELECT max(revision) FROM changes" };
    let revision = connection.query_row(newest, [], |row| row.get::<_, Option<i64>>(0)).map_err(failed)?;
    Ok(Description { scene: scene.into(), revision: revision.map_or(0, revision_of) })
}

/// Copies a project to a new file, also while a process has it: all commands that were accepted before the copy began.
///
/// # Errors
/// [`JournalError`]. [`JournalError::Exists`] if there is a file of the copy's name; it stays as it is.
pub fn copy(project: &Path, copy: &Path) -> Result<(), JournalError> {
    let failed = |e: rusqlite::Error| failure(copy, &e);
    let storage = |e: std::io::Error| JournalError::Storage { path: copy.into(), reason: e.to_string() };
    let unopenable = |reason: String| JournalError::Unopenable { path: copy.into(), reason };
    if std::fs::symlink_metadata(copy).is_ok() {
        return Err(JournalError::Exists { path: copy.into() });
    }
    let (connection, _) = open(project)?;
    let folder = copy.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let staged = tempfile::Builder::new().prefix(".staged-").tempfile_in(folder);
    let staged = staged.map_err(|e| unopenable(e.to_string()))?;
    // SQLite's copy of a live database: one consistent state, whole pages, no free ones.
    let name = staged.path().to_str().ok_or_else(|| unopenable("its name is not UTF-8".to_owned()))?;
    connection.execute("VACUUM INTO ?1", [name]).map_err(failed)?;
    let check = Connection::open_with_flags(staged.path(), OpenFlags::SQLITE_OPEN_READ_ONLY).map_err(failed)?;
    let sound: String = check.query_row("PRAGMA quick_check(1)", [], |row| row.get(0)).map_err(failed)?;
    drop(check);
    if sound != "ok" {
        return Err(damaged(project, sound));
    }
    // SQLite does not wait for the disk here.
    sg_input::file::open(staged.path()).and_then(|opened| opened.file.sync_all()).map_err(storage)?;
    match staged.persist_noclobber(copy) {
        Ok(_) => sync_folder(copy).map_err(storage),
        Err(error) if error.error.kind() == std::io::ErrorKind::AlreadyExists => {
            Err(JournalError::Exists { path: copy.into() })
        }
        Err(error) => Err(storage(error.error)),
    }
}

/// A connection that reads, and the schema. It leaves an owner's files and those of a dead owner as they are.
fn open(path: &Path) -> Result<(Connection, i64), JournalError> {
    let failed = |e: rusqlite::Error| failure(path, &e);
    must_be_file(path)?;
    let connection =
        Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX);
    let connection = connection.map_err(failed)?;
    connection.busy_timeout(PATIENCE).map_err(failed)?;
    // The last connection that closes would move the log into the file. That is the owner's work.
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    let has_log = std::fs::metadata(log).is_ok_and(|log| log.len() > 0);
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, has_log).map_err(failed)?;
    let number = |name| connection.pragma_query_value(None, name, |row| row.get::<_, i64>(0)).map_err(failed);
    if number("application_id")? != APPLICATION {
        return Err(JournalError::NotAProject { path: path.into() });
    }
    match number("user_version")? {
        found @ 1..=SCHEMA => Ok((connection, found)),
        found if found > SCHEMA => Err(JournalError::Newer { path: path.into(), found, known: SCHEMA }),
        found => Err(damaged(path, format!("schema {found} was never written"))),
    }
}
