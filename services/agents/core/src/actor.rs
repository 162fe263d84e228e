//! The core agent on the bus: observe, interpret, act, observe again, reply. It publishes every stage under the id of the
//! conversation with a growing step number.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::{Duration, Instant};

use lru::LruCache;
use sg_language::intent_prompt::{MAX_TURN_BYTES, MAX_TURNS};
use sg_language::prompt::clip;
use sg_language::reply::{self, Evidence};
use sg_language::{grammar, paraphrase, permission, request_ids};
use sg_llm::{LlmClient, LlmError};
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::language::{
    Act, AgentState, Clause, Intent, IntentRequest, Observation, Perceive, Plan, PlanResult, Reply, Turn, Utterance,
};
use sg_proto::limits::MAX_UTTERANCE_BYTES;
use sg_proto::render::{CaptureRequest, Quality};
use sg_proto::scene::ChangesRequest;
use sg_runtime::actor::{self, Actor, ActorError};
use sg_runtime::bus::{Bus, LivelinessChange};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{Host, StartError};
use tokio::sync::{mpsc, watch};

use crate::image_diff::images_differ;
use crate::published_state::PublishedState;
use crate::publishing::publish;
use crate::tour::TourGuide;
use crate::turn_changes::TurnChanges;

/// Length of the request queue.
const QUEUE: usize = 16;
/// Replies and faults kept for repeated requests.
const CACHED_REPLIES: NonZeroUsize = NonZeroUsize::MIN.saturating_add(63);
/// Shortest time that is enough to repeat a failed utterance.
const MIN_RETRY_TIME: Duration = Duration::from_millis(500);
/// Conversations kept in memory.
const CACHED_CONVERSATIONS: NonZeroUsize = NonZeroUsize::MIN.saturating_add(255);
/// Edge of the captured image, pixels.
const CAPTURE_PIXELS: u32 = 256;
/// Most units whose coverage one observation measures: each needs its own image.
const MAX_MEASURED_UNITS: usize = 32;
/// Timeout of one observation.
const OBSERVE_TIME: Duration = Duration::from_secs(3);
/// Time reserved for the reply.
const MARGIN: Duration = Duration::from_millis(150);
/// Backend of an intent that a program has sent as clauses.
const TYPED: &str = "typed";
/// Length of the queue of liveliness events.
const LIVELINESS_QUEUE: usize = 256;

pub(crate) async fn start(host: Host) -> Result<(), StartError> {
    if host.role() != role::AGENT_CORE {
        return Err(StartError::Input(format!(
            "role `{}`: this executable serves `{}`",
            host.role(),
            role::AGENT_CORE
        )));
    }
    let llm = LlmClient::new(&host.params()?)
        .map_err(|e| StartError::Input(format!("parameters of `{}`: {e}", host.role())))?;
    let agent_state = llm.initial_state();
    let retained = host.bus().retain(&keys::CORE_STATE, agent_state.clone()).await?;
    let published_state = Arc::new(PublishedState::new(retained, agent_state.clone()));
    let liveliness = host.bus().watch_liveliness(LIVELINESS_QUEUE).await?;
    let [capture_processes, voices] = count_processes([role::RENDER_CAPTURE, role::SPEECH], liveliness);
    let agent = CoreAgent {
        bus: host.bus().clone(),
        llm,
        agent_state,
        tours: TourGuide::new(host.bus().clone(), voices, Arc::clone(&published_state)),
        published_state,
        capture_processes,
        intents: LruCache::new(CACHED_REPLIES),
        replies: LruCache::new(CACHED_REPLIES),
        faults: LruCache::new(CACHED_REPLIES),
        conversations: LruCache::new(CACHED_CONVERSATIONS),
    };
    let (mailbox, _) = host.spawn(agent, QUEUE);
    host.route(&keys::UTTER, QUEUE, &mailbox, |utterance, context, reply| Message::Utter { utterance, context, reply })
        .await?;
    Ok(())
}

/// Counts the live processes of each role. Without one the agent does not wait for its answer.
fn count_processes<const N: usize>(
    roles: [&'static str; N],
    mut events: mpsc::Receiver<LivelinessChange>,
) -> [watch::Receiver<usize>; N] {
    let mut counted = roles.map(|role| (role, BTreeSet::new(), watch::channel(0).0));
    let receivers = counted.each_ref().map(|(_, _, count)| count.subscribe());
    tokio::spawn(async move {
        while let Some(event) = events.recv().await {
            for (_, alive, count) in counted.iter_mut().filter(|counted| event.role == counted.0) {
                if event.alive {
                    alive.insert(event.instance.clone())
                } else {
                    alive.remove(&event.instance)
                };
                count.send_replace(alive.len());
            }
        }
    });
    receivers
}

enum Message {
    Utter { utterance: Utterance, context: Context, reply: actor::Reply<Reply> },
}

struct CoreAgent {
    bus: Bus,
    llm: LlmClient,
    agent_state: AgentState,
    published_state: Arc<PublishedState>,
    tours: TourGuide,
    /// Number of live capture processes.
    capture_processes: watch::Receiver<usize>,
    /// Intents by utterance id. A model may interpret a repeated utterance differently, and half of the plan may be done.
    intents: LruCache<String, Intent>,
    /// Replies by utterance id, for repeated requests.
    replies: LruCache<String, Reply>,
    /// Transient faults by utterance id, for repeated requests without time for another try.
    faults: LruCache<String, Fault>,
    /// Conversations by id.
    conversations: LruCache<String, Conversation>,
}

/// The history of a conversation.
#[derive(Debug, Clone, Default)]
struct Conversation {
    /// The last step.
    step: u32,
    /// The last turns, oldest first.
    turns: Vec<Turn>,
    /// What the newest turn changed.
    changes: Option<TurnChanges>,
}

impl Conversation {
    fn add(&mut self, utterance: &str, reply: &str, changes: Option<TurnChanges>) {
        let cut = |text| clip(text, MAX_TURN_BYTES).to_owned();
        self.turns.push(Turn { utterance: cut(utterance), reply: cut(reply), ..Turn::default() });
        self.changes = changes;
        let excess = self.turns.len().saturating_sub(MAX_TURNS);
        self.turns.drain(..excess);
    }
}

/// The progress of one utterance through the stages.
struct LoopProgress {
    context: Context,
    step: u32,
    /// What was changed so far.
    changes: Option<TurnChanges>,
}

impl LoopProgress {
    /// The context of the next stage.
    fn next_stage(&mut self) -> Context {
        self.step = self.step.saturating_add(1);
        self.current_stage()
    }

    /// The context of another message of the current stage.
    fn current_stage(&self) -> Context {
        self.context.next().at_step(self.context.conversation.clone(), self.step)
    }
}

/// A transient fault of an agent as a sentence. A fault whose details name a role is a sentence already.
fn stage_fault(stage: &str, fault: Fault) -> Fault {
    let message = match fault.code {
        _ if fault.details.iter().any(|d| role::ALL.contains(&d.as_str())) => return fault,
        Code::Unavailable => format!("The {stage} agent is unavailable; try again in a moment."),
        Code::DeadlineExceeded => format!("The {stage} agent did not answer in time; try again in a moment."),
        _ => return fault,
    };
    Fault { message, ..fault }
}

/// The intent of clauses that a program has sent: nothing is to be understood.
fn typed_intent(clauses: &[Clause]) -> Intent {
    Intent { clauses: clauses.to_vec(), backend: TYPED.to_owned(), ..Intent::default() }
}

/// The fault where the model failed and no fallback is allowed.
fn llm_fault(error: &LlmError) -> Fault {
    Fault { retry_after: error.retry_after(), ..Fault::new(error.code(), error.sentence()) }
}

impl CoreAgent {
    async fn utter(&mut self, utterance: &Utterance, mut context: Context) -> Result<Reply, Fault> {
        let start = Instant::now();
        if utterance.text.len() > MAX_UTTERANCE_BYTES {
            return Err(Fault::invalid(format!(
                "the utterance has {} bytes; the limit is {MAX_UTTERANCE_BYTES}",
                utterance.text.len()
            )));
        }
        if context.id.is_empty() {
            context = context.with_id(Context::root().id);
        }
        if let Some(reply) = self.replies.get(&context.id) {
            return Ok(reply.clone());
        }
        if let Some(fault) = self.faults.get(&context.id).filter(|_| context.remaining() < MIN_RETRY_TIME) {
            return Err(fault.clone());
        }
        let mut turn = self.begin(context);
        publish(&self.bus, &keys::UTTERANCE, utterance, &turn.next_stage()).await;
        let outcome = match self.answer(utterance, &mut turn).await {
            Ok(reply) => self.paraphrase(reply, &utterance.text, &turn.context).await,
            Err(fault) => Err(fault),
        };
        let mut reply = match &outcome {
            Ok(reply) => reply.clone(),
            Err(fault) => Reply { text: fault.message.clone(), ok: false, ..Reply::default() },
        };
        reply.elapsed_ms = start.elapsed().as_secs_f64() * 1e3;
        publish(&self.bus, &keys::REPLY, &reply, &turn.next_stage()).await;
        let id = turn.context.conversation.clone();
        let conversation = self.conversations.get_or_insert_mut(id, Conversation::default);
        conversation.step = turn.step;
        conversation.add(&utterance.text, &reply.text, turn.changes);
        // A fault is transient: a repeated utterance continues where it stopped.
        match outcome {
            Ok(_) => {
                self.replies.put(turn.context.id.clone(), reply.clone());
            }
            Err(fault) => {
                self.faults.put(turn.context.id.clone(), fault.clone());
                return Err(fault);
            }
        }
        Ok(reply)
    }

    /// Observe, interpret, act, observe again.
    async fn answer(&mut self, utterance: &Utterance, turn: &mut LoopProgress) -> Result<Reply, Fault> {
        let before = self.observe("before", 0, turn).await;
        let inner = |context: Context| {
            let time = context.remaining().saturating_sub(MARGIN);
            context.within(time)
        };
        let intent = match self.intents.get(&turn.context.id) {
            Some(intent) => intent.clone(),
            None => {
                let intent = match utterance.clauses.as_slice() {
                    [] => self.interpret(utterance, &before, turn).await?,
                    typed => typed_intent(typed),
                };
                self.intents.put(turn.context.id.clone(), intent.clone());
                intent
            }
        };
        let revision = before.scene.as_ref().map_or(0, |s| s.revision);
        if intent.clauses.is_empty() {
            return Ok(reply::without_clauses(&intent, revision));
        }
        if let Some(reason) = permission::refusal(utterance.source(), &intent.clauses) {
            return Ok(Reply { text: reason.to_owned(), revision, ..Reply::default() });
        }
        let plan = Plan { clauses: intent.clauses.clone(), observation: Some(before.clone()) };
        let stage = turn.next_stage();
        publish(&self.bus, &keys::PLAN, &plan, &stage).await;
        let execute = inner(turn.next_stage()).with_id(request_ids::plan(&turn.context.id));
        let mut outcome: PlanResult =
            self.bus.ask(&keys::EXECUTE, &plan, &execute).await.map_err(|f| stage_fault("function", f))?;
        turn.changes = TurnChanges::of(&intent, &outcome);
        let is_interrupted = self.follow_tour(&intent, &mut outcome).await;
        let changed = outcome.actions.iter().any(|action| {
            let clause = usize::try_from(action.clause).ok().and_then(|i| intent.clauses.get(i));
            action.ok && action.command.is_some() && clause.is_some_and(reply::changes_image)
        });
        let after = if changed { Some(self.observe("after", outcome.revision, turn).await) } else { None };
        let frames = after.as_ref().and_then(|a| Some((before.frame.as_ref()?, a.frame.as_ref()?)));
        let changed = frames.and_then(|(b, a)| images_differ(b, a));
        let evidence = Evidence { before: &before, after: after.as_ref(), changed };
        let reply = reply::compose(&intent, &outcome, &evidence);
        if is_interrupted {
            return Ok(Reply { text: format!("{} The tour waits; say “go on” to continue.", reply.text), ..reply });
        }
        Ok(reply)
    }

    /// Carries out changes of a tour. Returns whether a tour now waits, since something else was done.
    async fn follow_tour(&mut self, intent: &Intent, outcome: &mut PlanResult) -> bool {
        let mut is_about_tour = false;
        for action in &mut outcome.actions {
            let clause = usize::try_from(action.clause).ok().and_then(|at| intent.clauses.get(at));
            let Some(clause) = clause.filter(|clause| clause.act() == Act::Tour) else { continue };
            is_about_tour = true;
            if !action.ok {
                continue;
            }
            match self.tours.change(clause.tour(), &action.units).await {
                Ok(None) => {}
                Ok(Some(text)) => action.text = text.to_owned(),
                Err(reason) => (action.ok, action.text) = (false, reason.to_owned()),
            }
        }
        !is_about_tour && self.tours.interrupt()
    }

    /// Asks the intent agent. A third of the time is left to act.
    async fn interpret(
        &self,
        utterance: &Utterance,
        before: &Observation,
        turn: &mut LoopProgress,
    ) -> Result<Intent, Fault> {
        let parse = turn.next_stage();
        let request = IntentRequest {
            text: utterance.text.clone(),
            observation: Some(before.clone()),
            conversation: self.earlier_turns(before, &parse).await,
        };
        let time = parse.remaining() * 2 / 3;
        let parse = parse.within(time).with_id(request_ids::intent(&turn.context.id));
        self.bus.ask(&keys::PARSE, &request, &parse).await.map_err(|f| stage_fault("intent", f))
    }

    /// The earlier turns of the conversation. The newest one tells how it can be taken back.
    async fn earlier_turns(&self, before: &Observation, context: &Context) -> Vec<Turn> {
        let Some(conversation) = self.conversations.peek(&context.conversation) else { return Vec::new() };
        let mut turns = conversation.turns.clone();
        let (Some(last), Some(changes), Some(scene)) =
            (turns.last_mut(), conversation.changes.as_ref(), before.scene.as_ref())
        else {
            return turns;
        };
        let request = ChangesRequest { from: changes.start(), snapshot: false };
        let limited = context.next().within(OBSERVE_TIME.min(context.remaining() / 3));
        match self.bus.ask(&keys::SCENE_CHANGES, &request, &limited).await {
            Ok(since) => {
                let steps = changes.steps(&since.events, scene);
                (last.undo_steps, last.later_views) = (steps.all, steps.later_views);
            }
            // The turn can then only be read again.
            Err(fault) => tracing::warn!(%fault, "the changes of the last turn are unknown"),
        }
        turns
    }

    /// Lets the model rephrase a reply, where a model is configured.
    async fn paraphrase(&mut self, reply: Reply, utterance: &str, context: &Context) -> Result<Reply, Fault> {
        let plain = Reply { facts: reply.text.clone(), backend: grammar::NAME.to_owned(), ..reply };
        if !self.llm.has_model() {
            return Ok(plain);
        }
        let Some(prompt) =
            paraphrase::prompt(role::AGENT_CORE, utterance, &plain, &request_ids::paraphrase(&context.id))
        else {
            return Ok(plain);
        };
        let deadline = context.deadline.checked_sub(MARGIN).unwrap_or(context.deadline);
        match self.llm.ask(&prompt, deadline, |answer| paraphrase::parse_answer(answer, utterance, &plain.facts)).await
        {
            Ok(answer) => {
                self.llm.record_success();
                Ok(Reply { text: answer.value, backend: self.llm.backend().to_owned(), model: answer.model, ..plain })
            }
            // The commands are done already, so the fault reports them too.
            Err(error) => match self.llm.fall_back(error, &mut self.agent_state) {
                Ok(fallback) => Ok(Reply { fallback, ..plain }),
                Err(error) => {
                    let fault = llm_fault(&error);
                    let message = format!("{} {}", plain.facts, fault.message);
                    Err(Fault { message, ..fault })
                }
            },
        }
    }

    /// Observes the scene and its image. Missing parts are named in the observation and are not an error.
    async fn observe(&self, moment: &str, at_least_revision: u64, turn: &mut LoopProgress) -> Observation {
        let context = turn.next_stage();
        let time = OBSERVE_TIME.min(context.remaining() / 3);
        let limited = context.clone().within(time);
        let mut observation = Observation { moment: moment.to_owned(), ..Observation::default() };
        let mut missing = Vec::new();
        match self.bus.newest(&keys::SCENE_STATE, &limited.next()).await {
            Ok(scene) => observation.scene = Some(scene),
            Err(fault) => missing.push(missing_reason(&fault, "scene")),
        }
        let scene = observation.scene.as_ref();
        let units = scene.map_or(0, |s| s.base_units.len() + s.units.len());
        let capture = CaptureRequest {
            width: CAPTURE_PIXELS,
            height: CAPTURE_PIXELS,
            quality: Quality::Fast.into(),
            at_least_revision: at_least_revision.max(scene.map_or(0, |s| s.revision)),
            measure_units: units <= MAX_MEASURED_UNITS,
            ..CaptureRequest::default()
        };
        let perceive = Perceive { capture: Some(capture.clone()), moment: moment.to_owned() };
        publish(&self.bus, &keys::PERCEIVE, &perceive, &context).await;
        if *self.capture_processes.borrow() == 0 {
            missing.push("no render process is running".to_owned());
        } else if scene.is_some() {
            match self.bus.ask(&keys::CAPTURE, &capture, &limited.next()).await {
                Ok(frame) => observation.frame = Some(frame),
                Err(fault) => missing.push(missing_reason(&fault, "render")),
            }
        }
        observation.missing = missing.join("; ");
        publish(&self.bus, &keys::OBSERVATION, &observation, &turn.next_stage()).await;
        observation
    }

    /// Starts a turn in the conversation of the utterance, or in a new one. Steps continue those of the last utterance.
    fn begin(&self, context: Context) -> LoopProgress {
        let conversation =
            if context.conversation.is_empty() { Context::root().id } else { context.conversation.clone() };
        let last = self.conversations.peek(&conversation).map_or(0, |c| c.step);
        let step = last.max(context.step.saturating_sub(1));
        let context = context.at_step(conversation, step);
        LoopProgress { context, step, changes: None }
    }
}

/// The reason why a part of an observation is missing.
fn missing_reason(fault: &Fault, service: &str) -> String {
    match fault.code {
        Code::Unavailable => format!("the {service} service is unavailable"),
        Code::DeadlineExceeded => format!("the {service} service did not answer in time"),
        _ => fault.message.clone(),
    }
}

impl Actor for CoreAgent {
    type Message = Message;
    type State = String;

    fn name(&self) -> &'static str {
        "core"
    }

    fn state(&self) -> String {
        format!("{} utterances answered, {} refused", self.agent_state.answered, self.agent_state.refused)
    }

    async fn handle(&mut self, message: Message) -> Result<(), ActorError> {
        let Message::Utter { utterance, context, reply } = message;
        let outcome = if context.remaining().is_zero() {
            Err(Fault::deadline("the utterance passed its deadline in the queue and was not executed"))
        } else {
            self.utter(&utterance, context.clone()).await
        };
        self.agent_state.answered += 1;
        self.agent_state.refused += u64::from(outcome.as_ref().map_or(true, |r| !r.ok));
        self.published_state.set(self.agent_state.clone(), &context.next()).await;
        let _ = reply.send(outcome);
        Ok(())
    }
}
