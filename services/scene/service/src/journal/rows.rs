//! Rows of the project file and their checksums.

use std::path::Path;

use prost::Message;
use rusqlite::{Connection, Row, params};
use sg_proto::scene::{Command, CommandResult, Event, State};

use super::error::JournalError;
use super::values;
use sg_edit::{Applied, EditState, Editor, HistoryMove};

/// The result of an accepted command, for its repetition.
pub(super) struct ResultRow {
    pub(super) revision: u64,
    pub(super) id: String,
    /// [`digest`] of the command.
    pub(super) digest: Vec<u8>,
    pub(super) result: Vec<u8>,
    pub(super) checksum: Vec<u8>,
}

impl ResultRow {
    pub(super) const SELECT: &str = "SELECT revision, id, digest, result, checksum FROM results";

    pub(super) fn of(command: &Command, result: &CommandResult) -> Self {
        Self::new(result.revision, command.id.clone(), digest(&command.encode_to_vec()), result.encode_to_vec())
    }

    pub(super) fn new(revision: u64, id: String, digest: Vec<u8>, result: Vec<u8>) -> Self {
        let mut row = Self { revision, id, digest, result, checksum: Vec::new() };
        row.checksum = row.sum();
        row
    }

    pub(super) fn read(row: &Row<'_>) -> rusqlite::Result<Self> {
        Ok(Self {
            revision: revision_of(row.get(0)?),
            id: row.get(1)?,
            digest: row.get(2)?,
            result: row.get(3)?,
            checksum: row.get(4)?,
        })
    }

    pub(super) fn insert(&self, connection: &Connection) -> rusqlite::Result<()> {
        let sql = "INSERT INTO results (revision, id, digest, result, checksum) VALUES (?1, ?2, ?3, ?4, ?5)";
        let values = params![signed(self.revision), self.id, self.digest, self.result, self.checksum];
        connection.prepare_cached(sql)?.execute(values)?;
        Ok(())
    }

    fn sum(&self) -> Vec<u8> {
        let revision = self.revision.to_le_bytes();
        checksum([self.id.as_bytes(), &revision, &self.digest, &self.result])
    }

    pub(super) fn checked(self, path: &Path) -> Result<Self, JournalError> {
        if self.checksum == self.sum() {
            return Ok(self);
        }
        Err(damaged(path, format!("the result of revision {} has another checksum", self.revision)))
    }
}

/// What an accepted command changed.
pub(super) struct ChangeRow {
    pub(super) revision: u64,
    /// The event and the values before it, as [`values::pack`] makes them.
    pub(super) change: Vec<u8>,
    pub(super) history: String,
    pub(super) steps: i64,
    pub(super) checksum: Vec<u8>,
}

impl ChangeRow {
    pub(super) const SELECT: &str = "SELECT revision, change, history, steps, checksum FROM changes";

    /// # Errors
    /// The compressor's error.
    pub(super) fn of(applied: &Applied) -> std::io::Result<Self> {
        let inverse = Event { changes: applied.inverse.clone(), ..Event::default() };
        let change = values::pack(&applied.event.encode_to_vec(), &inverse.encode_to_vec())?;
        let (history, steps) = match applied.history {
            HistoryMove::Keep => ("keep", 0),
            HistoryMove::Push => ("push", 0),
            HistoryMove::Undo(n) => ("undo", n),
            HistoryMove::Redo(n) => ("redo", n),
        };
        let steps = i64::try_from(steps).unwrap_or(i64::MAX);
        Ok(Self::new(applied.event.revision, change, history.to_owned(), steps))
    }

    pub(super) fn new(revision: u64, change: Vec<u8>, history: String, steps: i64) -> Self {
        let mut row = Self { revision, change, history, steps, checksum: Vec::new() };
        row.checksum = row.sum();
        row
    }

    pub(super) fn read(row: &Row<'_>) -> rusqlite::Result<Self> {
        Ok(Self {
            revision: revision_of(row.get(0)?),
            change: row.get(1)?,
            history: row.get(2)?,
            steps: row.get(3)?,
            checksum: row.get(4)?,
        })
    }

    pub(super) fn insert(&self, connection: &Connection) -> rusqlite::Result<()> {
        let sql = "INSERT INTO changes (revision, change, history, steps, checksum) VALUES (?1, ?2, ?3, ?4, ?5)";
        let values = params![signed(self.revision), self.change, self.history, self.steps, self.checksum];
        connection.prepare_cached(sql)?.execute(values)?;
        Ok(())
    }

    fn sum(&self) -> Vec<u8> {
        let numbers = [self.revision, self.steps.unsigned_abs()].map(u64::to_le_bytes).concat();
        checksum([self.history.as_bytes(), &numbers, &self.change])
    }

    pub(super) fn checked(self, path: &Path) -> Result<Self, JournalError> {
        if self.checksum == self.sum() {
            return Ok(self);
        }
        Err(damaged(path, format!("revision {} has another checksum", self.revision)))
    }

    /// The event, and the values before it in the form of an event.
    pub(super) fn values(&self, path: &Path) -> Result<(Event, Event), JournalError> {
        let torn = |reason: String| damaged(path, format!("revision {}: {reason}", self.revision));
        let (event, inverse) = values::unpack(&self.change).map_err(torn)?;
        Ok((message(path, &event, self.revision)?, message(path, &inverse, self.revision)?))
    }

    pub(super) fn history(&self, path: &Path) -> Result<HistoryMove, JournalError> {
        let steps = usize::try_from(self.steps).unwrap_or(0);
        match self.history.as_str() {
            "keep" => Ok(HistoryMove::Keep),
            "push" => Ok(HistoryMove::Push),
            "undo" => Ok(HistoryMove::Undo(steps)),
            "redo" => Ok(HistoryMove::Redo(steps)),
            other => Err(damaged(path, format!("revision {}: `{other}` is no history move", self.revision))),
        }
    }
}

/// A stored state with the editor's other data; `undo` and `redo` are revisions, little endian, one after another.
pub(super) struct SnapshotRow {
    pub(super) revision: u64,
    pub(super) state: Vec<u8>,
    pub(super) next_unit: u64,
    pub(super) undo: Vec<u8>,
    pub(super) redo: Vec<u8>,
    pub(super) checksum: Vec<u8>,
}

impl SnapshotRow {
    pub(super) fn of(editor: &Editor) -> Self {
        let packed = |revisions: Vec<u64>| revisions.into_iter().flat_map(u64::to_le_bytes).collect();
        let (undo, redo) = editor.history().revisions();
        let mut row = Self {
            revision: editor.state().revision(),
            state: editor.state().state(true).encode_to_vec(),
            next_unit: editor.next_unit(),
            undo: packed(undo),
            redo: packed(redo),
            checksum: Vec::new(),
        };
        row.checksum = row.sum();
        row
    }

    pub(super) fn read(row: &Row<'_>) -> rusqlite::Result<Self> {
        Ok(Self {
            revision: revision_of(row.get(0)?),
            state: row.get(1)?,
            next_unit: revision_of(row.get(2)?),
            undo: row.get(3)?,
            redo: row.get(4)?,
            checksum: row.get(5)?,
        })
    }

    pub(super) fn insert(&self, connection: &Connection) -> rusqlite::Result<()> {
        let sql = "INSERT OR REPLACE INTO snapshots (revision, state, next_unit, undo, redo, checksum)
                   VALUES (?1, ?2, ?3, ?4, ?5, ?6)";
        connection.prepare_cached(sql)?.execute(params![
            signed(self.revision),
            self.state,
            signed(self.next_unit),
            self.undo,
            self.redo,
            self.checksum
        ])?;
        Ok(())
    }

    pub(super) fn sum(&self) -> Vec<u8> {
        let numbers = [self.revision, self.next_unit].map(u64::to_le_bytes).concat();
        checksum([&numbers, &self.state, &self.undo, &self.redo].map(Vec::as_slice))
    }

    /// The state, and the revisions that undo and redo would move.
    pub(super) fn decoded(
        &self,
        path: &Path,
        opened: &EditState,
    ) -> Result<(EditState, Vec<u64>, Vec<u64>), JournalError> {
        let message: State = message(path, &self.state, self.revision)?;
        let state = EditState::from_snapshot(&message).map_err(|e| damaged(path, e.to_string()))?;
        if state.geometry().count != opened.geometry().count || state.revision() != self.revision {
            return Err(damaged(path, format!("the stored state of revision {} is of another scene", self.revision)));
        }
        // The scene's files may have moved since.
        let state = state.with_geometry_of(opened);
        let unpacked = |bytes: &[u8]| bytes.as_chunks().0.iter().map(|c| u64::from_le_bytes(*c)).collect();
        Ok((state, unpacked(&self.undo), unpacked(&self.redo)))
    }
}

/// First half of the BLAKE3 of a command's encoding. It tells a repeated command from another one of the same id.
pub(super) fn digest(command: &[u8]) -> Vec<u8> {
    blake3::hash(command).as_bytes().iter().take(16).copied().collect()
}

/// First half of the BLAKE3 of parts with their lengths.
pub(super) fn checksum<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> Vec<u8> {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    hasher.finalize().as_bytes().iter().take(16).copied().collect()
}

/// SQLite's integers are signed; revisions and ids count up from 0 and never reach the end.
pub(super) fn signed(n: u64) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}

pub(super) fn revision_of(n: i64) -> u64 {
    u64::try_from(n).unwrap_or(0)
}

/// A stored message.
pub(super) fn message<M: Message + Default>(path: &Path, bytes: &[u8], revision: u64) -> Result<M, JournalError> {
    M::decode(bytes).map_err(|e| damaged(path, format!("revision {revision}: {e}")))
}

/// The file differs from the written one.
pub(super) fn damaged(path: &Path, reason: String) -> JournalError {
    JournalError::Damaged { path: path.to_path_buf(), reason }
}
