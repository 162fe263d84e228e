//! Questions and answers byte for byte, with the envelope that goes with them.

use std::time::Duration;

use prost::{Message, Name};
use sg_proto::bus::{Code, Envelope, Error as WireError};
use sg_proto::keys::{self, Request, role};
use sg_runtime::bus::{RawMessage, RawReply};
use sg_runtime::context::Context;

/// How long an answer may take; generous, for busy machines.
pub(super) const ANSWER: Duration = Duration::from_secs(20);

/// A well-formed question.
#[derive(Debug, Clone)]
pub(super) struct Question {
    pub(super) name: &'static str,
    /// Full name of the request.
    pub(super) request: String,
    /// Full name of the reply.
    pub(super) reply: String,
    pub(super) payload: Vec<u8>,
    /// A caller that may ask.
    pub(super) sender: &'static str,
    /// Whether every caller may.
    pub(super) open: bool,
}

impl Question {
    pub(super) fn of<Q: Message + Name, R: Name>(row: &Request<Q, R>, request: &Q) -> Self {
        let open = row.senders.contains(&keys::ANY);
        Self {
            name: row.name,
            request: Q::full_name(),
            reply: R::full_name(),
            payload: request.encode_to_vec(),
            sender: row.senders.first().copied().filter(|s| *s != keys::ANY).unwrap_or(role::CLI),
            open,
        }
    }

    /// As it travels under an id.
    pub(super) fn raw(&self, id: &str) -> RawMessage {
        self.within(&self.envelope(id))
    }

    /// As it travels in an envelope.
    pub(super) fn within(&self, envelope: &Envelope) -> RawMessage {
        RawMessage {
            encoding: encoding(&self.request),
            payload: Some(self.payload.clone()),
            attachment: Some(envelope.encode_to_vec()),
        }
    }

    pub(super) fn envelope(&self, id: &str) -> Envelope {
        Envelope {
            id: id.to_owned(),
            deadline_ms: u32::try_from(ANSWER.as_millis()).unwrap_or(u32::MAX),
            sender: self.sender.to_owned(),
            ..Envelope::default()
        }
    }

    /// The payload of the reply.
    pub(super) fn replied(&self, heard: RawReply) -> Result<Vec<u8>, String> {
        match heard {
            RawReply::Reply { encoding, payload } if encoding == self::encoding(&self.reply) => Ok(payload),
            RawReply::Reply { encoding, .. } => {
                Err(format!("{}: a reply of encoding `{encoding}`, not of {}", self.name, self.reply))
            }
            other => Err(match refusal(other) {
                Ok(error) => format!("{}: refused: {:?}: {}", self.name, error.code(), error.message),
                Err(why) => format!("{}: {why}", self.name),
            }),
        }
    }
}

pub(super) fn encoding(name: &str) -> String {
    format!("application/protobuf;{name}")
}

/// The typed error in place of a reply.
pub(super) fn refusal(heard: RawReply) -> Result<WireError, String> {
    match heard {
        RawReply::Nothing => Err("no answer at all".to_owned()),
        RawReply::Reply { encoding, .. } => Err(format!("a reply ({encoding}) where a refusal is due")),
        RawReply::Refusal { encoding, payload } => {
            if encoding != self::encoding(&WireError::full_name()) {
                return Err(format!("a refusal of encoding `{encoding}` is no {}", WireError::full_name()));
            }
            let error = WireError::decode(&payload[..]).map_err(|e| format!("a refusal that is malformed: {e}"))?;
            if error.code() == Code::Unspecified || error.message.is_empty() {
                return Err(format!("a refusal without code or message: {error:?}"));
            }
            Ok(error)
        }
    }
}

/// A refusal with one of these codes.
pub(super) fn refused_as(heard: RawReply, codes: &[Code]) -> Result<(), String> {
    let error = refusal(heard)?;
    if codes.contains(&error.code()) {
        return Ok(());
    }
    Err(format!("refused with {:?} ({}), not with {codes:?}", error.code(), error.message))
}

/// The start of a chain that has as long as an answer may take.
pub(super) fn soon() -> Context {
    Context::root().deadline_in(ANSWER)
}

/// A complaint unless something holds.
pub(super) fn hold(holds: bool, complaint: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(complaint()) }
}
