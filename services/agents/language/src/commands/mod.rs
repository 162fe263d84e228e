//! Commands in words. Each command is one row of the table: its phrases, fields, examples and effect.
//!
//! `CONTRIBUTING.md` says how to add a command.

mod answers;
mod background;
mod best_view;
mod color;
pub(crate) mod command;
mod delete;
mod duplicate;
mod files;
mod frame;
pub(crate) mod help;
mod history;
pub(crate) mod kept_views;
mod light;
mod lock;
mod merge;
pub(crate) mod movement;
mod naming;
mod opacity;
mod orbit;
mod question;
mod selection;
mod set_view;
mod shading;
pub(crate) mod table;
pub(crate) mod tone;
mod tour;
pub(crate) mod transfer_function;
mod verbs;
mod viewpoint;
mod visibility;
mod zoom;

pub use table::{examples, help, resolve};
