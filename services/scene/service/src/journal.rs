//! The project file: every accepted command of a scene, stored before its event is published.
//!
//! SQLite in WAL mode with `synchronous = FULL`. An accepted command makes a row of `results`, which answers its
//! repetition, and a row of `changes`: its event and the values before it. `snapshots` holds the opened state (revision 0)
//! and the newest checkpoint. Start-up replays the changes after the checkpoint. Rows carry a checksum of their content.
//!
//! A checkpoint also removes what nobody can ask for any more (`retention.rs`). So size and start-up depend on the scene
//! and on the reach of undo, not on the number of commands.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use prost::Message as _;
use rusqlite::{Connection, OpenFlags, OptionalExtension, Row};
use sg_proto::scene::{Command, CommandResult, Event};

use self::error::failure;
use self::rows::{ChangeRow, ResultRow, SnapshotRow, damaged, digest, message, revision_of, signed};
use self::schema::{APPLICATION, LASTING_TABLES, SCHEMA, TABLES};
use sg_edit::{Applied, EditState, Editor, Entry, History, stored_entry};
use sg_formats::staged_file::sync_folder;
use sg_scene::model::Scene;

mod error;
mod lock;
mod reader;
mod retention;
mod rows;
mod schema;
#[cfg(test)]
mod tests;
mod values;

pub use self::error::JournalError;
pub use self::lock::{ProjectLock, is_in_use};
pub use self::reader::{Description, copy, describe};

/// Accepted commands from one checkpoint to the next.
const CHECKPOINT_EVERY: u64 = 64;
/// Bytes of changes from one checkpoint to the next.
const CHECKPOINT_BYTES: usize = 16 << 20;
/// Time limit for a lock of another process.
const PATIENCE: Duration = Duration::from_secs(3);
/// Size that SQLite's log shrinks to after a large transaction, bytes.
const LOG_BYTES: i64 = 16 << 20;

/// The open project file.
#[derive(Debug)]
pub struct Journal {
    connection: Connection,
    path: PathBuf,
    /// Revision of the newest checkpoint.
    checkpoint: u64,
    /// Bytes of changes since.
    since: usize,
    // The last field: it is dropped after the connection.
    _lock: ProjectLock,
}

/// The stored result of an accepted command.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredResult {
    /// The result, marked as repeated.
    pub result: CommandResult,
    digest: Vec<u8>,
}

impl StoredResult {
    /// Whether it is the result of this command, with this content.
    #[must_use]
    pub fn is_of(&self, command: &Command) -> bool {
        self.digest == digest(&command.encode_to_vec())
    }
}

impl Journal {
    /// Opens or creates a project, and restores the editor after the last accepted command. A project of an older schema
    /// is brought to the present one.
    ///
    /// `opened` is the state of the scene as its files say. A project keeps the looks that the scene had when the project
    /// was made.
    ///
    /// # Errors
    /// [`JournalError`]; a file that is there is left as it is.
    pub fn open(path: &Path, scene: Arc<Scene>, opened: EditState) -> Result<(Self, Editor), JournalError> {
        let storage = |reason: std::io::Error| JournalError::Storage { path: path.into(), reason: reason.to_string() };
        let lock = ProjectLock::take(path)?;
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags).map_err(|e| failure(path, &e))?;
        let mut journal = Self { connection, path: path.into(), checkpoint: 0, since: 0, _lock: lock };
        journal.prepare().map_err(|e| failure(path, &e))?;
        let application: i64 = journal.pragma("application_id")?;
        let tables: i64 =
            journal.query("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0))?.unwrap_or_default();
        let editor = if tables == 0 && application == 0 {
            journal.create(scene, opened)?
        } else {
            journal.resume(application, scene, &opened)?
        };
        sync_folder(path).map_err(storage)?;
        Ok((journal, editor))
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Settings of the connection. Nothing is written before the file is recognized.
    fn prepare(&self) -> rusqlite::Result<()> {
        self.connection.busy_timeout(PATIENCE)?;
        self.connection.pragma_update(None, "synchronous", "FULL")?;
        self.connection.pragma_update(None, "foreign_keys", true)?;
        self.connection.pragma_update_and_check(None, "journal_size_limit", LOG_BYTES, |_| Ok(()))?;
        self.connection.set_prepared_statement_cache_capacity(16);
        Ok(())
    }

    fn pragma(&self, name: &str) -> Result<i64, JournalError> {
        self.connection.pragma_query_value(None, name, |row| row.get(0)).map_err(|e| self.failed(&e))
    }

    fn use_wal(&self) -> Result<(), JournalError> {
        let mode: String = self
            .connection
            .pragma_update_and_check(None, "journal_mode", "WAL", |row| row.get(0))
            .map_err(|e| self.failed(&e))?;
        if mode.eq_ignore_ascii_case("wal") {
            return Ok(());
        }
        let reason = format!("the file system allows no write-ahead log (journal mode {mode})");
        Err(JournalError::Storage { path: self.path.clone(), reason })
    }

    fn create(&mut self, scene: Arc<Scene>, opened: EditState) -> Result<Editor, JournalError> {
        // SQLite fixes it with the first page.
        self.connection.pragma_update(None, "auto_vacuum", "INCREMENTAL").map_err(|e| self.failed(&e))?;
        self.use_wal()?;
        let editor = Editor::new(scene, opened);
        let row = SnapshotRow::of(&editor);
        let geometry = editor.state().geometry().clone();
        // One transaction: a crash leaves a project or an empty file. The next start makes an empty file a project.
        self.transaction(|t| {
            t.execute_batch(LASTING_TABLES)?;
            t.execute_batch(TABLES)?;
            t.pragma_update(None, "application_id", APPLICATION)?;
            t.pragma_update(None, "user_version", SCHEMA)?;
            for (key, value) in [
                ("scene_path", geometry.path.as_str()),
                ("scene_hash", geometry.hash.as_str()),
                ("made_by", env!("CARGO_PKG_VERSION")),
            ] {
                t.execute("INSERT INTO meta (key, value) VALUES (?1, ?2)", [key, value])?;
            }
            row.insert(t)
        })?;
        Ok(editor)
    }

    fn resume(&mut self, application: i64, scene: Arc<Scene>, opened: &EditState) -> Result<Editor, JournalError> {
        if application != APPLICATION {
            return Err(JournalError::NotAProject { path: self.path.clone() });
        }
        let found = self.pragma("user_version")?;
        if found > SCHEMA {
            return Err(JournalError::Newer { path: self.path.clone(), found, known: SCHEMA });
        }
        if found < 1 {
            return Err(self.damaged(format!("schema {found} was never written")));
        }
        let sound: String = self.query("PRAGMA quick_check(1)", [], |row| row.get(0))?.unwrap_or_default();
        if sound != "ok" {
            return Err(self.damaged(sound));
        }
        let initial = self.initial_state(opened)?;
        // A copy comes without the log.
        self.use_wal()?;
        let newest = self.snapshot("revision = (SELECT max(revision) FROM snapshots)")?;
        let (state, undo, redo) = newest.decoded(&self.path, opened)?;
        if found < SCHEMA {
            let reached = undo.iter().chain(&redo).copied().collect();
            schema::migrate(&mut self.connection, &self.path, newest.revision, &reached)?;
        }
        self.checkpoint = newest.revision;
        let history = History::restored(self.entries(&undo)?, self.entries(&redo)?);
        let mut editor = Editor::restored(scene, initial, state, history, newest.next_unit);
        self.replay(&mut editor)?;
        self.note_scene_path(&opened.geometry().path)?;
        Ok(editor)
    }

    /// The state at revision 0, if the project is of the scene.
    fn initial_state(&self, opened: &EditState) -> Result<EditState, JournalError> {
        let of_scene: Option<String> =
            self.query("SELECT value FROM meta WHERE key = 'scene_hash'", [], |r| r.get(0))?;
        let of_scene = of_scene.ok_or_else(|| self.damaged("it does not say which scene it is of".to_owned()))?;
        let other = |reason: String| JournalError::OtherScene { path: self.path.clone(), reason };
        if of_scene != opened.geometry().hash {
            let short = |hash: &str| hash.get(..12).unwrap_or(hash).to_owned();
            let (a, b) = (short(&of_scene), short(&opened.geometry().hash));
            return Err(other(format!("geometry {a}… instead of {b}…")));
        }
        let initial = self.snapshot("revision = 0")?.decoded(&self.path, opened)?.0;
        let same_unit = initial.base_units().iter().map(|b| (&b.name, b.range()));
        if !same_unit.eq(opened.base_units().iter().map(|b| (&b.name, b.range()))) {
            return Err(other("its base units have other names".to_owned()));
        }
        if initial.geometry().bounds != opened.geometry().bounds {
            return Err(other("its box for strokes is another".to_owned()));
        }
        Ok(initial)
    }

    /// Brings an editor up to the last accepted command.
    fn replay(&mut self, editor: &mut Editor) -> Result<(), JournalError> {
        let mut last = editor.state().revision();
        loop {
            let rows = self.rows("WHERE revision > ?1 ORDER BY revision LIMIT 64", last)?;
            if rows.is_empty() {
                break;
            }
            for row in rows {
                if row.revision != last + 1 {
                    return Err(self.damaged(format!("revision {} is missing", last + 1)));
                }
                last = row.revision;
                self.since += row.change.len();
                let ((event, inverse), step) = (row.values(&self.path)?, row.history(&self.path)?);
                editor.replay(&event, &inverse.changes, step).map_err(|e| self.damaged(e.to_string()))?;
            }
        }
        let rows: Option<i64> = self.query("SELECT max(revision) FROM changes", [], |row| row.get(0))?.flatten();
        if revision_of(rows.unwrap_or(0)) < last {
            return Err(self.damaged(format!("commands behind revision {last} are missing")));
        }
        Ok(())
    }

    /// Remembers where the scene is, if it has moved.
    fn note_scene_path(&mut self, path: &str) -> Result<(), JournalError> {
        let known: Option<String> =
            self.query("SELECT value FROM meta WHERE key = 'scene_path'", [], |row| row.get(0))?;
        if known.as_deref() == Some(path) {
            return Ok(());
        }
        let sql = "INSERT OR REPLACE INTO meta (key, value) VALUES ('scene_path', ?1)";
        self.transaction(|t| t.execute(sql, [path]).map(drop))
    }

    /// The stored result of a command, if it was accepted before. Those of the last 20,000 commands are kept.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn find(&self, id: &str) -> Result<Option<StoredResult>, JournalError> {
        let found = self.query(&format!("{} WHERE id = ?1", ResultRow::SELECT), [id], ResultRow::read)?;
        let Some(row) = found else { return Ok(None) };
        let row = row.checked(&self.path)?;
        let result = message::<CommandResult>(&self.path, &row.result, row.revision)?;
        Ok(Some(StoredResult { result: CommandResult { repeated: true, ..result }, digest: row.digest }))
    }

    /// Makes an accepted command durable. When this returns without an error it survives a crash of the machine.
    ///
    /// # Errors
    /// [`JournalError`]; nothing of it is then stored.
    pub fn append(&mut self, command: &Command, applied: &Applied) -> Result<(), JournalError> {
        let result = ResultRow::of(command, &applied.result);
        let change = ChangeRow::of(applied)
            .map_err(|e| JournalError::Storage { path: self.path.clone(), reason: e.to_string() })?;
        self.transaction(|t| {
            result.insert(t)?;
            change.insert(t)
        })?;
        self.since += change.change.len();
        Ok(())
    }

    /// Stores a checkpoint after enough commands or bytes.
    ///
    /// # Errors
    /// As [`Journal::checkpoint`].
    pub fn checkpoint_if_due(&mut self, editor: &Editor) -> Result<(), JournalError> {
        let is_due = editor.state().revision() >= self.checkpoint + CHECKPOINT_EVERY || self.since >= CHECKPOINT_BYTES;
        if is_due { self.checkpoint(editor) } else { Ok(()) }
    }

    /// Stores the whole state, so that the next start is fast, and removes what nobody can ask for any more. Both happen in
    /// one transaction.
    ///
    /// # Errors
    /// [`JournalError`]; nothing is lost by that but the next start's speed.
    pub fn checkpoint(&mut self, editor: &Editor) -> Result<(), JournalError> {
        let revision = editor.state().revision();
        let row = SnapshotRow::of(editor);
        let (undo, redo) = editor.history().revisions();
        let reached: HashSet<u64> = undo.into_iter().chain(redo).collect();
        self.transaction(|t| {
            row.insert(t)?;
            t.execute("DELETE FROM snapshots WHERE revision > 0 AND revision < ?1", [signed(revision)])?;
            retention::remove_old(t, revision, &reached)
        })?;
        (self.checkpoint, self.since) = (revision, 0);
        retention::give_back_free_pages(&self.connection).map_err(|e| self.failed(&e))
    }

    /// Events after a revision, oldest first: at most `most` and, encoded, at most `bytes` together. The flag says whether
    /// these are all. There is none if the first of them is no longer kept.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn events(&self, from: u64, most: usize, bytes: usize) -> Result<(Vec<Event>, bool), JournalError> {
        let mut events = Vec::new();
        let (mut last, mut taken) = (from, 0);
        loop {
            let rows = self.rows("WHERE revision > ?1 ORDER BY revision LIMIT 16", last)?;
            if rows.is_empty() {
                return Ok((events, true));
            }
            for row in rows {
                if row.revision != last + 1 {
                    return Ok((Vec::new(), false));
                }
                let (event, _) = row.values(&self.path)?;
                taken += event.encoded_len() + 8;
                if events.len() == most || taken > bytes {
                    return Ok((events, false));
                }
                last = row.revision;
                events.push(event);
            }
        }
    }

    /// The event of the last accepted command.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn last_event(&self) -> Result<Option<Event>, JournalError> {
        let row = self.row("ORDER BY revision DESC LIMIT 1", [])?;
        row.map(|row| row.values(&self.path).map(|(event, _)| event)).transpose()
    }

    fn entries(&self, revisions: &[u64]) -> Result<Vec<Entry>, JournalError> {
        let missing = |revision| self.damaged(format!("revision {revision} is missing"));
        revisions
            .iter()
            .map(|&revision| {
                let row = self.row("WHERE revision = ?1", [signed(revision)])?.ok_or_else(|| missing(revision))?;
                let (event, inverse) = row.values(&self.path)?;
                stored_entry(&event, &inverse.changes).map_err(|e| self.damaged(e.to_string()))
            })
            .collect()
    }

    fn row(&self, clause: &str, params: impl rusqlite::Params) -> Result<Option<ChangeRow>, JournalError> {
        let found = self.query(&format!("{} {clause}", ChangeRow::SELECT), params, ChangeRow::read)?;
        found.map(|row| row.checked(&self.path)).transpose()
    }

    fn rows(&self, clause: &str, after: u64) -> Result<Vec<ChangeRow>, JournalError> {
        let all = || {
            let mut statement = self.connection.prepare_cached(&format!("{} {clause}", ChangeRow::SELECT))?;
            statement.query_map([signed(after)], ChangeRow::read)?.collect::<rusqlite::Result<Vec<_>>>()
        };
        let rows = all().map_err(|e| self.failed(&e))?;
        rows.into_iter().map(|row| row.checked(&self.path)).collect()
    }

    fn snapshot(&self, which: &str) -> Result<SnapshotRow, JournalError> {
        let sql = format!("SELECT revision, state, next_unit, undo, redo, checksum FROM snapshots WHERE {which}");
        let row = self.query(&sql, [], SnapshotRow::read)?;
        let row = row.ok_or_else(|| self.damaged("the stored state is missing".to_owned()))?;
        if row.checksum != row.sum() {
            return Err(self.damaged(format!("the stored state of revision {} has another checksum", row.revision)));
        }
        Ok(row)
    }

    fn query<T>(
        &self,
        sql: &str,
        params: impl rusqlite::Params,
        read: impl FnOnce(&Row<'_>) -> rusqlite::Result<T>,
    ) -> Result<Option<T>, JournalError> {
        let found = self.connection.prepare_cached(sql).and_then(|mut s| s.query_row(params, read).optional());
        found.map_err(|e| self.failed(&e))
    }

    fn transaction(
        &mut self,
        work: impl FnOnce(&rusqlite::Transaction<'_>) -> rusqlite::Result<()>,
    ) -> Result<(), JournalError> {
        let done = self.connection.transaction().and_then(|t| {
            work(&t)?;
            t.commit()
        });
        done.map_err(|e| self.failed(&e))
    }

    fn damaged(&self, reason: String) -> JournalError {
        damaged(&self.path, reason)
    }

    fn failed(&self, error: &rusqlite::Error) -> JournalError {
        failure(&self.path, error)
    }

    /// Lets the file grow no further than this many bytes from now on: a full disk for tests.
    #[cfg(test)]
    pub(crate) fn limit_growth(&self, bytes: i64) {
        let pages = self.pragma("page_count").unwrap() + bytes / self.pragma("page_size").unwrap();
        self.connection.pragma_update_and_check(None, "max_page_count", pages, |_| Ok(())).unwrap();
    }
}
