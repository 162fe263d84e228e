//! What a display shows and what the person before it asks for.
//!
//! A display (a window, a headset) has a loop that draws. Between that loop and everything that answers in its own time lies
//! a [`Seat`]: the loop takes the newest [`Shown`] and hands [`Request`]s in, and neither waits. Nothing here knows the bus.

mod asked;
mod beside;
mod brush;
mod conversation;
mod draft;
mod dressing;
mod pacing;
mod scrub;
mod tools;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use glam::DVec3;
use sg_edit::EditState;
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::{StrokeMode, WalkTuning, command};
use sg_proto::selection::{Proposal, ProposalsReply, SampleRequest, StrokesRequest};
use sg_scene::mask::Mask;
use sg_scene::model::SceneBox;

pub use asked::Asked;
pub use beside::Beside;
pub use brush::{Hand, Sense, Tip};
pub use conversation::{Conversation, Entry, Turn};
pub use draft::Drafts;
pub use dressing::{Colors, Dressing, colors_of};
pub use pacing::{Level, Pacing};
pub use scrub::{LEAKS, Scrub, Scrubs, THRESHOLDS};
pub use tools::{BrushMode, Showing, Tools, Turns};

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
    /// What `selected` is the walk's with, while a hand tries that.
    pub tried: Option<WalkTuning>,
    /// What the selection's process does with walks; absent while it is away.
    pub walks: Option<Walks>,
    /// Where a next stroke would tell most, as it was told last.
    pub proposals: Option<Arc<ProposalsReply>>,
    /// Super-Gaussian of each Gaussian, [`sg_raster::structure::NO_CLUSTER`] for none; absent until clusters are known.
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
            tried: None,
            walks: None,
            proposals: None,
            clusters: None,
            conversation: Arc::default(),
            offered: Offered::default(),
            notices: Arc::default(),
        }
    }

    /// What the last walk is done with, or is being tried with; `None` where there is no walk, or nobody who would do it
    /// again with something else.
    #[must_use]
    pub fn tuning(&self) -> Option<WalkTuning> {
        let first = self.walks.filter(|_| self.offered.selection)?.tuning?;
        let steps = self.scene.selection().steps();
        let walks = |step: &Option<Step>| matches!(step, Some(Step::Stroke(s)) if s.mode() == StrokeMode::Walk);
        if !steps.iter().any(|s| walks(&s.step)) {
            return None;
        }
        let tuned = |step: &Option<Step>| if let Some(Step::Tuning(t)) = step { Some(*t) } else { None };
        Some(self.tried.or_else(|| steps.iter().rev().find_map(|s| tuned(&s.step))).unwrap_or(first))
    }

    /// How many places for a next stroke can be asked for; 0 where there is no walk that could go on.
    #[must_use]
    pub fn most_proposals(&self) -> u32 {
        self.tuning().and(self.walks).map_or(0, |w| w.most_proposals)
    }

    /// Where a next stroke would tell most, best first, as far as that is about the selection that is there.
    #[must_use]
    pub fn proposals(&self) -> &[Proposal] {
        let about = |p: &&Arc<ProposalsReply>| p.selection_hash == self.scene.selection().hash();
        self.proposals.as_ref().filter(about).filter(|_| self.most_proposals() > 0).map_or(&[], |p| &p.proposals)
    }

    /// Where in a scene with these bounds the proposal of a number from 0 lies.
    #[must_use]
    pub fn proposal_at(&self, bounds: SceneBox, number: usize) -> Option<DVec3> {
        let normalized = DVec3::from_slice(self.proposals().get(number)?.point.get(..3)?);
        Some(bounds.denormalize(normalized)).filter(|at| at.is_finite())
    }
}

/// What a selection's process does with walks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Walks {
    /// What they are done with where no step says otherwise; `None` where nothing else can be asked for.
    pub tuning: Option<WalkTuning>,
    /// Most places for a next stroke that it tells of at once.
    pub most_proposals: u32,
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
    /// The last walk is tried with other numbers. One that is passed by a newer one is never looked at.
    Tune(WalkTuning),
    /// What was tried, or was being drawn, is not wanted any more.
    Forget,
    /// At most so many places where a next stroke would tell most.
    Propose(u32),
    /// Something said to the agents.
    Say(String),
    /// What was said last is withdrawn.
    Withdraw,
    /// A scene or volume is opened in a window of its own.
    Open(PathBuf),
}

impl Request {
    /// Whether nobody need look at it once `later` has been asked for.
    fn gives_way_to(&self, later: &Self) -> bool {
        matches!((self, later), (Self::Tune(_), Self::Tune(_) | Self::Select(_) | Self::Forget))
    }
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

/// What both sides of a seat have in common.
#[derive(Debug)]
struct Common {
    /// The newest, and how often it was replaced.
    shown: Mutex<(u64, Arc<Shown>)>,
    pace: Mutex<Pace>,
    over: AtomicBool,
}

/// A display's side: newest value in, requests out, neither ever waited for.
#[derive(Debug)]
pub struct Seat {
    common: Arc<Common>,
    /// Which of the newest was taken last.
    taken: u64,
    requests: SyncSender<Request>,
    dropped: u64,
}

/// The other side of a [`Seat`].
#[derive(Debug)]
pub struct Service {
    /// Where the newest goes.
    pub news: News,
    /// What was asked for; it ends with the display. [`Asked`] takes it in order.
    pub requests: Receiver<Request>,
}

/// Changes what a display shows. Clones change the same.
#[derive(Debug, Clone)]
pub struct News(Arc<Common>);

impl News {
    /// The newest.
    #[must_use]
    pub fn newest(&self) -> Arc<Shown> {
        Arc::clone(&lock(&self.0.shown).1)
    }

    /// Changes what is shown.
    pub fn change(&self, what: impl FnOnce(&mut Shown)) {
        let mut shown = lock(&self.0.shown);
        what(Arc::make_mut(&mut shown.1));
        shown.0 += 1;
    }

    /// Tells the person something; the oldest line goes where there are too many.
    pub fn notice(&self, text: impl Into<String>, refused: bool) {
        let text = text.into();
        self.change(|shown| {
            let number = shown.notices.last().map_or(1, |n| n.number + 1);
            let passed = (shown.notices.len() + 1).saturating_sub(NOTICES);
            let line = Notice { number, text, refused };
            shown.notices = shown.notices.iter().skip(passed).cloned().chain([line]).collect();
        });
    }

    /// Has the display close.
    pub fn end(&self) {
        self.0.over.store(true, Ordering::Relaxed);
    }

    /// How the display keeps up.
    #[must_use]
    pub fn pace(&self) -> Pace {
        lock(&self.0.pace).clone()
    }
}

fn lock<T>(what: &Mutex<T>) -> MutexGuard<'_, T> {
    what.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Seat {
    /// A seat and its other side.
    #[must_use]
    pub fn new(first: Shown) -> (Self, Service) {
        let common = Arc::new(Common {
            shown: Mutex::new((0, Arc::new(first))),
            pace: Mutex::default(),
            over: AtomicBool::new(false),
        });
        let (requests, asked) = sync_channel(REQUESTS);
        let news = News(Arc::clone(&common));
        (Self { common, taken: 0, requests, dropped: 0 }, Service { news, requests: asked })
    }

    /// The newest.
    #[must_use]
    pub fn newest(&mut self) -> Arc<Shown> {
        let shown = lock(&self.common.shown);
        self.taken = shown.0;
        Arc::clone(&shown.1)
    }

    /// Whether there is something newer than what was taken last.
    #[must_use]
    pub fn has_news(&self) -> bool {
        lock(&self.common.shown).0 != self.taken
    }

    /// Whether the display has to close.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.common.over.load(Ordering::Relaxed)
    }

    /// Hands a request in; whether there was room for it.
    pub fn ask(&mut self, request: Request) -> bool {
        let taken = self.requests.try_send(request).is_ok();
        self.dropped += u64::from(!taken);
        taken
    }

    /// Says how the display keeps up.
    pub fn tell(&self, pace: Pace) {
        *lock(&self.common.pace) = pace;
    }

    /// Requests for which there was no room.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}
