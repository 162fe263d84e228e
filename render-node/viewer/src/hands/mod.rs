//! Hands that hold a scene: where it stands in the room, and how grabbing, scaling and turning change that.
//!
//! Pure functions in f64, whatever tells where hands are. The room is in metres, x right, y up, z backward (as OpenXR has
//! it); its floor or the eyes are at y = 0.

mod bookmark;
mod comfort_vignette;
mod eye;
mod grab;
mod input;
mod joints;
mod placement;
mod pointing;

pub use bookmark::{Bookmark, Bookmarks, MOST_BOOKMARKS};
pub use comfort_vignette::ComfortVignette;
pub use eye::{Eye, Fov};
pub use grab::{Grab, MIN_APART, SCALES, TurnMode};
pub use input::{HandInput, Side, Switch};
pub use joints::{BareHand, JOINTS, Joints};
pub use placement::{Origin, Placement, Pose, Stance};
pub use pointing::{Pointed, Pointer, Rectangle, nearest};
