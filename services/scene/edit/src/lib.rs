//! Edits of a scene: the editable state, the commands that change it, and copies that follow.
//!
//! [`EditState`] is the editable state of a scene, as a value. An [`Editor`] owns it. It applies [`Command`]s in order and
//! returns an [`Event`] with the new values for each. A [`Replica`] is a reader's copy that follows the events. This crate
//! does no input or output.
//!
//! ```
//! use std::sync::Arc;
//!
//! use sg_edit::{EditState, Editor, Replica};
//! use sg_proto::replica::Replica as _;
//! use sg_proto::scene::{Color, Command, SetColor, Target, command::Action};
//! use sg_scene::synthetic::test_scene;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = Arc::new(test_scene(&[("bone", 5), ("skin", 7)]));
//! let opened = EditState::of_scene(&scene, "scene.toml", scene.content_hash().to_hex().to_string());
//! let mut editor = Editor::new(scene, opened.clone());
//! let mut replica = Replica::new(opened);
//!
//! let target = Some(Target { units: vec!["bone".to_owned()], ..Target::default() });
//! let color = Some(Color { red: 1.0, green: 0.0, blue: 0.0 });
//! let action = Some(Action::SetColor(SetColor { target, color }));
//! let applied = editor.apply(&Command { id: "1".to_owned(), expected_revision: 0, action })?;
//! assert_eq!(applied.result.summary, "coloured bone #ff0000");
//!
//! replica.apply(&applied.event)?;
//! assert_eq!(**replica.state(), *editor.state());
//! # Ok(())
//! # }
//! ```
//!
//! [`Command`]: sg_proto::scene::Command
//! [`Event`]: sg_proto::scene::Event

mod appearance;
mod change;
mod command_number;
mod deletion;
mod derived;
mod duplicates;
mod duplication;
mod edited;
mod editor;
mod environment;
mod error;
mod history;
mod kept_views;
mod lock;
mod measure;
mod membership;
mod merge;
mod names;
mod placed_scene;
mod placement;
mod reach;
mod reclassification;
mod replica;
mod state;
mod target;
#[cfg(test)]
mod tests;
mod tone;
mod transaction;
mod transformation;
mod visibility;
pub mod wire;

pub use change::{Change, StateMismatch};
pub use duplicates::Duplicate;
pub use edited::Part;
pub use editor::{Applied, Editor};
pub use error::EditError;
pub use history::HistoryMove;
pub use placed_scene::PlacedScene;
pub use placement::{Placement, middle};
pub use reach::{LEAK_RANGE, leak_of, reach_of};
pub use replica::{Replica, ReplicaError};
pub use state::{BaseUnitState, EditState, Geometry, KeptView, Selection, Unit, UnitRef, mask_hash};

pub use editor::{check_id, stored_entry};
pub use history::{Entry, History};
