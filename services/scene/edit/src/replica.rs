//! A reader's copy of the state, updated by events.

use sg_proto::scene::{Changes, Event, change};

use super::state::{EditState, StateMismatch};
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
    /// It belongs to other geometry.
    #[error("revision {revision} is of geometry {found}, not {expected}")]
    Geometry {
        /// Of the snapshot.
        revision: u64,
        /// Its content hash.
        found: String,
        /// That of the copy.
        expected: String,
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

/// The outcome of an offered event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Offered {
    /// It was the next one; the copy is at its revision.
    Accepted,
    /// Events in between are missing: ask the scene for changes from `have` on.
    Gap {
        /// Revision of the copy.
        have: u64,
        /// Revision of the event.
        got: u64,
    },
    /// The copy has it already.
    Old,
}

impl EditState {
    /// Takes the next event, whole or not at all.
    ///
    /// # Errors
    /// [`ReplicaError`]; the state is then as it was.
    pub fn apply_event(&mut self, event: &Event) -> Result<(), ReplicaError> {
        let revision = event.revision;
        if revision != self.revision + 1 {
            return Err(ReplicaError::Gap { have: self.revision, got: revision });
        }
        let mut next = self.clone();
        for change in &event.changes {
            let change =
                decode_change(change, self.count()).map_err(|source| ReplicaError::Message { revision, source })?;
            next.apply_change(change).map_err(|source| ReplicaError::StateMismatch { revision, source })?;
        }
        next.revision = revision;
        *self = next;
        Ok(())
    }
}

/// A copy of the state at a known revision.
///
/// A reader starts with [`Replica::new`] from its geometry or from a snapshot. It offers every received event. After a
/// gap, it asks the scene for changes from [`Replica::revision`] until [`Replica::take`] brings nothing new.
#[derive(Debug, Clone, PartialEq)]
pub struct Replica {
    state: EditState,
    selected_at: u64,
}

impl Replica {
    /// A copy that begins at this state.
    #[must_use]
    pub fn new(state: EditState) -> Self {
        Self { selected_at: state.revision, state }
    }

    /// The last revision with a new selection.
    #[must_use]
    pub fn selected_at(&self) -> u64 {
        self.selected_at
    }

    /// The state.
    #[must_use]
    pub fn state(&self) -> &EditState {
        &self.state
    }

    /// Its revision.
    #[must_use]
    pub fn revision(&self) -> u64 {
        self.state.revision
    }

    /// Offers an event as it was heard.
    ///
    /// # Errors
    /// [`ReplicaError`] if it is the next one but cannot be taken; ask for a snapshot then.
    pub fn offer(&mut self, event: &Event) -> Result<Offered, ReplicaError> {
        let have = self.revision();
        if event.revision <= have {
            return Ok(Offered::Old);
        }
        if event.revision > have + 1 {
            return Ok(Offered::Gap { have, got: event.revision });
        }
        self.state.apply_event(event)?;
        if event.changes.iter().any(|c| matches!(c.item, Some(change::Item::Selection(_)))) {
            self.selected_at = event.revision;
        }
        Ok(Offered::Accepted)
    }

    /// Takes the scene's messages for a gap; returns whether they brought anything new. Ask again as long as they did: one
    /// answer holds a bounded number of events.
    ///
    /// # Errors
    /// [`ReplicaError`]; events before the failing one have been taken.
    pub fn take(&mut self, changes: &Changes) -> Result<bool, ReplicaError> {
        let before = self.revision();
        if let Some(snapshot) = &changes.snapshot {
            let revision = snapshot.revision;
            let state =
                EditState::from_snapshot(snapshot).map_err(|source| ReplicaError::Message { revision, source })?;
            let (found, expected) = (&state.geometry.hash, &self.state.geometry.hash);
            if found != expected {
                return Err(ReplicaError::Geometry { revision, found: found.clone(), expected: expected.clone() });
            }
            // A late snapshot must not revert newer events.
            if revision > before {
                self.selected_at = revision;
                self.state = state;
            }
        }
        for event in &changes.events {
            if let Offered::Gap { have, got } = self.offer(event)? {
                return Err(ReplicaError::Gap { have, got });
            }
        }
        Ok(self.revision() > before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::scene::{Change, Color, Mask, Selection, change::Item};
    use sg_scene::synthetic::test_scene;

    fn replica() -> Replica {
        Replica::new(EditState::of_scene(&test_scene(&[("bone", 4)]), "", "hash"))
    }

    fn background(revision: u64, red: f32) -> Event {
        let item = Some(Item::Background(Color { red, green: 0.0, blue: 0.0 }));
        Event { revision, changes: vec![Change { item }], ..Event::default() }
    }

    #[test]
    fn events_are_taken_in_order_once() {
        let mut replica = replica();
        assert_eq!(replica.offer(&background(1, 0.5)), Ok(Offered::Accepted));
        assert_eq!(replica.offer(&background(1, 0.7)), Ok(Offered::Old));
        assert_eq!(replica.offer(&background(3, 0.9)), Ok(Offered::Gap { have: 1, got: 3 }));
        assert_eq!(replica.state().background().x, 0.5);
        let missed = Changes { revision: 3, events: vec![background(2, 0.8), background(3, 0.9)], snapshot: None };
        assert_eq!(replica.take(&missed), Ok(true));
        assert_eq!(replica.take(&missed), Ok(false));
        assert_eq!((replica.revision(), replica.state().background().x), (3, 0.9));
    }

    #[test]
    fn a_torn_event_changes_nothing() {
        let mut replica = replica();
        let before = replica.clone();
        let mut torn = background(1, 0.5);
        let mask = Some(Mask { length: 9, bits: vec![0, 0] });
        torn.changes.push(Change { item: Some(Item::Selection(Selection { mask, ..Selection::default() })) });
        assert!(matches!(replica.offer(&torn), Err(ReplicaError::Message { revision: 1, .. })));
        torn.changes[1] = Change { item: None };
        assert!(replica.offer(&torn).is_err());
        assert_eq!(replica, before);
    }

    #[test]
    fn a_snapshot_of_other_geometry_is_refused_and_an_older_one_ignored() {
        let mut replica = replica();
        let other = EditState::of_scene(&test_scene(&[("bone", 4)]), "", "other").state(true);
        let changes = |state| Changes { revision: 0, events: vec![], snapshot: Some(state) };
        assert!(matches!(replica.take(&changes(other)), Err(ReplicaError::Geometry { .. })));
        let old = replica.state().state(true);
        replica.offer(&background(1, 0.5)).unwrap();
        assert_eq!(replica.take(&changes(old)), Ok(false));
        assert_eq!(replica.revision(), 1);
    }
}
