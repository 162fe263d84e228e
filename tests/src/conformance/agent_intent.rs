//! Checks of the role that understands utterances.

use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::language::{Act, Clause, Intent, IntentRequest, Observation};
use sg_proto::limits::MAX_UTTERANCE_BYTES;
use sg_proto::scene::{BaseUnit, State};

use super::question::{Question, hold, refused_as, soon};
use super::stage::{Stage, decode, next_of, text_of};
use super::{Checks, Subject};

pub(super) const ROLE: &str = role::AGENT_INTENT;

pub(super) const SUBJECT: Subject = Subject { role: ROLE, needs: &[], question, essence };

/// An utterance in front of a scene with a body and a sac.
fn request(text: &str) -> IntentRequest {
    let unit = |name: &str| BaseUnit { name: name.to_owned(), visible: true, opacity: 1.0, ..BaseUnit::default() };
    let scene = State { base_units: vec![unit("body"), unit("sac")], ..State::default() };
    let observation = Observation { moment: "before".to_owned(), scene: Some(scene), ..Observation::default() };
    IntentRequest { text: text.to_owned(), observation: Some(observation), ..IntentRequest::default() }
}

fn question(_id: &str) -> Question {
    Question::of(&keys::PARSE, &request("make the sac red"))
}

fn essence(payload: &[u8]) -> Result<String, String> {
    let intent: Intent = decode(payload)?;
    Ok(text_of(&intent))
}

pub(super) async fn checks(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    checks.note("understands what everybody says", understands(stage).await);
    checks.note("says what it has not understood", not_understood(stage).await);
    checks.note("refuses what is no utterance", misfits(stage).await);
    checks.note("publishes what it understood, in its conversation", publishes(stage).await);
}

async fn parse(stage: &Stage<'_>, text: &str) -> Result<Intent, String> {
    let intent = stage.cli.ask(&keys::PARSE, &request(text), &soon()).await;
    intent.map_err(|f| format!("“{text}”: {f}"))
}

fn is_about(clause: &Clause, name: &str) -> bool {
    let target = clause.target.clone().unwrap_or_default();
    !target.complement && target.names.iter().any(|n| n.to_lowercase().contains(name))
}

fn is_close(clause: &Clause, amount: f64) -> bool {
    clause.amount.is_some_and(|a| (a - amount).abs() < 0.01)
}

fn is_red(clause: &Clause) -> bool {
    clause.color.is_some_and(|c| c.red > 0.7 && c.green < 0.3 && c.blue < 0.3)
}

async fn understands(stage: &Stage<'_>) -> Result<(), String> {
    type Fits = fn(&[Clause]) -> bool;
    let sayings: [(&str, &[Act], Fits); 7] = [
        ("undo", &[Act::Undo], |_| true),
        ("hide the body", &[Act::Hide], |c| is_about(&c[0], "body")),
        ("show the body", &[Act::Show], |c| is_about(&c[0], "body")),
        ("make the sac red", &[Act::SetColor], |c| is_about(&c[0], "sac") && is_red(&c[0])),
        ("fade the body to 20 percent", &[Act::SetOpacity], |c| is_about(&c[0], "body") && is_close(&c[0], 0.2)),
        ("set the opacity of the sac to 0.5", &[Act::SetOpacity], |c| is_about(&c[0], "sac") && is_close(&c[0], 0.5)),
        ("make the sac red and fade everything else to 20 percent", &[Act::SetColor, Act::SetOpacity], |c| {
            is_about(&c[0], "sac") && c[1].target.as_ref().is_some_and(|t| t.complement) && is_close(&c[1], 0.2)
        }),
    ];
    for (text, acts, fits) in sayings {
        let intent = parse(stage, text).await?;
        let understood: Vec<Act> = intent.clauses.iter().map(Clause::act).collect();
        let all = understood == acts && intent.not_understood.is_empty() && fits(&intent.clauses);
        hold(all, || format!("“{text}” is understood as {intent:?}"))?;
        hold(!intent.backend.is_empty(), || "it does not say what understood it".to_owned())?;
    }
    Ok(())
}

async fn not_understood(stage: &Stage<'_>) -> Result<(), String> {
    let nonsense = parse(stage, "florble the grumpf sideways").await?;
    hold(nonsense.clauses.is_empty() && !nonsense.not_understood.is_empty(), || format!("nonsense: {nonsense:?}"))?;
    let half = parse(stage, "hide the sac, then florble the grumpf").await?;
    hold(half.clauses.first().is_some_and(|c| c.act() == Act::Hide) && !half.not_understood.is_empty(), || {
        format!("what was half nonsense: {half:?}")
    })
}

async fn misfits(stage: &mut Stage<'_>) -> Result<(), String> {
    for (what, text) in [("nothing", " ".to_owned()), ("a book", "red ".repeat(MAX_UTTERANCE_BYTES))] {
        let id = stage.new_id();
        let question = Question::of(&keys::PARSE, &request(&text));
        refused_as(stage.put(&question, &id).await, &[Code::InvalidArgument])
            .map_err(|why| format!("{what}: {why}"))?;
    }
    Ok(())
}

async fn publishes(stage: &Stage<'_>) -> Result<(), String> {
    let mut intents = stage.cli.subscribe(&keys::INTENT, ROLE, 64).await.map_err(|e| e.to_string())?;
    let before = stage.cli.newest(&keys::INTENT_STATE, &soon()).await.map_err(|f| f.to_string())?;
    let context = soon().at_step("talk", 4);
    let asked = stage.cli.ask(&keys::PARSE, &request("hide the sac"), &context).await.map_err(|f| f.to_string())?;
    let (told, chain) = next_of(&mut intents, "event/intent", |_, c| c.conversation == "talk").await?;
    hold(told == asked, || "what is published is not what was answered".to_owned())?;
    hold(chain.step == 4 && chain.cause == context.id, || {
        format!("step {} caused by `{}`, not step 4 caused by `{}`", chain.step, chain.cause, context.id)
    })?;
    let after = stage.cli.newest(&keys::INTENT_STATE, &soon()).await.map_err(|f| f.to_string())?;
    hold(after.answered > before.answered && !after.backend.is_empty(), || format!("{before:?}, then {after:?}"))
}
