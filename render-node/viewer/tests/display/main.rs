//! The work of a display beside drawing: brushes, drafts, levels.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test fails by panicking and says what it measured"
)]

mod brush;
mod drafts;
mod parameter_drag;
mod quality;
mod recorded;
#[cfg(feature = "xr")]
mod sticks;
