//! Progress of work: since when a worker is busy, and with what.
//!
//! The health message of a process reports the progress of its actors and rows. The supervisor restarts a service whose
//! work makes no progress for longer than the launch file allows. Work that is long by nature calls [`Progress::step`]
//! between its parts.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Progress of one worker: an actor, a row, or the loading code of a process. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Progress(Arc<Mutex<State>>);

#[derive(Debug, Default)]
struct State {
    /// The present work, and the time of its begin or its last step.
    busy: Option<(&'static str, Instant)>,
    steps: u64,
}

tokio::task_local! {
    static CURRENT: Progress;
}

/// Progress of the worker on whose task this is called: in [`Actor::handle`](crate::actor::Actor::handle), in the handler of
/// a row, or while the process loads. Pass it on to other threads.
///
/// Elsewhere the result is valid, but nobody observes it.
#[must_use]
pub fn current() -> Progress {
    CURRENT.try_with(Progress::clone).unwrap_or_default()
}

impl Progress {
    /// Reports that a part of the present work is done.
    pub fn step(&self) {
        let mut state = self.lock();
        state.steps += 1;
        if let Some((_, since)) = &mut state.busy {
            *since = Instant::now();
        }
    }

    /// Begins work.
    pub(crate) fn begin(&self, work: &'static str) {
        self.lock().busy = Some((work, Instant::now()));
    }

    /// Ends the present work, or leaves it to another worker.
    pub(crate) fn end(&self) {
        self.lock().busy = None;
    }

    /// The present work, and the time since its begin or its last step.
    pub(crate) fn busy(&self) -> Option<(&'static str, Duration)> {
        self.lock().busy.map(|(work, since)| (work, since.elapsed()))
    }

    /// Number of reported steps.
    pub(crate) fn steps(&self) -> u64 {
        self.lock().steps
    }

    /// Runs a future as the work of this worker.
    pub(crate) async fn scope<F: Future>(self, future: F) -> F::Output {
        CURRENT.scope(self, future).await
    }

    /// Ignores poisoning: each change is a single assignment.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_step_begins_the_time_anew() {
        let progress = Progress::default();
        assert_eq!(progress.busy(), None);
        progress.begin("cmd/walk");
        std::thread::sleep(Duration::from_millis(30));
        let (work, time) = progress.busy().unwrap();
        assert!(work == "cmd/walk" && time >= Duration::from_millis(30));
        progress.clone().scope(async { current().step() }).await;
        assert!(progress.busy().unwrap().1 < time && progress.steps() == 1);
        progress.end();
        current().step();
        assert_eq!((progress.busy(), progress.steps()), (None, 1), "a step elsewhere is not counted here");
    }
}
