//! The rows that a project keeps: bounded, however many commands it has seen.

use std::collections::HashSet;

use rusqlite::Connection;

use super::rows::{revision_of, signed};

/// Results that are kept for repeated ids: those of the last commands, this many.
pub(super) const RESULTS_KEPT: u64 = 20_000;
/// Changes that are kept for readers that missed some: the last ones, this many at most.
pub(super) const RECENT_CHANGES: u64 = 256;
/// Most bytes of these changes on disk.
const RECENT_BYTES: usize = 16 << 20;
/// Free pages that stay in the file for the next rows.
const FREE_PAGES: u64 = 256;

/// Whether the result of a revision is kept at the newest one.
pub(super) fn keeps_result(revision: u64, newest: u64) -> bool {
    revision + RESULTS_KEPT > newest
}

/// Whether the change of a revision is kept for readers, if there is room.
pub(super) fn is_recent(revision: u64, newest: u64) -> bool {
    revision + RECENT_CHANGES > newest
}

/// Removes rows without further use after a checkpoint at `newest`: old results, and changes that neither readers nor undo and
/// redo (`reached`) can ask for.
pub(super) fn remove_old(connection: &Connection, newest: u64, reached: &HashSet<u64>) -> rusqlite::Result<()> {
    let oldest = newest.saturating_sub(RESULTS_KEPT);
    connection.prepare_cached("DELETE FROM results WHERE revision <= ?1")?.execute([signed(oldest)])?;
    let mut bytes = 0_usize;
    let mut has_room = true;
    let mut old = Vec::new();
    // The length of a blob is in its row's head, so the blobs themselves are not read.
    let mut all = connection.prepare_cached("SELECT revision, length(change) FROM changes ORDER BY revision DESC")?;
    let mut rows = all.query([])?;
    while let Some(row) = rows.next()? {
        let revision = revision_of(row.get(0)?);
        bytes = usize::try_from(row.get::<_, i64>(1)?).unwrap_or(usize::MAX).saturating_add(bytes);
        // The newest one is announced again at the next start.
        has_room &= is_recent(revision, newest) && (bytes <= RECENT_BYTES || revision == newest);
        if !has_room && !reached.contains(&revision) {
            old.push(revision);
        }
    }
    let mut delete = connection.prepare_cached("DELETE FROM changes WHERE revision = ?1")?;
    for revision in old {
        delete.execute([signed(revision)])?;
    }
    Ok(())
}

/// Gives free pages back to the file system, where they are more than a quarter of the file.
pub(super) fn give_back_free_pages(connection: &Connection) -> rusqlite::Result<()> {
    let count = |name| connection.pragma_query_value(None, name, |row| row.get(0)).map(revision_of);
    let (free, all) = (count("freelist_count")?, count("page_count")?);
    let stay = FREE_PAGES.max(all / 4);
    if free > stay {
        let mut vacuum = connection.prepare(&format!("PRAGMA incremental_vacuum({})", free - stay))?;
        let mut rows = vacuum.query([])?;
        while rows.next()?.is_some() {}
    }
    Ok(())
}
