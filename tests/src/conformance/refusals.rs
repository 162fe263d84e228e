//! The requests that every role has to refuse, and the callers that it must not refuse.

use sg_proto::bus::{Code, Envelope, StatusRequest};
use sg_proto::keys::{self, Kind};
use sg_proto::limits::{MAX_ENVELOPE_BYTES, MAX_MESSAGE_BYTES};
use sg_runtime::bus::RawMessage;

use super::Checks;
use super::question::{ANSWER, Question, encoding, hold, refused_as};
use super::stage::Stage;

/// A forbidden request is refused with a typed error and counted, and the service goes on.
pub(super) async fn checks(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    let before = stage.health(stage.subject.role).await.map(|h| h.refused);
    let mut refused = 0;
    for (what, raw, codes) in bad_questions(stage) {
        let question = (stage.subject.question)("");
        let heard = stage.cli.ask_raw(stage.subject.role, question.name, &raw, ANSWER).await;
        checks.note(what, refused_as(heard, codes));
        refused += 1;
    }
    checks.note("refuses what comes from an epoch that has passed", old_epoch(stage).await);
    refused += 1;
    let counted = async {
        let (before, after) = (before?, stage.health(stage.subject.role).await?.refused);
        hold(after >= before + refused, || format!("{refused} refusals, but cmd/status counts {}", after - before))
    };
    checks.note("counts what it refuses", counted.await);
    checks.note("serves everybody who may ask", everybody_who_may(stage).await);
    checks.note("serves a node as the sender in its key", asked_from_a_node(stage).await);
    checks.note("goes on after garbage on the streams it follows", garbage_on_streams(stage).await);
}

type Bad = (&'static str, RawMessage, &'static [Code]);

fn bad_questions(stage: &mut Stage<'_>) -> Vec<Bad> {
    let id = stage.new_id();
    let question = (stage.subject.question)(&id);
    let good = question.raw(&id);
    let major = question.request.replace(".v1.", ".v2.");
    let mut bad: Vec<Bad> = vec![
        (
            "refuses a message of another type",
            RawMessage { encoding: encoding("supergaussian.bus.v1.Envelope"), ..good.clone() },
            &[Code::InvalidArgument],
        ),
        (
            "refuses a message of another major version",
            RawMessage { encoding: encoding(&major), ..good.clone() },
            &[Code::InvalidArgument],
        ),
        (
            "refuses what is no protobuf message",
            RawMessage { encoding: "text/plain".to_owned(), ..good.clone() },
            &[Code::InvalidArgument],
        ),
        (
            "refuses a malformed payload",
            RawMessage { payload: Some(vec![0xff; 16]), ..good.clone() },
            &[Code::InvalidArgument],
        ),
        ("refuses a question without payload", RawMessage { payload: None, ..good.clone() }, &[Code::InvalidArgument]),
        (
            "refuses an oversized payload",
            RawMessage { payload: Some(vec![0; MAX_MESSAGE_BYTES + 1]), ..good.clone() },
            &[Code::ResourceExhausted],
        ),
        (
            "refuses a malformed envelope",
            RawMessage { attachment: Some(vec![0xff; 16]), ..good.clone() },
            &[Code::InvalidArgument],
        ),
        (
            "refuses an oversized envelope",
            RawMessage { attachment: Some(vec![0; MAX_ENVELOPE_BYTES + 1]), ..good.clone() },
            &[Code::ResourceExhausted],
        ),
    ];
    if !question.open {
        let stranger = Envelope { sender: "stranger".to_owned(), ..question.envelope(&id) };
        bad.push(("refuses a sender who may not ask", question.within(&stranger), &[Code::PermissionDenied]));
    }
    bad
}

async fn old_epoch(stage: &mut Stage<'_>) -> Result<(), String> {
    let id = stage.new_id();
    // A sender that no other check uses: the role remembers the epoch of this request.
    let question = Question::of(&keys::STATUS, &StatusRequest {});
    let of = |epoch| {
        let envelope = Envelope { epoch, sender: "replaced".to_owned(), ..question.envelope(&id) };
        question.within(&envelope)
    };
    let role = stage.subject.role;
    question.replied(stage.cli.ask_raw(role, question.name, &of(7), ANSWER).await)?;
    refused_as(stage.cli.ask_raw(role, question.name, &of(6), ANSWER).await, &[Code::Aborted])?;
    question.replied(stage.cli.ask_raw(role, question.name, &of(7), ANSWER).await).map(drop)
}

async fn garbage_on_streams(stage: &mut Stage<'_>) -> Result<(), String> {
    for row in keys::rows().into_iter().filter(|r| r.role != keys::ANY && !matches!(r.kind, Kind::Request { .. })) {
        let (Kind::Stream { message } | Kind::Retained { message }) = &row.kind else { continue };
        for raw in [
            RawMessage { encoding: encoding(message), payload: Some(vec![0xff; 64]), attachment: None },
            RawMessage { encoding: encoding(message), payload: Some(Vec::new()), attachment: Some(vec![0xff; 64]) },
            RawMessage { encoding: "text/plain".to_owned(), payload: Some(b"garbage".to_vec()), attachment: None },
        ] {
            stage.cli.put_raw(row.role, row.name, &raw).await.map_err(|e| e.to_string())?;
        }
    }
    let id = stage.new_id();
    stage.essence(&id).await.map(drop)
}

/// Every caller that the table permits is answered.
async fn everybody_who_may(stage: &mut Stage<'_>) -> Result<(), String> {
    let role = stage.subject.role;
    let name = (stage.subject.question)("").name;
    let row = keys::rows().into_iter().find(|r| r.belongs_to(role) && r.name == name).ok_or("no such row")?;
    for sender in row.senders.iter().map(|s| if *s == keys::ANY { "anybody" } else { s }) {
        let id = stage.new_id();
        let question = (stage.subject.question)(&id);
        let envelope = Envelope { sender: sender.to_owned(), ..question.envelope(&id) };
        let heard = stage.cli.ask_raw(role, name, &question.within(&envelope), ANSWER).await;
        question.replied(heard).map_err(|why| format!("asked by `{sender}`: {why}"))?;
    }
    Ok(())
}

/// A node asks under a key with its identity. The envelope cannot name another sender, and raises no epoch of one.
async fn asked_from_a_node(stage: &mut Stage<'_>) -> Result<(), String> {
    let role = stage.subject.role;
    let id = stage.new_id();
    let question = Question::of(&keys::STATUS, &StatusRequest {});
    let segment = format!("@node/gpu1/selection/selection.1/{role}");
    let of = |sender: &str, epoch| {
        let envelope = Envelope { epoch, sender: sender.to_owned(), ..question.envelope(&id) };
        question.within(&envelope)
    };
    question.replied(stage.cli.ask_raw(&segment, question.name, &of("selection", 0), ANSWER).await)?;
    let forged = stage.cli.ask_raw(&segment, question.name, &of("impersonated", u64::MAX), ANSWER).await;
    refused_as(forged, &[Code::PermissionDenied])?;
    question.replied(stage.cli.ask_raw(role, question.name, &of("impersonated", 1), ANSWER).await).map(drop)
}
