//! Encoding of typed messages as payloads: names, size limits, envelopes.

use std::sync::LazyLock;

use prost::{Message, Name};
use sg_proto::bus::Envelope;
use sg_proto::keys::Identity;
use sg_proto::limits::{MAX_ENVELOPE_BYTES, MAX_MESSAGE_BYTES};
use zenoh::bytes::{Encoding, ZBytes};

use crate::context::Context;
use crate::fault::Fault;

/// BLAKE3 of the compiled schema, hexadecimal.
pub(crate) static SCHEMA_HASH: LazyLock<String> =
    LazyLock::new(|| blake3::hash(sg_proto::DESCRIPTORS).to_hex().to_string());

const PROTOBUF: &str = "application/protobuf;";

pub(crate) fn encoding<M: Name>() -> Encoding {
    Encoding::from(format!("{PROTOBUF}{}", M::full_name()))
}

/// Encodes a message. One over the size limit is refused, since no receiver accepts it.
pub(crate) fn encode<M: Message + Name>(message: &M) -> Result<Vec<u8>, Fault> {
    let bytes = message.encode_to_vec();
    if bytes.len() > MAX_MESSAGE_BYTES {
        return Err(Fault::exhausted(format!(
            "a {} of {} bytes is over the limit of {MAX_MESSAGE_BYTES} bytes for one message",
            M::full_name(),
            bytes.len()
        )));
    }
    Ok(bytes)
}

/// Decodes a payload of type `M`. Other types, oversized and malformed payloads are refused.
pub(crate) fn decode<M: Message + Name + Default>(encoding: &Encoding, payload: &ZBytes) -> Result<M, Fault> {
    let encoding = encoding.to_string();
    let Some(name) = encoding.strip_prefix(PROTOBUF) else {
        return Err(Fault::invalid(format!(
            "payload of encoding `{encoding}` refused; send `{PROTOBUF}{}`",
            M::full_name()
        )));
    };
    if name != M::full_name() {
        return Err(Fault::invalid(format!("message of type `{name}` refused; this key takes `{}`", M::full_name())));
    }
    if payload.len() > MAX_MESSAGE_BYTES {
        return Err(Fault::exhausted(format!(
            "a {name} of {} bytes is over the limit of {MAX_MESSAGE_BYTES} bytes for one message",
            payload.len()
        )));
    }
    M::decode(&*payload.to_bytes()).map_err(|e| Fault::invalid(format!("malformed {name}: {e}")))
}

/// Full name of the protobuf message in an encoding, if any.
pub(crate) fn message_name(encoding: &Encoding) -> Option<String> {
    encoding.to_string().strip_prefix(PROTOBUF).map(str::to_owned)
}

/// Decodes the envelope of a message. An absent one is empty; a malformed or oversized one is refused.
pub(crate) fn envelope(attachment: Option<&ZBytes>) -> Result<Envelope, Fault> {
    let Some(attachment) = attachment else { return Ok(Envelope::default()) };
    if attachment.len() > MAX_ENVELOPE_BYTES {
        return Err(Fault::exhausted(format!(
            "an envelope of {} bytes is over the limit of {MAX_ENVELOPE_BYTES}",
            attachment.len()
        )));
    }
    Envelope::decode(&*attachment.to_bytes()).map_err(|e| Fault::invalid(format!("malformed envelope: {e}")))
}

/// A message and its context, from the parts that travel: as every receiver of the bus decodes them.
///
/// `identity` is the sender by the message's key (`sg_proto::keys::split`). The caller checks it, as well as roles and epochs.
///
/// # Errors
/// A wrong encoding, a message over its limit, or bytes that are no such message.
pub fn received<M: Message + Name + Default>(
    encoding_name: &str,
    payload: &[u8],
    attachment: Option<&[u8]>,
    identity: Option<Identity>,
) -> Result<(M, Context), Fault> {
    let envelope = envelope(attachment.map(ZBytes::from).as_ref())?;
    let message = decode(&Encoding::from(encoding_name), &ZBytes::from(payload))?;
    Ok((message, Context::from_envelope(envelope, identity)))
}
