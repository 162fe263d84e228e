//! The undo and redo stacks.

use std::collections::VecDeque;
use std::sync::Arc;

use super::change::Change;

/// Most entries of the undo stack.
pub(super) const MAX_ENTRIES: usize = 1000;
/// Most bytes of masks and steps in both stacks. Beyond it, the oldest entries are dropped. A start reads all of them.
pub(super) const MAX_BYTES: usize = 64 << 20;

/// One accepted command's values after and before.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Revision that the command made.
    pub revision: u64,
    /// One line for people.
    pub label: String,
    /// Values after it.
    pub forward: Vec<Change>,
    /// Values before it.
    pub backward: Vec<Change>,
}

impl Entry {
    /// Bytes of masks and steps, as if nothing were shared.
    fn bytes(&self) -> usize {
        let of = |change: &Change| match change {
            Change::Unit(unit) => unit.mask.len().div_ceil(8) * (1 + usize::from(unit.deleted.is_some())),
            Change::DeletedGaussians(mask) => mask.len().div_ceil(8),
            Change::Duplicates(parts) => parts.iter().map(|part| part.originals().len().div_ceil(8)).sum(),
            Change::Placements(parts) => parts.iter().map(|part| part.members.len().div_ceil(8)).sum(),
            Change::Selection(selection) => selection.bytes(),
            Change::KeptViews(views) => views.iter().map(|kept| 128 + kept.name.len()).sum(),
            Change::TransferFunction(function) => function.as_ref().map_or(0, |f| 64 * f.points.len()),
            _ => 0,
        };
        self.forward.iter().chain(&self.backward).map(of).sum()
    }
}

/// The effect of a command on the history.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HistoryMove {
    /// No entry: no value changed that undo could restore.
    Keep,
    /// Undo reaches it; redo is cleared.
    Push,
    /// It undoes this many changes.
    Undo(usize),
    /// It redoes this many changes.
    Redo(usize),
}

/// The two stacks. They follow from the accepted commands alone, so a replay makes the same ones.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct History {
    /// Oldest first.
    undo: VecDeque<Arc<Entry>>,
    /// The next entry is the last.
    redo: Vec<Arc<Entry>>,
    bytes: usize,
}

impl History {
    /// Stored stacks: `undo` oldest first, `redo` with its next entry last.
    pub fn restored(undo: Vec<Entry>, redo: Vec<Entry>) -> Self {
        let bytes = undo.iter().chain(&redo).map(Entry::bytes).sum();
        let shared = |entries: Vec<Entry>| entries.into_iter().map(Arc::new);
        Self { undo: shared(undo).collect(), redo: shared(redo).collect(), bytes }
    }

    /// The newest `n` entries that undo restores, newest first.
    pub fn undoable(&self, n: usize) -> impl Iterator<Item = &Entry> {
        self.undo.iter().rev().take(n).map(AsRef::as_ref)
    }

    /// The next `n` entries that redo restores, in this order.
    pub fn redoable(&self, n: usize) -> impl Iterator<Item = &Entry> {
        self.redo.iter().rev().take(n).map(AsRef::as_ref)
    }

    /// Revisions of both stacks, in the order of [`History::restored`].
    pub fn revisions(&self) -> (Vec<u64>, Vec<u64>) {
        (self.undo.iter().map(|e| e.revision).collect(), self.redo.iter().map(|e| e.revision).collect())
    }

    /// Carries a move out; `entry` is the command's own.
    pub fn step(&mut self, step: HistoryMove, entry: impl FnOnce() -> Entry) {
        match step {
            HistoryMove::Keep => {}
            HistoryMove::Push => {
                let entry = entry();
                let brought: usize = self.redo.drain(..).map(|e| e.bytes()).sum();
                self.bytes = self.bytes - brought + entry.bytes();
                self.undo.push_back(Arc::new(entry));
                while self.undo.len() > MAX_ENTRIES || self.bytes > MAX_BYTES {
                    let Some(oldest) = self.undo.pop_front() else { break };
                    self.bytes -= oldest.bytes();
                }
            }
            HistoryMove::Undo(n) => {
                for _ in 0..n {
                    self.redo.extend(self.undo.pop_back());
                }
            }
            HistoryMove::Redo(n) => {
                for _ in 0..n {
                    self.undo.extend(self.redo.pop());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::Selection;
    use sg_scene::mask::Mask;

    fn entry(revision: u64, gaussians: usize) -> Entry {
        let selection = Selection::new(Arc::new(Mask::empty(gaussians)), Arc::new([]));
        let forward = vec![Change::Selection(selection)];
        Entry { revision, label: String::new(), forward, backward: Vec::new() }
    }

    #[test]
    fn the_oldest_changes_go_when_there_are_too_many_or_they_are_too_large() {
        let mut history = History::default();
        for revision in 1..=MAX_ENTRIES as u64 + 5 {
            history.step(HistoryMove::Push, || entry(revision, 8));
        }
        let (undo, _) = history.revisions();
        assert_eq!((undo.len(), undo[0]), (MAX_ENTRIES, 6));

        let large = 8 * (MAX_BYTES / 4);
        let mut history = History::default();
        for revision in 1..=6 {
            history.step(HistoryMove::Push, || entry(revision, large));
        }
        assert_eq!(history.revisions().0, [3, 4, 5, 6]);
    }

    #[test]
    fn redo_restores_in_order_until_a_new_change() {
        let mut history = History::default();
        for revision in 1..=3 {
            history.step(HistoryMove::Push, || entry(revision, 8));
        }
        history.step(HistoryMove::Undo(2), || unreachable!());
        assert_eq!(history.revisions(), (vec![1], vec![3, 2]));
        history.step(HistoryMove::Redo(1), || unreachable!());
        assert_eq!(history.redoable(9).map(|e| e.revision).collect::<Vec<_>>(), [3]);
        history.step(HistoryMove::Push, || entry(9, 8));
        assert_eq!(history.revisions(), (vec![1, 2, 9], vec![]));
        assert_eq!(history.bytes, 3);
    }
}
