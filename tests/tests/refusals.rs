//! Every request of every role of a running stack refuses invalid requests with a typed error. The error is counted, and the
//! stack goes on.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test's helpers fail the test")]

use std::time::Duration;

use prost::{Message as _, Name as _};
use sg_proto::bus::{Code, Envelope, Error as WireError, StatusRequest};
use sg_proto::keys::{self, Kind, role};
use sg_proto::limits::{MAX_ENVELOPE_BYTES, MAX_MESSAGE_BYTES};
use sg_runtime::bus::{Bus, RawMessage, RawReply};
use sg_runtime::context::Context;
use sg_tests::stack::Stack;

const ANSWER: Duration = Duration::from_secs(20);

/// Roles that are served by a process of their own.
fn served() -> impl Iterator<Item = &'static str> {
    role::ALL.into_iter().filter(|r| !role::NON_SERVICES.contains(r))
}

async fn refused(cli: &Bus, role: &str) -> u64 {
    let context = Context::root().deadline_in(ANSWER);
    cli.ask_role(&keys::STATUS, role, &StatusRequest {}, &context).await.unwrap().refused
}

/// Messages that every request refuses, and the code of the refusal.
fn bad(request: &str, sender: &str, open: bool) -> Vec<(&'static str, RawMessage, Code)> {
    let protobuf = |name: &str| format!("application/protobuf;{name}");
    let envelope = |sender: &str| {
        let envelope = Envelope { id: "bad".into(), sender: sender.into(), deadline_ms: 20_000, ..Envelope::default() };
        Some(envelope.encode_to_vec())
    };
    let raw =
        |encoding: String, payload: Vec<u8>, attachment| RawMessage { encoding, payload: Some(payload), attachment };
    let own = protobuf(request);
    let major = protobuf(&request.replace(".v1.", ".v2."));
    let mut all = vec![
        ("unknown type", raw(protobuf("supergaussian.none.v1.None"), vec![], envelope(sender)), Code::InvalidArgument),
        ("another major", raw(major, vec![], envelope(sender)), Code::InvalidArgument),
        ("garbage", raw(own.clone(), vec![0xff; 32], envelope(sender)), Code::InvalidArgument),
        ("oversized", raw(own.clone(), vec![0; MAX_MESSAGE_BYTES + 1], envelope(sender)), Code::ResourceExhausted),
        ("malformed envelope", raw(own.clone(), vec![], Some(vec![0xff; 32])), Code::InvalidArgument),
        (
            "oversized envelope",
            raw(own.clone(), vec![], Some(vec![0; MAX_ENVELOPE_BYTES + 1])),
            Code::ResourceExhausted,
        ),
        (
            "no payload",
            RawMessage { encoding: own.clone(), payload: None, attachment: envelope(sender) },
            Code::InvalidArgument,
        ),
    ];
    if !open {
        all.push(("wrong sender", raw(own.clone(), vec![], envelope("stranger")), Code::PermissionDenied));
        all.push(("no sender", raw(own, vec![], None), Code::PermissionDenied));
    }
    all
}

#[test]
fn every_key_of_every_role_refuses_invalid_requests() {
    let stack = Stack::up().unwrap();
    let before = stack.ps();
    sg_runtime::process::block_on(async {
        let cli = stack.join(role::CLI).await.unwrap();
        for role in served().chain([role::SUPERVISOR]) {
            let is_service = role != role::SUPERVISOR;
            let counted = if is_service { refused(&cli, role).await } else { 0 };
            let mut sent = 0;
            for row in keys::rows().iter().filter(|r| r.role == role || is_service && r.role == keys::ANY) {
                let Kind::Request { request, .. } = &row.kind else { continue };
                let open = row.senders.contains(&keys::ANY);
                let sender = row.senders.iter().find(|s| **s != keys::ANY).unwrap_or(&role::CLI);
                for (what, raw, code) in bad(request, sender, open) {
                    sent += 1;
                    let heard = cli.ask_raw(role, row.name, &raw, ANSWER).await;
                    let place = format!("{what} to {role}/{}", row.name);
                    let RawReply::Refusal { encoding, payload } = heard else { panic!("{place}: {heard:?}") };
                    assert_eq!(encoding, format!("application/protobuf;{}", WireError::full_name()), "{place}");
                    let error = WireError::decode(&payload[..]).unwrap();
                    assert_eq!(error.code(), code, "{place}: {}", error.message);
                    assert!(!error.message.is_empty(), "{place}");
                }
            }
            assert!(sent > 20, "{role} has no rows");
            if is_service {
                assert_eq!(refused(&cli, role).await - counted, sent, "{role} counts what it refuses");
            }
        }
    })
    .unwrap();
    // The same processes serve on.
    let after = stack.ps();
    for (before, after) in before.iter().zip(&after) {
        assert_eq!((&before["pid"], &after["state"]), (&after["pid"], &"READY".into()));
    }
    let (status, _, said) = stack.run(&["say", "make the sac red"]).unwrap();
    assert_eq!(status, Some(0), "{said}");
}
