//! Watches a display whose loop can block in a third-party call.

use std::time::Duration;

/// The blocking call of a display's loop and its duration so far; `None` while the loop runs.
pub(super) type BlockedCall = Box<dyn Fn() -> Option<(&'static str, Duration)> + Send>;

/// Blocked time before a warning.
const WARN_AFTER: Duration = Duration::from_secs(2);

/// A watch beside the loop.
pub(super) struct LoopWatchdog {
    blocked_call: BlockedCall,
    patience: Duration,
    warned: bool,
    gave_up: bool,
}

impl LoopWatchdog {
    pub(super) fn new(blocked_call: BlockedCall, patience: Duration) -> Self {
        Self { blocked_call, patience, warned: false, gave_up: false }
    }

    /// Checks the loop and logs changes between running and blocked. Returns the reason for giving up, once, when a block
    /// outlasts the patience.
    pub(super) fn check(&mut self) -> Option<String> {
        let blocked = (self.blocked_call)().filter(|(_, duration)| *duration >= WARN_AFTER.min(self.patience));
        let Some((what, duration)) = blocked else {
            if self.warned && !self.gave_up {
                tracing::info!("the headset's runtime answers again");
            }
            self.warned = false;
            return None;
        };
        let seconds = duration.as_secs_f64();
        if !self.warned {
            self.warned = true;
            let patience = self.patience.as_secs_f64();
            tracing::warn!(
                "the headset's runtime has not answered for {seconds:.0} s (asked for {what}): it hangs or is stopped; it is waited for up to {patience:.0} s"
            );
        }
        if duration < self.patience || self.gave_up {
            return None;
        }
        self.gave_up = true;
        Some(format!("the headset's runtime has not answered for {seconds:.0} s (asked for {what}); it is asked anew"))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    #[test]
    fn a_loop_that_stays_away_is_given_up_once() {
        let seconds = Arc::new(AtomicU64::new(0));
        let now = Arc::clone(&seconds);
        let blocked_call = move || match now.load(Ordering::Relaxed) {
            0 => None,
            duration => Some(("a frame", Duration::from_secs(duration))),
        };
        let mut watchdog = LoopWatchdog::new(Box::new(blocked_call), Duration::from_secs(5));
        let mut at = |duration: u64| {
            seconds.store(duration, Ordering::Relaxed);
            watchdog.check()
        };
        // It comes back, and is held again.
        assert_eq!([0, 1, 3, 4, 0, 1].map(&mut at), [const { None }; 6]);
        assert!(at(5).is_some_and(|line| line.contains("5 s") && line.contains("a frame")));
        assert_eq!([6, 60, 0, 9].map(&mut at), [const { None }; 4]);
    }
}
