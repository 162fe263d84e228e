//! Messages of the contract.

use std::sync::LazyLock;

use prost_reflect::{DescriptorPool, DynamicMessage, SerializeOptions};
use sg_edit::Replica;
use sg_proto::keys::{self, Identity};
use sg_proto::prost::Message as _;
use sg_proto::replica::Replica as _;
use sg_proto::scene::{Changes, Command};
use sg_proto::{bus, launch, recode};
use sg_runtime::wire;

use crate::parts::Parts;
use crate::stage::Stage;

static NAMES: LazyLock<Vec<&'static str>> = LazyLock::new(sg_proto::message_names);
static POOL: LazyLock<DescriptorPool> = LazyLock::new(|| DescriptorPool::decode(sg_proto::DESCRIPTORS).unwrap());

/// Input of [`message`] for a payload of this type; `None` for an unknown type.
pub(crate) fn message_input(name: &str, payload: &[u8]) -> Option<Vec<u8>> {
    let at = NAMES.iter().position(|known| *known == name)?;
    Some([&u16::try_from(at).ok()?.to_le_bytes()[..], payload].concat())
}

/// The first two bytes choose the type. The rest is decoded as a receiver does, and as `watch` shows it.
pub(crate) fn message(_: &Stage, input: &[u8]) -> bool {
    let mut parts = Parts(input);
    let at = usize::from(u16::from_le_bytes([parts.byte(), parts.byte()])) % NAMES.len();
    let (name, payload) = (NAMES[at], parts.rest());
    let descriptor = POOL.get_message_by_name(name).unwrap();
    if let Ok(dynamic) = DynamicMessage::decode(descriptor, payload) {
        let options = SerializeOptions::new().use_proto_field_name(true).stringify_64_bit_integers(false);
        let _ = dynamic.serialize_with_options(serde_json::value::Serializer, &options);
    }
    let Some(Ok(bytes)) = recode(name, payload) else { return false };
    assert_eq!(recode(name, &bytes).and_then(Result::ok).as_ref(), Some(&bytes), "{name} is not stable");
    true
}

/// Blocks: the key, the encoding, the envelope. The rest is the payload.
pub(crate) fn received(_: &Stage, input: &[u8]) -> bool {
    let mut parts = Parts(input);
    let (key, encoding, envelope) = (parts.block(), parts.block(), parts.block());
    let payload = parts.rest();
    let (Ok(key), Ok(encoding)) = (std::str::from_utf8(key), std::str::from_utf8(encoding)) else { return false };
    let Some((identity, rest)) = keys::split("demo", key) else { return false };
    if let Some(identity) = &identity {
        assert_eq!(identity.key("demo", rest), key, "a key says its sender in one way");
    }
    let envelope = (!envelope.is_empty()).then_some(envelope);
    let read = |identity: Option<Identity>| {
        let done = [
            wire::received::<Command>(encoding, payload, envelope, identity.clone()).map(drop),
            wire::received::<bus::Health>(encoding, payload, envelope, identity.clone()).map(drop),
            wire::received::<launch::JoinRequest>(encoding, payload, envelope, identity).map(drop),
        ];
        for fault in done.iter().filter_map(|d| d.as_ref().err()) {
            assert!(fault.to_wire().encoded_len() < 4096 + 4 * input.len());
        }
        done.iter().any(Result::is_ok)
    };
    read(identity)
}

/// A reader's answer: a snapshot, then events.
pub(crate) fn replica(_: &Stage, input: &[u8]) -> bool {
    let Ok(changes) = Changes::decode(input) else { return false };
    let Some(snapshot) = &changes.snapshot else { return false };
    let Ok(mut replica) = Replica::from_snapshot(snapshot) else { return false };
    for event in &changes.events {
        let before = replica.revision();
        let applied = replica.apply(event).is_ok();
        assert_eq!(replica.revision(), if applied { event.revision } else { before });
    }
    // What a replica holds, others can read.
    let state = replica.state().state(true);
    let copy = Replica::from_snapshot(&state).unwrap();
    assert_eq!(copy.state().state(true).encode_to_vec(), state.encode_to_vec());
    true
}
