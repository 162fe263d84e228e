//! The client side of requests: sent to a role until it answers or the deadline passes.

use std::time::{Duration, Instant, SystemTime};

use prost::{Message, Name};
use sg_proto::bus::{CancelRequest, Code, Error as WireError, Health, StatusRequest};
use sg_proto::keys::{self, Identity, Priority, Request, Retained};
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::handlers::FifoChannelHandler;
use zenoh::query::{QueryTarget, Reply, ReplyKeyExpr};
use zenoh::sample::Sample;

use super::identity::Origin;
use super::{BoxFuture, Bus};
use crate::context::Context;
use crate::fault::Fault;
use crate::metrics::{self, Metric};
use crate::trace::{self, Kind};
use crate::wire;

/// A query to a role: a request, or no payload for a retained value.
struct RoleQuery<'a> {
    role: &'a str,
    name: &'static str,
    priority: Priority,
    /// Reference counted, so a retry copies nothing.
    payload: Option<(ZBytes, Encoding)>,
}

/// Replies to a query, as they come.
type Replies = FifoChannelHandler<Reply>;

/// A reply, with its sender if that is a process on a node.
struct QueryReply {
    encoding: Encoding,
    payload: ZBytes,
    identity: Option<Identity>,
}

/// First pause between two tries.
const FIRST_PAUSE: Duration = Duration::from_millis(10);

/// Longest pause between two tries. A caller notices a restarted service at most this much later.
const LONGEST_PAUSE: Duration = Duration::from_millis(50);

/// Time without a reply after which the role's process is asked for its age; doubled after each answer.
const FIRST_DOUBT: Duration = Duration::from_secs(1);

/// Longest wait for that answer.
const STATUS_TIMEOUT: Duration = Duration::from_millis(500);

/// Deadline of a cancellation.
const CANCEL_TIMEOUT: Duration = Duration::from_secs(1);

impl Bus {
    /// Sends a request to the role of a row and waits for its reply until the deadline of `context`.
    ///
    /// While no process serves the role, the request is sent again under the same id. A call thus survives a restart of the
    /// service. A service must treat a repeated id as the same request.
    ///
    /// # Errors
    /// The typed error of the service; `Unavailable` if no process served the role; `DeadlineExceeded` without a reply in
    /// time.
    pub async fn ask<Q, R>(&self, row: &Request<Q, R>, request: &Q, context: &Context) -> Result<R, Fault>
    where
        Q: Message + Name,
        R: Message + Name + Default,
    {
        self.ask_role(row, row.role, request, context).await
    }

    /// As [`Bus::ask`], to a given role or to one instance ([`keys::instance`]).
    ///
    /// # Errors
    /// As in [`Bus::ask`].
    pub async fn ask_role<Q, R>(
        &self,
        row: &Request<Q, R>,
        role: &str,
        request: &Q,
        context: &Context,
    ) -> Result<R, Fault>
    where
        Q: Message + Name,
        R: Message + Name + Default,
    {
        let payload = Some((ZBytes::from(wire::encode(request)?), wire::encoding::<Q>()));
        let query = RoleQuery { role, name: row.name, priority: row.priority, payload };
        Ok(self.query(&query, context).await?.0)
    }

    /// As [`Bus::ask`], with the sender of the reply: a process on a node, or `None` for the supervisor's machine.
    ///
    /// # Errors
    /// As in [`Bus::ask`].
    pub async fn ask_identified<Q, R>(
        &self,
        row: &Request<Q, R>,
        request: &Q,
        context: &Context,
    ) -> Result<(R, Option<Identity>), Fault>
    where
        Q: Message + Name,
        R: Message + Name + Default,
    {
        let payload = Some((ZBytes::from(wire::encode(request)?), wire::encoding::<Q>()));
        let query = RoleQuery { role: row.role, name: row.name, priority: row.priority, payload };
        self.query(&query, context).await
    }

    /// Asks for the newest value of a row.
    ///
    /// # Errors
    /// As in [`Bus::ask`].
    pub async fn newest<M>(&self, row: &Retained<M>, context: &Context) -> Result<M, Fault>
    where
        M: Message + Name + Default,
    {
        Ok(self.newest_identified(row, context).await?.0)
    }

    /// As [`Bus::newest`], with the sender of the value, as in [`Bus::ask_identified`].
    ///
    /// # Errors
    /// As in [`Bus::ask`].
    pub async fn newest_identified<M>(
        &self,
        row: &Retained<M>,
        context: &Context,
    ) -> Result<(M, Option<Identity>), Fault>
    where
        M: Message + Name + Default,
    {
        let query = RoleQuery { role: row.role, name: row.name, priority: Priority::Normal, payload: None };
        self.query(&query, context).await
    }

    /// Cancels a request to a role. Returns whether the request was pending.
    ///
    /// # Errors
    /// As in [`Bus::ask`].
    pub async fn cancel(&self, role: &str, id: &str) -> Result<bool, Fault> {
        let context = Context::root().deadline_in(CANCEL_TIMEOUT);
        let request = CancelRequest { id: id.to_owned() };
        Ok(self.ask_role(&keys::CANCEL, role, &request, &context).await?.found)
    }

    /// Sends a query and decodes its reply.
    async fn query<R>(&self, query: &RoleQuery<'_>, context: &Context) -> Result<(R, Option<Identity>), Fault>
    where
        R: Message + Name + Default,
    {
        let QueryReply { encoding, payload, identity } = self.query_until_answered(query, context).await?;
        Ok((self.counted(query.name, wire::decode::<R>(&encoding, &payload))?, identity))
    }

    /// Sends a query until a process answers it or the deadline passes.
    ///
    /// Neither generic nor `async`, as all code that calls zenoh: see [`BoxFuture`].
    fn query_until_answered<'a>(
        &'a self,
        query: &'a RoleQuery<'a>,
        context: &'a Context,
    ) -> BoxFuture<'a, Result<QueryReply, Fault>> {
        Box::pin(async move {
            let (begun, started) = (Instant::now(), SystemTime::now());
            let mut pause = FIRST_PAUSE;
            let outcome = loop {
                match self.query_once(query, context).await {
                    Err(fault) if fault.code == Code::Unavailable && context.remaining() > pause => {
                        metrics::count(Metric::Retries, &[("key", query.name)], 1);
                        tokio::time::sleep(pause).await;
                        pause = (pause * 2).min(LONGEST_PAUSE);
                    }
                    outcome => break outcome,
                }
            };
            let code = outcome.as_ref().err().map(|f| f.code);
            let labels = [("key", query.name), ("code", metrics::code(code))];
            metrics::observe(Metric::AskSeconds, &labels, begun.elapsed());
            trace::record(context, Kind::Client, || format!("ask {} {}", query.role, query.name), started, code);
            outcome
        })
    }

    async fn query_once(&self, query: &RoleQuery<'_>, context: &Context) -> Result<QueryReply, Fault> {
        let RoleQuery { role, name, .. } = query;
        let remaining = context.remaining();
        let late = || Fault::deadline(format!("`{role}` did not answer {name} in time"));
        if remaining.is_zero() {
            return Err(late());
        }
        let key = self.sending_key(role, name);
        let replies = self.send(query, &key, context).await?;
        let sent = Instant::now();
        // The bus also ends a query at its timeout, but its clock is coarse.
        let end = remaining + Duration::from_millis(20);
        let mut patience = FIRST_DOUBT;
        let first = loop {
            let rest = end.saturating_sub(sent.elapsed());
            match tokio::time::timeout(rest.min(patience), replies.recv_async()).await {
                Err(_) if patience < rest => {
                    if self.has_newer_process(role, sent).await {
                        return Err(Fault::unavailable(format!(
                            "the process of `{role}` ended before it answered {name}"
                        )));
                    }
                    patience *= 2;
                }
                outcome => break outcome,
            }
        };
        match first {
            Err(_) => Err(late()),
            // Neither a reply nor an error: no process serves the role, or it has died.
            Ok(Err(_)) if context.remaining().is_zero() => Err(late()),
            Ok(Err(_)) => {
                Err(Fault::unavailable(format!("no process serves `{role}` at the moment; try again in a moment")))
            }
            Ok(Ok(reply)) => match reply.result() {
                Ok(sample) => self.check_reply(query, &key, sample),
                Err(error) => match wire::decode::<WireError>(error.encoding(), error.payload()) {
                    Ok(wire) => Err(Fault::from_wire(wire)),
                    // The bus reports its own timeout as an error in its own encoding.
                    Err(_) => Err(late()),
                },
            },
        }
    }

    /// Sends a query once. Its replies come until the deadline of `context`.
    async fn send(&self, query: &RoleQuery<'_>, key: &str, context: &Context) -> Result<Replies, Fault> {
        let mut get = self
            .inner
            .zenoh
            .get(key)
            .target(QueryTarget::BestMatching)
            // A process on a node replies under its own key.
            .accept_replies(ReplyKeyExpr::Any)
            .priority(zenoh_priority(query.priority))
            .timeout(context.remaining());
        if let Some((payload, encoding)) = &query.payload {
            let envelope = context.to_envelope(&self.inner.role, self.epoch(), 0).encode_to_vec();
            get = get.payload(payload.clone()).encoding(encoding.clone()).attachment(envelope);
        }
        get.await.map_err(|e| Fault::internal(format!("{key}: {e}")))
    }

    /// Whether the process of a role or instance has started after `sent`, so that it cannot have got a query of that time.
    ///
    /// The bus ends the queries to a process that is gone. Rarely it does not, for a query sent while the process was killed.
    async fn has_newer_process(&self, role: &str, sent: Instant) -> bool {
        let Ok(payload) = wire::encode(&StatusRequest {}) else { return false };
        let payload = Some((ZBytes::from(payload), wire::encoding::<StatusRequest>()));
        let query = RoleQuery { role, name: keys::STATUS.name, priority: keys::STATUS.priority, payload };
        let key = self.sending_key(role, query.name);
        let context = Context::root().deadline_in(STATUS_TIMEOUT);
        let Ok(replies) = self.send(&query, &key, &context).await else { return false };
        let Ok(Ok(reply)) = tokio::time::timeout(STATUS_TIMEOUT, replies.recv_async()).await else { return false };
        let health = reply.result().ok().and_then(|sample| {
            let QueryReply { encoding, payload, .. } = self.check_reply(&query, &key, sample).ok()?;
            wire::decode::<Health>(&encoding, &payload).ok()
        });
        health.is_some_and(|health| Duration::from_millis(health.uptime_ms) < sent.elapsed())
    }

    /// Checks that the asked role or instance has sent a reply, and that its role has not passed to another instance.
    fn check_reply(&self, query: &RoleQuery<'_>, key: &str, reply: &Sample) -> Result<QueryReply, Fault> {
        let RoleQuery { role, name, .. } = query;
        let replied = reply.key_expr().as_str();
        let refused = |reason: String| {
            self.inner.counters.refuse(name);
            Fault::new(Code::Unauthenticated, reason)
        };
        let identity = match self.origin(replied, name) {
            // The supervisor's machine replies under the key of the query. No node may.
            _ if replied == key => None,
            Ok(Origin { identity: Some(identity), segment }) if segment == *role && identity.owns(role) => {
                Some(identity)
            }
            _ => return Err(refused(format!("a reply under `{replied}` is not one of `{role}` to {name}"))),
        };
        let envelope = wire::envelope(reply.attachment()).inspect_err(|_| self.inner.counters.refuse(name))?;
        let named = identity.as_ref().map_or(*role, |i| i.role.as_str());
        // Processes of another language may omit the envelope. An instance has any role.
        let is_unnamed = identity.is_none() && (envelope.sender.is_empty() || role.starts_with('@'));
        if !is_unnamed && envelope.sender != named {
            return Err(refused(format!("`{}` replied to {name} in place of `{role}`", envelope.sender)));
        }
        if !role.starts_with('@') && self.check_epoch(&envelope).is_err() {
            self.inner.counters.refuse(name);
            // The new instance of the role answers the next try.
            return Err(Fault::unavailable(format!("`{role}` has passed to another instance; try again in a moment")));
        }
        let (encoding, payload) = (reply.encoding().clone(), reply.payload().clone());
        // A process on a node cannot send the bus's own form of an error.
        if identity.is_some() && wire::message_name(&encoding).is_some_and(|n| n == WireError::full_name()) {
            return Err(wire::decode::<WireError>(&encoding, &payload).map_or_else(|fault| fault, Fault::from_wire));
        }
        Ok(QueryReply { encoding, payload, identity })
    }
}

/// Priority in the terms of zenoh.
pub(super) fn zenoh_priority(priority: Priority) -> zenoh::qos::Priority {
    match priority {
        Priority::Interactive => zenoh::qos::Priority::InteractiveHigh,
        Priority::Normal => zenoh::qos::Priority::Data,
        Priority::Background => zenoh::qos::Priority::Background,
    }
}
