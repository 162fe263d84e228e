//! Measures how long the runtime has blocked the loop.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Whether a call into the runtime is still blocked. Clones observe the same loop.
///
/// A stopped (not killed) runtime answers nothing, and OpenXR gives its calls no deadline. The thread of such a call cannot
/// be recovered, and a second session beside it is not allowed. So the loop waits. Another thread watches here and decides
/// when to end the process.
#[derive(Debug, Clone, Default)]
pub struct Watchdog(Arc<Mutex<Option<(&'static str, Instant)>>>);

impl Watchdog {
    /// The pending runtime call and its duration; `None` while the loop is outside the runtime.
    #[must_use]
    pub fn blocked_call(&self) -> Option<(&'static str, Duration)> {
        self.asked().map(|(what, since)| (what, since.elapsed()))
    }

    /// Calls the runtime.
    pub(super) fn watch<T>(&self, what: &'static str, call: impl FnOnce() -> T) -> T {
        *self.asked() = Some((what, Instant::now()));
        let answer = call();
        *self.asked() = None;
        answer
    }

    fn asked(&self) -> MutexGuard<'_, Option<(&'static str, Instant)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_call_that_does_not_come_back_is_seen_from_beside() {
        let watchdog = Watchdog::default();
        assert!(watchdog.blocked_call().is_none());
        let (go, waits) = std::sync::mpsc::channel::<()>();
        let inside = watchdog.clone();
        let caller = std::thread::spawn(move || inside.watch("a frame", || waits.recv().is_ok()));
        let begun = Instant::now();
        while watchdog.blocked_call().is_none_or(|(_, long)| long < Duration::from_millis(20)) {
            assert!(begun.elapsed() < Duration::from_secs(10));
            std::thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(watchdog.blocked_call().map(|(what, _)| what), Some("a frame"));
        go.send(()).ok();
        assert!(caller.join().is_ok_and(|answered| answered));
        assert!(watchdog.blocked_call().is_none());
    }
}
