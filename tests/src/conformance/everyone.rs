//! Checks of every role: readiness, answering for itself, withdrawal of requests, recovery after `kill -9`, standing by,
//! promotion, and ending.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use prost::Message as _;
use sg_proto::bus::{CancelRequest, Code, Envelope, MetricsRequest, Phase, PromoteRequest, Ready, StatusRequest};
use sg_proto::golden::Line;
use sg_proto::keys::{self, Kind, Row, role};
use sg_proto::released;
use sg_runtime::bus::{RawMessage, RawReply};

use super::question::{ANSWER, encoding, hold, refusal, refused_as, soon};
use super::stage::{Stage, next_of, next_ready};
use super::{Checks, process::Ended};

/// How long a process may take that has nothing to do but to end.
const END: Duration = Duration::from_secs(15);
/// How long a process may outlive its supervisor.
const ORPHAN: Duration = Duration::from_secs(5);
/// Exit status for wrong parameters or input.
const EXIT_INPUT: i32 = 2;
/// Questions that are put at once to have one in hand when it is withdrawn.
const BURST: usize = 12;

/// Golden bytes by package. They hold the parts of the last release.
const GOLDEN: [(&str, &str); 8] = [
    ("supergaussian.bus.v1", include_str!("../../../proto/golden/supergaussian.bus.v1.txt")),
    ("supergaussian.labeling.v1", include_str!("../../../proto/golden/supergaussian.labeling.v1.txt")),
    ("supergaussian.language.v1", include_str!("../../../proto/golden/supergaussian.language.v1.txt")),
    ("supergaussian.launch.v1", include_str!("../../../proto/golden/supergaussian.launch.v1.txt")),
    ("supergaussian.render.v1", include_str!("../../../proto/golden/supergaussian.render.v1.txt")),
    ("supergaussian.scene.v1", include_str!("../../../proto/golden/supergaussian.scene.v1.txt")),
    ("supergaussian.selection.v1", include_str!("../../../proto/golden/supergaussian.selection.v1.txt")),
    ("supergaussian.speech.v1", include_str!("../../../proto/golden/supergaussian.speech.v1.txt")),
];

/// Arguments that the program must refuse before it serves anything.
pub(super) async fn before_service(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    let instance = stage.new_instance();
    let process = stage.start_as(&instance, stage.subject.role, r#"{"no_such_parameter": 1}"#, &[]);
    checks.note("ends with status 2 on an unknown parameter", ends_with_input_error(process).await);
    let instance = stage.new_instance();
    let process = stage.start_as(&instance, role::CLI, "{}", &[]);
    checks.note("ends with status 2 on a role that is not its own", ends_with_input_error(process).await);
}

async fn ends_with_input_error(process: Result<super::process::Process, String>) -> Result<(), String> {
    let mut process = process?;
    let wanted = Ended { status: Some(EXIT_INPUT) };
    match process.end(END).await {
        Some(ended) if ended == wanted => {
            hold(!process.last_words().is_empty(), || "it did not say what is wrong on standard error".to_owned())
        }
        Some(ended) => Err(format!("it ended with {:?}: {}", ended.status, process.last_words())),
        None => Err(format!("it still runs after {} s", END.as_secs())),
    }
}

/// Rows that a role answers or owns.
fn answered_rows(role: &str) -> Vec<Row> {
    keys::rows().into_iter().filter(|r| r.belongs_to(role) && !matches!(r.kind, Kind::Stream { .. })).collect()
}

/// The candidate gets ready; whether it serves.
pub(super) async fn begin(stage: &mut Stage<'_>, checks: &mut Checks<'_>) -> bool {
    let alive = stage.router.watch_liveliness(64).await;
    let ready = match stage.serve().await {
        Ok(ready) => ready,
        Err(why) => {
            checks.note("gets ready in time", Err(why));
            return false;
        }
    };
    checks.note("gets ready in time", ready_is_right(stage, &ready, false, stage.epoch()));
    let role = stage.subject.role;
    checks.note("declares the rows of its role and no others", declares_its_rows(role, &ready));
    let token = async {
        let mut alive = alive.map_err(|e| e.to_string())?;
        let one = async {
            while let Some(seen) = alive.recv().await {
                if seen.alive && (seen.role.as_str(), &seen.instance) == (role, &ready.instance) {
                    return true;
                }
            }
            false
        };
        hold(tokio::time::timeout(ANSWER, one).await == Ok(true), || "no liveliness token".to_owned())
    };
    checks.note("has a liveliness token", token.await);
    true
}

fn ready_is_right(stage: &Stage<'_>, ready: &Ready, standby: bool, epoch: u64) -> Result<(), String> {
    hold(ready.role == stage.subject.role, || format!("event/ready says role `{}`", ready.role))?;
    hold(ready.standby == standby, || format!("event/ready says standby = {}", ready.standby))?;
    hold(ready.epoch == epoch, || format!("event/ready says epoch {}, granted was {epoch}", ready.epoch))?;
    hold(!ready.version.is_empty(), || "event/ready says no version".to_owned())?;
    hold(std::path::Path::new(&format!("/proc/{}", ready.pid)).exists(), || {
        format!("event/ready says process id {}, which is none", ready.pid)
    })
}

fn declares_its_rows(role: &str, ready: &Ready) -> Result<(), String> {
    let declared: BTreeSet<&str> = ready.declares.iter().map(String::as_str).collect();
    let rows = keys::rows();
    let strange: Vec<_> =
        declared.iter().filter(|n| !rows.iter().any(|r| r.belongs_to(role) && r.name == **n)).collect();
    hold(strange.is_empty(), || format!("no rows of `{role}`: {strange:?}"))?;
    let absent: Vec<_> = answered_rows(role).into_iter().map(|r| r.name).filter(|n| !declared.contains(n)).collect();
    hold(absent.is_empty(), || format!("rows of `{role}` that event/ready does not name: {absent:?}"))
}

/// Questions that every process answers, and the role's own.
pub(super) async fn answers(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    checks.note("answers cmd/status", status(stage).await);
    checks.note("tells its health every second", health(stage).await);
    checks.note("answers cmd/metrics", metrics(stage).await);
    checks.note("hands out its newest values", newest_values(stage).await);
    let id = stage.new_id();
    checks.note("answers a question of its role", stage.essence(&id).await.map(drop));
    checks.note("gives one answer for one id", one_answer_for_one_id(stage).await);
    checks.note("is never silent where time runs out", deadlines(stage).await);
    checks.note("can be withdrawn from", withdrawal(stage).await);
    checks.note("passes over fields of a newer version", newer_version(stage).await);
    checks.note("serves the messages of the last release", released_messages(stage).await);
}

async fn status(stage: &Stage<'_>) -> Result<(), String> {
    let health = stage.health(stage.subject.role).await?;
    let serving = stage.serving.as_ref().map_or("", |p| &p.instance);
    hold(health.phase() == Phase::Ready, || format!("phase {:?}", health.phase()))?;
    hold(health.role == stage.subject.role && health.instance == serving, || {
        format!("it says that it is `{}` of role `{}`", health.instance, health.role)
    })?;
    hold(health.epoch == stage.epoch(), || format!("it says epoch {}, not {}", health.epoch, stage.epoch()))?;
    hold(health.memory_bytes > 0, || "it does not say how much memory it takes".to_owned())
}

async fn health(stage: &Stage<'_>) -> Result<(), String> {
    let role = stage.subject.role;
    let mut heard = stage.cli.subscribe(&keys::HEALTH, role, 8).await.map_err(|e| e.to_string())?;
    let begun = Instant::now();
    let (_, first) = next_of(&mut heard, "event/health", |_, _| true).await?;
    next_of(&mut heard, "second event/health", |_, _| true).await?;
    hold(first.sender == role, || format!("event/health comes from sender `{}`", first.sender))?;
    let took = begun.elapsed();
    hold(took < Duration::from_secs(10), || format!("two signs of life took {:.1} s", took.as_secs_f64()))
}

async fn metrics(stage: &Stage<'_>) -> Result<(), String> {
    let asked = stage.cli.ask_role(&keys::METRICS, stage.subject.role, &MetricsRequest {}, &soon()).await;
    let text = asked.map_err(|f| f.to_string())?.text;
    let samples: Vec<&str> = text.lines().filter(|l| !l.is_empty() && !l.starts_with('#')).collect();
    hold(!samples.is_empty(), || "no sample in it".to_owned())?;
    let value = |line: &str| line.rsplit(' ').next().and_then(|v| v.parse::<f64>().ok());
    let wrong: Vec<_> = samples.iter().filter(|l| value(l).is_none()).collect();
    hold(wrong.is_empty(), || format!("not in Prometheus' text format: {wrong:?}"))
}

async fn newest_values(stage: &Stage<'_>) -> Result<(), String> {
    let role = stage.subject.role;
    for row in answered_rows(role) {
        let Kind::Retained { message } = &row.kind else { continue };
        match stage.cli.ask_raw(role, row.name, &RawMessage::default(), ANSWER).await {
            RawReply::Reply { encoding, payload } if encoding == self::encoding(message) => {
                sg_proto::recode(message, &payload).ok_or("not in the contract")?.map_err(|e| e.to_string())?;
            }
            other => return Err(format!("`{}` is answered with {other:?}", row.name)),
        }
    }
    Ok(())
}

async fn one_answer_for_one_id(stage: &mut Stage<'_>) -> Result<(), String> {
    let id = stage.new_id();
    let (first, second) = (stage.essence(&id).await?, stage.essence(&id).await?);
    hold(first == second, || format!("the same id again is answered otherwise:\n  {first}\n  {second}"))
}

async fn deadlines(stage: &mut Stage<'_>) -> Result<(), String> {
    for _ in 0..10 {
        let id = stage.new_id();
        let question = (stage.subject.question)(&id);
        let envelope = Envelope { deadline_ms: 1, ..question.envelope(&id) };
        let raw = question.within(&envelope);
        match stage.cli.ask_raw(stage.subject.role, question.name, &raw, ANSWER).await {
            RawReply::Reply { .. } => (),
            other => refused_as(other, &[Code::DeadlineExceeded])?,
        }
    }
    Ok(())
}

async fn withdrawal(stage: &mut Stage<'_>) -> Result<(), String> {
    let role = stage.subject.role;
    let unknown = CancelRequest { id: stage.new_id() };
    let reply = stage.cli.ask_role(&keys::CANCEL, role, &unknown, &soon()).await.map_err(|f| f.to_string())?;
    hold(!reply.found, || "it says to have found an id that was never asked".to_owned())?;

    let ids: Vec<String> = (0..BURST).map(|_| stage.new_id()).collect();
    let asking: Vec<_> = ids
        .iter()
        .map(|id| {
            let (cli, question, id) = (stage.cli.clone(), (stage.subject.question)(id), id.clone());
            tokio::spawn(async move { cli.ask_raw(role, question.name, &question.raw(&id), ANSWER).await })
        })
        .collect();
    let last = CancelRequest { id: ids.last().cloned().unwrap_or_default() };
    let reply = stage.cli.ask_role(&keys::CANCEL, role, &last, &soon()).await.map_err(|f| f.to_string())?;
    for (n, asked) in asking.into_iter().enumerate() {
        let heard = asked.await.map_err(|e| e.to_string())?;
        let is_last = n + 1 == BURST;
        match refusal(heard.clone()) {
            Ok(error) if error.code() == Code::Cancelled => {
                hold(is_last, || "another question than the one withdrawn was answered `cancelled`".to_owned())?;
            }
            // A full queue refuses at once; a question that came after its withdrawal is answered.
            Ok(error) => hold(error.code() == Code::ResourceExhausted, || format!("refused: {error:?}"))?,
            Err(why) => {
                hold(matches!(heard, RawReply::Reply { .. }), || why)?;
                hold(!(is_last && reply.found), || "a withdrawn question got its answer all the same".to_owned())?;
            }
        }
    }
    Ok(())
}

/// Field 12345 as a number: a newer version may have added such a field anywhere.
const NEWER_FIELD: [u8; 4] = [0xc8, 0x83, 0x06, 0x01];

async fn newer_version(stage: &mut Stage<'_>) -> Result<(), String> {
    let id = stage.new_id();
    let question = (stage.subject.question)(&id);
    let mut raw = question.raw(&id);
    raw.payload = raw.payload.map(|p| [&p[..], &NEWER_FIELD].concat());
    raw.attachment = raw.attachment.map(|a| [&a[..], &NEWER_FIELD].concat());
    let heard = stage.cli.ask_raw(stage.subject.role, question.name, &raw, ANSWER).await;
    question.replied(heard).map(drop)
}

/// The program accepts the form of the released encodings of every row's requests. It answers them or refuses their content, but
/// never their form.
async fn released_messages(stage: &mut Stage<'_>) -> Result<(), String> {
    let role = stage.subject.role;
    let before = stage.health(role).await?.refused;
    let parts = released::golden_parts().map_err(|e| e.to_string())?;
    let mut sent = 0;
    for row in answered_rows(role) {
        let Kind::Request { request, .. } = &row.kind else { continue };
        // A promotion is not tried with made-up numbers.
        if row.name == keys::PROMOTE.name {
            continue;
        }
        let sender = row.senders.first().copied().filter(|s| *s != keys::ANY).unwrap_or(role::CLI);
        for (package, text) in GOLDEN {
            let Some(part) = parts.iter().find(|p| p.package == package) else { continue };
            let lines = text.get(..part.bytes).unwrap_or_default().lines();
            for line in lines.filter(|l| l.split(' ').next() == Some(request)) {
                let envelope =
                    Envelope { id: stage.new_id(), sender: sender.to_owned(), deadline_ms: 500, ..Envelope::default() };
                let raw = RawMessage {
                    encoding: encoding(request),
                    payload: Some(Line::parse(line).map_err(|e| e.to_string())?.bytes),
                    attachment: Some(envelope.encode_to_vec()),
                };
                let heard = stage.cli.ask_raw(role, row.name, &raw, ANSWER).await;
                hold(heard != RawReply::Nothing, || format!("{}: no answer to a released {request}", row.name))?;
                sent += 1;
            }
        }
    }
    let after = stage.health(role).await?.refused;
    hold(after == before, || format!("{} of {sent} released messages were refused for their form", after - before))
}

/// Killed without a word, it comes back with the same answers.
pub(super) async fn restart(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    let outcome = async {
        let id = stage.new_id();
        let before = stage.essence(&id).await?;
        let ready = stage.kill_and_serve().await?;
        ready_is_right(stage, &ready, false, stage.epoch())?;
        let after = stage.essence(&id).await?;
        hold(before == after, || format!("the same id is answered otherwise:\n  {before}\n  {after}"))
    };
    checks.note("comes back after kill -9 with the same answers", outcome.await);
}

/// A second instance stands by, the first drains, and the second is promoted. Callers get their answers throughout.
pub(super) async fn hand_over(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    let role = stage.subject.role;
    let Some(mut incumbent) = stage.serving.take() else {
        checks.note("stands by", Err("no candidate serves".to_owned()));
        return;
    };
    let newcomer = stage.new_instance();
    let segment = keys::instance(&newcomer);
    let standing = async {
        let mut heard = stage.hear_ready("@instance/*").await?;
        let process = stage.start(&newcomer, &["--standby"])?;
        let ready = next_ready(&mut heard, &newcomer, stage.candidate.ready).await;
        let ready = ready.ok_or_else(|| format!("it does not announce itself: {}", process.last_words()))?;
        ready_is_right(stage, &ready, true, 0)?;
        let health = stage.health(&segment).await?;
        hold(health.phase() == Phase::Standby, || format!("cmd/status says phase {:?}", health.phase()))?;
        let serving = stage.health(role).await?.instance;
        hold(serving == incumbent.instance, || format!("the role is answered by `{serving}` already"))?;
        let question = (stage.subject.question)("tried out");
        let raw = question.raw("tried out");
        question.replied(stage.cli.ask_raw(&segment, question.name, &raw, ANSWER).await)?;
        let strangers = stage.cli.ask_role(&keys::PROMOTE, &segment, &PromoteRequest { epoch: 1 }, &soon()).await;
        hold(strangers.as_ref().is_err_and(|f| f.code == Code::PermissionDenied), || {
            format!("anybody may promote it: {strangers:?}")
        })?;
        Ok(process)
    };
    let process = match standing.await {
        Ok(process) => process,
        Err(why) => {
            checks.note("stands by", Err(why));
            stage.serving = Some(incumbent);
            return;
        }
    };
    checks.note("stands by", Ok(()));

    // A caller goes on asking with the bus's own patience while the role changes hands.
    let (cli, id) = (stage.cli.clone(), stage.new_id());
    let done = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
    let stop = std::sync::Arc::clone(&done);
    let asking = tokio::spawn(async move {
        let mut asked = 0_u32;
        while !stop.load(std::sync::atomic::Ordering::Relaxed) {
            let context = soon().with_id(format!("{id}-{asked}"));
            cli.ask_role(&keys::STATUS, role, &StatusRequest {}, &context).await.map_err(|f| f.to_string())?;
            asked += 1;
        }
        hold(asked > 0, || "nothing was asked".to_owned())
    });
    incumbent.signal(nix::sys::signal::Signal::SIGTERM);
    let ended = incumbent.end(END).await;
    checks.note(
        "drains and ends with status 0 when it is told to",
        match ended {
            Some(Ended { status: Some(0) }) => Ok(()),
            Some(Ended { status }) => Err(format!("it ended with {status:?}: {}", incumbent.last_words())),
            None => Err(format!("it still runs after {} s", END.as_secs())),
        },
    );
    drop(incumbent);

    let promotion = async {
        let mut heard = stage.hear_ready(role).await?;
        let epoch = stage.next_epoch();
        let promoted = stage.router.ask_role(&keys::PROMOTE, &segment, &PromoteRequest { epoch }, &soon()).await;
        promoted.map_err(|f| format!("cmd/promote: {f}"))?;
        let ready = next_ready(&mut heard, &newcomer, ANSWER).await.ok_or("it does not announce its role")?;
        ready_is_right(stage, &ready, false, epoch)?;
        let health = stage.health(role).await?;
        hold(health.instance == newcomer && health.phase() == Phase::Ready && health.epoch == epoch, || {
            format!("`{}` of epoch {} answers in phase {:?}", health.instance, health.epoch, health.phase())
        })?;
        let id = stage.new_id();
        stage.essence(&id).await?;
        let again =
            stage.router.ask_role(&keys::PROMOTE, &segment, &PromoteRequest { epoch: epoch + 1 }, &soon()).await;
        hold(again.as_ref().is_err_and(|f| f.code == Code::FailedPrecondition), || {
            format!("it can be promoted twice: {again:?}")
        })
    };
    checks.note("takes the role when it is promoted", promotion.await);
    done.store(true, std::sync::atomic::Ordering::Relaxed);
    let lost = asking.await.map_err(|e| e.to_string()).flatten();
    checks.note("loses no question while the role changes hands", lost);
    stage.serving = Some(process);
}

/// A process ends with its supervisor.
pub(super) async fn ends(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    // The role has to be free for another.
    stage.serving = None;
    let outcome = async {
        let instance = stage.new_instance();
        let mut heard = stage.hear_ready(stage.subject.role).await?;
        let mut supervisor = stage.start_below_another(&instance)?;
        let ready = next_ready(&mut heard, &instance, stage.candidate.ready).await;
        let ready = ready.ok_or_else(|| format!("not ready below another process: {}", supervisor.last_words()))?;
        supervisor.kill_alone().await;
        let process = format!("/proc/{}/stat", ready.pid);
        let begun = Instant::now();
        while runs(&process) {
            hold(begun.elapsed() < ORPHAN, || format!("it still runs after {} s", ORPHAN.as_secs()))?;
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        Ok(())
    };
    checks.note("ends with its supervisor", outcome.await);
}

/// Whether a process runs. A dead process that its parent has not waited for does not.
fn runs(stat: &str) -> bool {
    let text = std::fs::read_to_string(stat).unwrap_or_default();
    text.rsplit(')').next().and_then(|rest| rest.split_whitespace().next()).is_some_and(|state| state != "Z")
}
