//! Questions: put to a role until it answers or the deadline passes.

use std::time::{Duration, Instant, SystemTime};

use prost::{Message, Name};
use sg_proto::bus::{CancelRequest, Code, Error as WireError};
use sg_proto::keys::{self, Ask, Slot, Urgency};
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::qos::Priority;
use zenoh::query::QueryTarget;

use super::{Boxed, Bus};
use crate::context::Context;
use crate::fault::Fault;
use crate::metrics::{self, Metric};
use crate::trace::{self, Kind};
use crate::wire;

/// What is put to a role: a request, or nothing for the newest value.
struct Question<'a> {
    role: &'a str,
    name: &'static str,
    urgency: Urgency,
    /// Counted, not copied, each time the question is put again.
    payload: Option<(ZBytes, Encoding)>,
}

/// Longest pause between two tries of a question: what a caller adds to the time that a service takes to come back.
const LONGEST_PAUSE: Duration = Duration::from_millis(50);

/// How long a withdrawal may take: whoever withdraws does not care any more.
const CANCEL_TIME: Duration = Duration::from_secs(1);

impl Bus {
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

    /// As [`Bus::ask`], for rows that every role answers, and for one instance ([`keys::instance`]).
    ///
    /// # Errors
    /// As [`Bus::ask`].
    pub async fn ask_role<Q, R>(&self, row: &Ask<Q, R>, role: &str, request: &Q, context: &Context) -> Result<R, Fault>
    where
        Q: Message + Name,
        R: Message + Name + Default,
    {
        let payload = Some((ZBytes::from(wire::encode(request)?), wire::encoding::<Q>()));
        let question = Question { role, name: row.name, urgency: row.urgency, payload };
        self.put_question(&question, context).await
    }

    /// The newest value of a row right now.
    ///
    /// # Errors
    /// As [`Bus::ask`].
    pub async fn newest<M>(&self, row: &Slot<M>, context: &Context) -> Result<M, Fault>
    where
        M: Message + Name + Default,
    {
        let question = Question { role: row.role, name: row.name, urgency: Urgency::Ordinary, payload: None };
        self.put_question(&question, context).await
    }

    /// Withdraws a request that was put to a role; whether it was still waiting or being worked on.
    ///
    /// # Errors
    /// As [`Bus::ask`].
    pub async fn cancel(&self, role: &str, id: &str) -> Result<bool, Fault> {
        let context = Context::root().deadline_in(CANCEL_TIME);
        let request = CancelRequest { id: id.to_owned() };
        Ok(self.ask_role(&keys::CANCEL, role, &request, &context).await?.found)
    }

    /// Puts a question and decodes its answer.
    async fn put_question<R>(&self, question: &Question<'_>, context: &Context) -> Result<R, Fault>
    where
        R: Message + Name + Default,
    {
        let (encoding, payload) = self.put_until_answered(question, context).await?;
        self.counted(question.name, wire::decode::<R>(&encoding, &payload))
    }

    /// Puts a question until somebody answers it or the deadline passes.
    ///
    /// Neither generic nor `async`, as all that speaks to zenoh: see [`Boxed`].
    fn put_until_answered<'a>(
        &'a self,
        question: &'a Question<'a>,
        context: &'a Context,
    ) -> Boxed<'a, Result<(Encoding, ZBytes), Fault>> {
        Box::pin(async move {
            let (begun, started) = (Instant::now(), SystemTime::now());
            let mut pause = Duration::from_millis(10);
            let outcome = loop {
                match self.put_once(question, context).await {
                    Err(fault) if fault.code == Code::Unavailable && context.remaining() > pause => {
                        metrics::count(Metric::Retries, &[("key", question.name)], 1);
                        tokio::time::sleep(pause).await;
                        pause = (pause * 2).min(LONGEST_PAUSE);
                    }
                    outcome => break outcome,
                }
            };
            let code = outcome.as_ref().err().map(|f| f.code);
            let labels = [("key", question.name), ("code", metrics::code(code))];
            metrics::observe(Metric::AskSeconds, &labels, begun.elapsed());
            trace::record(context, Kind::Client, || format!("ask {} {}", question.role, question.name), started, code);
            outcome
        })
    }

    async fn put_once(&self, question: &Question<'_>, context: &Context) -> Result<(Encoding, ZBytes), Fault> {
        let Question { role, name, urgency, payload } = question;
        let remaining = context.remaining();
        let late = || Fault::deadline(format!("`{role}` did not answer {name} in time"));
        if remaining.is_zero() {
            return Err(late());
        }
        let key = keys::key(&self.inner.session, role, name);
        let mut get = self
            .inner
            .zenoh
            .get(&key)
            .target(QueryTarget::BestMatching)
            .priority(priority(*urgency))
            .timeout(remaining);
        if let Some((payload, encoding)) = payload {
            let envelope = context.to_envelope(&self.inner.role, self.epoch(), 0).encode_to_vec();
            get = get.payload(payload.clone()).encoding(encoding.clone()).attachment(envelope);
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
                Ok(sample) => Ok((sample.encoding().clone(), sample.payload().clone())),
                Err(error) => match wire::decode::<WireError>(error.encoding(), error.payload()) {
                    Ok(wire) => Err(Fault::from_wire(wire)),
                    // The bus reports its own time-out as an error reply in its own encoding.
                    Err(_) => Err(late()),
                },
            },
        }
    }
}

/// What the bus calls it.
pub(super) fn priority(urgency: Urgency) -> Priority {
    match urgency {
        Urgency::Interactive => Priority::InteractiveHigh,
        Urgency::Ordinary => Priority::Data,
        Urgency::Background => Priority::Background,
    }
}
