//! Answers: requests of a row, admitted, queued, handled one after another, withdrawn.

use std::collections::HashMap;
use std::future::Future;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use prost::{Message, Name};
use sg_proto::bus::{Code, Error as WireError};
use sg_proto::keys::{self, Ask};
use tokio::sync::{Notify, mpsc};
use tokio::task::JoinHandle;
use tracing::Instrument as _;
use zenoh::Wait;
use zenoh::query::Query;

use super::place::Declared;
use super::{Bus, BusError};
use crate::context::Context;
use crate::fault::Fault;
use crate::metrics::{self, Metric};
use crate::trace::{self, Kind};
use crate::wire;

/// Requests that were admitted and are not answered yet, so that they can be withdrawn.
#[derive(Debug, Default)]
pub(super) struct Pending {
    next: AtomicU64,
    requests: Mutex<HashMap<u64, Waiting>>,
}

#[derive(Debug)]
struct Waiting {
    id: String,
    query: Query,
    withdrawn: Arc<Notify>,
}

/// A place among the pending requests, given back when dropped.
struct Ticket {
    bus: Bus,
    number: u64,
    withdrawn: Arc<Notify>,
}

impl Drop for Ticket {
    fn drop(&mut self) {
        let requests = &self.bus.inner.pending.requests;
        requests.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.number);
    }
}

/// A request in the queue of its row.
struct Admitted<Q> {
    query: Query,
    request: Q,
    context: Context,
    ticket: Ticket,
    received: Instant,
}

impl Bus {
    /// Answers the requests of a row, one after another, from a queue of `capacity`.
    ///
    /// Requests of a wrong type, form, size, sender or epoch are refused before `handler` sees them; one that has waited
    /// past its deadline is answered `DeadlineExceeded` without work; one that was withdrawn is answered `Cancelled` and
    /// its handler dropped.
    ///
    /// # Errors
    /// [`BusError::Declare`], also for a row of another role.
    pub async fn serve<Q, R, H, F>(&self, row: &Ask<Q, R>, capacity: usize, mut handler: H) -> Result<Serving, BusError>
    where
        Q: Message + Name + Default + 'static,
        R: Message + Name + 'static,
        H: FnMut(Q, Context) -> F + Send + 'static,
        F: Future<Output = Result<R, Fault>> + Send,
    {
        let (sender, mut queue) = mpsc::channel::<Admitted<Q>>(capacity);
        let (bus, row) = (self.clone(), *row);
        let receive = move |query: Query| match bus.admit(&row, &query) {
            Err(fault) => {
                bus.inner.counters.refuse(row.name);
                refuse(&query, &fault);
            }
            Ok((request, context)) => {
                let ticket = bus.ticket(&context.id, &query);
                if let Err(error) =
                    sender.try_send(Admitted { query, request, context, ticket, received: Instant::now() })
                {
                    bus.inner.counters.drop(row.name, 1);
                    let (fault, admitted) = match error {
                        mpsc::error::TrySendError::Full(item) => (busy(row.name, capacity), item),
                        mpsc::error::TrySendError::Closed(item) => {
                            (Fault::unavailable("the service is stopping; try again in a moment"), item)
                        }
                    };
                    refuse(&admitted.query, &fault);
                }
            }
        };
        let declared = self.declare(row.role, row.name, Arc::new(receive)).await?;

        let bus = self.clone();
        let worker = tokio::spawn(async move {
            while let Some(Admitted { query, request, context, ticket, received }) = queue.recv().await {
                let (begun, started) = (Instant::now(), SystemTime::now());
                let context = context.entered();
                let span = tracing::info_span!("serve", trace_id = context.trace_id(), key = row.name);
                let mut withdrawn = false;
                let outcome = if context.remaining().is_zero() {
                    Err(Fault::deadline("the request waited past its deadline and was not tried"))
                } else {
                    let handling = handler(request, context.clone()).instrument(span);
                    tokio::select! {
                        biased;
                        () = ticket.withdrawn.notified() => {
                            withdrawn = true;
                            Err(cancelled())
                        }
                        outcome = handling => outcome,
                    }
                };
                bus.inner.counters.answer(received.elapsed());
                let code = outcome.as_ref().err().map(|f| f.code);
                let labels = [("key", row.name), ("code", metrics::code(code))];
                metrics::observe(Metric::ServeSeconds, &labels, begun.elapsed());
                trace::record(&context, Kind::Server, || format!("serve {}", row.name), started, code);
                // Who withdrew a request has been answered.
                if !withdrawn {
                    let encoded = outcome.and_then(|r| wire::encode(&r).map(|bytes| (bytes, wire::encoding::<R>())));
                    reply(&query, encoded);
                }
            }
        });
        Ok(Serving { declared, worker })
    }

    /// Type, size, form, sender and epoch of a request.
    fn admit<Q, R>(&self, row: &Ask<Q, R>, query: &Query) -> Result<(Q, Context), Fault>
    where
        Q: Message + Name + Default + 'static,
    {
        let envelope = wire::envelope(query.attachment())?;
        if !row.senders.iter().any(|s| *s == keys::ANY || *s == envelope.sender) {
            return Err(Fault::new(
                Code::PermissionDenied,
                format!("`{}` may not ask {}; only {} may", envelope.sender, row.name, row.senders.join(", ")),
            ));
        }
        self.check_epoch(&envelope)?;
        let (Some(encoding), Some(payload)) = (query.encoding(), query.payload()) else {
            return Err(Fault::invalid(format!("a request without payload; this key takes `{}`", Q::full_name())));
        };
        Ok((wire::decode(encoding, payload)?, Context::from_envelope(envelope)))
    }

    fn ticket(&self, id: &str, query: &Query) -> Ticket {
        let number = self.inner.pending.next.fetch_add(1, Ordering::Relaxed);
        let withdrawn = Arc::new(Notify::new());
        let waiting = Waiting { id: id.to_owned(), query: query.clone(), withdrawn: Arc::clone(&withdrawn) };
        // As many as the queues of all rows hold.
        self.inner.pending.requests.lock().unwrap_or_else(PoisonError::into_inner).insert(number, waiting);
        Ticket { bus: self.clone(), number, withdrawn }
    }

    /// Answers every pending request of this id `Cancelled` and drops the handler that works on it; whether there was one.
    #[must_use]
    pub fn withdraw(&self, id: &str) -> bool {
        let mut requests = self.inner.pending.requests.lock().unwrap_or_else(PoisonError::into_inner);
        let numbers: Vec<u64> =
            requests.iter().filter(|(_, w)| !id.is_empty() && w.id == id).map(|(n, _)| *n).collect();
        for number in &numbers {
            if let Some(waiting) = requests.remove(number) {
                refuse(&waiting.query, &cancelled());
                waiting.withdrawn.notify_one();
            }
        }
        !numbers.is_empty()
    }
}

fn cancelled() -> Fault {
    Fault::new(Code::Cancelled, "the request was withdrawn; what was done by then stays done")
}

fn busy(name: &str, capacity: usize) -> Fault {
    Fault {
        retry_after: Some(Duration::from_millis(100)),
        ..Fault::exhausted(format!("{capacity} requests of {name} are waiting already; try again in a moment"))
    }
}

fn refuse(query: &Query, fault: &Fault) {
    let bytes = fault.to_wire().encode_to_vec();
    if let Err(error) = query.reply_err(bytes).encoding(wire::encoding::<WireError>()).wait() {
        tracing::debug!(key = %query.key_expr(), %error, "a refusal could not be sent: the asker is gone");
    }
}

pub(super) fn reply(query: &Query, outcome: Result<(Vec<u8>, zenoh::bytes::Encoding), Fault>) {
    match outcome {
        Err(fault) => refuse(query, &fault),
        Ok((bytes, encoding)) => {
            if let Err(error) = query.reply(query.key_expr().clone(), bytes).encoding(encoding).wait() {
                tracing::debug!(key = %query.key_expr(), %error, "a reply could not be sent: the asker is gone");
            }
        }
    }
}

/// A row that is being answered; dropping it stops at once, [`Serving::drain`] finishes what was accepted.
#[derive(Debug)]
pub struct Serving {
    declared: Arc<Declared>,
    worker: JoinHandle<()>,
}

impl Serving {
    /// Accepts nothing new and waits, at most `time`, until every accepted request is answered.
    pub async fn drain(mut self, time: Duration) {
        let _ = tokio::time::timeout(time, self.declared.withdraw()).await;
        if tokio::time::timeout(time, &mut self.worker).await.is_err() {
            tracing::warn!(seconds = time.as_secs_f64(), "requests were still waiting when the time to drain ran out");
        }
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        self.worker.abort();
    }
}
