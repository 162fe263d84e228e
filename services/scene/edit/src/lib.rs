//! Edits: the state that they change, the commands that change it, copies that follow.
//!
//! [`EditState`] is the editable state of a scene, as a value. An [`Editor`] owns it. It applies [`Command`]s in order
//! and returns an [`Event`] with the new values for each. A [`Replica`] is a reader's copy that follows the events.
//! Nothing here does input or output.
//!
//! [`Command`]: sg_proto::scene::Command
//! [`Event`]: sg_proto::scene::Event

mod appearance;
mod command_number;
mod derived;
mod editor;
mod environment;
mod error;
mod history;
mod membership;
mod names;
mod replica;
mod state;
mod target;
#[cfg(test)]
mod tests;
mod transaction;
pub mod wire;

pub use editor::{Applied, Editor};
pub use error::EditError;
pub use history::HistoryMove;
pub use replica::{Offered, Replica, ReplicaError};
pub use state::{BaseUnitState, Change, EditState, Geometry, Selection, StateMismatch, Unit, UnitRef, mask_hash};

pub use editor::{check_id, stored_entry};
pub use history::{Entry, History};
