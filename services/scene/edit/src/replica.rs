//! A reader's copy of the state, updated by events.

use std::sync::Arc;

use sg_proto::scene::{Event, State, change};

use super::change::StateMismatch;
use super::state::EditState;
use super::wire::{WireError, decode_change};

/// An event or snapshot that cannot be applied. The copy stays unchanged; a full snapshot repairs it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReplicaError {
    /// The message is malformed.
    #[error("revision {revision}: {source}")]
    Message {
        /// Of the event or snapshot.
        revision: u64,
        /// The cause.
        source: WireError,
    },
    /// It belongs to another scene.
    #[error("revision {revision}: {source}")]
    StateMismatch {
        /// Of the event or snapshot.
        revision: u64,
        /// The mismatch.
        source: StateMismatch,
    },
    /// The event does not follow the copy's revision.
    #[error("event {got} does not follow revision {have}")]
    Gap {
        /// Revision of the copy.
        have: u64,
        /// Revision of the event.
        got: u64,
    },
}

impl EditState {
    /// Takes the next event, whole or not at all.
    ///
    /// # Errors
    /// [`ReplicaError`]; the state is then as it was.
    pub fn apply_event(&mut self, event: &Event) -> Result<(), ReplicaError> {
        *self = self.after_event(event)?;
        Ok(())
    }

    /// The state after the next event.
    fn after_event(&self, event: &Event) -> Result<Self, ReplicaError> {
        let revision = event.revision;
        if revision != self.revision + 1 {
            return Err(ReplicaError::Gap { have: self.revision, got: revision });
        }
        let mut next = self.clone();
        for change in &event.changes {
            let change = decode_change(change).map_err(|source| ReplicaError::Message { revision, source })?;
            next.apply_change(change).map_err(|source| ReplicaError::StateMismatch { revision, source })?;
        }
        next.revision = revision;
        Ok(next)
    }
}

/// A copy of the state at a known revision. A clone is cheap: it shares the state.
///
/// The trait [`sg_proto::replica::Replica`] makes it from a snapshot and applies events to it. A reader on the bus gives it
/// to `SceneReplica` of `sg-runtime`, which asks the scene for both.
#[derive(Debug, Clone, PartialEq)]
pub struct Replica {
    state: Arc<EditState>,
    selected_at: u64,
}

impl Replica {
    /// A copy that begins at this state.
    #[must_use]
    pub fn new(state: EditState) -> Self {
        Self { selected_at: state.revision, state: Arc::new(state) }
    }

    /// The last revision with a new selection. A copy from a snapshot counts the snapshot's selection as new.
    #[must_use]
    pub fn selected_at(&self) -> u64 {
        self.selected_at
    }

    /// The state. All clones of one revision share it, so pointer equality means the same revision.
    #[must_use]
    pub fn state(&self) -> &Arc<EditState> {
        &self.state
    }
}

impl sg_proto::replica::Replica for Replica {
    type Error = ReplicaError;

    fn from_snapshot(snapshot: &State) -> Result<Self, ReplicaError> {
        let revision = snapshot.revision;
        let state = EditState::from_snapshot(snapshot);
        Ok(Self::new(state.map_err(|source| ReplicaError::Message { revision, source })?))
    }

    fn revision(&self) -> u64 {
        self.state.revision
    }

    fn apply(&mut self, event: &Event) -> Result<(), ReplicaError> {
        self.state = Arc::new(self.state.after_event(event)?);
        if event.changes.iter().any(|c| matches!(c.item, Some(change::Item::Selection(_)))) {
            self.selected_at = event.revision;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::replica::Replica as _;
    use sg_proto::scene::{Change, Color, Mask, Selection, change::Item};
    use sg_scene::synthetic::test_scene;

    use crate::wire::encode_mask;

    fn replica() -> Replica {
        Replica::new(EditState::of_scene(&test_scene(&[("bone", 4)]), "", "hash"))
    }

    fn event(revision: u64, item: Item) -> Event {
        Event { revision, changes: vec![Change { item: Some(item) }], ..Event::default() }
    }

    fn background(revision: u64, red: f32) -> Event {
        event(revision, Item::Background(Color { red, green: 0.0, blue: 0.0 }))
    }

    fn selection(revision: u64, selected: &[usize]) -> Event {
        let mask = sg_scene::mask::Mask::from_fn(4, |i| selected.contains(&i));
        let (count, hash) = (mask.count() as u64, crate::mask_hash(&mask));
        event(
            revision,
            Item::Selection(Selection { count, hash, mask: Some(encode_mask(&mask)), ..Selection::default() }),
        )
    }

    #[test]
    fn only_the_event_of_the_next_revision_is_applied() {
        let mut replica = replica();
        assert_eq!(replica.apply(&background(1, 0.5)), Ok(()));
        assert_eq!(replica.apply(&background(1, 0.7)), Err(ReplicaError::Gap { have: 1, got: 1 }));
        let gap = replica.apply(&background(3, 0.9)).unwrap_err();
        assert_eq!(gap.to_string(), "event 3 does not follow revision 1");
        assert_eq!((replica.revision(), replica.state().background().x), (1, 0.5));
        assert_eq!(replica.apply(&background(2, 0.8)), Ok(()));
        assert_eq!(replica.apply(&background(3, 0.9)), Ok(()));
        assert_eq!((replica.revision(), replica.state().background().x), (3, 0.9));
    }

    #[test]
    fn a_torn_event_changes_nothing() {
        let mut replica = replica();
        let before = replica.clone();
        let mut torn = background(1, 0.5);
        let mask = Some(Mask { length: 9, bits: vec![0, 0] });
        torn.changes.push(Change { item: Some(Item::Selection(Selection { mask, ..Selection::default() })) });
        let of_other_length = replica.apply(&torn);
        assert!(matches!(of_other_length, Err(ReplicaError::StateMismatch { revision: 1, .. })), "{of_other_length:?}");
        torn.changes[1] = Change { item: None };
        assert!(replica.apply(&torn).is_err());
        assert_eq!(replica, before);
    }

    #[test]
    fn a_copy_from_a_snapshot_goes_on_with_events() {
        let mut first = replica();
        first.apply(&background(1, 0.5)).unwrap();
        let mut second = Replica::from_snapshot(&first.state().state(true)).unwrap();
        assert_eq!((second.revision(), second.selected_at(), second.state()), (1, 1, first.state()));
        for replica in [&mut first, &mut second] {
            replica.apply(&background(2, 0.8)).unwrap();
        }
        assert_eq!(second.state(), first.state());
    }

    #[test]
    fn a_snapshot_without_masks_is_refused_with_its_revision() {
        let mut replica = replica();
        replica.apply(&background(1, 0.5)).unwrap();
        let error = Replica::from_snapshot(&replica.state().state(false)).unwrap_err();
        assert_eq!(error, ReplicaError::Message { revision: 1, source: WireError::Missing("selection.mask") });
    }

    #[test]
    fn the_revision_of_the_newest_selection_is_known() {
        let mut replica = replica();
        assert_eq!(replica.selected_at(), 0);
        replica.apply(&background(1, 0.5)).unwrap();
        assert_eq!(replica.selected_at(), 0);
        replica.apply(&selection(2, &[1, 3])).unwrap();
        replica.apply(&background(3, 0.6)).unwrap();
        assert_eq!((replica.revision(), replica.selected_at()), (3, 2));
    }

    #[test]
    fn a_clone_shares_the_state_until_the_next_event() {
        let mut replica = replica();
        let clone = replica.clone();
        assert!(Arc::ptr_eq(replica.state(), clone.state()));
        replica.apply(&background(1, 0.5)).unwrap();
        assert!(!Arc::ptr_eq(replica.state(), clone.state()));
    }
}
