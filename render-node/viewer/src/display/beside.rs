//! Work beside a loop that must not wait: the newest wish is worked on, the newest outcome lies ready.

use std::fmt;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// A thread that makes an outcome of the newest wish. A wish that is passed by a newer one is never looked at.
pub struct Beside<W, D> {
    desk: Arc<Desk<W, D>>,
    thread: Option<JoinHandle<()>>,
}

struct Desk<W, D> {
    slots: Mutex<Slots<W, D>>,
    news: Condvar,
}

struct Slots<W, D> {
    wish: Option<W>,
    done: Option<D>,
    working: bool,
    over: bool,
}

impl<W, D> Desk<W, D> {
    fn slots(&self) -> MutexGuard<'_, Slots<W, D>> {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<W: Send + 'static, D: Send + 'static> Beside<W, D> {
    /// Starts the thread. `told` is called from it whenever there is an outcome, such as to wake the loop.
    ///
    /// # Errors
    /// What the system says where it gives no thread.
    pub fn new(
        name: &str,
        mut work: impl FnMut(W) -> D + Send + 'static,
        told: impl Fn() + Send + 'static,
    ) -> std::io::Result<Self> {
        let desk = Arc::new(Desk {
            slots: Mutex::new(Slots { wish: None, done: None, working: false, over: false }),
            news: Condvar::new(),
        });
        let here = Arc::clone(&desk);
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            loop {
                let wish = {
                    let idle = |s: &mut Slots<W, D>| s.wish.is_none() && !s.over;
                    let mut slots = here.news.wait_while(here.slots(), idle).unwrap_or_else(PoisonError::into_inner);
                    if slots.over {
                        return;
                    }
                    slots.working = true;
                    slots.wish.take()
                };
                let Some(wish) = wish else { continue };
                let done = work(wish);
                let mut slots = here.slots();
                slots.done = Some(done);
                slots.working = false;
                drop(slots);
                told();
            }
        })?;
        Ok(Self { desk, thread: Some(thread) })
    }

    /// Puts a wish in the place of the one that has not been begun.
    pub fn want(&self, wish: W) {
        self.desk.slots().wish = Some(wish);
        self.desk.news.notify_one();
    }

    /// The newest outcome that has not been taken yet.
    #[must_use]
    pub fn take(&self) -> Option<D> {
        self.desk.slots().done.take()
    }

    /// Whether nothing is worked on and nothing waits.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        let slots = self.desk.slots();
        !slots.working && slots.wish.is_none()
    }
}

impl<W, D> Drop for Beside<W, D> {
    fn drop(&mut self) {
        self.desk.slots().over = true;
        self.desk.news.notify_one();
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has said so; there is nothing left of it to end.
            let _ = thread.join();
        }
    }
}

impl<W, D> fmt::Debug for Beside<W, D> {
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
        let (told, tells) = mpsc::channel();
        let work = move |wish: u32| {
            begun.send(wish).unwrap();
            goes_on.recv_timeout(SOON).unwrap();
            10 * wish
        };
        let beside = Beside::new("tested", work, move || told.send(()).unwrap()).unwrap();
        assert!(beside.is_idle() && beside.take().is_none());
        beside.want(1);
        assert_eq!(begins.recv_timeout(SOON), Ok(1));
        for wish in 2..=5 {
            beside.want(wish);
        }
        assert!(!beside.is_idle());
        go_on.send(()).unwrap();
        assert_eq!(begins.recv_timeout(SOON), Ok(5), "2, 3 and 4 were passed by");
        go_on.send(()).unwrap();
        tells.recv_timeout(SOON).unwrap();
        tells.recv_timeout(SOON).unwrap();
        assert_eq!(beside.take(), Some(50));
        assert_eq!(beside.take(), None, "taken once");
        assert!(beside.is_idle());
    }
}
