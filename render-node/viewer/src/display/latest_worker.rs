//! A worker beside a loop that must not wait: it processes the newest job and keeps the newest outcome.

use std::fmt;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// A thread that processes the newest job. A newer job replaces a waiting one.
pub struct LatestWorker<J, R> {
    shared: Arc<Shared<J, R>>,
    thread: Option<JoinHandle<()>>,
}

struct Shared<J, R> {
    slots: Mutex<Slots<J, R>>,
    changed: Condvar,
}

struct Slots<J, R> {
    job: Option<J>,
    result: Option<R>,
    working: bool,
    stopped: bool,
}

impl<J, R> Shared<J, R> {
    fn slots(&self) -> MutexGuard<'_, Slots<J, R>> {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<J: Send + 'static, R: Send + 'static> LatestWorker<J, R> {
    /// Starts the thread. `wake` is called from it whenever there is an outcome, such as to wake the loop.
    ///
    /// # Errors
    /// The system's error if it cannot start a thread.
    pub fn new(
        name: &str,
        mut work: impl FnMut(J) -> R + Send + 'static,
        wake: impl Fn() + Send + 'static,
    ) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            slots: Mutex::new(Slots { job: None, result: None, working: false, stopped: false }),
            changed: Condvar::new(),
        });
        let here = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            loop {
                let job = {
                    let idle = |s: &mut Slots<J, R>| s.job.is_none() && !s.stopped;
                    let mut slots = here.changed.wait_while(here.slots(), idle).unwrap_or_else(PoisonError::into_inner);
                    if slots.stopped {
                        return;
                    }
                    slots.working = true;
                    slots.job.take()
                };
                let Some(job) = job else { continue };
                let result = work(job);
                let mut slots = here.slots();
                slots.result = Some(result);
                slots.working = false;
                drop(slots);
                wake();
            }
        })?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Submits a job; it replaces the waiting one.
    pub fn submit(&self, job: J) {
        self.shared.slots().job = Some(job);
        self.shared.changed.notify_one();
    }

    /// The newest outcome, if not yet taken.
    #[must_use]
    pub fn take(&self) -> Option<R> {
        self.shared.slots().result.take()
    }

    /// Whether no job is running or waiting.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        let slots = self.shared.slots();
        !slots.working && slots.job.is_none()
    }
}

impl<J, R> Drop for LatestWorker<J, R> {
    fn drop(&mut self) {
        self.shared.slots().stopped = true;
        self.shared.changed.notify_one();
        if let Some(thread) = self.thread.take() {
            // A panic has already been reported; there is nothing left to end.
            let _ = thread.join();
        }
    }
}

impl<J, R> fmt::Debug for LatestWorker<J, R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.thread.as_ref().and_then(|t| t.thread().name());
        f.debug_struct("Beside").field("thread", &name).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;
    use std::time::Duration;

    use super::*;

    const SOON: Duration = Duration::from_secs(20);

    #[test]
    fn the_newest_wish_is_worked_on_and_those_before_it_are_passed_by() {
        let (begun, begins) = mpsc::channel();
        let (go_on, goes_on) = mpsc::channel::<()>();
        let (wake, tells) = mpsc::channel();
        let work = move |job: u32| {
            begun.send(job).unwrap();
            goes_on.recv_timeout(SOON).unwrap();
            10 * job
        };
        let worker = LatestWorker::new("tested", work, move || wake.send(()).unwrap()).unwrap();
        assert!(worker.is_idle() && worker.take().is_none());
        worker.submit(1);
        assert_eq!(begins.recv_timeout(SOON), Ok(1));
        for job in 2..=5 {
            worker.submit(job);
        }
        assert!(!worker.is_idle());
        go_on.send(()).unwrap();
        assert_eq!(begins.recv_timeout(SOON), Ok(5), "2, 3 and 4 were passed by");
        go_on.send(()).unwrap();
        tells.recv_timeout(SOON).unwrap();
        tells.recv_timeout(SOON).unwrap();
        assert_eq!(worker.take(), Some(50));
        assert_eq!(worker.take(), None, "taken once");
        assert!(worker.is_idle());
    }
}
