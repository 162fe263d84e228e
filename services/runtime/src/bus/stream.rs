//! Streams: published without waiting for anybody, numbered, followed with bounded memory.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use prost::{Message, Name};
use sg_proto::keys::{self, Stream, Urgency};
use tokio::sync::broadcast;
use zenoh::Wait;
use zenoh::bytes::Encoding;
use zenoh::pubsub::Subscriber;
use zenoh::qos::CongestionControl;
use zenoh::sample::Sample;

use super::ask::priority;
use super::{Boxed, Bus, BusError};
use crate::context::Context;
use crate::fault::Fault;
use crate::metrics::{self, Metric};
use crate::trace::{self, Kind};
use crate::wire;

/// Numbers of the last messages that this process sent, by row.
#[derive(Debug, Default)]
pub(super) struct Sequences(Mutex<HashMap<&'static str, Arc<Mutex<u64>>>>);

impl Sequences {
    fn of(&self, name: &'static str) -> Arc<Mutex<u64>> {
        Arc::clone(self.0.lock().unwrap_or_else(PoisonError::into_inner).entry(name).or_default())
    }
}

/// Senders of one key expression whose numbers are remembered; the key of each ends in its role or instance.
const SENDERS: usize = 256;

/// Numbers of the last messages that were received, by key, to count what was lost on the way.
#[derive(Debug, Default)]
struct Received(Mutex<HashMap<String, (u64, u64)>>);

impl Received {
    /// Messages that are missing before this one.
    fn missing(&self, key: &str, epoch: u64, sequence: u64) -> u64 {
        if sequence == 0 {
            return 0;
        }
        let mut last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match last.get_mut(key) {
            Some(seen) => {
                // A process that was started again counts from the beginning.
                let missing = if seen.0 == epoch && sequence > seen.1 { sequence - seen.1 - 1 } else { 0 };
                *seen = (epoch, sequence);
                missing
            }
            None => {
                if last.len() < SENDERS {
                    last.insert(key.to_owned(), (epoch, sequence));
                }
                0
            }
        }
    }
}

impl Bus {
    /// Publishes one message of a stream. Nobody need listen; a slow listener does not hold the sender up: what finds no
    /// room within a millisecond is dropped, and listeners count it by the messages' numbers.
    ///
    /// # Errors
    /// A message over the size limit, a row of another role, or a connection that is closed.
    pub async fn publish<M>(&self, row: &Stream<M>, message: &M, context: &Context) -> Result<(), Fault>
    where
        M: Message + Name,
    {
        self.own_row(row.role, row.name).map_err(Fault::internal)?;
        self.put(row.name, row.urgency, message, context)
    }

    pub(super) fn put<M: Message + Name>(
        &self,
        name: &'static str,
        urgency: Urgency,
        message: &M,
        context: &Context,
    ) -> Result<(), Fault> {
        self.put_bytes(name, urgency, wire::encode(message)?, wire::encoding::<M>(), context)
    }

    fn put_bytes(
        &self,
        name: &'static str,
        urgency: Urgency,
        payload: Vec<u8>,
        encoding: Encoding,
        context: &Context,
    ) -> Result<(), Fault> {
        let key = keys::key(self.session(), &self.segment(), name);
        // Said once in a life: a supervisor that missed it would wait in vain.
        let once = name == keys::READY.name;
        let congestion = if once { CongestionControl::Block } else { CongestionControl::Drop };
        let counter = self.inner.sequences.of(name);
        // Held while sending: a listener takes numbers out of order for messages lost.
        let mut sequence = counter.lock().unwrap_or_else(PoisonError::into_inner);
        *sequence += 1;
        let envelope = context.to_envelope(self.role(), self.epoch(), *sequence).encode_to_vec();
        metrics::count(Metric::Published, &[("key", name)], 1);
        let started = SystemTime::now();
        // Never waits for a listener, so that it can be called from a thread that must not wait.
        let outcome = self
            .inner
            .zenoh
            .put(&key, payload)
            .encoding(encoding)
            .attachment(envelope)
            .priority(priority(urgency))
            .congestion_control(congestion)
            .wait()
            .map_err(|e| Fault::unavailable(format!("{key}: {e}")));
        // Stages of a conversation are worth a span, signs of life are not.
        if !context.conversation.is_empty() {
            let code = outcome.as_ref().err().map(|f| f.code);
            trace::record(context, Kind::Producer, || format!("publish {name}"), started, code);
        }
        outcome
    }

    /// Follows a stream of one role, holding at most `capacity` messages: a slow reader loses the oldest.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub async fn follow<M>(&self, row: &Stream<M>, role: &str, capacity: usize) -> Result<Following<M>, BusError>
    where
        M: Message + Name + Default + Clone + 'static,
    {
        let key = keys::key(&self.inner.session, role, row.name);
        let (sender, receiver) = broadcast::channel(capacity);
        let (bus, name) = (self.clone(), row.name);
        let received = Received::default();
        let missed = Arc::new(AtomicU64::new(0));
        let missing = Arc::clone(&missed);
        let take = move |sample: Sample| {
            let parts = wire::envelope(sample.attachment()).and_then(|envelope| {
                bus.check_epoch(&envelope)?;
                Ok((wire::decode::<M>(sample.encoding(), sample.payload())?, envelope))
            });
            if let Ok((message, envelope)) = bus.counted(name, parts) {
                let lost = received.missing(sample.key_expr().as_str(), envelope.epoch, envelope.sequence);
                if lost > 0 {
                    missing.fetch_add(lost, Ordering::Relaxed);
                    bus.inner.counters.drop(name, lost);
                }
                // Nobody listening any more is no fault: the reader is being dropped.
                let _ = sender.send((message, Context::from_envelope(envelope)));
            }
        };
        let subscriber = self.subscribe(key, Box::new(take)).await?;
        Ok(Following { receiver, late: 0, missed, bus: self.clone(), name, _subscriber: subscriber })
    }

    /// Every message under any key of the session, undecoded: for people who watch.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub async fn watch_all(&self, capacity: usize) -> Result<Watching, BusError> {
        let key = format!("{}/{}/**", keys::ROOT, self.inner.session);
        let (sender, receiver) = broadcast::channel(capacity);
        let take = move |sample: Sample| {
            let envelope = wire::envelope(sample.attachment()).unwrap_or_default();
            let seen = Seen {
                key: sample.key_expr().to_string(),
                message: wire::message_name(sample.encoding()).unwrap_or_default(),
                payload: sample.payload().to_bytes().into_owned(),
                context: Context::from_envelope(envelope),
            };
            let _ = sender.send(seen);
        };
        let subscriber = self.subscribe(key, Box::new(take)).await?;
        Ok(Watching { receiver, lost: 0, _subscriber: subscriber })
    }
}

impl Bus {
    fn subscribe(
        &self,
        key: String,
        take: Box<dyn Fn(Sample) + Send + Sync>,
    ) -> Boxed<'_, Result<Subscriber<()>, BusError>> {
        Box::pin(async move {
            let declaring = self.inner.zenoh.declare_subscriber(&key).callback(take);
            declaring.await.map_err(|e| BusError::Declare { key, reason: e.to_string() })
        })
    }
}

/// The reading end of a stream.
#[derive(Debug)]
pub struct Following<M: Clone> {
    receiver: broadcast::Receiver<(M, Context)>,
    late: u64,
    missed: Arc<AtomicU64>,
    bus: Bus,
    name: &'static str,
    _subscriber: Subscriber<()>,
}

impl<M: Clone> Following<M> {
    /// The next message; `None` when the bus is closed. Lost messages are skipped and counted.
    pub async fn next(&mut self) -> Option<(M, Context)> {
        loop {
            match self.receiver.recv().await {
                Ok(item) => return Some(item),
                Err(broadcast::error::RecvError::Lagged(n)) => {
                    self.late += n;
                    self.bus.inner.counters.drop(self.name, n);
                }
                Err(broadcast::error::RecvError::Closed) => return None,
            }
        }
    }

    /// Messages lost so far: on the way, and because this reader was slow.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.late + self.missed.load(Ordering::Relaxed)
    }
}

/// A message somebody sent, undecoded.
#[derive(Debug, Clone)]
pub struct Seen {
    /// Key expression.
    pub key: String,
    /// Full name of the message type; empty if the payload is no protobuf message.
    pub message: String,
    /// Encoded message.
    pub payload: Vec<u8>,
    /// Its chain.
    pub context: Context,
}

/// The reading end of everything.
#[derive(Debug)]
pub struct Watching {
    receiver: broadcast::Receiver<Seen>,
    lost: u64,
    _subscriber: Subscriber<()>,
}

impl Watching {
    /// The next message; `None` when the bus is closed.
    pub async fn next(&mut self) -> Option<Seen> {
        loop {
            match self.receiver.recv().await {
                Ok(seen) => return Some(seen),
                Err(broadcast::error::RecvError::Lagged(n)) => self.lost += n,
                Err(broadcast::error::RecvError::Closed) => return None,
            }
        }
    }

    /// Messages lost so far because this reader was slow.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_counted_and_a_new_life_is_none() {
        let received = Received::default();
        let missing = |key, epoch, sequence| received.missing(key, epoch, sequence);
        assert_eq!(missing("a", 1, 4), 0, "what came before one listened is not missed");
        assert_eq!(missing("a", 1, 5), 0);
        assert_eq!(missing("a", 1, 9), 3);
        assert_eq!(missing("b", 1, 2), 0, "each sender counts for itself");
        assert_eq!(missing("a", 2, 1), 0);
        assert_eq!(missing("a", 2, 3), 1);
        assert_eq!(missing("a", 2, 0), 0, "unnumbered");
    }
}
