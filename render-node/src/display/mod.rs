//! What a display shows and what the person before it asks for.
//!
//! A display (a window, a headset) has a loop that draws. Between that loop and everything that answers in its own time lies
//! a [`Seat`]: the loop takes the newest [`Shown`] and hands [`Request`]s in, and neither waits. Nothing here knows the bus.

mod beside;
mod brush;
mod conversation;
mod draft;
mod dressing;
mod pacing;
mod tools;

use std::sync::Arc;

use sg_proto::scene::command;
use sg_proto::selection::{SampleRequest, StrokesRequest};
use sg_scene::edit::EditState;
use sg_scene::mask::Mask;
use tokio::sync::{mpsc, watch};

pub use beside::Beside;
pub use brush::{Hand, Sense, Tip};
pub use conversation::{Conversation, Entry, Turn};
pub use draft::Drafts;
pub use dressing::{Colors, Dressing, colors_of};
pub use pacing::{Level, Pacing};
pub use tools::{BrushMode, Showing, Tools};

/// Requests that may wait to be carried out; more are dropped and counted.
pub const REQUESTS: usize = 64;

/// Lines that are kept for a person to read.
pub const NOTICES: usize = 8;

/// The newest of everything that a display shows, each part by itself as new as it is known. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Shown {
    /// The scene at its newest revision.
    pub scene: Arc<EditState>,
    /// What undo would take back, newest first.
    pub undo: Arc<[String]>,
    /// What redo would bring back, next first.
    pub redo: Arc<[String]>,
    /// What is selected, or will be as soon as it is durable, or would be if the stroke under way ended now.
    pub selected: Arc<Mask>,
    /// Whether `selected` is more than the scene has committed.
    pub tentative: bool,
    /// Super-Gaussian of each Gaussian, [`crate::structure::NO_CLUSTER`] for none; absent until clusters are known.
    pub clusters: Option<Arc<[u32]>>,
    /// What was said and answered.
    pub conversation: Arc<Conversation>,
    /// Which services answer.
    pub offered: Offered,
    /// What went wrong or is worth knowing, newest last, at most [`NOTICES`] lines.
    pub notices: Arc<[Notice]>,
}

impl Shown {
    /// A scene of which nothing else is known.
    #[must_use]
    pub fn of(scene: Arc<EditState>) -> Self {
        Self {
            selected: Arc::clone(scene.selection().mask()),
            scene,
            undo: Arc::default(),
            redo: Arc::default(),
            tentative: false,
            clusters: None,
            conversation: Arc::default(),
            offered: Offered::default(),
            notices: Arc::default(),
        }
    }
}

/// Which services answer: a control whose service is away is not drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Offered {
    /// The scene takes changes.
    pub scene: bool,
    /// Strokes become selections.
    pub selection: bool,
    /// The agents take part in a conversation.
    pub agents: bool,
}

/// A line for a person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Notice {
    /// Counts up, so that a display can tell a new line from one it has shown.
    pub number: u64,
    /// What happened and what to do about it.
    pub text: String,
    /// Whether something asked for was not done.
    pub refused: bool,
}

/// What a person asks for. Each is carried out in the order in which it was asked, beside the loop that draws.
#[derive(Debug, Clone, PartialEq)]
pub enum Request {
    /// One change of the scene, journaled.
    Change(Box<command::Action>),
    /// New samples of a stroke under way.
    Sample(SampleRequest),
    /// Strokes or operations that are complete.
    Select(StrokesRequest),
    /// Something said to the agents.
    Say(String),
    /// What was said last is withdrawn.
    Withdraw,
}

/// How a display keeps up.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pace {
    /// Frames that it has shown.
    pub frames: u64,
    /// Pictures of the scene in them.
    pub pictures: u64,
    /// Pictures that were there later than they should have been.
    pub late: u64,
    /// Seconds that the newest one took.
    pub seconds: f64,
    /// What drew it.
    pub engine: String,
    /// Revision of the scene that the newest frame shows.
    pub revision: u64,
}

/// A display's side: newest value in, requests out, neither ever waited for.
#[derive(Debug)]
pub struct Seat {
    shown: watch::Receiver<Arc<Shown>>,
    requests: mpsc::Sender<Request>,
    pace: watch::Sender<Pace>,
    dropped: u64,
}

/// The other side of a [`Seat`].
#[derive(Debug)]
pub struct Service {
    /// Where the newest goes.
    pub shown: watch::Sender<Arc<Shown>>,
    /// What was asked for.
    pub requests: mpsc::Receiver<Request>,
    /// How the display keeps up.
    pub pace: watch::Receiver<Pace>,
}

impl Seat {
    /// A seat and its other side.
    #[must_use]
    pub fn new(first: Shown) -> (Self, Service) {
        let (newest, shown) = watch::channel(Arc::new(first));
        let (requests, asked) = mpsc::channel(REQUESTS);
        let (pace, told) = watch::channel(Pace::default());
        (Self { shown, requests, pace, dropped: 0 }, Service { shown: newest, requests: asked, pace: told })
    }

    /// The newest.
    #[must_use]
    pub fn newest(&mut self) -> Arc<Shown> {
        Arc::clone(&self.shown.borrow_and_update())
    }

    /// Whether there is something newer than what was taken last.
    #[must_use]
    pub fn has_news(&self) -> bool {
        self.shown.has_changed().unwrap_or(false)
    }

    /// Whether the other side has gone, so that the display has to close.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.requests.is_closed()
    }

    /// Hands a request in; whether there was room for it.
    pub fn ask(&mut self, request: Request) -> bool {
        let taken = self.requests.try_send(request).is_ok();
        self.dropped += u64::from(!taken);
        taken
    }

    /// Says how the display keeps up.
    pub fn tell(&self, pace: Pace) {
        self.pace.send_replace(pace);
    }

    /// Requests for which there was no room.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}
