//! Checks of the role that carries out plans.

use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::language::{Act, Clause, Observation, Plan, PlanResult, Reference};
use sg_proto::scene::BaseUnit;
use sg_runtime::bus::Bus;

use super::question::{Question, hold, refused_as, soon};
use super::stage::{Stage, decode, next_of};
use super::{Checks, Subject};

const ROLE: &str = role::AGENT_FUNCTION;

pub(super) const SUBJECT: Subject = Subject { role: ROLE, needs: &[role::SCENE], question, essence };

fn question(_id: &str) -> Question {
    let list = Clause { act: Act::List.into(), words: "list the units".to_owned(), ..Clause::default() };
    Question::of(&keys::EXECUTE, &Plan { clauses: vec![list], observation: None })
}

fn essence(payload: &[u8]) -> Result<String, String> {
    let result: PlanResult = decode(payload)?;
    let said: Vec<_> = result.actions.iter().map(|a| (a.ok, a.text.as_str())).collect();
    hold(said.iter().all(|(ok, _)| *ok), || format!("the units cannot be listed: {said:?}"))?;
    Ok(format!("{said:?}"))
}

fn clause(act: Act, name: &str) -> Clause {
    let target = Reference { names: vec![name.to_owned()], ..Reference::default() };
    Clause { act: act.into(), target: Some(target), words: format!("{act:?} {name}"), ..Clause::default() }
}

/// Halves the opacity: done twice, it shows.
fn halve(name: &str) -> Clause {
    Clause { amount: Some(0.5), relative: true, ..clause(Act::SetOpacity, name) }
}

pub(super) async fn checks(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    let outcome = async {
        let core = stage.join(role::AGENT_CORE).await?;
        checks.note("carries out a plan and tells of each step", carries_out(stage, &core).await);
        checks.note("stops at the first step that fails", stops(stage, &core).await);
        checks.note("carries out a plan once", once(stage, &core, false).await);
        checks.note("carries out a plan once though killed in between", once(stage, &core, true).await);
        Ok(())
    };
    let joined: Result<(), String> = outcome.await;
    if joined.is_err() {
        checks.note("can be asked by the core agent", joined);
    }
    checks.note("refuses a plan without end", endless(stage).await);
}

async fn unit(stage: &Stage<'_>, name: &str) -> Result<BaseUnit, String> {
    let state = stage.scene_state().await?;
    state.base_units.into_iter().find(|u| u.name == name).ok_or_else(|| format!("the scene has no {name}"))
}

async fn execute(stage: &Stage<'_>, core: &Bus, id: &str, clauses: Vec<Clause>) -> Result<PlanResult, String> {
    let observation = Observation { scene: Some(stage.scene_state().await?), ..Observation::default() };
    let plan = Plan { clauses, observation: Some(observation) };
    let context = soon().with_id(id).at_step("talk", 5);
    core.ask(&keys::EXECUTE, &plan, &context).await.map_err(|f| format!("cmd/execute: {f}"))
}

async fn carries_out(stage: &mut Stage<'_>, core: &Bus) -> Result<(), String> {
    let mut actions = stage.cli.subscribe(&keys::ACTION, ROLE, 64).await.map_err(|e| e.to_string())?;
    let id = stage.new_id();
    let result = execute(stage, core, &id, vec![clause(Act::Hide, "body"), halve("sac")]).await?;
    let done: Vec<_> = result.actions.iter().map(|a| (a.clause, a.ok, a.command.is_some())).collect();
    hold(done == [(0, true, true), (1, true, true)], || format!("{:?}", result.actions))?;
    hold(!unit(stage, "body").await?.visible, || "the body is still shown".to_owned())?;
    let sac = unit(stage, "sac").await?.opacity;
    hold((sac - 0.5).abs() < 0.01, || format!("the sac's opacity is {sac}, not a half"))?;
    for n in 0..2 {
        next_of(&mut actions, "event/action", |a, c| a.clause == n && c.conversation == "talk").await?;
    }
    let revision = stage.scene_state().await?.revision;
    hold(result.revision == revision, || format!("revision {} told, {revision} is", result.revision))
}

async fn stops(stage: &mut Stage<'_>, core: &Bus) -> Result<(), String> {
    let before = stage.scene_state().await?.revision;
    let id = stage.new_id();
    let result = execute(stage, core, &id, vec![clause(Act::Hide, "no such thing"), halve("sac")]).await?;
    let failed = result.actions.first().filter(|a| !a.ok && !a.text.is_empty());
    hold(failed.is_some() && result.actions.len() == 1, || format!("{:?}", result.actions))?;
    let after = stage.scene_state().await?.revision;
    hold(after == before, || "a step after the failed one was carried out".to_owned())
}

async fn once(stage: &mut Stage<'_>, core: &Bus, killed: bool) -> Result<(), String> {
    let id = stage.new_id();
    let observation = Observation { scene: Some(stage.scene_state().await?), ..Observation::default() };
    let plan = Plan { clauses: vec![halve("sac"), halve("body")], observation: Some(observation) };
    let context = || soon().with_id(id.clone());
    let first = core.ask(&keys::EXECUTE, &plan, &context()).await.map_err(|f| format!("cmd/execute: {f}"))?;
    let before = stage.scene_state().await?;
    if killed {
        stage.kill_and_serve().await?;
    }
    let second = core.ask(&keys::EXECUTE, &plan, &context()).await.map_err(|f| format!("cmd/execute: {f}"))?;
    let after = stage.scene_state().await?;
    hold(after.base_units == before.base_units && after.revision == before.revision, || {
        format!("the same plan again took the scene from revision {} to {}", before.revision, after.revision)
    })?;
    hold(second.actions.len() == first.actions.len() && second.actions.iter().all(|a| a.ok), || format!("{second:?}"))
}

async fn endless(stage: &mut Stage<'_>) -> Result<(), String> {
    let id = stage.new_id();
    let plan = Plan { clauses: vec![clause(Act::Show, "sac"); 20_000], observation: None };
    let codes = &[Code::InvalidArgument, Code::ResourceExhausted, Code::OutOfRange];
    refused_as(stage.put(&Question::of(&keys::EXECUTE, &plan), &id).await, codes)
}
