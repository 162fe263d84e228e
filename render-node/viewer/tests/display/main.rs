//! The work of a display beside drawing: brushes, drafts, levels.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod brush;
mod drafts;
mod parameter_drag;
#[cfg(feature = "xr")]
mod sticks;
