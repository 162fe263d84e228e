//! The channel between a display and its backend: the newest view state in, requests out.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use super::request::Request;
use super::view_state::{NOTICES, Notice, ViewState};

/// Most waiting requests; more are dropped and counted.
pub const REQUESTS: usize = 64;

/// Pace of a display.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameStats {
    /// Frames shown.
    pub frames: u64,
    /// Pictures of the scene in them.
    pub pictures: u64,
    /// Pictures that missed their time.
    pub late: u64,
    /// Seconds of the newest picture.
    pub seconds: f64,
    /// The renderer.
    pub engine: String,
    /// Scene revision of the newest frame.
    pub revision: u64,
    /// Width and height of the picture in the display, pixels; 0 where it has no one size.
    pub size: [u32; 2],
}

/// State that both ends of the channel share.
struct SharedState {
    /// The newest state and its version.
    state: Mutex<(u64, Arc<ViewState>)>,
    frame_stats: Mutex<FrameStats>,
    closed: AtomicBool,
    /// Time of the display's last look for an update.
    last_turn: Mutex<Instant>,
    /// Wakes a loop that sleeps until there is an update.
    wake: OnceLock<Box<dyn Fn() + Send + Sync>>,
    /// Whether the loop was woken since it last took the state.
    woken: AtomicBool,
}

impl SharedState {
    /// Wakes the loop once until it takes the state.
    fn wake(&self) {
        if let Some(wake) = self.wake.get()
            && !self.woken.swap(true, Ordering::AcqRel)
        {
            wake();
        }
    }
}

impl fmt::Debug for SharedState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SharedState").field("closed", &self.closed).finish_non_exhaustive()
    }
}

/// A display's side: newest value in, requests out, neither ever waited for.
#[derive(Debug)]
pub struct ViewPort {
    shared: Arc<SharedState>,
    /// Version of the last state taken.
    taken_version: u64,
    requests: SyncSender<Request>,
    dropped: u64,
}

/// The other side of a [`ViewPort`].
#[derive(Debug)]
pub struct Backend {
    /// Publishes the newest state.
    pub writer: StateWriter,
    /// Requests; the channel ends with the display. Read it with [`super::RequestQueue`].
    pub requests: Receiver<Request>,
}

/// Writes the view state of a display. Clones write the same state.
#[derive(Debug, Clone)]
pub struct StateWriter(Arc<SharedState>);

impl StateWriter {
    /// The newest.
    #[must_use]
    pub fn newest(&self) -> Arc<ViewState> {
        Arc::clone(&lock(&self.0.state).1)
    }

    /// Updates the view state.
    pub fn update(&self, what: impl FnOnce(&mut ViewState)) {
        let mut state = lock(&self.0.state);
        what(Arc::make_mut(&mut state.1));
        state.0 += 1;
        drop(state);
        self.0.wake();
    }

    /// Adds a notice for the person; the oldest goes if there are too many.
    pub fn notice(&self, text: impl Into<String>, refused: bool) {
        let text = text.into();
        self.update(|state| {
            let number = state.notices.last().map_or(1, |n| n.number + 1);
            let passed = (state.notices.len() + 1).saturating_sub(NOTICES);
            let line = Notice { number, text, refused };
            state.notices = state.notices.iter().skip(passed).cloned().chain([line]).collect();
        });
    }

    /// Closes the display.
    pub fn close(&self) {
        self.0.closed.store(true, Ordering::Relaxed);
        self.0.wake();
    }

    /// Time since the display's loop last looked for an update. It looks twice a second or more often, unless it hangs.
    #[must_use]
    pub fn silent_for(&self) -> Duration {
        lock(&self.0.last_turn).elapsed()
    }

    /// Pace of the display.
    #[must_use]
    pub fn frame_stats(&self) -> FrameStats {
        lock(&self.0.frame_stats).clone()
    }
}

fn lock<T>(what: &Mutex<T>) -> MutexGuard<'_, T> {
    what.lock().unwrap_or_else(PoisonError::into_inner)
}

impl ViewPort {
    /// A view port and its other side.
    #[must_use]
    pub fn new(first: ViewState) -> (Self, Backend) {
        let shared = Arc::new(SharedState {
            state: Mutex::new((0, Arc::new(first))),
            frame_stats: Mutex::default(),
            closed: AtomicBool::new(false),
            last_turn: Mutex::new(Instant::now()),
            wake: OnceLock::new(),
            woken: AtomicBool::new(false),
        });
        let (requests, queue) = sync_channel(REQUESTS);
        let writer = StateWriter(Arc::clone(&shared));
        (Self { shared, taken_version: 0, requests, dropped: 0 }, Backend { writer, requests: queue })
    }

    /// Has `wake` called, from any thread, when there is an update or the display must close. It is called once until
    /// [`Self::newest`] takes the update. Only the first call has an effect.
    pub fn on_update(&self, wake: impl Fn() + Send + Sync + 'static) {
        let _ = self.shared.wake.set(Box::new(wake));
    }

    /// The newest.
    #[must_use]
    pub fn newest(&mut self) -> Arc<ViewState> {
        *lock(&self.shared.last_turn) = Instant::now();
        // Before the state is read, so that no update after it goes without a call.
        self.shared.woken.store(false, Ordering::Release);
        let state = lock(&self.shared.state);
        self.taken_version = state.0;
        Arc::clone(&state.1)
    }

    /// Whether the state has changed since the last read.
    #[must_use]
    pub fn has_update(&self) -> bool {
        *lock(&self.shared.last_turn) = Instant::now();
        lock(&self.shared.state).0 != self.taken_version
    }

    /// Whether the display must close.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        *lock(&self.shared.last_turn) = Instant::now();
        self.shared.closed.load(Ordering::Relaxed)
    }

    /// Sends a request; returns whether there was room for it.
    pub fn send(&mut self, request: Request) -> bool {
        let taken_version = self.requests.try_send(request).is_ok();
        self.dropped += u64::from(!taken_version);
        taken_version
    }

    /// Reports the display's pace.
    pub fn report(&self, frame_stats: FrameStats) {
        *lock(&self.shared.frame_stats) = frame_stats;
    }

    /// Number of requests dropped for lack of room.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use sg_edit::EditState;
    use sg_scene::synthetic::test_scene;

    use super::*;

    #[test]
    fn a_sleeping_loop_is_woken_once_for_all_updates_until_it_takes_them() {
        let state = EditState::of_scene(&test_scene(&[("ball", 3)]), "scene.toml", "hash");
        let (mut view_port, Backend { writer, .. }) = ViewPort::new(ViewState::of(Arc::new(state)));
        let calls = Arc::new(AtomicUsize::new(0));
        let counted = Arc::clone(&calls);
        view_port.on_update(move || {
            counted.fetch_add(1, Ordering::Relaxed);
        });
        (0..3).for_each(|_| writer.notice("news", false));
        assert!(view_port.has_update() && calls.load(Ordering::Relaxed) == 1);
        assert_eq!(view_port.newest().notices.len(), 3);
        assert!(!view_port.has_update());
        writer.notice("more", false);
        assert_eq!(calls.load(Ordering::Relaxed), 2);
        let _ = view_port.newest();
        writer.close();
        assert!(view_port.is_closed() && calls.load(Ordering::Relaxed) == 3);
    }
}
