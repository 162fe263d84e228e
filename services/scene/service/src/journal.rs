//! The project file: every accepted command of a scene, stored before its event is published.
//!
//! SQLite in WAL mode with `synchronous = FULL`. A row of `commands` is one accepted command with its result, its event
//! and the values before it. `snapshots` holds the opened state (revision 0) and the newest checkpoint. Start-up
//! replays the rows after the checkpoint. Rows carry a checksum of their content. The file is locked while it is open.
//! The system frees it when its process dies.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use prost::Message as _;
use rusqlite::{Connection, OpenFlags, OptionalExtension, Row};
use sg_proto::scene::{Command, CommandResult, Event};

use self::error::failure;
use self::rows::{CommandRow, SnapshotRow, damaged, message, revision_of, signed};
use sg_edit::{Applied, EditState, Editor, Entry, History, HistoryMove, stored_entry};
use sg_formats::staged_file::sync_folder;
use sg_scene::model::Scene;

mod error;
mod rows;
#[cfg(test)]
mod tests;

pub use self::error::JournalError;

/// Version of the tables, in SQLite's `user_version`.
const SCHEMA: i64 = 1;
/// Marks a project file, in SQLite's `application_id`: `SGPJ`.
const APPLICATION: i64 = 0x5347_504a;
/// Accepted commands from one checkpoint to the next.
const CHECKPOINT_EVERY: u64 = 64;
/// Time limit for a lock of another process.
const PATIENCE: Duration = Duration::from_secs(3);

const TABLES: &str = "
    CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT, WITHOUT ROWID;
    CREATE TABLE commands (
        revision INTEGER PRIMARY KEY,
        id TEXT NOT NULL UNIQUE,
        command BLOB NOT NULL,
        result BLOB NOT NULL,
        event BLOB NOT NULL,
        inverse BLOB NOT NULL,
        history TEXT NOT NULL,
        steps INTEGER NOT NULL,
        checksum BLOB NOT NULL
    ) STRICT;
    CREATE TABLE snapshots (
        revision INTEGER PRIMARY KEY,
        state BLOB NOT NULL,
        next_unit INTEGER NOT NULL,
        undo BLOB NOT NULL,
        redo BLOB NOT NULL,
        checksum BLOB NOT NULL
    ) STRICT;
";

/// The open project file.
#[derive(Debug)]
pub struct Journal {
    connection: Connection,
    path: PathBuf,
    checkpoint: u64,
}

impl Journal {
    /// Opens or creates a project, and restores the editor after the last accepted command.
    ///
    /// `opened` is the state of the scene as its files say. A project keeps the looks that the scene had when the project
    /// was made.
    ///
    /// # Errors
    /// [`JournalError`]; a file that is there is left as it is.
    pub fn open(path: &Path, scene: Arc<Scene>, opened: EditState) -> Result<(Self, Editor), JournalError> {
        let storage = |reason: std::io::Error| JournalError::Storage { path: path.into(), reason: reason.to_string() };
        match std::fs::metadata(path) {
            Ok(metadata) if !metadata.is_file() => return Err(JournalError::NotAProject { path: path.into() }),
            Ok(_) => {}
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => return Err(storage(error)),
        }
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_CREATE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags).map_err(|e| failure(path, &e))?;
        let mut journal = Self { connection, path: path.into(), checkpoint: 0 };
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

    /// Settings of the connection. Nothing is written before the file is recognized. The lock and the journal mode come
    /// first, because SQLite fixes them at the first access.
    fn prepare(&self) -> rusqlite::Result<()> {
        self.connection.busy_timeout(PATIENCE)?;
        self.connection.pragma_update(None, "locking_mode", "EXCLUSIVE")?;
        self.connection.pragma_update(None, "synchronous", "FULL")?;
        self.connection.pragma_update(None, "foreign_keys", true)?;
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
        self.use_wal()?;
        let editor = Editor::new(scene, opened);
        let row = SnapshotRow::of(&editor);
        let geometry = editor.state().geometry().clone();
        // One transaction: a crash leaves a project or an empty file. The next start makes an empty file a project.
        self.transaction(|t| {
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
        if found != SCHEMA {
            return Err(self.damaged(format!("schema {found} was never written")));
        }
        self.use_wal()?;
        let sound: String = self.query("PRAGMA quick_check(1)", [], |row| row.get(0))?.unwrap_or_default();
        if sound != "ok" {
            return Err(self.damaged(sound));
        }
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
        let newest = self.snapshot("revision = (SELECT max(revision) FROM snapshots)")?;
        self.checkpoint = newest.revision;
        let (state, undo, redo) = newest.decoded(&self.path, opened)?;
        let history = History::restored(self.entries(&undo, opened)?, self.entries(&redo, opened)?);
        let mut editor = Editor::restored(scene, initial, state, history, newest.next_unit);
        self.replay(&mut editor)?;
        Ok(editor)
    }

    /// Brings an editor up to the last accepted command.
    fn replay(&self, editor: &mut Editor) -> Result<(), JournalError> {
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
                let (event, inverse, step) =
                    (row.event(&self.path)?, row.inverse(&self.path)?, row.history(&self.path)?);
                editor.replay(&event, &inverse.changes, step).map_err(|e| self.damaged(e.to_string()))?;
            }
        }
        let rows: Option<i64> = self.query("SELECT max(revision) FROM commands", [], |row| row.get(0))?.flatten();
        if revision_of(rows.unwrap_or(0)) < last {
            return Err(self.damaged(format!("commands behind revision {last} are missing")));
        }
        Ok(())
    }

    /// The stored result of a command, if it was accepted before.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn find(&self, id: &str) -> Result<Option<CommandResult>, JournalError> {
        let Some(row) = self.row("WHERE id = ?1", [id])? else { return Ok(None) };
        message::<CommandResult>(&self.path, &row.result, row.revision)
            .map(|r| Some(CommandResult { repeated: true, ..r }))
    }

    /// Makes an accepted command durable. When this returns without an error it survives a crash of the machine.
    ///
    /// # Errors
    /// [`JournalError`]; nothing of it is then stored.
    pub fn append(&mut self, command: &Command, applied: &Applied) -> Result<(), JournalError> {
        let inverse = Event { changes: applied.inverse.clone(), ..Event::default() };
        let (history, steps) = match applied.history {
            HistoryMove::Keep => ("keep", 0),
            HistoryMove::Push => ("push", 0),
            HistoryMove::Undo(n) => ("undo", n),
            HistoryMove::Redo(n) => ("redo", n),
        };
        let mut row = CommandRow {
            revision: applied.event.revision,
            id: command.id.clone(),
            command: command.encode_to_vec(),
            result: applied.result.encode_to_vec(),
            event: applied.event.encode_to_vec(),
            inverse: inverse.encode_to_vec(),
            history: history.to_owned(),
            steps: i64::try_from(steps).unwrap_or(i64::MAX),
            checksum: Vec::new(),
        };
        row.checksum = row.sum();
        self.transaction(|t| row.insert(t))
    }

    /// Stores a checkpoint after enough commands, so that the next start is fast.
    ///
    /// # Errors
    /// [`JournalError`]; nothing is lost by that but the next start's speed.
    pub fn checkpoint_if_due(&mut self, editor: &Editor) -> Result<(), JournalError> {
        let revision = editor.state().revision();
        if revision < self.checkpoint + CHECKPOINT_EVERY {
            return Ok(());
        }
        let row = SnapshotRow::of(editor);
        self.transaction(|t| {
            row.insert(t)?;
            t.execute("DELETE FROM snapshots WHERE revision > 0 AND revision < ?1", [signed(revision)])?;
            Ok(())
        })?;
        self.checkpoint = revision;
        Ok(())
    }

    /// Events after a revision, oldest first: at most `most` and, encoded, at most `bytes` together. The flag says whether
    /// these are all.
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
                taken += row.event.len() + 8;
                if events.len() == most || taken > bytes {
                    return Ok((events, false));
                }
                last = row.revision;
                events.push(row.event(&self.path)?);
            }
        }
    }

    /// The event of the last accepted command.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn last_event(&self) -> Result<Option<Event>, JournalError> {
        let row = self.row("ORDER BY revision DESC LIMIT 1", [])?;
        row.map(|row| row.event(&self.path)).transpose()
    }

    fn entries(&self, revisions: &[u64], opened: &EditState) -> Result<Vec<Entry>, JournalError> {
        let missing = |revision| self.damaged(format!("revision {revision} is missing"));
        revisions
            .iter()
            .map(|&revision| {
                let row = self.row("WHERE revision = ?1", [signed(revision)])?.ok_or_else(|| missing(revision))?;
                let (event, inverse) = (row.event(&self.path)?, row.inverse(&self.path)?);
                stored_entry(&event, &inverse.changes, opened.count()).map_err(|e| self.damaged(e.to_string()))
            })
            .collect()
    }

    fn row(&self, clause: &str, params: impl rusqlite::Params) -> Result<Option<CommandRow>, JournalError> {
        let found = self.query(&format!("{} {clause}", CommandRow::SELECT), params, CommandRow::read)?;
        found.map(|row| row.checked(&self.path)).transpose()
    }

    fn rows(&self, clause: &str, after: u64) -> Result<Vec<CommandRow>, JournalError> {
        let all = || {
            let mut statement = self.connection.prepare_cached(&format!("{} {clause}", CommandRow::SELECT))?;
            statement.query_map([signed(after)], CommandRow::read)?.collect::<rusqlite::Result<Vec<_>>>()
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
