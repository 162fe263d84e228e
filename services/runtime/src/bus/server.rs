//! The server side of requests: validated, queued, handled one at a time, cancelled.

use std::collections::{BTreeMap, HashMap};
use std::future::Future;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use prost::{Message, Name};
use sg_proto::bus::{Code, Envelope, Error as WireError, RowHealth};
use sg_proto::keys::{self, Identity, Request};
use sg_proto::limits::NODE_OPEN_REQUESTS;
use tokio::sync::{Notify, mpsc};
use tokio::task::JoinHandle;
use tracing::Instrument as _;
use zenoh::Wait;
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::query::Query;

use super::addressing::DeclaredRow;
use super::{Bus, BusError};
use crate::actor::millis;
use crate::context::Context;
use crate::fault::Fault;
use crate::metrics::{self, Metric};
use crate::progress::Progress;
use crate::trace::{self, Kind};
use crate::wire;

/// Requests without an answer yet, so that they can be cancelled.
#[derive(Debug, Default)]
pub(super) struct PendingRequests {
    next: AtomicU64,
    requests: Mutex<HashMap<u64, PendingRequest>>,
    /// Progress of the handlers, by row.
    rows: Mutex<BTreeMap<&'static str, Progress>>,
}

#[derive(Debug)]
struct PendingRequest {
    id: String,
    /// Node of the caller; absent for the supervisor's machine.
    node: Option<String>,
    query: Query,
    cancelled: Arc<Notify>,
    row: &'static str,
    /// Time of the receipt; `None` once a handler has taken it.
    waits_since: Option<Instant>,
}

/// Removes a pending request when dropped.
struct PendingGuard {
    bus: Bus,
    number: u64,
    cancelled: Arc<Notify>,
}

impl Drop for PendingGuard {
    fn drop(&mut self) {
        let requests = &self.bus.inner.pending.requests;
        requests.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.number);
    }
}

impl PendingGuard {
    /// Notes that a handler has taken the request.
    fn begin(&self) {
        let requests = &self.bus.inner.pending.requests;
        let mut requests = requests.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(request) = requests.get_mut(&self.number) {
            request.waits_since = None;
        }
    }
}

/// A request in the queue of its row.
struct QueuedRequest<Q> {
    query: Query,
    request: Q,
    context: Context,
    pending: PendingGuard,
    received: Instant,
}

impl Bus {
    /// Answers the requests of a row, one at a time, from a queue of `capacity`.
    ///
    /// - A request of a wrong type, form, size, sender or epoch is refused before `handler` sees it. So is one of a node that
    ///   has used up its quota.
    /// - A request that waited past its deadline gets `DeadlineExceeded` without work.
    /// - A cancelled request gets `Cancelled`, and the future of its handler is dropped.
    ///
    /// # Errors
    /// [`BusError::Declare`], also for a row of another role.
    pub async fn serve<Q, R, H, F>(
        &self,
        row: &Request<Q, R>,
        capacity: usize,
        mut handler: H,
    ) -> Result<ServerHandle, BusError>
    where
        Q: Message + Name + Default + 'static,
        R: Message + Name + 'static,
        H: FnMut(Q, Context) -> F + Send + 'static,
        F: Future<Output = Result<R, Fault>> + Send,
    {
        let (sender, mut queue) = mpsc::channel::<QueuedRequest<Q>>(capacity);
        let (bus, row) = (self.clone(), *row);
        let receive = move |query: Query| {
            let identity = match bus.admit(&query, row.name) {
                Ok(identity) => identity,
                Err(fault) => return bus.refuse(&query, &fault),
            };
            let (request, context) = match bus.validate(&row, &query, identity) {
                Ok(valid) => valid,
                Err(fault) => {
                    bus.inner.counters.refuse(row.name);
                    return bus.refuse(&query, &fault);
                }
            };
            let Some(pending) = bus.add_pending(row.name, &context, &query) else {
                bus.inner.counters.drop(row.name, 1);
                return bus.refuse(&query, &too_many_open());
            };
            // Nodes leave a quarter of the queue to the supervisor's machine.
            if context.identity.is_some() && sender.capacity() <= sender.max_capacity() / 4 {
                bus.inner.counters.drop(row.name, 1);
                return bus.refuse(&query, &busy(row.name, capacity));
            }
            if let Err(error) =
                sender.try_send(QueuedRequest { query, request, context, pending, received: Instant::now() })
            {
                bus.inner.counters.drop(row.name, 1);
                let (fault, refused) = match error {
                    mpsc::error::TrySendError::Full(item) => (busy(row.name, capacity), item),
                    mpsc::error::TrySendError::Closed(item) => {
                        (Fault::unavailable("the service is stopping; try again in a moment"), item)
                    }
                };
                bus.refuse(&refused.query, &fault);
            }
        };
        let declared = self.declare(row.role, row.name, !row.local_only, Arc::new(receive)).await?;

        let bus = self.clone();
        let progress = Progress::default();
        let rows = &self.inner.pending.rows;
        rows.lock().unwrap_or_else(PoisonError::into_inner).insert(row.name, progress.clone());
        let worker = tokio::spawn(progress.clone().scope(async move {
            while let Some(QueuedRequest { query, request, context, pending, received }) = queue.recv().await {
                let (begun, started) = (Instant::now(), SystemTime::now());
                pending.begin();
                progress.begin(row.name);
                let context = context.in_span();
                let span = tracing::info_span!("serve", trace_id = context.trace_id(), key = row.name);
                let mut cancelled = false;
                let outcome = if context.remaining().is_zero() {
                    Err(Fault::deadline("the request waited past its deadline and was not tried"))
                } else {
                    let handling = handler(request, context.clone()).instrument(span);
                    tokio::select! {
                        biased;
                        () = pending.cancelled.notified() => {
                            cancelled = true;
                            Err(cancellation())
                        }
                        outcome = handling => outcome,
                    }
                };
                progress.end();
                bus.inner.counters.answer(received.elapsed());
                let code = outcome.as_ref().err().map(|f| f.code);
                let labels = [("key", row.name), ("code", metrics::code(code))];
                metrics::observe(Metric::ServeSeconds, &labels, begun.elapsed());
                trace::record(&context, Kind::Server, || format!("serve {}", row.name), started, code);
                // The cancellation has answered it already.
                if !cancelled {
                    let encoded = outcome.and_then(|r| wire::encode(&r).map(|bytes| (bytes, wire::encoding::<R>())));
                    bus.reply(&query, encoded);
                }
            }
        }));
        Ok(ServerHandle { declared, worker })
    }

    /// Reads the sender of a query from its key, and takes the query out of the sender's quota. Counts a failure.
    pub(super) fn admit(&self, query: &Query, name: &'static str) -> Result<Option<Identity>, Fault> {
        let identity = self.counted(name, self.origin(query.key_expr().as_str(), name))?.identity;
        let bytes = query.payload().map_or(0, ZBytes::len) + query.attachment().map_or(0, ZBytes::len);
        if let Err(fault) = self.check_quota(identity.as_ref(), bytes) {
            self.inner.counters.drop(name, 1);
            return Err(fault);
        }
        Ok(identity)
    }

    /// Checks type, size, form, sender and epoch of a request.
    fn validate<Q, R>(
        &self,
        row: &Request<Q, R>,
        query: &Query,
        identity: Option<Identity>,
    ) -> Result<(Q, Context), Fault>
    where
        Q: Message + Name + Default + 'static,
    {
        let envelope = wire::envelope(query.attachment())?;
        if !row.senders.iter().any(|s| *s == keys::ANY || *s == envelope.sender) {
            return Err(Fault::new(
                Code::PermissionDenied,
                format!("`{}` may not send {}; only {} may", envelope.sender, row.name, row.senders.join(", ")),
            ));
        }
        self.check_sender(identity.as_ref(), &envelope)?;
        let (Some(encoding), Some(payload)) = (query.encoding(), query.payload()) else {
            return Err(Fault::invalid(format!("a request without payload; send `{}`", Q::full_name())));
        };
        Ok((wire::decode(encoding, payload)?, Context::from_envelope(envelope, identity)))
    }

    /// Notes a request until it is answered; `None` if too many of the same node wait.
    fn add_pending(&self, row: &'static str, context: &Context, query: &Query) -> Option<PendingGuard> {
        let number = self.inner.pending.next.fetch_add(1, Ordering::Relaxed);
        let cancelled = Arc::new(Notify::new());
        let node = context.identity.as_ref().map(|i| i.node.clone());
        // The queues of all rows bound their number.
        let mut requests = self.inner.pending.requests.lock().unwrap_or_else(PoisonError::into_inner);
        if node.is_some() && requests.values().filter(|r| r.node == node).count() >= NODE_OPEN_REQUESTS {
            return None;
        }
        let (id, query, waits_since) = (context.id.clone(), query.clone(), Some(Instant::now()));
        let cancel = Arc::clone(&cancelled);
        requests.insert(number, PendingRequest { id, node, query, cancelled: cancel, row, waits_since });
        Some(PendingGuard { bus: self.clone(), number, cancelled })
    }

    /// The served rows with unanswered requests, by name.
    #[must_use]
    pub fn row_health(&self) -> Vec<RowHealth> {
        let pending = &self.inner.pending;
        let rows = pending.rows.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let requests = pending.requests.lock().unwrap_or_else(PoisonError::into_inner);
        let health = rows.into_iter().filter_map(|(name, progress)| {
            let mut of_row = requests.values().filter(|r| r.row == name).peekable();
            of_row.peek()?;
            let waiting: Vec<Instant> = of_row.filter_map(|r| r.waits_since).collect();
            Some(RowHealth {
                name: name.to_owned(),
                queued: u32::try_from(waiting.len()).unwrap_or(u32::MAX),
                waited_ms: waiting.iter().min().map_or(0, |since| millis(since.elapsed())),
                busy_ms: progress.busy().map_or(0, |(_, time)| millis(time)),
            })
        });
        health.collect()
    }

    /// Answers every pending request of this id with `Cancelled` and drops its handler. Returns whether there was one.
    ///
    /// `by` is the context of the cancellation. A node can cancel its own requests only.
    #[must_use]
    pub fn cancel_pending(&self, id: &str, by: &Context) -> bool {
        let node = by.identity.as_ref().map(|i| i.node.as_str());
        let may_cancel = |r: &PendingRequest| node.is_none() || node == r.node.as_deref();
        let mut requests = self.inner.pending.requests.lock().unwrap_or_else(PoisonError::into_inner);
        let numbers: Vec<u64> =
            requests.iter().filter(|(_, r)| !id.is_empty() && r.id == id && may_cancel(r)).map(|(n, _)| *n).collect();
        for number in &numbers {
            if let Some(request) = requests.remove(number) {
                self.refuse(&request.query, &cancellation());
                request.cancelled.notify_one();
            }
        }
        !numbers.is_empty()
    }

    fn refuse(&self, query: &Query, fault: &Fault) {
        let bytes = fault.to_wire().encode_to_vec();
        let encoding = wire::encoding::<WireError>();
        // The bus gives an error the key of its query. A node may answer under its own keys only, so it sends a reply.
        let sent = match self.replying_key(query) {
            Some(key) => self.send_reply(query, &key, bytes, encoding),
            None => query.reply_err(bytes).encoding(encoding).wait(),
        };
        if let Err(error) = sent {
            tracing::debug!(key = %query.key_expr(), %error, "an error could not be sent: the caller has gone");
        }
    }

    pub(super) fn reply(&self, query: &Query, outcome: Result<(Vec<u8>, Encoding), Fault>) {
        match outcome {
            Err(fault) => self.refuse(query, &fault),
            Ok((bytes, encoding)) => {
                let key = self.replying_key(query).unwrap_or_else(|| query.key_expr().to_string());
                if let Err(error) = self.send_reply(query, &key, bytes, encoding) {
                    tracing::debug!(key = %query.key_expr(), %error, "a reply could not be sent: the caller has gone");
                }
            }
        }
    }

    /// Key of a reply that carries the identity of this process; `None` on the supervisor's machine.
    fn replying_key(&self, query: &Query) -> Option<String> {
        let identity = self.inner.identity.as_ref()?;
        let (_, rest) = keys::split(self.session(), query.key_expr().as_str())?;
        Some(identity.key(self.session(), rest))
    }

    fn send_reply(&self, query: &Query, key: &str, bytes: Vec<u8>, encoding: Encoding) -> zenoh::Result<()> {
        let envelope = Envelope { sender: self.role().to_owned(), epoch: self.epoch(), ..Envelope::default() };
        query.reply(key, bytes).encoding(encoding).attachment(envelope.encode_to_vec()).wait()
    }
}

fn cancellation() -> Fault {
    Fault::new(Code::Cancelled, "the request was cancelled; changes made before that remain")
}

fn too_many_open() -> Fault {
    Fault {
        retry_after: Some(Duration::from_millis(100)),
        ..Fault::exhausted(format!("{NODE_OPEN_REQUESTS} requests of this node wait already; try again in a moment"))
    }
}

fn busy(name: &str, capacity: usize) -> Fault {
    Fault {
        retry_after: Some(Duration::from_millis(100)),
        ..Fault::exhausted(format!("the queue of {name} is full ({capacity} requests); try again in a moment"))
    }
}

/// A row that is being answered. Dropping it stops at once; [`ServerHandle::drain`] finishes accepted requests.
#[derive(Debug)]
pub struct ServerHandle {
    declared: Arc<DeclaredRow>,
    worker: JoinHandle<()>,
}

impl ServerHandle {
    /// Accepts no new request and waits at most `limit` until every accepted one is answered.
    pub async fn drain(mut self, limit: Duration) {
        let _ = tokio::time::timeout(limit, self.declared.undeclare()).await;
        if tokio::time::timeout(limit, &mut self.worker).await.is_err() {
            tracing::warn!(seconds = limit.as_secs_f64(), "requests were still pending at the end of the drain time");
        }
    }
}

impl Drop for ServerHandle {
    fn drop(&mut self) {
        self.worker.abort();
    }
}
