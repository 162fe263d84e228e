//! The supervisor's clock. It stands still while the supervisor does not run.
//!
//! A supervisor may be stopped (SIGSTOP, Ctrl-Z) or starved. Its deadlines judge others by missing signs of life, which it
//! could not receive meanwhile. So the time of such a gap does not count. The kernel's monotonic clock stands still while
//! the machine is suspended, and does not follow changes of the time of day.

use std::time::{Duration, Instant};

use crate::reconcile::Time;

/// Longest pause between two turns of the event loop.
pub(super) const TURN: Duration = Duration::from_millis(250);
/// Gap between two turns beyond which the supervisor did not run. It is above a busy machine's usual delays.
const GAP: Duration = Duration::from_millis(1000);

#[derive(Debug)]
pub(super) struct AwakeClock {
    began: Instant,
    /// Time of the last turn, and how long the supervisor had run by then.
    turned: Instant,
    ran: Duration,
}

impl AwakeClock {
    pub(super) fn new() -> Self {
        let now = Instant::now();
        Self { began: now, turned: now, ran: Duration::ZERO }
    }

    /// Time that the supervisor has run.
    pub(super) fn now(&self) -> Time {
        self.at(Instant::now())
    }

    /// The same as an instant, for deadlines that others set.
    pub(super) fn instant(&self) -> Instant {
        self.began + self.now()
    }

    /// Time left until an instant of this clock.
    pub(super) fn until(&self, deadline: Instant) -> Duration {
        deadline.saturating_duration_since(self.instant())
    }

    /// Time in which the supervisor did not run, up to now. It also covers a gap that no turn has noticed yet, and may be too
    /// long by less than [`GAP`].
    pub(super) fn standstill(&self) -> Duration {
        self.standstill_at(Instant::now())
    }

    /// Whether the supervisor stood still since [`AwakeClock::standstill`] was this.
    pub(super) fn stood_still_since(&self, standstill: Duration) -> bool {
        self.standstill() > standstill + GAP
    }

    /// Begins a turn of the event loop. Returns the length of the gap before it, if the supervisor did not run.
    pub(super) fn turn(&mut self) -> Option<Duration> {
        self.turn_at(Instant::now())
    }

    fn at(&self, now: Instant) -> Time {
        self.ran + now.saturating_duration_since(self.turned).min(TURN)
    }

    fn standstill_at(&self, now: Instant) -> Duration {
        now.saturating_duration_since(self.began).saturating_sub(self.at(now))
    }

    fn turn_at(&mut self, now: Instant) -> Option<Duration> {
        let gap = now.saturating_duration_since(self.turned);
        self.ran += if gap > GAP { TURN } else { gap };
        self.turned = now;
        (gap > GAP).then_some(gap)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_without_turns_does_not_count() {
        let mut clock = AwakeClock::new();
        let mut now = clock.began;
        for _ in 0..8 {
            now += Duration::from_millis(250);
            assert_eq!(clock.turn_at(now), None);
        }
        assert_eq!(clock.at(now), Duration::from_secs(2));
        now += Duration::from_secs(3600);
        assert_eq!(clock.at(now), Duration::from_millis(2250), "no reading counts the gap");
        assert_eq!(clock.turn_at(now), Some(Duration::from_secs(3600)));
        assert_eq!(clock.at(now), Duration::from_millis(2250));
        // A delay of a busy machine is time.
        now += Duration::from_millis(900);
        assert_eq!(clock.turn_at(now), None);
        assert_eq!(clock.at(now), Duration::from_millis(3150));
    }

    #[test]
    fn a_standstill_is_known_before_the_next_turn() {
        let mut clock = AwakeClock::new();
        let mut now = clock.began;
        let before = clock.standstill_at(now);
        now += Duration::from_millis(900);
        assert!(clock.standstill_at(now) < before + GAP, "a busy machine");
        assert_eq!(clock.turn_at(now), None);
        assert_eq!(clock.standstill_at(now), before);
        now += Duration::from_secs(9);
        assert!(clock.standstill_at(now) > before + GAP);
        assert!(clock.turn_at(now).is_some());
        assert!(clock.standstill_at(now) > before + GAP);
        let after = clock.standstill_at(now);
        now += Duration::from_millis(250);
        assert_eq!(clock.turn_at(now), None);
        assert_eq!(clock.standstill_at(now), after);
    }
}
