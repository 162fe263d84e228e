//! A headset through OpenXR: a session that lives as long as its runtime does and comes back with it.
//!
//! [`Headset::open`] finds the runtime and opens the graphics device that it wants; [`Headset::frame`] is the loop's one
//! call. The loop waits in `xrWaitFrame` and nowhere else. Another thread detects with [`Watchdog`] that a stopped runtime
//! blocks the loop. Each frame carries the hands' input as [`crate::hands::HandInput`].

mod actions;
mod bindings;
mod device;
mod error;
mod frame;
mod hand_tracking;
mod headset;
mod options;
mod panel_layer;
mod quad;
mod session;
mod session_state;
mod space;
mod surroundings;
mod swapchain;
mod visibility_mask;
mod watchdog;

pub use error::XrError;
pub use frame::Frame;
pub use headset::{FrameOutcome, FrameTiming, Headset, PAUSE};
pub use options::{BlendMode, Options, SurroundingsSource};
pub use panel_layer::{Counts, PanelLayer};
pub use quad::{PanelId, Quad};
pub use visibility_mask::Triangle;
pub use watchdog::Watchdog;
