//! The owner of the state: applies commands in order.

use std::sync::Arc;

use prost::Message as _;
use sg_proto::limits::{MAX_MESSAGE_BYTES, MAX_NAME_BYTES};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Change as ChangeMessage, Command, CommandResult, Event, State};

use super::change::Change;
use super::error::EditError;
use super::history::{Entry, History, HistoryMove};
use super::placed_scene::PlacedScene;
use super::replica::ReplicaError;
use super::state::EditState;
use super::transaction::{Transaction, affected_units};
use super::wire::{decode_change, encode_change};
use sg_scene::model::Scene;

/// Lines of undo and redo that a state message carries.
const HISTORY_LINES: usize = 20;

/// The scene's state with what is needed to change it. Deterministic: the same commands make the same states, ids and
/// summaries everywhere.
#[derive(Debug, Clone)]
pub struct Editor {
    scene: PlacedScene,
    initial: EditState,
    state: EditState,
    history: History,
    next_unit: u64,
}

/// The effect of an accepted command.
#[derive(Debug, Clone, PartialEq)]
pub struct Applied {
    /// Every value that changed, as it stands after the command.
    pub event: Event,
    /// The same values as they stood before, in the form of an event's changes.
    pub inverse: Vec<ChangeMessage>,
    /// The result for the sender.
    pub result: CommandResult,
    /// Its effect on the history.
    pub history: HistoryMove,
}

impl EditState {
    /// This state after an action, for a display that previews a change. `scene` is the present one, with Gaussians where this
    /// state has them. Without a history, undo and redo are refused and reset changes nothing.
    ///
    /// # Errors
    /// [`EditError`] as the scene's owner would refuse the action.
    pub fn after(&self, scene: &Arc<Scene>, action: Action) -> Result<Self, EditError> {
        let next_unit = self.units.keys().next_back().map_or(1, |last| last + 1);
        let shown = PlacedScene::shown(Arc::clone(scene), self);
        let editor = Editor { next_unit, scene: shown, ..Editor::new(Arc::clone(scene), self.clone()) };
        let command = Command { id: "draft".to_owned(), expected_revision: 0, action: Some(action) };
        Ok(editor.execute(&command)?.0)
    }
}

impl Editor {
    /// The owner of a state as a scene is opened; `initial` is [`EditState::of_scene`] of it.
    #[must_use]
    pub fn new(scene: Arc<Scene>, initial: EditState) -> Self {
        let scene = PlacedScene::new(scene);
        Self { scene, state: initial.clone(), initial, history: History::default(), next_unit: 1 }
    }

    /// The owner of a state as it was stored.
    pub fn restored(scene: Arc<Scene>, initial: EditState, state: EditState, history: History, next_unit: u64) -> Self {
        Self { scene: PlacedScene::new(scene), initial, state, history, next_unit }
    }

    /// The present state.
    #[must_use]
    pub fn state(&self) -> &EditState {
        &self.state
    }

    /// The scene with Gaussians where the present state has them.
    pub(super) fn scene(&self) -> Arc<Scene> {
        self.scene.of(&self.state)
    }

    /// The state as it was when the scene was opened.
    #[must_use]
    pub fn initial(&self) -> &EditState {
        &self.initial
    }

    /// Entries that undo and redo reach.
    #[must_use]
    pub fn history(&self) -> &History {
        &self.history
    }

    /// Id that the next editable unit gets.
    #[must_use]
    pub fn next_unit(&self) -> u64 {
        self.next_unit
    }

    /// The present state as a message, with the labels of undo and redo.
    #[must_use]
    pub fn message(&self, with_masks: bool) -> State {
        let lines = |entries: &mut dyn Iterator<Item = &Entry>| entries.map(|e| e.label.clone()).collect();
        State {
            undo: lines(&mut self.history.undoable(HISTORY_LINES)),
            redo: lines(&mut self.history.redoable(HISTORY_LINES)),
            ..self.state.state(with_masks)
        }
    }

    /// Applies a command, or refuses it and changes nothing.
    ///
    /// Ids are not stored here: the caller detects repeated commands.
    ///
    /// # Errors
    /// [`EditError`].
    pub fn apply(&mut self, command: &Command) -> Result<Applied, EditError> {
        self.apply_with(command, |_| Ok(()))
    }

    /// As [`Editor::apply`], but the change takes place only if `keep` has made it durable.
    ///
    /// # Errors
    /// [`EditError`] or the error of `keep`. Nothing has changed then.
    pub fn apply_with<E: From<EditError>>(
        &mut self,
        command: &Command,
        keep: impl FnOnce(&Applied) -> Result<(), E>,
    ) -> Result<Applied, E> {
        let (next, applied, entry) = self.execute(command)?;
        keep(&applied)?;
        self.next_unit = next_unit(self.next_unit, &entry.forward);
        self.state = next;
        self.history.step(applied.history, || entry);
        Ok(applied)
    }

    /// Replays a stored command.
    pub fn replay(&mut self, event: &Event, inverse: &[ChangeMessage], step: HistoryMove) -> Result<(), ReplicaError> {
        let entry = stored_entry(event, inverse)?;
        self.state.apply_event(event)?;
        self.next_unit = next_unit(self.next_unit, &entry.forward);
        self.history.step(step, || entry);
        Ok(())
    }

    fn execute(&self, command: &Command) -> Result<(EditState, Applied, Entry), EditError> {
        check_id(&command.id)?;
        let found = self.state.revision;
        if command.expected_revision != 0 && command.expected_revision != found {
            return Err(EditError::RevisionConflict { expected: command.expected_revision, found });
        }
        let missing =
            || EditError::Malformed { field: "action", reason: "the command does nothing; set one".to_owned() };
        let (mut next, step, summary) = match command.action.as_ref().ok_or_else(missing)? {
            Action::Undo(undo) => self.undone(undo.steps.max(1) as usize)?,
            Action::Redo(redo) => self.redone(redo.steps.max(1) as usize)?,
            action => self.run_transaction(action)?,
        };
        let (before, after) = (snapshot_bytes(&self.state), snapshot_bytes(&next));
        if after > MAX_MESSAGE_BYTES && after > before {
            return Err(EditError::TooLarge {
                what: "the scene's masks and steps of selection",
                bytes: after,
                limit: MAX_MESSAGE_BYTES,
            });
        }
        let revision = found + 1;
        next.revision = revision;
        let forward = self.state.changes_to(&next);
        let backward = next.changes_to(&self.state);
        let event = Event {
            revision,
            command_id: command.id.clone(),
            summary: summary.clone(),
            changes: forward.iter().map(encode_change).collect(),
        };
        let bytes = event.encoded_len();
        if bytes > MAX_MESSAGE_BYTES {
            return Err(EditError::TooLarge { what: "the change", bytes, limit: MAX_MESSAGE_BYTES });
        }
        let result = CommandResult {
            id: command.id.clone(),
            revision,
            summary: summary.clone(),
            repeated: false,
            units: affected_units(&forward, &self.state),
            selection_hash: next.selection.hash().to_owned(),
        };
        let inverse = backward.iter().map(encode_change).collect();
        let entry = Entry { revision, label: summary, forward, backward };
        Ok((next, Applied { event, inverse, result, history: step }, entry))
    }

    fn run_transaction(&self, action: &Action) -> Result<(EditState, HistoryMove, String), EditError> {
        let mut transaction = Transaction {
            scene: &self.scene,
            initial: &self.initial,
            state: self.state.clone(),
            next_unit: self.next_unit,
        };
        let summary = match action {
            Action::SetColor(a) => transaction.set_color(a)?,
            Action::SetOpacity(a) => transaction.set_opacity(a)?,
            Action::SetVisibility(a) => transaction.set_visibility(a)?,
            Action::ShowOnly(a) => transaction.show_only(a)?,
            Action::SetLight(a) => transaction.set_light(a)?,
            Action::SetBackground(a) => transaction.set_background(a)?,
            Action::SetTerm(a) => transaction.set_term(a)?,
            Action::SetView(a) => transaction.set_view(a)?,
            Action::KeepView(a) => transaction.keep_view(a)?,
            Action::ForgetView(a) => transaction.forget_view(a)?,
            Action::CommitSelection(a) => transaction.commit_selection(a)?,
            Action::Select(a) => transaction.select(a)?,
            Action::SaveUnit(a) => transaction.save_unit(a)?,
            Action::DeleteUnit(a) => transaction.delete_unit(a)?,
            Action::RenameUnit(a) => transaction.rename_unit(a)?,
            Action::DeleteGaussians(a) => transaction.delete_gaussians(a)?,
            Action::SetLock(a) => transaction.set_lock(a)?,
            Action::RestoreGaussians(_) => transaction.restore_gaussians()?,
            Action::TransformGaussians(a) => transaction.transform_gaussians(a)?,
            Action::MergeUnits(a) => transaction.merge_units(a)?,
            Action::SetTone(a) => transaction.set_tone(a)?,
            Action::DuplicateGaussians(a) => transaction.duplicate_gaussians(a)?,
            Action::SetTransferFunction(a) => transaction.set_transfer_function(a)?,
            Action::AdjustTransferFunction(a) => transaction.adjust_transfer_function(a)?,
            Action::Reset(_) => transaction.reset(),
            // Carried out on the history by the caller.
            Action::Undo(_) | Action::Redo(_) => String::new(),
        };
        transaction.prune();
        let next = transaction.state;
        // A command that only names its target is nothing that a person would want to take back.
        let changed = self.state.changes_to(&next).iter().any(|c| !matches!(c, Change::Focus(_)));
        Ok((next, if changed { HistoryMove::Push } else { HistoryMove::Keep }, summary))
    }

    fn undone(&self, steps: usize) -> Result<(EditState, HistoryMove, String), EditError> {
        let entries: Vec<_> = self.history.undoable(steps).collect();
        let next = self.with_values(entries.iter().flat_map(|e| &e.backward));
        let summary = match entries.as_slice() {
            [] => return Err(EditError::NothingToUndo),
            [entry] => format!("undid: {}", entry.label),
            many => format!("undid {} changes", many.len()),
        };
        Ok((next?, HistoryMove::Undo(entries.len()), summary))
    }

    fn redone(&self, steps: usize) -> Result<(EditState, HistoryMove, String), EditError> {
        let entries: Vec<_> = self.history.redoable(steps).collect();
        let next = self.with_values(entries.iter().flat_map(|e| &e.forward));
        let summary = match entries.as_slice() {
            [] => return Err(EditError::NothingToRedo),
            [entry] => format!("redid: {}", entry.label),
            many => format!("redid {} changes", many.len()),
        };
        Ok((next?, HistoryMove::Redo(entries.len()), summary))
    }

    fn with_values<'a>(&self, values: impl Iterator<Item = &'a Change>) -> Result<EditState, EditError> {
        let mut next = self.state.clone();
        for value in values {
            let mismatch =
                |m: super::change::StateMismatch| EditError::Malformed { field: "history", reason: m.to_string() };
            next.apply_change(value.clone()).map_err(mismatch)?;
        }
        // Commands that only changed the focus have no entry, so a later entry may not clear what an earlier one sets.
        next.prune_focus();
        Ok(next)
    }
}

/// At least as many bytes as a snapshot takes: readers must be able to get one.
fn snapshot_bytes(state: &EditState) -> usize {
    let mask = state.count().div_ceil(8) + 64;
    let names: usize = state.names().map(|(name, _)| name.len() + 128).sum();
    let deleted = usize::from(!state.deleted.is_none()) + state.units().filter(|u| u.deleted.is_some()).count();
    mask * (state.units.len() + deleted + state.placements.len() + state.duplicates.len())
        + 64
        + state.selection.bytes()
        + names
        + 128 * state.placements.len()
        + 64 * state.transfer_function.as_ref().map_or(0, |function| function.points.len())
        + state.kept_views.iter().map(|kept| 128 + kept.name.len()).sum::<usize>()
        + state.geometry.path.len()
        + (64 << 10)
}

/// Whether an id can name a command: not empty, at most 128 bytes.
///
/// # Errors
/// [`EditError::Malformed`].
pub fn check_id(id: &str) -> Result<(), EditError> {
    if id.is_empty() || id.len() > MAX_NAME_BYTES {
        let reason = format!("an id has 1 to {MAX_NAME_BYTES} bytes, unique to the change; this has {}", id.len());
        return Err(EditError::Malformed { field: "id", reason });
    }
    Ok(())
}

/// A history entry from the stored form of a command.
pub fn stored_entry(event: &Event, inverse: &[ChangeMessage]) -> Result<Entry, ReplicaError> {
    let revision = event.revision;
    let decoded = |changes: &[ChangeMessage]| {
        changes
            .iter()
            .map(|c| decode_change(c).map_err(|source| ReplicaError::Message { revision, source }))
            .collect::<Result<Vec<_>, _>>()
    };
    Ok(Entry { revision, label: event.summary.clone(), forward: decoded(&event.changes)?, backward: decoded(inverse)? })
}

/// The next free id after changes. It follows from the changes alone, so a replay makes the same ids.
fn next_unit(present: u64, changes: &[Change]) -> u64 {
    let ids = changes.iter().filter_map(|c| if let Change::Unit(unit) = c { Some(unit.id) } else { None });
    ids.fold(present, |next, id| next.max(id.saturating_add(1)))
}
