//! Counters of the messages of one process, and its response times.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::metrics::{self, Metric};

/// Counters of one connection to the bus.
#[derive(Debug, Default)]
pub struct Counters {
    refused: AtomicU64,
    dropped: AtomicU64,
    answered: AtomicU64,
    /// Time of each newest answer, and its delay after the receipt of the request.
    newest: Mutex<VecDeque<(Instant, Duration)>>,
}

/// Most response times to keep.
const MAX_ANSWERS: usize = 256;
/// Longest age of a response time.
const MAX_ANSWER_AGE: Duration = Duration::from_secs(60);

impl Counters {
    /// Number of messages refused for their type, size, form, sender or epoch.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }

    /// Number of messages dropped in transit or at a full queue.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Number of requests answered with a reply or a typed error.
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

    /// Median and 99th percentile of the response time, milliseconds; 0 without requests.
    ///
    /// Measured from receipt to answer, over the newest 256 requests of the last minute.
    #[must_use]
    pub fn answer_ms(&self) -> (f64, f64) {
        let newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        let recent = newest.iter().filter(|(at, _)| at.elapsed() < MAX_ANSWER_AGE);
        let mut times: Vec<f64> = recent.map(|(_, time)| time.as_secs_f64() * 1e3).collect();
        times.sort_by(f64::total_cmp);
        // Nearest-rank percentile.
        let rank = |share: f64| ((share * times.len() as f64).ceil() as usize).saturating_sub(1);
        let at = |share| times.get(rank(share)).copied().unwrap_or(0.0);
        (at(0.5), at(0.99))
    }

    pub(super) fn answer(&self, time: Duration) {
        self.answered.fetch_add(1, Ordering::Relaxed);
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        newest.truncate(MAX_ANSWERS - 1);
        newest.push_front((Instant::now(), time));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_use_the_newest_requests() {
        let counters = Counters::default();
        assert_eq!(counters.answer_ms(), (0.0, 0.0));
        for ms in (1..=1000_u64).rev() {
            counters.answer(Duration::from_millis(ms));
        }
        assert_eq!((counters.answered(), counters.answer_ms()), (1000, (128.0, 254.0)));
    }
}
