//! The server side of requests: validated, queued, handled one at a time, cancelled.

use std::collections::HashMap;
use std::future::Future;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use prost::{Message, Name};
use sg_proto::bus::{Code, Error as WireError};
use sg_proto::keys::{self, Request};
use tokio::sync::{Notify, mpsc};
use tokio::task::JoinHandle;
use tracing::Instrument as _;
use zenoh::Wait;
use zenoh::query::Query;

use super::addressing::DeclaredRow;
use super::{Bus, BusError};
use crate::context::Context;
use crate::fault::Fault;
use crate::metrics::{self, Metric};
use crate::trace::{self, Kind};
use crate::wire;

/// Requests without an answer yet, so that they can be cancelled.
#[derive(Debug, Default)]
pub(super) struct PendingRequests {
    next: AtomicU64,
    requests: Mutex<HashMap<u64, PendingRequest>>,
}

#[derive(Debug)]
struct PendingRequest {
    id: String,
    query: Query,
    cancelled: Arc<Notify>,
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
    /// - A request of a wrong type, form, size, sender or epoch is refused before `handler` sees it.
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
        let receive = move |query: Query| match bus.validate(&row, &query) {
            Err(fault) => {
                bus.inner.counters.refuse(row.name);
                refuse(&query, &fault);
            }
            Ok((request, context)) => {
                let pending = bus.add_pending(&context.id, &query);
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
                    refuse(&refused.query, &fault);
                }
            }
        };
        let declared = self.declare(row.role, row.name, Arc::new(receive)).await?;

        let bus = self.clone();
        let worker = tokio::spawn(async move {
            while let Some(QueuedRequest { query, request, context, pending, received }) = queue.recv().await {
                let (begun, started) = (Instant::now(), SystemTime::now());
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
                bus.inner.counters.answer(received.elapsed());
                let code = outcome.as_ref().err().map(|f| f.code);
                let labels = [("key", row.name), ("code", metrics::code(code))];
                metrics::observe(Metric::ServeSeconds, &labels, begun.elapsed());
                trace::record(&context, Kind::Server, || format!("serve {}", row.name), started, code);
                // The cancellation has answered it already.
                if !cancelled {
                    let encoded = outcome.and_then(|r| wire::encode(&r).map(|bytes| (bytes, wire::encoding::<R>())));
                    reply(&query, encoded);
                }
            }
        });
        Ok(ServerHandle { declared, worker })
    }

    /// Checks type, size, form, sender and epoch of a request.
    fn validate<Q, R>(&self, row: &Request<Q, R>, query: &Query) -> Result<(Q, Context), Fault>
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
        self.check_epoch(&envelope)?;
        let (Some(encoding), Some(payload)) = (query.encoding(), query.payload()) else {
            return Err(Fault::invalid(format!("a request without payload; send `{}`", Q::full_name())));
        };
        Ok((wire::decode(encoding, payload)?, Context::from_envelope(envelope)))
    }

    fn add_pending(&self, id: &str, query: &Query) -> PendingGuard {
        let number = self.inner.pending.next.fetch_add(1, Ordering::Relaxed);
        let cancelled = Arc::new(Notify::new());
        let request = PendingRequest { id: id.to_owned(), query: query.clone(), cancelled: Arc::clone(&cancelled) };
        // The queues of all rows bound their number.
        self.inner.pending.requests.lock().unwrap_or_else(PoisonError::into_inner).insert(number, request);
        PendingGuard { bus: self.clone(), number, cancelled }
    }

    /// Answers every pending request of this id with `Cancelled` and drops its handler. Returns whether there was one.
    #[must_use]
    pub fn cancel_pending(&self, id: &str) -> bool {
        let mut requests = self.inner.pending.requests.lock().unwrap_or_else(PoisonError::into_inner);
        let numbers: Vec<u64> =
            requests.iter().filter(|(_, r)| !id.is_empty() && r.id == id).map(|(n, _)| *n).collect();
        for number in &numbers {
            if let Some(request) = requests.remove(number) {
                refuse(&request.query, &cancellation());
                request.cancelled.notify_one();
            }
        }
        !numbers.is_empty()
    }
}

fn cancellation() -> Fault {
    Fault::new(Code::Cancelled, "the request was cancelled; changes made before that remain")
}

fn busy(name: &str, capacity: usize) -> Fault {
    Fault {
        retry_after: Some(Duration::from_millis(100)),
        ..Fault::exhausted(format!("the queue of {name} is full ({capacity} requests); try again in a moment"))
    }
}

fn refuse(query: &Query, fault: &Fault) {
    let bytes = fault.to_wire().encode_to_vec();
    if let Err(error) = query.reply_err(bytes).encoding(wire::encoding::<WireError>()).wait() {
        tracing::debug!(key = %query.key_expr(), %error, "an error could not be sent: the caller has gone");
    }
}

pub(super) fn reply(query: &Query, outcome: Result<(Vec<u8>, zenoh::bytes::Encoding), Fault>) {
    match outcome {
        Err(fault) => refuse(query, &fault),
        Ok((bytes, encoding)) => {
            if let Err(error) = query.reply(query.key_expr().clone(), bytes).encoding(encoding).wait() {
                tracing::debug!(key = %query.key_expr(), %error, "a reply could not be sent: the caller has gone");
            }
        }
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
