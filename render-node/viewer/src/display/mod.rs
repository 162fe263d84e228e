//! What a display shows and what the person before it asks for.
//!
//! A display (a window, a headset) has a loop that draws. Between that loop and everything that answers in its own time lies
//! a [`Seat`]: the loop takes the newest [`Shown`] and hands [`Request`]s in, and neither waits. Nothing here knows the bus.

mod asked;
mod beside;
mod brush;
mod channel;
mod conversation;
mod draft;
mod dressing;
mod pacing;
mod request;
mod scrub;
mod tools;
mod view_state;

pub use asked::Asked;
pub use beside::Beside;
pub use brush::{Hand, Sense, Tip};
pub use channel::{News, Pace, REQUESTS, Seat, Service};
pub use conversation::{Conversation, Entry, Turn};
pub use draft::Drafts;
pub use dressing::{Colors, Dressing, colors_of};
pub use pacing::{Level, Pacing};
pub use request::Request;
pub use scrub::{LEAKS, Scrub, Scrubs, THRESHOLDS};
pub use tools::{BrushMode, Showing, Tools, Turns};
pub use view_state::{NOTICES, Notice, Offered, Shown, Walks};
