//! Pauses between restarts.

use std::time::Duration;

/// The pause before restart `failures` (from 1): doubled each time, at most `max`.
pub(super) fn pause(initial: Duration, max: Duration, failures: u32) -> Duration {
    let doublings = failures.saturating_sub(1).min(31);
    initial.saturating_mul(1 << doublings).min(max)
}

/// Spreads pauses by up to a fifth either way, so that services that failed together start apart. The generator is
/// SplitMix64 (Steele, Lea and Flood 2014). The same seed gives the same numbers.
#[derive(Debug, Clone)]
pub(super) struct Jitter {
    state: u64,
}

impl Jitter {
    pub(super) fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    pub(super) fn spread(&mut self, pause: Duration) -> Duration {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        let unit = ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64;
        pause.mul_f64(0.8 + 0.4 * unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_up_to_their_limit_and_are_spread_by_a_fifth() {
        let (initial, max) = (Duration::from_millis(100), Duration::from_secs(5));
        let pauses: Vec<_> = (1..=8).map(|n| pause(initial, max, n).as_millis()).collect();
        assert_eq!(pauses, [100, 200, 400, 800, 1600, 3200, 5000, 5000]);
        assert_eq!(pause(initial, max, u32::MAX), max);
        let mut jitter = Jitter::new(7);
        let spread: Vec<_> = (0..1000).map(|_| jitter.spread(initial).as_secs_f64()).collect();
        assert!(spread.iter().all(|s| (0.08..=0.12).contains(s)));
        let mean = spread.iter().sum::<f64>() / 1000.0;
        assert!((mean - 0.1).abs() < 0.002, "{mean}");
        assert!(spread.iter().any(|s| *s < 0.085) && spread.iter().any(|s| *s > 0.115));
    }
}
