//! The bus as services see it: ask, answer, publish, follow, newest value, liveliness.
//!
//! Every receive path is bounded: a request that finds its queue full is refused at once, a stream reader that falls
//! behind loses the oldest messages, and both are counted.

use std::future::Future;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use prost::{Message, Name};
use sg_proto::bus::{Code, Error as WireError};
use sg_proto::keys::{self, Ask, Slot, Stream};
use tokio::sync::{broadcast, mpsc, watch};
use tokio::task::JoinHandle;
use zenoh::Wait;
use zenoh::query::{Query, QueryTarget};
use zenoh::sample::SampleKind;

use crate::context::Context;
use crate::fault::Fault;
use crate::wire;

/// Counters of one process's use of the bus.
#[derive(Debug, Default)]
pub struct Counters {
    /// Messages refused because of their type, size, form or sender.
    pub refused: AtomicU64,
    /// Stream messages lost and requests turned away because a bounded queue was full.
    pub dropped: AtomicU64,
    /// Requests answered, with a reply or a typed error.
    pub answered: AtomicU64,
}

/// A connection to one session's bus, under one role. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Bus {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    zenoh: zenoh::Session,
    session: String,
    role: String,
    counters: Counters,
}

/// A bus that could not be joined or opened.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// The endpoint could not be reached or opened.
    #[error("bus of session `{session}` at {endpoint}: {reason}")]
    Open {
        /// Session.
        session: String,
        /// Endpoint.
        endpoint: String,
        /// What the bus said.
        reason: String,
    },
    /// A key could not be declared.
    #[error("key `{key}` could not be declared: {reason}")]
    Declare {
        /// The key expression.
        key: String,
        /// What the bus said.
        reason: String,
    },
}

/// What is put to a role: a request, or nothing for the newest value.
struct Question<'a> {
    role: &'a str,
    name: &'static str,
    payload: Option<(&'a [u8], zenoh::bytes::Encoding)>,
}

/// How long a client tries to reach the router before it gives up.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);

impl Bus {
    /// Joins a session's bus as a client of the router that its supervisor embeds.
    ///
    /// # Errors
    /// [`BusError::Open`] if the router does not answer within five seconds.
    pub async fn connect(session: &str, role: &str, endpoint: &str) -> Result<Self, BusError> {
        Self::open(session, role, endpoint, false).await
    }

    /// Opens a session's router on a unix socket; everybody else is a client of it.
    ///
    /// # Errors
    /// [`BusError::Open`] if the socket cannot be opened.
    pub async fn route(session: &str, role: &str, socket: &Path) -> Result<Self, BusError> {
        Self::open(session, role, &endpoint_of(socket), true).await
    }

    async fn open(session: &str, role: &str, endpoint: &str, router: bool) -> Result<Self, BusError> {
        let fail = |reason: String| BusError::Open { session: session.into(), endpoint: endpoint.into(), reason };
        let config = config(endpoint, router).map_err(&fail)?;
        let opening = tokio::time::timeout(CONNECT_TIMEOUT, zenoh::open(config));
        let zenoh = match opening.await {
            Ok(Ok(zenoh)) => zenoh,
            Ok(Err(e)) => return Err(fail(e.to_string())),
            Err(_) => return Err(fail(format!("no answer within {} s", CONNECT_TIMEOUT.as_secs()))),
        };
        let inner = Inner { zenoh, session: session.into(), role: role.into(), counters: Counters::default() };
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Name of the session.
    #[must_use]
    pub fn session(&self) -> &str {
        &self.inner.session
    }

    /// Role under which this process sends.
    #[must_use]
    pub fn role(&self) -> &str {
        &self.inner.role
    }

    /// Counters of this connection.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.inner.counters
    }

    /// Asks the role of a row and waits for its reply, at most until the context's deadline.
    ///
    /// While nobody serves the role the question is put again under the same id, so a service that is being restarted
    /// is waited for; a role must therefore treat an id it has seen as the same request.
    ///
    /// # Errors
    /// The typed error of the service; `Unavailable` if nobody served the role, `DeadlineExceeded` if the answer did
    /// not come in time.
    pub async fn ask<Q, R>(&self, row: &Ask<Q, R>, request: &Q, context: &Context) -> Result<R, Fault>
    where
        Q: Message + Name,
        R: Message + Name + Default,
    {
        self.ask_role(row, row.role, request, context).await
    }

    /// As [`Bus::ask`], for rows that every role answers.
    ///
    /// # Errors
    /// As [`Bus::ask`].
    pub async fn ask_role<Q, R>(&self, row: &Ask<Q, R>, role: &str, request: &Q, context: &Context) -> Result<R, Fault>
    where
        Q: Message + Name,
        R: Message + Name + Default,
    {
        let payload = wire::encode(request)?;
        let question = Question { role, name: row.name, payload: Some((&payload, wire::encoding::<Q>())) };
        self.put_question(&question, context).await
    }

    /// Puts a question until somebody answers it or the deadline passes.
    async fn put_question<R>(&self, question: &Question<'_>, context: &Context) -> Result<R, Fault>
    where
        R: Message + Name + Default,
    {
        let mut pause = Duration::from_millis(10);
        loop {
            match self.put_once(question, context).await {
                Err(fault) if fault.code == Code::Unavailable && context.remaining() > pause => {
                    tokio::time::sleep(pause).await;
                    pause = (pause * 2).min(Duration::from_millis(200));
                }
                outcome => return outcome,
            }
        }
    }

    async fn put_once<R>(&self, question: &Question<'_>, context: &Context) -> Result<R, Fault>
    where
        R: Message + Name + Default,
    {
        let Question { role, name, payload } = question;
        let remaining = context.remaining();
        let late = || Fault::deadline(format!("`{role}` did not answer {name} in time"));
        if remaining.is_zero() {
            return Err(late());
        }
        let key = keys::key(&self.inner.session, role, name);
        let mut get = self.inner.zenoh.get(&key).target(QueryTarget::BestMatching).timeout(remaining);
        if let Some((payload, encoding)) = payload {
            let envelope = context.to_envelope(&self.inner.role).encode_to_vec();
            get = get.payload(payload.to_vec()).encoding(encoding.clone()).attachment(envelope);
        }
        let replies = get.await.map_err(|e| Fault::internal(format!("{key}: {e}")))?;
        // The bus ends a query by itself at its time-out, but its clock is coarse: ours decides.
        let first = tokio::time::timeout(remaining + Duration::from_millis(20), replies.recv_async()).await;
        match first {
            Err(_) => Err(late()),
            // No reply and no error: nobody is there, or who was there died.
            Ok(Err(_)) if context.remaining().is_zero() => Err(late()),
            Ok(Err(_)) => {
                Err(Fault::unavailable(format!("nobody serves `{role}` at the moment; try again in a moment")))
            }
            Ok(Ok(reply)) => match reply.result() {
                Ok(sample) => self.counted(wire::decode::<R>(sample.encoding(), sample.payload())),
                Err(error) => match wire::decode::<WireError>(error.encoding(), error.payload()) {
                    Ok(wire) => Err(Fault::from_wire(wire)),
                    // The bus reports its own time-out as an error reply in its own encoding.
                    Err(_) => Err(late()),
                },
            },
        }
    }

    /// Answers the requests of a row, one after another, from a queue of `capacity`.
    ///
    /// Requests of a wrong type, form, size or sender are refused before `handler` sees them; one that has waited past
    /// its deadline is answered `DeadlineExceeded` without work.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub async fn serve<Q, R, H, F>(
        &self,
        row: &Ask<Q, R>,
        role: &str,
        capacity: usize,
        mut handler: H,
    ) -> Result<Serving, BusError>
    where
        Q: Message + Name + Default + 'static,
        R: Message + Name + 'static,
        H: FnMut(Q, Context) -> F + Send + 'static,
        F: Future<Output = Result<R, Fault>> + Send,
    {
        let key = keys::key(&self.inner.session, role, row.name);
        let (sender, mut queue) = mpsc::channel::<(Query, Q, Context)>(capacity);
        let bus = self.clone();
        let row = *row;
        let queryable = self
            .inner
            .zenoh
            .declare_queryable(&key)
            .complete(true)
            .callback(move |query| match bus.admit(&row, &query) {
                Err(fault) => {
                    bus.inner.counters.refused.fetch_add(1, Ordering::Relaxed);
                    refuse(&query, &fault);
                }
                Ok((request, context)) => {
                    if let Err(error) = sender.try_send((query, request, context)) {
                        bus.inner.counters.dropped.fetch_add(1, Ordering::Relaxed);
                        let (fault, (query, ..)) = match error {
                            mpsc::error::TrySendError::Full(item) => (busy(row.name, capacity), item),
                            mpsc::error::TrySendError::Closed(item) => {
                                (Fault::unavailable("the service is stopping; try again in a moment"), item)
                            }
                        };
                        refuse(&query, &fault);
                    }
                }
            })
            .await
            .map_err(|e| BusError::Declare { key: key.clone(), reason: e.to_string() })?;

        let bus = self.clone();
        let worker = tokio::spawn(async move {
            while let Some((query, request, context)) = queue.recv().await {
                let outcome = if context.remaining().is_zero() {
                    Err(Fault::deadline("the request waited past its deadline and was not tried"))
                } else {
                    handler(request, context).await
                };
                bus.inner.counters.answered.fetch_add(1, Ordering::Relaxed);
                reply(&query, outcome.and_then(|r| wire::encode(&r).map(|bytes| (bytes, wire::encoding::<R>()))));
            }
        });
        Ok(Serving { queryable: Some(queryable), worker })
    }

    /// Type, size, form and sender of a request.
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
        let (Some(encoding), Some(payload)) = (query.encoding(), query.payload()) else {
            return Err(Fault::invalid(format!("a request without payload; this key takes `{}`", Q::full_name())));
        };
        Ok((wire::decode(encoding, payload)?, Context::from_envelope(envelope)))
    }

    /// Publishes one message of a stream. Nobody need listen; a slow listener does not hold the sender up.
    ///
    /// # Errors
    /// A message over the size limit, or a connection that is closed.
    pub async fn publish<M>(&self, row: &Stream<M>, message: &M, context: &Context) -> Result<(), Fault>
    where
        M: Message + Name,
    {
        self.put(row.name, message, context).await
    }

    async fn put<M: Message + Name>(&self, name: &str, message: &M, context: &Context) -> Result<(), Fault> {
        let key = keys::key(&self.inner.session, &self.inner.role, name);
        self.inner
            .zenoh
            .put(&key, wire::encode(message)?)
            .encoding(wire::encoding::<M>())
            .attachment(context.to_envelope(&self.inner.role).encode_to_vec())
            .await
            .map_err(|e| Fault::unavailable(format!("{key}: {e}")))
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
        let bus = self.clone();
        let subscriber = self
            .inner
            .zenoh
            .declare_subscriber(&key)
            .callback(move |sample| {
                let parts = wire::envelope(sample.attachment())
                    .and_then(|e| Ok((wire::decode::<M>(sample.encoding(), sample.payload())?, e)));
                if let Ok((message, envelope)) = bus.counted(parts) {
                    // Nobody listening any more is no fault: the reader is being dropped.
                    let _ = sender.send((message, Context::from_envelope(envelope)));
                }
            })
            .await
            .map_err(|e| BusError::Declare { key, reason: e.to_string() })?;
        Ok(Following { receiver, lost: 0, bus: self.clone(), _subscriber: subscriber })
    }

    /// Owns the newest value of a row: publishes every new one and hands the present one to late readers.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub async fn own<M>(&self, row: &Slot<M>, initial: M) -> Result<Owned<M>, BusError>
    where
        M: Message + Name + Clone + Sync + 'static,
    {
        let key = keys::key(&self.inner.session, &self.inner.role, row.name);
        let (sender, receiver) = watch::channel(initial);
        let queryable = self
            .inner
            .zenoh
            .declare_queryable(&key)
            .complete(true)
            .callback(move |query| {
                let newest = wire::encode(&*receiver.borrow());
                reply(&query, newest.map(|bytes| (bytes, wire::encoding::<M>())));
            })
            .await
            .map_err(|e| BusError::Declare { key, reason: e.to_string() })?;
        Ok(Owned { sender, bus: self.clone(), name: row.name, _queryable: queryable })
    }

    /// The newest value of a row right now.
    ///
    /// # Errors
    /// As [`Bus::ask`].
    pub async fn newest<M>(&self, row: &Slot<M>, context: &Context) -> Result<M, Fault>
    where
        M: Message + Name + Default,
    {
        let question = Question { role: row.role, name: row.name, payload: None };
        self.put_question(&question, context).await
    }

    /// Every message under any key of the session, undecoded: for people who watch.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub async fn watch_all(&self, capacity: usize) -> Result<Watching, BusError> {
        let key = format!("{}/{}/**", keys::ROOT, self.inner.session);
        let (sender, receiver) = broadcast::channel(capacity);
        let subscriber = self
            .inner
            .zenoh
            .declare_subscriber(&key)
            .callback(move |sample| {
                let envelope = wire::envelope(sample.attachment()).unwrap_or_default();
                let seen = Seen {
                    key: sample.key_expr().to_string(),
                    message: wire::message_name(sample.encoding()).unwrap_or_default(),
                    payload: sample.payload().to_bytes().into_owned(),
                    context: Context::from_envelope(envelope),
                };
                let _ = sender.send(seen);
            })
            .await
            .map_err(|e| BusError::Declare { key, reason: e.to_string() })?;
        Ok(Watching { receiver, lost: 0, _subscriber: subscriber })
    }

    /// Declares that an instance of this role is alive, until the token is dropped or the process dies.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub async fn declare_alive(&self, instance: &str) -> Result<Alive, BusError> {
        let key = keys::alive(&self.inner.session, &self.inner.role, instance);
        let token = self
            .inner
            .zenoh
            .liveliness()
            .declare_token(&key)
            .await
            .map_err(|e| BusError::Declare { key, reason: e.to_string() })?;
        Ok(Alive { _token: token })
    }

    /// Watches who comes and goes: role, instance, and whether it is alive; who is there already comes first.
    ///
    /// # Errors
    /// [`BusError::Declare`].
    pub async fn watch_alive(&self, capacity: usize) -> Result<mpsc::Receiver<Liveliness>, BusError> {
        let key = keys::alive(&self.inner.session, "*", "*");
        let (sender, receiver) = mpsc::channel(capacity);
        let bus = self.clone();
        self.inner
            .zenoh
            .liveliness()
            .declare_subscriber(&key)
            .history(true)
            .callback(move |sample| {
                let key = sample.key_expr().to_string();
                let mut parts = key.rsplit('/');
                if let (Some(instance), Some(role)) = (parts.next(), parts.next()) {
                    let alive = sample.kind() == SampleKind::Put;
                    let seen = Liveliness { role: role.to_owned(), instance: instance.to_owned(), alive };
                    if sender.try_send(seen).is_err() {
                        bus.inner.counters.dropped.fetch_add(1, Ordering::Relaxed);
                    }
                }
            })
            .background()
            .await
            .map_err(|e| BusError::Declare { key, reason: e.to_string() })?;
        Ok(receiver)
    }

    /// Leaves the bus. Bounded in time; what is still unsent then is lost, as it would be with the process.
    pub async fn close(&self) {
        let _ = tokio::time::timeout(Duration::from_secs(2), self.inner.zenoh.close()).await;
    }

    fn counted<T>(&self, outcome: Result<T, Fault>) -> Result<T, Fault> {
        if outcome.is_err() {
            self.inner.counters.refused.fetch_add(1, Ordering::Relaxed);
        }
        outcome
    }
}

/// The endpoint of a unix socket.
#[must_use]
pub fn endpoint_of(socket: &Path) -> String {
    format!("unixsock-stream/{}", socket.display())
}

fn config(endpoint: &str, router: bool) -> Result<zenoh::Config, String> {
    let mut config = zenoh::Config::default();
    let endpoints = serde_json::json!([endpoint]).to_string();
    let none = "[]".to_owned();
    let (listen, connect) = if router { (endpoints, none) } else { (none, endpoints) };
    let mode = if router { "\"router\"" } else { "\"client\"" };
    for (key, value) in [
        ("mode", mode),
        ("listen/endpoints", &listen),
        ("connect/endpoints", &connect),
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "false"),
        // A process that is stopped rather than dead is noticed by its lease.
        ("transport/link/tx/lease", "2000"),
        ("transport/link/rx/max_message_size", "8388608"),
    ] {
        config.insert_json5(key, value).map_err(|e| format!("setting {key}: {e}"))?;
    }
    Ok(config)
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

fn reply(query: &Query, outcome: Result<(Vec<u8>, zenoh::bytes::Encoding), Fault>) {
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
    queryable: Option<zenoh::query::Queryable<()>>,
    worker: JoinHandle<()>,
}

impl Serving {
    /// Accepts nothing new and waits, at most `time`, until every accepted request is answered.
    pub async fn drain(mut self, time: Duration) {
        if let Some(queryable) = self.queryable.take() {
            let _ = tokio::time::timeout(time, queryable.undeclare()).await;
        }
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

/// The reading end of a stream.
#[derive(Debug)]
pub struct Following<M: Clone> {
    receiver: broadcast::Receiver<(M, Context)>,
    lost: u64,
    bus: Bus,
    _subscriber: zenoh::pubsub::Subscriber<()>,
}

impl<M: Clone> Following<M> {
    /// The next message; `None` when the bus is closed. Lost messages are skipped and counted.
    pub async fn next(&mut self) -> Option<(M, Context)> {
        loop {
            match self.receiver.recv().await {
                Ok(item) => return Some(item),
                Err(broadcast::error::RecvError::Lagged(n)) => {
                    self.lost += n;
                    self.bus.inner.counters.dropped.fetch_add(n, Ordering::Relaxed);
                }
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
    _subscriber: zenoh::pubsub::Subscriber<()>,
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

/// The owning end of a newest value.
#[derive(Debug)]
pub struct Owned<M> {
    sender: watch::Sender<M>,
    bus: Bus,
    name: &'static str,
    _queryable: zenoh::query::Queryable<()>,
}

impl<M: Message + Name + Clone> Owned<M> {
    /// Replaces the value and tells whoever follows.
    ///
    /// # Errors
    /// As [`Bus::publish`]; the value is replaced all the same and late readers get it.
    pub async fn set(&self, value: M, context: &Context) -> Result<(), Fault> {
        self.sender.send_replace(value.clone());
        self.bus.put(self.name, &value, context).await
    }
}

/// A declared liveliness token.
#[derive(Debug)]
pub struct Alive {
    _token: zenoh::liveliness::LivelinessToken,
}

/// Somebody came or went.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Liveliness {
    /// Role.
    pub role: String,
    /// Instance.
    pub instance: String,
    /// Whether it came (true) or went.
    pub alive: bool,
}
