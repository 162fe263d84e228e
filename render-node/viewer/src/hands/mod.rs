//! Hands that hold a scene: its placement in the room, and its changes by grabbing, scaling and turning.
//!
//! Pure functions in f64, independent of the tracking source. The room is in metres, x right, y up, z backward (as in
//! OpenXR). Its floor or the eyes are at y = 0.

mod bookmark;
mod comfort_vignette;
mod eye;
mod grab;
mod input;
mod joints;
pub mod locomotion;
mod placement;
mod pointing;
mod raised;

pub use bookmark::{Bookmark, Bookmarks, MOST_BOOKMARKS};
pub use comfort_vignette::ComfortVignette;
pub use eye::{Eye, Fov};
pub use grab::{Grab, MIN_APART, SCALES, TurnMode};
pub use input::{HandInput, Side, Switch};
pub use joints::{BareHand, JOINTS, Joints};
pub use locomotion::{Arc, Teleport};
pub use placement::{Origin, Placement, Pose, Stance};
pub use pointing::{Pointed, Pointer, Rectangle, facing, nearest};
pub use raised::RaisedHand;
