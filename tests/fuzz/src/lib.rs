//! Fuzzing of every reader of this project, and of the messages on the bus.
//!
//! A [`Target`] hands bytes to one reader, as its caller does, and checks what comes back. [`TARGETS`] lists all of them. The
//! engine, libFuzzer, changes the bytes and keeps those that reach new code. Without the engine, a test replays the inputs
//! of [`corpus`] and every input that once failed.
//!
//! A reader fails by a panic, by a result that breaks its promise, by more memory than [`Memory`] allows, or by more time
//! than the engine allows.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a panic is a finding")]

pub mod corpus;
mod memory;
mod parts;
pub mod seeds;
mod stage;
mod table;
mod target;
mod targets;

pub use stage::Stage;
pub use table::{TARGETS, named};
pub use target::{Memory, Target};
