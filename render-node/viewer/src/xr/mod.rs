//! A headset through OpenXR: a session that lives as long as its runtime does and comes back with it.
//!
//! [`Headset::open`] finds the runtime and opens the graphics device that it wants; [`Headset::frame`] is the loop's one call.
//! The loop waits in `xrWaitFrame` and nowhere else; whoever is beside it sees with [`Held`] when a runtime that was stopped
//! keeps it. What hands do comes with each frame as [`crate::hands::HandInput`].

mod actions;
mod bindings;
mod board;
mod device;
mod error;
mod fingers;
mod frame;
mod headset;
mod held;
mod life;
mod live;
mod mask;
mod options;
mod quad;
mod space;
mod target;

pub use board::{Board, Counts};
pub use error::XrError;
pub use frame::Frame;
pub use headset::{Headset, PAUSE, Paced, Step};
pub use held::Held;
pub use mask::Triangle;
pub use options::Options;
pub use quad::{PanelId, Quad};
