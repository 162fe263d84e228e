//! Looks after a display whose loop somebody else's program can hold.

use std::time::Duration;

/// What holds a display's loop and for how long it has; `None` while it goes on.
pub(super) type Holds = Box<dyn Fn() -> Option<(&'static str, Duration)> + Send>;

/// How long a loop may be held before that is said.
const WORTH_SAYING: Duration = Duration::from_secs(2);

/// A watch beside the loop.
pub(super) struct Watch {
    holds: Holds,
    patience: Duration,
    said: bool,
    given_up: bool,
}

impl Watch {
    pub(super) fn new(holds: Holds, patience: Duration) -> Self {
        Self { holds, patience, said: false, given_up: false }
    }

    /// Looks whether the loop goes on, and says it when that changes. Once, when it has been held for longer than patience
    /// lasts: why it is given up.
    pub(super) fn look(&mut self) -> Option<String> {
        let held = (self.holds)().filter(|(_, long)| *long >= WORTH_SAYING.min(self.patience));
        let Some((what, long)) = held else {
            if self.said && !self.given_up {
                tracing::info!("the headset's runtime answers again");
            }
            self.said = false;
            return None;
        };
        let seconds = long.as_secs_f64();
        if !self.said {
            self.said = true;
            let patience = self.patience.as_secs_f64();
            tracing::warn!(
                "the headset's runtime has not answered for {seconds:.0} s (asked for {what}): it hangs or is stopped; it is waited for up to {patience:.0} s"
            );
        }
        if long < self.patience || self.given_up {
            return None;
        }
        self.given_up = true;
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
        let holds = move || match now.load(Ordering::Relaxed) {
            0 => None,
            long => Some(("a frame", Duration::from_secs(long))),
        };
        let mut watch = Watch::new(Box::new(holds), Duration::from_secs(5));
        let mut at = |long: u64| {
            seconds.store(long, Ordering::Relaxed);
            watch.look()
        };
        // It comes back, and is held again.
        assert_eq!([0, 1, 3, 4, 0, 1].map(&mut at), [const { None }; 6]);
        assert!(at(5).is_some_and(|line| line.contains("5 s") && line.contains("a frame")));
        assert_eq!([6, 60, 0, 9].map(&mut at), [const { None }; 4]);
    }
}
