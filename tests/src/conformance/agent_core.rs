//! Checks of the role that hears utterances and answers.

use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::language::{Act, Clause, Reference, Reply, Source, Utterance};
use sg_proto::limits::MAX_UTTERANCE_BYTES;
use sg_proto::scene::Color;

use super::question::{Question, hold, refused_as, soon};
use super::stage::{Stage, decode, next_of};
use super::{Checks, Subject};

pub(super) const ROLE: &str = role::AGENT_CORE;

pub(super) const SUBJECT: Subject =
    Subject { role: ROLE, needs: &[role::SCENE, role::AGENT_INTENT, role::AGENT_FUNCTION], question, essence };

fn utterance(text: &str) -> Utterance {
    Utterance { text: text.to_owned(), source: Source::Text.into(), ..Utterance::default() }
}

fn question(_id: &str) -> Question {
    Question::of(&keys::UTTER, &utterance("list the units"))
}

fn essence(payload: &[u8]) -> Result<String, String> {
    let reply: Reply = decode(payload)?;
    hold(reply.ok, || format!("the units cannot be listed: {}", reply.text))?;
    Ok(reply.text)
}

pub(super) async fn checks(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    checks.note("closes the loop, stage by stage", closes_the_loop(stage).await);
    checks.note("does what was said once", once(stage, false).await);
    checks.note("does what was said once though killed in between", once(stage, true).await);
    checks.note("says what was not understood", not_understood(stage).await);
    checks.note("does typed actions of a program, but none on files", typed_actions(stage).await);
    checks.note("refuses what is no utterance", misfits(stage).await);
}

async fn say(stage: &Stage<'_>, text: &str, id: &str) -> Result<Reply, String> {
    let context = soon().with_id(id).at_step("talk", 1);
    stage.cli.ask(&keys::UTTER, &utterance(text), &context).await.map_err(|f| format!("“{text}”: {f}"))
}

async fn closes_the_loop(stage: &mut Stage<'_>) -> Result<(), String> {
    let fail = |e: sg_runtime::bus::BusError| e.to_string();
    let mut utterances = stage.cli.subscribe(&keys::UTTERANCE, ROLE, 64).await.map_err(fail)?;
    let mut observations = stage.cli.subscribe(&keys::OBSERVATION, ROLE, 64).await.map_err(fail)?;
    let mut plans = stage.cli.subscribe(&keys::PLAN, ROLE, 64).await.map_err(fail)?;
    let mut replies = stage.cli.subscribe(&keys::REPLY, ROLE, 64).await.map_err(fail)?;
    let id = stage.new_id();
    let reply = say(stage, "make the sac red", &id).await?;
    hold(reply.ok && !reply.text.is_empty(), || format!("{reply:?}"))?;
    let state = stage.scene_state().await?;
    let sac = state.base_units.iter().find(|u| u.name == "sac").and_then(|u| u.palette).unwrap_or_default();
    hold(sac.red > 0.7 && sac.green < 0.3, || format!("the sac is {sac:?}"))?;
    hold(reply.revision == state.revision, || format!("revision {} told, {} is", reply.revision, state.revision))?;
    let (_, first) = next_of(&mut utterances, "event/utterance", |_, c| c.conversation == "talk").await?;
    let (seen, second) = next_of(&mut observations, "event/observation", |_, c| c.conversation == "talk").await?;
    let (_, third) = next_of(&mut plans, "event/plan", |_, c| c.conversation == "talk").await?;
    let (told, last) = next_of(&mut replies, "event/reply", |_, c| c.conversation == "talk").await?;
    let steps = [first.step, second.step, third.step, last.step];
    hold(steps.is_sorted_by(|a, b| a < b), || format!("the steps of the stages do not grow: {steps:?}"))?;
    hold(seen.scene.is_some(), || "it acted without having seen the scene".to_owned())?;
    hold(told.text == reply.text, || "what is published is not what was answered".to_owned())
}

async fn once(stage: &mut Stage<'_>, killed: bool) -> Result<(), String> {
    for text in ["make the body green", "make the body blue"] {
        let id = stage.new_id();
        say(stage, text, &id).await?;
    }
    let id = stage.new_id();
    let first = say(stage, "undo", &id).await?;
    hold(first.ok, || format!("{first:?}"))?;
    let before = stage.scene_state().await?;
    if killed {
        stage.kill_and_serve().await?;
    }
    let second = say(stage, "undo", &id).await?;
    let after = stage.scene_state().await?;
    hold(after.base_units == before.base_units && second.ok, || {
        format!("the same utterance again took the scene from revision {} to {}", before.revision, after.revision)
    })
}

async fn not_understood(stage: &mut Stage<'_>) -> Result<(), String> {
    let before = stage.scene_state().await?.revision;
    let id = stage.new_id();
    let reply = say(stage, "florble the grumpf sideways", &id).await?;
    hold(!reply.ok && !reply.text.is_empty(), || format!("{reply:?}"))?;
    let after = stage.scene_state().await?.revision;
    hold(after == before, || "nonsense changed the scene".to_owned())
}

async fn typed_actions(stage: &mut Stage<'_>) -> Result<(), String> {
    let blue = Some(Color { red: 0.0, green: 0.0, blue: 1.0 });
    let target = Some(Reference { names: vec!["sac".to_owned()], ..Reference::default() });
    let words = || "for the program".to_owned();
    let color = Clause { act: Act::SetColor.into(), target, color: blue, words: words(), ..Clause::default() };
    let file = Clause { act: Act::SavePicture.into(), words: words(), ..Clause::default() };
    let id = stage.new_id();
    let reply = send_typed(stage, vec![color.clone()], &id).await?;
    hold(reply.ok, || format!("{reply:?}"))?;
    let before = stage.scene_state().await?;
    let sac = before.base_units.iter().find(|u| u.name == "sac").and_then(|u| u.palette).unwrap_or_default();
    hold(sac.blue > 0.99 && sac.red < 0.01, || format!("the sac is {sac:?}"))?;
    let id = stage.new_id();
    let reply = send_typed(stage, vec![color, file], &id).await?;
    hold(!reply.ok && !reply.text.is_empty(), || format!("{reply:?}"))?;
    let after = stage.scene_state().await?;
    hold(after.revision == before.revision, || "actions beside one on a file were done".to_owned())
}

async fn send_typed(stage: &Stage<'_>, clauses: Vec<Clause>, id: &str) -> Result<Reply, String> {
    // The text would do something else.
    let utterance = Utterance { text: "hide everything".to_owned(), source: Source::Program.into(), clauses };
    let context = soon().with_id(id).at_step("typed", 1);
    stage.cli.ask(&keys::UTTER, &utterance, &context).await.map_err(|f| f.to_string())
}

async fn misfits(stage: &mut Stage<'_>) -> Result<(), String> {
    let id = stage.new_id();
    let book = utterance(&"red ".repeat(MAX_UTTERANCE_BYTES));
    refused_as(stage.put(&Question::of(&keys::UTTER, &book), &id).await, &[Code::InvalidArgument])
}
