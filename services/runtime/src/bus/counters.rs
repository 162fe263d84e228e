//! Counts of one process's messages, and the times of its answers.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::metrics::{self, Metric};

/// Counters of one process's use of the bus.
#[derive(Debug, Default)]
pub struct Counters {
    refused: AtomicU64,
    dropped: AtomicU64,
    answered: AtomicU64,
    /// When the newest requests were answered, and how long after their receipt.
    newest: Mutex<VecDeque<(Instant, Duration)>>,
}

/// Answers whose times are remembered …
const ANSWERS: usize = 256;
/// … and for how long.
const ANSWER_AGE: Duration = Duration::from_secs(60);

impl Counters {
    /// Messages refused because of their type, size, form, sender or epoch.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }

    /// Stream messages lost on the way or because a bounded queue was full, and requests turned away for the same reason.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Requests answered, with a reply or a typed error.
    #[must_use]
    pub fn answered(&self) -> u64 {
        self.answered.load(Ordering::Relaxed)
    }

    pub(super) fn refuse(&self, key: &'static str) {
        self.refused.fetch_add(1, Ordering::Relaxed);
        metrics::count(Metric::Refused, &[("key", key)], 1);
    }

    pub(super) fn drop(&self, key: &'static str, count: u64) {
        self.dropped.fetch_add(count, Ordering::Relaxed);
        metrics::count(Metric::Dropped, &[("key", key)], count);
    }

    /// Milliseconds from receipt to answer of the newest requests, at most 256 and of the last minute: median and 99th
    /// percentile, both 0 where there were none.
    #[must_use]
    pub fn answer_ms(&self) -> (f64, f64) {
        let newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        let recent = newest.iter().filter(|(at, _)| at.elapsed() < ANSWER_AGE);
        let mut times: Vec<f64> = recent.map(|(_, time)| time.as_secs_f64() * 1e3).collect();
        times.sort_by(f64::total_cmp);
        // The smallest time that at least this share of all does not exceed.
        let rank = |share: f64| ((share * times.len() as f64).ceil() as usize).saturating_sub(1);
        let at = |share| times.get(rank(share)).copied().unwrap_or(0.0);
        (at(0.5), at(0.99))
    }

    pub(super) fn answer(&self, time: Duration) {
        self.answered.fetch_add(1, Ordering::Relaxed);
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        newest.truncate(ANSWERS - 1);
        newest.push_front((Instant::now(), time));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answer_times_are_of_the_newest_requests() {
        let counters = Counters::default();
        assert_eq!(counters.answer_ms(), (0.0, 0.0));
        for ms in (1..=1000_u64).rev() {
            counters.answer(Duration::from_millis(ms));
        }
        assert_eq!((counters.answered(), counters.answer_ms()), (1000, (128.0, 254.0)));
    }
}
