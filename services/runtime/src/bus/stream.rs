//! Streams: published without waiting, numbered, received with bounded memory.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use prost::{Message, Name};
use sg_proto::bus::Code;
use sg_proto::keys::{self, Identity, Priority, Stream};
use tokio::sync::broadcast;
use zenoh::Wait;
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::pubsub::Subscriber;
use zenoh::qos::CongestionControl;
use zenoh::sample::Sample;

use super::client::zenoh_priority;
use super::identity::Origin;
use super::{BoxFuture, Bus, BusError};
use crate::context::Context;
use crate::fault::Fault;
use crate::metrics::{self, Metric};
use crate::trace::{self, Kind};
use crate::wire;

/// Sequence numbers of the last messages sent by this process, by row.
#[derive(Debug, Default)]
pub(super) struct Sequences(Mutex<HashMap<&'static str, Arc<Mutex<u64>>>>);

impl Sequences {
    fn of(&self, name: &'static str) -> Arc<Mutex<u64>> {
        Arc::clone(self.0.lock().unwrap_or_else(PoisonError::into_inner).entry(name).or_default())
    }
}

/// Most senders of one key expression to remember. Each has a key of its own.
const MAX_SENDERS: usize = 256;

/// Epochs and sequence numbers of the last messages received, by key, to count lost messages.
#[derive(Debug, Default)]
struct Received(Mutex<HashMap<String, (u64, u64)>>);

impl Received {
    /// Counts the messages lost before this one.
    fn missing(&self, key: &str, epoch: u64, sequence: u64) -> u64 {
        if sequence == 0 {
            return 0;
        }
        let mut last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match last.get_mut(key) {
            Some(known) => {
                // A restarted process counts from 1 again.
                let missing = if known.0 == epoch && sequence > known.1 { sequence - known.1 - 1 } else { 0 };
                *known = (epoch, sequence);
                missing
            }
            None => {
                if last.len() < MAX_SENDERS {
                    last.insert(key.to_owned(), (epoch, sequence));
                }
                0
            }
        }
    }
}

impl Bus {
    /// Publishes one message of a stream.
    ///
    /// A slow subscriber does not delay the sender: without room within a millisecond the message is dropped. Subscribers
    /// count dropped messages by their sequence numbers.
    ///
    /// # Errors
    /// A message over the size limit, a row of another role, or a closed connection.
    pub async fn publish<M>(&self, row: &Stream<M>, message: &M, context: &Context) -> Result<(), Fault>
    where
        M: Message + Name,
    {
        self.check_role(row.role, row.name).map_err(Fault::internal)?;
        self.put(row.name, row.priority, message, context)
    }

    pub(super) fn put<M: Message + Name>(
        &self,
        name: &'static str,
        priority: Priority,
        message: &M,
        context: &Context,
    ) -> Result<(), Fault> {
        self.put_bytes(name, priority, wire::encode(message)?, wire::encoding::<M>(), context)
    }

    fn put_bytes(
        &self,
        name: &'static str,
        priority: Priority,
        payload: Vec<u8>,
        encoding: Encoding,
        context: &Context,
    ) -> Result<(), Fault> {
        let key = self.sending_key(&self.segment(), name);
        // Sent once per process: a supervisor that missed it would wait until its deadline.
        let once = name == keys::READY.name;
        let congestion = if once { CongestionControl::Block } else { CongestionControl::Drop };
        let counter = self.inner.sequences.of(name);
        // Locked while sending: subscribers count messages out of order as lost.
        let mut sequence = counter.lock().unwrap_or_else(PoisonError::into_inner);
        *sequence += 1;
        let envelope = context.to_envelope(self.role(), self.epoch(), *sequence).encode_to_vec();
        metrics::count(Metric::Published, &[("key", name)], 1);
        let started = SystemTime::now();
        // Does not wait for subscribers, so it can be called from threads that must not block.
        let outcome = self
            .inner
            .zenoh
            .put(&key, payload)
            .encoding(encoding)
            .attachment(envelope)
            .priority(zenoh_priority(priority))
            .congestion_control(congestion)
            .wait()
            .map_err(|e| Fault::unavailable(format!("{key}: {e}")));
        // Messages of a conversation get a span, periodic ones such as health do not.
        if !context.conversation.is_empty() {
            let code = outcome.as_ref().err().map(|f| f.code);
            trace::record(context, Kind::Producer, || format!("publish {name}"), started, code);
        }
        outcome
    }

    /// Subscribes to a stream of one role, of one instance, or of all ([`keys::ANY`]).
    ///
    /// The context of a message from a node has its [`Identity`]. A message that a node sends for another role or instance
    /// is refused. One that exceeds the node's quota is dropped. Both are counted.
    ///
    /// At most `capacity` messages of the supervisor's machine wait, and as many of nodes; a slow reader loses the oldest.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub async fn subscribe<M>(&self, row: &Stream<M>, role: &str, capacity: usize) -> Result<Subscription<M>, BusError>
    where
        M: Message + Name + Default + Clone + 'static,
    {
        // Nodes have a queue of their own, so that none can push out the messages of the supervisor's machine.
        let (home_sender, home) = broadcast::channel(capacity);
        let (nodes_sender, nodes) = broadcast::channel(capacity);
        let (bus, name) = (self.clone(), row.name);
        let received = Received::default();
        let missed = Arc::new(AtomicU64::new(0));
        let missing = Arc::clone(&missed);
        let receive = move |sample: Sample| {
            let Ok(identity) = bus.counted(name, bus.publisher(&sample, name)) else { return };
            let bytes = sample.payload().len() + sample.attachment().map_or(0, ZBytes::len);
            if bus.check_quota(identity.as_ref(), bytes).is_err() {
                return bus.inner.counters.drop(name, 1);
            }
            let parts = wire::envelope(sample.attachment()).and_then(|envelope| {
                bus.check_sender(identity.as_ref(), &envelope)?;
                Ok((wire::decode::<M>(sample.encoding(), sample.payload())?, envelope))
            });
            if let Ok((message, envelope)) = bus.counted(name, parts) {
                let lost = received.missing(sample.key_expr().as_str(), envelope.epoch, envelope.sequence);
                if lost > 0 {
                    missing.fetch_add(lost, Ordering::Relaxed);
                    bus.inner.counters.drop(name, lost);
                }
                let sender = if identity.is_none() { &home_sender } else { &nodes_sender };
                // Fails only while the reader is being dropped.
                let _ = sender.send((message, Context::from_envelope(envelope, identity)));
            }
        };
        let keys = [keys::key(self.session(), role, name), keys::from_nodes(self.session(), &format!("{role}/{name}"))];
        let subscribers = self.declare_subscribers(keys, Arc::new(receive)).await?;
        Ok(Subscription { home, nodes, late: 0, missed, bus: self.clone(), name, _subscribers: subscribers })
    }

    /// Subscribes to every stream and retained value of the session, undecoded. For tools that show messages to people.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub async fn watch_all(&self, capacity: usize) -> Result<SessionWatch, BusError> {
        let home = format!("{}/{}/**", keys::ROOT, self.inner.session);
        let nodes = keys::all_from_nodes(self.session());
        let (sender, receiver) = broadcast::channel(capacity);
        let session = self.session().to_owned();
        let receive = move |sample: Sample| {
            let envelope = wire::envelope(sample.attachment()).unwrap_or_default();
            let Some((identity, rest)) = keys::split(&session, sample.key_expr().as_str()) else { return };
            let segment = rest.split('/').next().unwrap_or_default();
            if identity.as_ref().is_some_and(|i| i.role != envelope.sender || i.role != segment) {
                return;
            }
            let message = WatchedMessage {
                key: format!("{}/{session}/{rest}", keys::ROOT),
                message: wire::message_name(sample.encoding()).unwrap_or_default(),
                payload: sample.payload().to_bytes().into_owned(),
                context: Context::from_envelope(envelope, identity),
            };
            let _ = sender.send(message);
        };
        let subscribers = self.declare_subscribers([home, nodes], Arc::new(receive)).await?;
        Ok(SessionWatch { receiver, lost: 0, _subscribers: subscribers })
    }
}

impl Bus {
    /// Sender of a message in a stream, from its key: a process on a node, or `None` for the supervisor's machine.
    fn publisher(&self, sample: &Sample, name: &str) -> Result<Option<Identity>, Fault> {
        let Origin { identity, segment } = self.origin(sample.key_expr().as_str(), name)?;
        match identity {
            Some(identity) if !identity.owns(segment) => Err(Fault::new(
                Code::PermissionDenied,
                format!("`{}` on node `{}` may not publish as `{segment}`", identity.instance, identity.node),
            )),
            identity => Ok(identity),
        }
    }

    /// Subscribes to messages of the supervisor's machine and of nodes.
    fn declare_subscribers(
        &self,
        keys: [String; 2],
        receive: Arc<dyn Fn(Sample) + Send + Sync>,
    ) -> BoxFuture<'_, Result<[Subscriber<()>; 2], BusError>> {
        Box::pin(async move {
            let declare = async |key: String| {
                let receive = Arc::clone(&receive);
                let declaring = self.inner.zenoh.declare_subscriber(&key).callback(move |sample| receive(sample));
                declaring.await.map_err(|e| BusError::Declare { key, reason: e.to_string() })
            };
            let [home, nodes] = keys;
            Ok([declare(home).await?, declare(nodes).await?])
        })
    }
}

/// The reading end of a stream.
#[derive(Debug)]
pub struct Subscription<M: Clone> {
    home: broadcast::Receiver<(M, Context)>,
    nodes: broadcast::Receiver<(M, Context)>,
    late: u64,
    missed: Arc<AtomicU64>,
    bus: Bus,
    name: &'static str,
    _subscribers: [Subscriber<()>; 2],
}

impl<M: Clone> Subscription<M> {
    /// Waits for the next message; `None` when the bus is closed. Lost messages are skipped and counted. Safe to cancel.
    ///
    /// Messages of the supervisor's machine come before those of nodes.
    pub async fn next(&mut self) -> Option<(M, Context)> {
        loop {
            let received = tokio::select! {
                biased;
                received = self.home.recv() => received,
                received = self.nodes.recv() => received,
            };
            match received {
                Ok(item) => return Some(item),
                Err(broadcast::error::RecvError::Lagged(n)) => {
                    self.late += n;
                    self.bus.inner.counters.drop(self.name, n);
                }
                Err(broadcast::error::RecvError::Closed) => return None,
            }
        }
    }

    /// Number of messages lost so far: in transit, and because this reader was slow.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.late + self.missed.load(Ordering::Relaxed)
    }
}

/// An undecoded message of any sender.
#[derive(Debug, Clone)]
pub struct WatchedMessage {
    /// Key expression, without the identity of a node.
    pub key: String,
    /// Full name of the message type; empty if the payload is not a protobuf message.
    pub message: String,
    /// Encoded message.
    pub payload: Vec<u8>,
    /// Its context.
    pub context: Context,
}

/// The reading end of all streams of a session.
#[derive(Debug)]
pub struct SessionWatch {
    receiver: broadcast::Receiver<WatchedMessage>,
    lost: u64,
    _subscribers: [Subscriber<()>; 2],
}

impl SessionWatch {
    /// Waits for the next message; `None` when the bus is closed.
    pub async fn next(&mut self) -> Option<WatchedMessage> {
        loop {
            match self.receiver.recv().await {
                Ok(message) => return Some(message),
                Err(broadcast::error::RecvError::Lagged(n)) => self.lost += n,
                Err(broadcast::error::RecvError::Closed) => return None,
            }
        }
    }

    /// Number of messages lost so far because this reader was slow.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_counted_and_a_restart_is_not_a_gap() {
        let received = Received::default();
        let missing = |key, epoch, sequence| received.missing(key, epoch, sequence);
        assert_eq!(missing("a", 1, 4), 0, "messages before the subscription are not lost");
        assert_eq!(missing("a", 1, 5), 0);
        assert_eq!(missing("a", 1, 9), 3);
        assert_eq!(missing("b", 1, 2), 0, "each sender counts for itself");
        assert_eq!(missing("a", 2, 1), 0);
        assert_eq!(missing("a", 2, 3), 1);
        assert_eq!(missing("a", 2, 0), 0, "unnumbered");
    }
}
