//! Context of a message: cause, conversation, trace and deadline.

use std::time::{Duration, Instant};

use sg_proto::bus::Envelope;
use sg_proto::keys::Identity;
use sg_proto::limits::DEFAULT_DEADLINE;
use uuid::Uuid;

/// Ids, conversation, trace and deadline of a message.
///
/// A handler receives the context of its request and derives the contexts of its own messages with [`Context::next`].
/// Conversation, trace and deadline thus pass through all services.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Context {
    /// Id of the message. A command takes effect at most once per id.
    pub id: String,
    /// Id of the message that caused it; empty at the start of a chain.
    pub cause: String,
    /// Conversation; empty outside one.
    pub conversation: String,
    /// Step within the conversation, from 1; 0 outside one.
    pub step: u32,
    /// W3C trace context, `00-<trace id>-<span id>-<flags>`.
    pub traceparent: String,
    /// Id of the parent span, 16 hexadecimal digits; empty at the start of a chain. Not sent: the parent at the receiver is
    /// this message.
    pub parent_span: String,
    /// Time at which the caller gives up.
    pub deadline: Instant,
    /// Role of the sender. For a process on a node the router has confirmed it; others state it themselves.
    pub sender: String,
    /// The sender, if it is a process on a node. Not sent.
    pub identity: Option<Identity>,
}

impl Context {
    /// Starts a chain with a new id, a new trace and the default deadline.
    #[must_use]
    pub fn root() -> Self {
        let trace = Uuid::now_v7();
        Self {
            id: Uuid::now_v7().to_string(),
            cause: String::new(),
            conversation: String::new(),
            step: 0,
            traceparent: format!("00-{}-{}-01", trace.simple(), span_id()),
            parent_span: String::new(),
            deadline: Instant::now() + DEFAULT_DEADLINE,
            sender: String::new(),
            identity: None,
        }
    }

    /// Context of a message caused by this one: new id and span, same conversation, step, trace and deadline.
    #[must_use]
    pub fn next(&self) -> Self {
        Self { id: Uuid::now_v7().to_string(), cause: self.id.clone(), ..self.in_span() }
    }

    /// Context of the work on this message: a new span whose parent is the message.
    #[must_use]
    pub(crate) fn in_span(&self) -> Self {
        let parent_span = self.span_id().to_owned();
        let traceparent = self
            .traceparent
            .get(..36)
            .map_or_else(|| self.traceparent.clone(), |head| format!("{head}{}-01", span_id()));
        Self { traceparent, parent_span, ..self.clone() }
    }

    /// Id of the trace, 32 hexadecimal digits; empty if the sender gave none.
    #[must_use]
    pub fn trace_id(&self) -> &str {
        self.traceparent.get(3..35).unwrap_or_default()
    }

    /// Id of the span, 16 hexadecimal digits; empty if the sender gave none.
    #[must_use]
    pub fn span_id(&self) -> &str {
        self.traceparent.get(36..52).unwrap_or_default()
    }

    /// Shortens the deadline to at most `time` from now.
    #[must_use]
    pub fn within(mut self, time: Duration) -> Self {
        self.deadline = self.deadline.min(Instant::now() + time);
        self
    }

    /// Sets the deadline to `time` from now, for the start of a chain.
    #[must_use]
    pub fn deadline_in(mut self, time: Duration) -> Self {
        self.deadline = Instant::now() + time;
        self
    }

    /// Sets the id.
    #[must_use]
    pub fn with_id(mut self, id: impl Into<String>) -> Self {
        self.id = id.into();
        self
    }

    /// Sets conversation and step.
    #[must_use]
    pub fn at_step(mut self, conversation: impl Into<String>, step: u32) -> Self {
        self.conversation = conversation.into();
        self.step = step;
        self
    }

    /// Time until the deadline; zero after it.
    #[must_use]
    pub fn remaining(&self) -> Duration {
        self.deadline.saturating_duration_since(Instant::now())
    }

    pub(crate) fn to_envelope(&self, sender: &str, epoch: u64, sequence: u64) -> Envelope {
        Envelope {
            id: self.id.clone(),
            cause: self.cause.clone(),
            conversation: self.conversation.clone(),
            step: self.step,
            traceparent: self.traceparent.clone(),
            deadline_ms: u32::try_from(self.remaining().as_millis()).unwrap_or(u32::MAX),
            epoch,
            schema_hash: String::new(),
            sender: sender.to_owned(),
            sequence,
        }
    }

    pub(crate) fn from_envelope(envelope: Envelope, identity: Option<Identity>) -> Self {
        let time = match envelope.deadline_ms {
            0 => DEFAULT_DEADLINE,
            ms => Duration::from_millis(ms.into()),
        };
        Self {
            id: envelope.id,
            cause: envelope.cause,
            conversation: envelope.conversation,
            step: envelope.step,
            traceparent: envelope.traceparent,
            parent_span: String::new(),
            deadline: Instant::now() + time,
            sender: envelope.sender,
            identity,
        }
    }
}

/// Eight random bytes, hexadecimal. The last bytes of a version-7 id are random.
fn span_id() -> String {
    Uuid::now_v7().simple().to_string()[16..].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_caused_message_keeps_conversation_trace_and_deadline() {
        let first = Context::root().at_step("talk", 3);
        let second = first.next();
        assert_eq!((second.conversation.as_str(), second.step, second.cause.as_str()), ("talk", 3, first.id.as_str()));
        assert_eq!(second.deadline, first.deadline);
        assert_eq!(first.traceparent[..36], second.traceparent[..36]);
        assert_ne!(first.traceparent, second.traceparent);
        assert_eq!(second.traceparent.len(), 55);
        assert_eq!((second.parent_span.as_str(), second.trace_id()), (first.span_id(), first.trace_id()));
        assert_eq!((first.parent_span.as_str(), first.span_id().len()), ("", 16));
    }

    #[test]
    fn a_deadline_is_never_extended() {
        let short = Context::root().deadline_in(Duration::from_millis(10));
        assert!(short.clone().within(Duration::from_secs(9)).deadline <= short.deadline);
    }
}
