//! The tables of a project file, and the way from the former schema to the present one.

use std::collections::HashSet;
use std::path::Path;

use rusqlite::{Connection, OptionalExtension, Row, Transaction};

use super::error::{JournalError, failure};
use super::rows::{ChangeRow, ResultRow, checksum, damaged, digest, revision_of, signed};
use super::{retention, values};

/// Version of the tables, in SQLite's `user_version`.
///
/// 1: one row for each command, kept for ever. 2: results and changes apart, both bounded.
pub(super) const SCHEMA: i64 = 2;
/// Marks a project file, in SQLite's `application_id`: `SGPJ`.
pub(super) const APPLICATION: i64 = 0x5347_504a;

/// Tables that no schema has changed.
pub(super) const LASTING_TABLES: &str = "
    CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT, WITHOUT ROWID;
    CREATE TABLE snapshots (
        revision INTEGER PRIMARY KEY,
        state BLOB NOT NULL,
        next_unit INTEGER NOT NULL,
        undo BLOB NOT NULL,
        redo BLOB NOT NULL,
        checksum BLOB NOT NULL
    ) STRICT;
";

/// Tables of schema 2.
pub(super) const TABLES: &str = "
    CREATE TABLE results (
        revision INTEGER PRIMARY KEY,
        id TEXT NOT NULL UNIQUE,
        digest BLOB NOT NULL,
        result BLOB NOT NULL,
        checksum BLOB NOT NULL
    ) STRICT;
    CREATE TABLE changes (
        revision INTEGER PRIMARY KEY,
        change BLOB NOT NULL,
        history TEXT NOT NULL,
        steps INTEGER NOT NULL,
        checksum BLOB NOT NULL
    ) STRICT;
";

/// One command in schema 1.
struct OldRow {
    revision: u64,
    id: String,
    command: Vec<u8>,
    result: Vec<u8>,
    event: Vec<u8>,
    inverse: Vec<u8>,
    history: String,
    steps: i64,
    checksum: Vec<u8>,
}

impl OldRow {
    const SELECT: &str = "SELECT revision, id, command, result, event, inverse, history, steps, checksum FROM commands
                          WHERE revision = ?1";

    fn read(row: &Row<'_>) -> rusqlite::Result<Self> {
        Ok(Self {
            revision: revision_of(row.get(0)?),
            id: row.get(1)?,
            command: row.get(2)?,
            result: row.get(3)?,
            event: row.get(4)?,
            inverse: row.get(5)?,
            history: row.get(6)?,
            steps: row.get(7)?,
            checksum: row.get(8)?,
        })
    }

    fn is_whole(&self) -> bool {
        let numbers = [self.revision, self.steps.unsigned_abs()].map(u64::to_le_bytes).concat();
        let texts = [self.id.as_bytes(), self.history.as_bytes()];
        let blobs = [&numbers, &self.command, &self.result, &self.event, &self.inverse].map(Vec::as_slice);
        self.checksum == checksum(texts.into_iter().chain(blobs))
    }
}

/// Turns a project of schema 1 into one of schema 2, whole or not at all.
///
/// `checkpoint` is the revision of the newest stored state, `reached` holds the revisions that its undo and redo reach.
pub(super) fn migrate(
    connection: &mut Connection,
    path: &Path,
    checkpoint: u64,
    reached: &HashSet<u64>,
) -> Result<(), JournalError> {
    let failed = |e: rusqlite::Error| failure(path, &e);
    let transaction = connection.transaction().map_err(failed)?;
    transaction.execute_batch(TABLES).map_err(failed)?;
    let newest = transaction.query_row("SELECT max(revision) FROM commands", [], |row| row.get::<_, Option<i64>>(0));
    let newest = newest.map_err(failed)?.map_or(0, revision_of);
    let revisions = transaction.prepare("SELECT revision FROM commands ORDER BY revision").and_then(|mut all| {
        all.query_map([], |row| Ok(revision_of(row.get(0)?)))?.collect::<rusqlite::Result<Vec<u64>>>()
    });
    for revision in revisions.map_err(failed)? {
        let keeps_change =
            revision > checkpoint || reached.contains(&revision) || retention::is_recent(revision, newest);
        let keeps_result = retention::keeps_result(revision, newest);
        if keeps_change || keeps_result {
            carry_over(&transaction, path, revision, keeps_change, keeps_result)?;
        }
    }
    let finish = || {
        transaction.execute_batch("DROP TABLE commands")?;
        transaction.pragma_update(None, "user_version", SCHEMA)
    };
    finish().map_err(failed)?;
    transaction.commit().map_err(failed)?;
    // Without room for a second copy the file only stays larger than it has to be.
    let shrunk = connection.execute_batch("PRAGMA auto_vacuum = INCREMENTAL; VACUUM");
    if let Err(error) = shrunk {
        tracing::warn!(project = %path.display(), %error, "the project could not be made smaller");
    }
    Ok(())
}

fn carry_over(
    transaction: &Transaction<'_>,
    path: &Path,
    revision: u64,
    keeps_change: bool,
    keeps_result: bool,
) -> Result<(), JournalError> {
    let failed = |e: rusqlite::Error| failure(path, &e);
    let found = transaction.prepare_cached(OldRow::SELECT);
    let row = found.and_then(|mut s| s.query_row([signed(revision)], OldRow::read).optional()).map_err(failed)?;
    let row = row.filter(OldRow::is_whole);
    let row = row.ok_or_else(|| damaged(path, format!("revision {revision} has another checksum")))?;
    if keeps_result {
        let row = ResultRow::new(revision, row.id, digest(&row.command), row.result);
        row.insert(transaction).map_err(failed)?;
    }
    if keeps_change {
        let change = values::pack(&row.event, &row.inverse);
        let change = change.map_err(|e| JournalError::Storage { path: path.into(), reason: e.to_string() })?;
        ChangeRow::new(revision, change, row.history, row.steps).insert(transaction).map_err(failed)?;
    }
    Ok(())
}
