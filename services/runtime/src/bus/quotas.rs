//! Quotas: how many messages and bytes this process takes from each node.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use sg_proto::limits::{NODE_BURST_SECONDS, NODE_BYTES_PER_SECOND, NODE_MESSAGES_PER_SECOND};

/// Quotas by node. The router knows each node by its certificate, so their number is that of the launch file.
#[derive(Debug, Default)]
pub(super) struct Quotas(Mutex<HashMap<String, Quota>>);

/// What a node may still send. It grows with time, up to the largest burst.
#[derive(Debug)]
struct Quota {
    messages: f64,
    bytes: f64,
    counted: Instant,
}

impl Quotas {
    /// Takes a message of a node out of its quota. Returns false if there is no room for it.
    pub(super) fn take(&self, node: &str, bytes: usize, now: Instant) -> bool {
        let burst = |rate: u32| f64::from(rate) * f64::from(NODE_BURST_SECONDS);
        let (most_messages, most_bytes) = (burst(NODE_MESSAGES_PER_SECOND), burst(NODE_BYTES_PER_SECOND));
        let mut quotas = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let full = Quota { messages: most_messages, bytes: most_bytes, counted: now };
        let quota = quotas.entry(node.to_owned()).or_insert(full);
        let seconds = now.saturating_duration_since(quota.counted).as_secs_f64();
        quota.messages = (quota.messages + seconds * f64::from(NODE_MESSAGES_PER_SECOND)).min(most_messages);
        quota.bytes = (quota.bytes + seconds * f64::from(NODE_BYTES_PER_SECOND)).min(most_bytes);
        quota.counted = now;
        let bytes = bytes as f64;
        let fits = quota.messages >= 1.0 && quota.bytes >= bytes;
        if fits {
            quota.messages -= 1.0;
            quota.bytes -= bytes;
        }
        fits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn each_node_has_a_quota_that_grows_with_time() {
        let quotas = Quotas::default();
        let began = Instant::now();
        let burst = NODE_MESSAGES_PER_SECOND * NODE_BURST_SECONDS;
        for _ in 0..burst {
            assert!(quotas.take("gpu1", 10, began));
        }
        assert!(!quotas.take("gpu1", 10, began));
        assert!(quotas.take("gpu2", 10, began), "another node has its own quota");
        let later = began + Duration::from_secs(1);
        let taken = (0..burst).filter(|_| quotas.take("gpu1", 10, later)).count();
        assert_eq!(taken, NODE_MESSAGES_PER_SECOND as usize);
    }

    #[test]
    fn bytes_are_limited_too() {
        let quotas = Quotas::default();
        let began = Instant::now();
        let large = sg_proto::limits::MAX_MESSAGE_BYTES;
        let taken = (0..10_000).filter(|_| quotas.take("gpu1", large, began)).count();
        assert_eq!(taken, (NODE_BYTES_PER_SECOND as usize) * (NODE_BURST_SECONDS as usize) / large);
    }
}
