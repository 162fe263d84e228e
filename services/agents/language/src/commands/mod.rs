//! Commands in words. Each command is one row of the table: its phrases, fields, examples and effect.
//!
//! To add a command:
//!
//! 1. If no act of the contract fits, add one to `Act` in `language.proto`, and its fields to `Clause`.
//! 2. Write one file here: a `Command` with its phrases, parser, examples, fields, effect and
//!    `resolve`.
//! 3. Declare the file here and add its row to the table in `table.rs`.
//! 4. If it sends a new scene action, add the sentence to `report.rs`.
//! 5. Add utterances with their intents to `tests/grammar.toml`.

mod background;
mod color;
pub(crate) mod command;
mod delete;
mod frame;
pub(crate) mod help;
mod history;
mod light;
mod naming;
mod opacity;
mod orbit;
mod question;
mod selection;
mod set_view;
mod shading;
pub(crate) mod table;
mod verbs;
mod viewpoint;
mod visibility;
mod zoom;

pub use table::{examples, help, resolve};
