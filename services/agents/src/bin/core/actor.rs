//! The core agent on the bus: hear, look, understand, act, look again, answer. Every stage is published under the
//! conversation's id, each with the next step number.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use sg_agents::prompt::clipped;
use sg_agents::recent::Recent;
use sg_agents::reply::{self, Seen};
use sg_agents::understand::{MAX_EXCHANGE_BYTES, MAX_EXCHANGES};
use sg_agents::{grammar, identity, retell};
use sg_proto::bus::Code;
use sg_proto::keys::{self, Stream, role};
use sg_proto::language::{
    AgentState, Exchange, Intent, IntentRequest, Observation, Perceive, Plan, PlanResult, Reply, Utterance,
};
use sg_proto::limits::MAX_UTTERANCE_BYTES;
use sg_proto::render::{CaptureRequest, Quality};
use sg_runtime::actor::{self, Actor};
use sg_runtime::bus::{Bus, Liveliness, Owned};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{Host, StartError};
use tokio::sync::{mpsc, watch};

use crate::mind::Mind;

/// Utterances that wait at most.
const QUEUE: usize = 16;
/// Replies and faults kept for askers that ask again.
const KEPT_REPLIES: usize = 64;
/// Less time than this is not enough to try again what failed for the moment.
const LEAST_TIME: Duration = Duration::from_millis(500);
/// Conversations that are remembered.
const KEPT_CONVERSATIONS: usize = 256;
/// Edge of the picture that is looked at, pixels.
const LOOK_PIXELS: u32 = 256;
/// Most units whose coverage is measured in one look: each costs a picture.
const MEASURED_UNITS: usize = 32;
/// Longest wait for one look, of which the scene itself takes a part.
const LOOK_TIME: Duration = Duration::from_secs(3);
/// Time kept back for the answer's own way.
const MARGIN: Duration = Duration::from_millis(150);
/// Processes that come and go between two looks at who is there.
const LIVELINESS_QUEUE: usize = 256;

pub(crate) async fn start(host: Host) -> Result<(), StartError> {
    if host.role() != role::AGENT_CORE {
        return Err(StartError::Input(format!(
            "role `{}`: this executable serves `{}`",
            host.role(),
            role::AGENT_CORE
        )));
    }
    let mind =
        Mind::new(&host.params()?).map_err(|e| StartError::Input(format!("parameters of `{}`: {e}", host.role())))?;
    let told = mind.told();
    let state = host.bus().own(&keys::CORE_STATE, told.clone()).await?;
    let seers = follow_captures(host.bus().watch_alive(LIVELINESS_QUEUE).await?);
    let core = Core {
        bus: host.bus().clone(),
        mind,
        told,
        state,
        seers,
        understood: Recent::new(KEPT_REPLIES),
        replies: Recent::new(KEPT_REPLIES),
        failed: Recent::new(KEPT_REPLIES),
        talks: Recent::new(KEPT_CONVERSATIONS),
    };
    let (mailbox, _) = host.spawn(core, QUEUE);
    host.serve(&keys::UTTER, QUEUE, move |utterance, context| {
        let mailbox = mailbox.clone();
        async move { mailbox.ask(context.deadline, |reply| Message::Utter { utterance, context, reply }).await }
    })
    .await?;
    Ok(())
}

/// How many capture processes are alive: where there is none, nobody waits for a picture.
fn follow_captures(mut coming: mpsc::Receiver<Liveliness>) -> watch::Receiver<usize> {
    let (count, seers) = watch::channel(0);
    tokio::spawn(async move {
        let mut alive = BTreeSet::new();
        while let Some(seen) = coming.recv().await {
            if seen.role == role::RENDER_CAPTURE {
                if seen.alive {
                    alive.insert(seen.instance)
                } else {
                    alive.remove(&seen.instance)
                };
                count.send_replace(alive.len());
            }
        }
    });
    seers
}

enum Message {
    Utter { utterance: Utterance, context: Context, reply: actor::Reply<Reply> },
}

struct Core {
    bus: Bus,
    mind: Mind,
    told: AgentState,
    state: Owned<AgentState>,
    seers: watch::Receiver<usize>,
    /// Intents by utterance: a model might understand otherwise when the same utterance comes again, and half of its plan
    /// may be done.
    understood: Recent<Intent>,
    /// Replies by utterance, for askers that ask again.
    replies: Recent<Reply>,
    /// Faults of the moment by utterance, for an asker that asks again with no time left to try again.
    failed: Recent<Fault>,
    /// Conversations as far as they are remembered.
    talks: Recent<Talk>,
}

/// What is remembered of a conversation.
#[derive(Debug, Clone, Default)]
struct Talk {
    /// The last step.
    step: u32,
    /// The last turns, oldest first.
    exchanges: Vec<Exchange>,
}

impl Talk {
    fn add(&mut self, said: &str, answered: &str) {
        let cut = |text| clipped(text, MAX_EXCHANGE_BYTES).to_owned();
        self.exchanges.push(Exchange { said: cut(said), answered: cut(answered) });
        let over = self.exchanges.len().saturating_sub(MAX_EXCHANGES);
        self.exchanges.drain(..over);
    }
}

/// One utterance on its way through the loop.
struct Turn {
    context: Context,
    step: u32,
}

impl Turn {
    /// The context of the next stage.
    fn stage(&mut self) -> Context {
        self.step = self.step.saturating_add(1);
        self.here()
    }

    /// Another message of the present stage.
    fn here(&self) -> Context {
        self.context.next().at_step(self.context.conversation.clone(), self.step)
    }
}

/// A fault of the moment said in the words of a person. One that names a role in its details was put into words by
/// whoever knew better which service is meant.
fn stage_fault(stage: &str, fault: Fault) -> Fault {
    let message = match fault.code {
        _ if fault.details.iter().any(|d| role::ALL.contains(&d.as_str())) => return fault,
        Code::Unavailable => format!("The {stage} agent is away; try again in a moment."),
        Code::DeadlineExceeded => format!("The {stage} agent did not answer in time; try again in a moment."),
        _ => return fault,
    };
    Fault { message, ..fault }
}

impl Core {
    async fn utter(&mut self, utterance: &Utterance, mut context: Context) -> Result<Reply, Fault> {
        let begun = Instant::now();
        if utterance.text.len() > MAX_UTTERANCE_BYTES {
            return Err(Fault::invalid(format!(
                "the utterance has {} bytes; say it in at most {MAX_UTTERANCE_BYTES}",
                utterance.text.len()
            )));
        }
        if context.id.is_empty() {
            context = context.with_id(Context::root().id);
        }
        if let Some(reply) = self.replies.get(&context.id) {
            return Ok(reply.clone());
        }
        if let Some(fault) = self.failed.get(&context.id).filter(|_| context.remaining() < LEAST_TIME) {
            return Err(fault.clone());
        }
        let mut turn = self.begin(context);
        self.tell(&keys::UTTERANCE, utterance, &turn.stage()).await;
        let outcome = match self.turn(utterance, &mut turn).await {
            Ok(reply) => self.worded(reply, &utterance.text, &turn.context).await,
            Err(fault) => Err(fault),
        };
        let mut reply = match &outcome {
            Ok(reply) => reply.clone(),
            Err(fault) => Reply { text: fault.message.clone(), ok: false, ..Reply::default() },
        };
        reply.elapsed_ms = begun.elapsed().as_secs_f64() * 1e3;
        self.tell(&keys::REPLY, &reply, &turn.stage()).await;
        let mut talk = self.talks.get(&turn.context.conversation).cloned().unwrap_or_default();
        talk.step = turn.step;
        talk.add(&utterance.text, &reply.text);
        self.talks.keep(&turn.context.conversation, talk);
        // A fault is of the moment: the same utterance may be sent again and goes on where it stopped.
        match outcome {
            Ok(_) => self.replies.keep(&turn.context.id, reply.clone()),
            Err(fault) => {
                self.failed.keep(&turn.context.id, fault.clone());
                return Err(fault);
            }
        }
        Ok(reply)
    }

    /// Look, understand, act, look again.
    async fn turn(&mut self, utterance: &Utterance, turn: &mut Turn) -> Result<Reply, Fault> {
        let before = self.look("before", 0, turn).await;
        let inner = |context: Context| {
            let time = context.remaining().saturating_sub(MARGIN);
            context.within(time)
        };
        let intent = match self.understood.get(&turn.context.id) {
            Some(intent) => intent.clone(),
            None => {
                let intent = self.understand(utterance, &before, turn).await?;
                self.understood.keep(&turn.context.id, intent.clone());
                intent
            }
        };
        let revision = before.scene.as_ref().map_or(0, |s| s.revision);
        if intent.clauses.is_empty() {
            return Ok(reply::not_understood(&intent, revision));
        }
        let plan = Plan { clauses: intent.clauses.clone(), observation: Some(before.clone()) };
        let acting = turn.stage();
        self.tell(&keys::PLAN, &plan, &acting).await;
        let execute = inner(turn.stage()).with_id(identity::plan(&turn.context.id));
        let outcome: PlanResult =
            self.bus.ask(&keys::EXECUTE, &plan, &execute).await.map_err(|f| stage_fault("function", f))?;
        let changed = outcome.actions.iter().any(|action| {
            let clause = usize::try_from(action.clause).ok().and_then(|i| intent.clauses.get(i));
            action.ok && action.command.is_some() && clause.is_some_and(reply::changes_picture)
        });
        let after = if changed { Some(self.look("after", outcome.revision, turn).await) } else { None };
        let frames = after.as_ref().and_then(|a| Some((before.frame.as_ref()?, a.frame.as_ref()?)));
        let differ = tokio::task::block_in_place(|| frames.and_then(|(b, a)| reply::differ(b, a)));
        let seen = Seen { before: &before, after: after.as_ref(), changed: differ };
        Ok(reply::compose(&intent, &outcome, &seen))
    }

    /// Asks what an utterance means; whoever understands leaves time to act.
    async fn understand(&self, utterance: &Utterance, before: &Observation, turn: &mut Turn) -> Result<Intent, Fault> {
        let talk = self.talks.get(&turn.context.conversation);
        let request = IntentRequest {
            text: utterance.text.clone(),
            observation: Some(before.clone()),
            conversation: talk.map_or_else(Vec::new, |talk| talk.exchanges.clone()),
        };
        let parse = turn.stage();
        let time = parse.remaining() * 2 / 3;
        let parse = parse.within(time).with_id(identity::intent(&turn.context.id));
        self.bus.ask(&keys::PARSE, &request, &parse).await.map_err(|f| stage_fault("intent", f))
    }

    /// A reply in the model's words, where there is a model and it keeps to the facts.
    async fn worded(&mut self, reply: Reply, said: &str, context: &Context) -> Result<Reply, Fault> {
        let plain = Reply { facts: reply.text.clone(), backend: grammar::NAME.to_owned(), ..reply };
        if !self.mind.has_model() {
            return Ok(plain);
        }
        let Some(prompt) = retell::prompt(role::AGENT_CORE, said, &plain, &identity::wording(&context.id)) else {
            return Ok(plain);
        };
        let deadline = context.deadline.checked_sub(MARGIN).unwrap_or(context.deadline);
        match self.mind.ask(&prompt, deadline, |answer| retell::accept(answer, said, &plain.facts)).await {
            Ok(thought) => {
                self.mind.served();
                Ok(Reply {
                    text: thought.value,
                    backend: self.mind.backend().to_owned(),
                    model: thought.model,
                    ..plain
                })
            }
            // What was done stays done, so it is told even where only the model was to tell it.
            Err(error) => match self.mind.instead(&error, &mut self.told) {
                Ok(fallback) => Ok(Reply { fallback, ..plain }),
                Err(fault) => {
                    let message = format!("{} {}", plain.facts, fault.message);
                    Err(Fault { message, ..fault })
                }
            },
        }
    }

    /// Looks at the scene and its picture. What cannot be seen in time is said in the observation, never an error.
    async fn look(&self, moment: &str, at_least_revision: u64, turn: &mut Turn) -> Observation {
        let context = turn.stage();
        let time = LOOK_TIME.min(context.remaining() / 3);
        let looking = context.clone().within(time);
        let mut observation = Observation { moment: moment.to_owned(), ..Observation::default() };
        let mut missing = Vec::new();
        match self.bus.newest(&keys::SCENE_STATE, &looking.next()).await {
            Ok(scene) => observation.scene = Some(scene),
            Err(fault) => missing.push(said(&fault, "scene")),
        }
        let scene = observation.scene.as_ref();
        let units = scene.map_or(0, |s| s.base_units.len() + s.units.len());
        let capture = CaptureRequest {
            width: LOOK_PIXELS,
            height: LOOK_PIXELS,
            quality: Quality::Fast.into(),
            at_least_revision: at_least_revision.max(scene.map_or(0, |s| s.revision)),
            measure_units: units <= MEASURED_UNITS,
            ..CaptureRequest::default()
        };
        let perceive = Perceive { capture: Some(capture.clone()), moment: moment.to_owned() };
        self.tell(&keys::PERCEIVE, &perceive, &context).await;
        if *self.seers.borrow() == 0 {
            missing.push("no process draws pictures at the moment".to_owned());
        } else if scene.is_some() {
            match self.bus.ask(&keys::CAPTURE, &capture, &looking.next()).await {
                Ok(frame) => observation.frame = Some(frame),
                Err(fault) => missing.push(said(&fault, "render")),
            }
        }
        observation.missing = missing.join("; ");
        self.tell(&keys::OBSERVATION, &observation, &turn.stage()).await;
        observation
    }

    /// Publishes a stage; the loop goes on whether or not anybody could be told.
    async fn tell<M: prost::Message + prost::Name>(&self, row: &Stream<M>, message: &M, context: &Context) {
        if let Err(fault) = self.bus.publish(row, message, context).await {
            tracing::warn!(%fault, key = row.name, "a stage could not be published");
        }
    }

    /// The conversation of an utterance: its own, or a new one; steps go on where the last utterance left them.
    fn begin(&self, context: Context) -> Turn {
        let conversation =
            if context.conversation.is_empty() { Context::root().id } else { context.conversation.clone() };
        let last = self.talks.get(&conversation).map_or(0, |talk| talk.step);
        let step = last.max(context.step.saturating_sub(1));
        let context = context.at_step(conversation, step);
        Turn { context, step }
    }
}

/// Why something could not be seen.
fn said(fault: &Fault, service: &str) -> String {
    match fault.code {
        Code::Unavailable => format!("the {service} service is away"),
        Code::DeadlineExceeded => format!("the {service} service did not answer in time"),
        _ => fault.message.clone(),
    }
}

impl Actor for Core {
    type Message = Message;
    type State = String;

    fn name(&self) -> &'static str {
        "core"
    }

    fn state(&self) -> String {
        format!("{} utterances answered, {} of them with a refusal", self.told.answered, self.told.refused)
    }

    async fn handle(&mut self, message: Message) -> Result<(), String> {
        let Message::Utter { utterance, context, reply } = message;
        let outcome = if context.remaining().is_zero() {
            Err(Fault::deadline("the utterance waited past its deadline and was not tried"))
        } else {
            self.utter(&utterance, context.clone()).await
        };
        self.told.answered += 1;
        self.told.refused += u64::from(outcome.as_ref().map_or(true, |r| !r.ok));
        if let Err(fault) = self.state.set(self.told.clone(), &context.next()).await {
            tracing::warn!(%fault, "the state could not be told");
        }
        let _ = reply.send(outcome);
        Ok(())
    }
}
