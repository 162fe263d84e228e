//! Rows of the project file and their checksums.

use std::path::Path;

use prost::Message;
use rusqlite::{Connection, Row, params};
use sg_proto::scene::{Event, State};

use super::error::JournalError;
use sg_edit::{EditState, Editor, HistoryMove};

/// One accepted command as it is stored.
pub(super) struct CommandRow {
    pub(super) revision: u64,
    pub(super) id: String,
    pub(super) command: Vec<u8>,
    pub(super) result: Vec<u8>,
    pub(super) event: Vec<u8>,
    pub(super) inverse: Vec<u8>,
    pub(super) history: String,
    pub(super) steps: i64,
    pub(super) checksum: Vec<u8>,
}

impl CommandRow {
    pub(super) const SELECT: &str =
        "SELECT revision, id, command, result, event, inverse, history, steps, checksum FROM commands";

    pub(super) fn read(row: &Row<'_>) -> rusqlite::Result<Self> {
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

    pub(super) fn insert(&self, connection: &Connection) -> rusqlite::Result<()> {
        let sql = "INSERT INTO commands (revision, id, command, result, event, inverse, history, steps, checksum)
                   VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)";
        connection.prepare_cached(sql)?.execute(params![
            signed(self.revision),
            self.id,
            self.command,
            self.result,
            self.event,
            self.inverse,
            self.history,
            self.steps,
            self.checksum,
        ])?;
        Ok(())
    }

    pub(super) fn sum(&self) -> Vec<u8> {
        let numbers = [self.revision, self.steps.unsigned_abs()].map(u64::to_le_bytes).concat();
        let texts = [self.id.as_bytes(), self.history.as_bytes()];
        checksum(
            texts
                .into_iter()
                .chain([&numbers, &self.command, &self.result, &self.event, &self.inverse].map(Vec::as_slice)),
        )
    }

    pub(super) fn checked(self, path: &Path) -> Result<Self, JournalError> {
        if self.checksum == self.sum() {
            return Ok(self);
        }
        Err(damaged(path, format!("revision {} has another checksum", self.revision)))
    }

    pub(super) fn event(&self, path: &Path) -> Result<Event, JournalError> {
        message(path, &self.event, self.revision)
    }

    pub(super) fn inverse(&self, path: &Path) -> Result<Event, JournalError> {
        message(path, &self.inverse, self.revision)
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
        if state.count() != opened.count() || state.revision() != self.revision {
            return Err(damaged(path, format!("the stored state of revision {} is of another scene", self.revision)));
        }
        // The scene's files may have moved since.
        let state = state.with_geometry_of(opened);
        let unpacked = |bytes: &[u8]| bytes.as_chunks().0.iter().map(|c| u64::from_le_bytes(*c)).collect();
        Ok((state, unpacked(&self.undo), unpacked(&self.redo)))
    }
}

/// First half of the BLAKE3 of parts with their lengths.
fn checksum<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> Vec<u8> {
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
