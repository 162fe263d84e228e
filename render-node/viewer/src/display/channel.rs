//! The channel between a display and its backend: the newest view state in, requests out.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::request::Request;
use super::view_state::{NOTICES, Notice, Shown};

/// Requests that may wait to be carried out; more are dropped and counted.
pub const REQUESTS: usize = 64;

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
    /// What was asked for; it ends with the display. [`super::Asked`] takes it in order.
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
