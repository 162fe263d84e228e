//! Copies of the scene that follow its events.

use std::fmt::Display;

use crate::scene::{Event, State};

/// A reader's copy of the scene at one revision.
///
/// A copy begins with a snapshot and applies every event after it, in order. This crate holds only the interface: the
/// implementation belongs to the library that knows the meaning of each change.
pub trait Replica: Clone + Send + Sync + 'static {
    /// Reason for a refused snapshot or event.
    type Error: Display + Send;

    /// Makes a copy from a snapshot with masks.
    ///
    /// # Errors
    /// The snapshot is malformed or belongs to another scene.
    fn from_snapshot(snapshot: &State) -> Result<Self, Self::Error>;

    /// Revision of the copy.
    fn revision(&self) -> u64;

    /// Applies the event of the next revision, as a whole or not at all.
    ///
    /// # Errors
    /// The event is malformed, belongs to another scene, or does not follow [`Replica::revision`].
    fn apply(&mut self, event: &Event) -> Result<(), Self::Error>;
}
