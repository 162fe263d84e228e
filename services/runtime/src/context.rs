//! Who caused a message, in which conversation, until when an answer is of use.

use std::time::{Duration, Instant};

use sg_proto::bus::Envelope;
use sg_proto::limits::DEFAULT_DEADLINE;
use uuid::Uuid;

/// The chain a message belongs to and the time that is left for it.
///
/// A handler receives the context of the request it serves; what it sends in turn is derived from it by
/// [`Context::next`], so that ids, conversation, trace and deadline run through the whole loop.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Context {
    /// Id of the message; for a command, the id under which it takes effect at most once.
    pub id: String,
    /// Id of the message that caused it; empty at the start of a chain.
    pub cause: String,
    /// Conversation; empty outside one.
    pub conversation: String,
    /// Step within the conversation, from 1; 0 outside one.
    pub step: u32,
    /// W3C trace context.
    pub traceparent: String,
    /// Span of what caused this message, hexadecimal; empty at the start of a chain. Not sent: the receiver's parent is
    /// this message.
    pub parent_span: String,
    /// When an answer is of no more use.
    pub deadline: Instant,
    /// Role of the sender, as it says of itself.
    pub sender: String,
}

impl Context {
    /// The start of a chain, with a fresh id and trace and the default deadline.
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
        }
    }

    /// A message that this one causes: fresh id and span, the same conversation, step, trace and deadline.
    #[must_use]
    pub fn next(&self) -> Self {
        Self { id: Uuid::now_v7().to_string(), cause: self.id.clone(), ..self.entered() }
    }

    /// The work on this message: the same in a span of its own, whose parent is the message.
    #[must_use]
    pub(crate) fn entered(&self) -> Self {
        let parent_span = self.span_id().to_owned();
        let traceparent = self
            .traceparent
            .get(..36)
            .map_or_else(|| self.traceparent.clone(), |head| format!("{head}{}-01", span_id()));
        Self { traceparent, parent_span, ..self.clone() }
    }

    /// Id of the trace, 32 hexadecimal digits; empty where a sender gave none.
    #[must_use]
    pub fn trace_id(&self) -> &str {
        self.traceparent.get(3..35).unwrap_or_default()
    }

    /// Id of this message's span, 16 hexadecimal digits; empty where a sender gave none.
    #[must_use]
    pub fn span_id(&self) -> &str {
        self.traceparent.get(36..52).unwrap_or_default()
    }

    /// The same with this much time from now, but never more than was left.
    #[must_use]
    pub fn within(mut self, time: Duration) -> Self {
        self.deadline = self.deadline.min(Instant::now() + time);
        self
    }

    /// The same with exactly this much time from now: for the start of a chain.
    #[must_use]
    pub fn deadline_in(mut self, time: Duration) -> Self {
        self.deadline = Instant::now() + time;
        self
    }

    /// The same under a given id.
    #[must_use]
    pub fn with_id(mut self, id: impl Into<String>) -> Self {
        self.id = id.into();
        self
    }

    /// The same as a step of a conversation.
    #[must_use]
    pub fn at_step(mut self, conversation: impl Into<String>, step: u32) -> Self {
        self.conversation = conversation.into();
        self.step = step;
        self
    }

    /// Time that is left; zero when the deadline has passed.
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

    pub(crate) fn from_envelope(envelope: Envelope) -> Self {
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
        }
    }
}

/// Eight random bytes, hexadecimal. The tail of a version-7 id is random.
fn span_id() -> String {
    Uuid::now_v7().simple().to_string()[16..].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_follows_keeps_conversation_trace_and_deadline() {
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
    fn a_deadline_is_never_lengthened_on_the_way() {
        let short = Context::root().deadline_in(Duration::from_millis(10));
        assert!(short.clone().within(Duration::from_secs(9)).deadline <= short.deadline);
    }
}
