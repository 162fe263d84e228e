//! Moments on the clock that goes on while the machine is suspended. The monotonic clock stands still then.

use std::time::Duration;

use nix::time::ClockId;

/// A moment on this clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct BootTime(Duration);

impl BootTime {
    pub(crate) fn now() -> Self {
        // Every kernel that this runs on has the first clock.
        let now = ClockId::CLOCK_BOOTTIME.now().or_else(|_| ClockId::CLOCK_MONOTONIC.now());
        Self(now.map(Duration::from).unwrap_or_default())
    }

    /// Time since this moment.
    pub(crate) fn elapsed(self) -> Duration {
        Self::now().0.saturating_sub(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_passes() {
        let began = BootTime::now();
        std::thread::sleep(Duration::from_millis(20));
        let passed = began.elapsed();
        assert!(passed >= Duration::from_millis(20) && passed < Duration::from_secs(10), "{passed:?}");
    }
}
