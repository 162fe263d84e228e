//! Edits: the state that they change, the commands that change it, copies that follow.
//!
//! [`EditState`] is everything that edits change, as a value. Its owner is an [`Editor`], which carries [`Command`]s out
//! one after another and tells of each as an [`Event`] with the values after it. A [`Replica`] is a reader's copy that is
//! kept up by events. Nothing here does input or output.
//!
//! [`Command`]: sg_proto::scene::Command
//! [`Event`]: sg_proto::scene::Event

mod derived;
mod draft;
mod editor;
mod error;
mod history;
mod look;
mod membership;
mod names;
mod number;
mod replica;
mod scenery;
mod state;
mod target;
#[cfg(test)]
mod tests;
pub mod wire;

pub use editor::{Applied, Editor};
pub use error::EditError;
pub use history::HistoryMove;
pub use replica::{Offered, Replica, ReplicaError};
pub use state::{BaseLook, Change, EditState, Geometry, Misfit, Selection, Unit, UnitRef, mask_hash};

pub use editor::{check_id, stored_entry};
pub use history::{Entry, History};
