//! The function agent on the bus: a plan in, scene commands out, one published result for every clause.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use sg_agents::names;
use sg_agents::recent::Recent;
use sg_agents::resolve::{self, Step};
use sg_agents::{account, choose, identity};
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::language::{Act, ActionResult, AgentState, Chosen, Clause, Plan, PlanResult};
use sg_proto::scene::{ChangesRequest, Command, CommandResult, Event, State};
use sg_runtime::actor::{Actor, Reply};
use sg_runtime::bus::{Bus, Owned};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{Host, StartError};

use crate::mind::{Mind, Thought};

/// Plans that wait at most.
const QUEUE: usize = 16;
/// Most clauses of one plan.
const MAX_CLAUSES: usize = 256;
/// Results and faults kept for askers that ask again.
const KEPT_RESULTS: usize = 64;
/// Choices of the model kept for plans that come again.
const KEPT_CHOICES: usize = 256;
/// Most names of one clause that the model is asked about.
const MAX_CHOICES: usize = 8;
/// Less time than this is not enough to try again what failed for the moment.
const LEAST_TIME: Duration = Duration::from_millis(400);
/// Time kept back for the answer's own way.
const MARGIN: Duration = Duration::from_millis(100);

pub(crate) async fn start(host: Host) -> Result<(), StartError> {
    if host.role() != role::AGENT_FUNCTION {
        return Err(StartError::Input(format!(
            "role `{}`: this executable serves `{}`",
            host.role(),
            role::AGENT_FUNCTION
        )));
    }
    let mind =
        Mind::new(&host.params()?).map_err(|e| StartError::Input(format!("parameters of `{}`: {e}", host.role())))?;
    let told = mind.told();
    let state = host.bus().own(&keys::FUNCTION_STATE, told.clone()).await?;
    let doer = Doer {
        bus: host.bus().clone(),
        mind,
        told,
        state,
        chosen: Recent::new(KEPT_CHOICES),
        done: Recent::new(KEPT_RESULTS),
        failed: Recent::new(KEPT_RESULTS),
    };
    let (mailbox, _) = host.spawn(doer, QUEUE);
    host.serve(&keys::EXECUTE, QUEUE, move |plan, context| {
        let mailbox = mailbox.clone();
        async move { mailbox.ask(context.deadline, |reply| Message::Execute { plan, context, reply }).await }
    })
    .await?;
    Ok(())
}

enum Message {
    Execute { plan: Plan, context: Context, reply: Reply<PlanResult> },
}

struct Doer {
    bus: Bus,
    mind: Mind,
    told: AgentState,
    state: Owned<AgentState>,
    /// Units that the model chose by plan and name as spoken; none where it found none.
    chosen: Recent<Option<Chosen>>,
    /// Results of plans, for askers that ask again.
    done: Recent<PlanResult>,
    /// Faults of the moment, for an asker that asks again with no time left to try again.
    failed: Recent<Fault>,
}

/// Whether a fault is one of the moment, so that the same plan may succeed later.
fn is_passing(fault: &Fault) -> bool {
    matches!(fault.code, Code::Unavailable | Code::DeadlineExceeded | Code::ResourceExhausted | Code::Cancelled)
}

/// A fault of the moment said in the words of a person; its details name the role that is meant.
fn of_scene(fault: Fault) -> Fault {
    let message = match fault.code {
        Code::Unavailable => "The scene service is away; try again in a moment.",
        Code::DeadlineExceeded => "The scene service did not answer in time; try again in a moment.",
        _ => return fault,
    };
    Fault { message: message.to_owned(), ..fault }.with_details([role::SCENE.to_owned()])
}

impl Doer {
    /// Carries out a plan, or gives the result again that it had.
    async fn once(&mut self, plan: &Plan, context: &Context) -> Result<PlanResult, Fault> {
        if let Some(result) = self.done.get(&context.id) {
            return Ok(result.clone());
        }
        if let Some(fault) = self.failed.get(&context.id).filter(|_| context.remaining() < LEAST_TIME) {
            return Err(fault.clone());
        }
        let outcome = self.execute(plan, context).await;
        match &outcome {
            Ok(result) => self.done.keep(&context.id, result.clone()),
            Err(fault) => self.failed.keep(&context.id, fault.clone()),
        }
        outcome
    }

    /// Carries out a plan. A fault of the moment fails the whole, to be sent again under the same id: what is done
    /// already is then found by its command's id and not done twice. Anything else is the result of its clause.
    async fn execute(&mut self, plan: &Plan, context: &Context) -> Result<PlanResult, Fault> {
        if plan.clauses.len() > MAX_CLAUSES {
            return Err(Fault::invalid(format!("a plan of {} clauses; at most {MAX_CLAUSES}", plan.clauses.len())));
        }
        let inner = context.clone().within(context.remaining().saturating_sub(MARGIN));
        let mut outcome = PlanResult::default();
        let asks_scene = plan.clauses.iter().any(|c| c.act() != Act::Help);
        let seen = || plan.observation.as_ref().and_then(|o| o.scene.clone()).unwrap_or_default();
        let mut state = if asks_scene { self.scene(&inner).await? } else { seen() };
        let done = self.already_done(plan, &state, &inner).await?;
        for (index, clause) in plan.clauses.iter().enumerate() {
            let id = identity::command(&context.id, index);
            let mut action = match done.get(&id) {
                Some(event) => repeated(&id, event),
                None => self.carry_out(clause, id, &state, plan, &inner).await.map_err(|fault| {
                    let before = outcome.actions.len();
                    let message = match before {
                        0 => fault.message.clone(),
                        n => format!("{} (after {n} of {} steps)", fault.message, plan.clauses.len()),
                    };
                    Fault { message, ..fault }
                })?,
            };
            action.clause = u32::try_from(index).unwrap_or(u32::MAX);
            if let Err(fault) = self.bus.publish(&keys::ACTION, &action, &context.next()).await {
                tracing::warn!(%fault, "an action could not be published");
            }
            let (ok, changed) = (action.ok, action.command.is_some());
            outcome.actions.push(action);
            if !ok {
                break;
            }
            if changed {
                // Names, focus and selection may be others now.
                state = self.scene(&inner).await?;
            }
        }
        outcome.revision = state.revision;
        Ok(outcome)
    }

    /// The scene as it stands, without masks.
    async fn scene(&self, context: &Context) -> Result<State, Fault> {
        self.bus.newest(&keys::SCENE_STATE, &context.next()).await.map_err(of_scene)
    }

    /// The scene with masks, where it fits a message.
    async fn whole_scene(&self, context: &Context) -> Option<State> {
        let request = ChangesRequest { from: 0, snapshot: true };
        let changes = self.bus.ask(&keys::SCENE_CHANGES, &request, &context.next()).await;
        changes.inspect_err(|fault| tracing::debug!(%fault, "no snapshot")).ok()?.snapshot
    }

    /// Commands of this plan that the scene has accepted already, in an earlier try.
    async fn already_done(
        &self,
        plan: &Plan,
        state: &State,
        context: &Context,
    ) -> Result<HashMap<String, Event>, Fault> {
        let seen = plan.observation.as_ref().and_then(|o| o.scene.as_ref()).map(|s| s.revision);
        let Some(from) = seen.filter(|seen| *seen < state.revision) else { return Ok(HashMap::new()) };
        let request = ChangesRequest { from, snapshot: false };
        let changes = self.bus.ask(&keys::SCENE_CHANGES, &request, &context.next()).await.map_err(of_scene)?;
        Ok(changes.events.into_iter().map(|event| (event.command_id.clone(), event)).collect())
    }

    /// A clause with units in place of names that no unit has, where the model knows which are meant; and its choices.
    async fn named(
        &mut self,
        clause: &Clause,
        state: &State,
        context: &Context,
    ) -> Result<(Clause, Vec<Chosen>), Fault> {
        let mut named = (clause.clone(), Vec::new());
        if !self.mind.has_model() {
            return Ok(named);
        }
        for spoken in choose::unknown(clause, state).into_iter().take(MAX_CHOICES) {
            let id = identity::derived(&context.id, &format!("unit for {spoken}"));
            let choice = match self.chosen.get(&id) {
                Some(choice) => choice.clone(),
                None => {
                    let Some(prompt) = choose::prompt(role::AGENT_FUNCTION, spoken, clause, state, &id) else {
                        continue;
                    };
                    // What is found has to be carried out too.
                    let deadline = Instant::now() + context.remaining() / 2;
                    match self.mind.ask(&prompt, deadline, |answer| choose::accept(answer, state)).await {
                        Ok(thought) => {
                            self.mind.served();
                            let Thought { value, model } = thought;
                            let choice = value.map(|unit| Chosen { spoken: spoken.to_owned(), unit, model });
                            self.chosen.keep(&id, choice.clone());
                            choice
                        }
                        Err(error) => {
                            let details = [role::AGENT_FUNCTION.to_owned()];
                            self.mind.instead(&error, &mut self.told).map_err(|fault| fault.with_details(details))?;
                            // The grammar's names are all there are; asking for the next one would only take time.
                            break;
                        }
                    }
                }
            };
            // A unit that was chosen in an earlier try may be gone since.
            if let Some(choice) = choice.filter(|c| names::all(state).contains(&c.unit.as_str())) {
                named.0 = choose::with(named.0, spoken, &choice.unit);
                named.1.push(choice);
            }
        }
        Ok(named)
    }

    /// What a command did that the scene has accepted under this id. One without action is never carried out, but has the
    /// stored result of its id.
    async fn known(&self, id: &str, context: &Context) -> Result<Option<Event>, Fault> {
        let probe = Command { id: id.to_owned(), ..Command::default() };
        match self.bus.ask(&keys::SCENE_APPLY, &probe, &context.next().with_id(id)).await {
            Ok(CommandResult { revision, summary, .. }) => {
                Ok(Some(Event { revision, command_id: id.to_owned(), summary, changes: Vec::new() }))
            }
            Err(fault) if is_passing(&fault) => Err(of_scene(fault)),
            Err(_) => Ok(None),
        }
    }

    async fn carry_out(
        &mut self,
        clause: &Clause,
        id: String,
        state: &State,
        plan: &Plan,
        context: &Context,
    ) -> Result<ActionResult, Fault> {
        let (clause, chosen) = self.named(clause, state, context).await?;
        let action = self.act(&clause, id, state, plan, context).await?;
        let text = chosen
            .iter()
            .rev()
            .fold(action.text, |text, c| format!("I took “{}” for the unit “{}”. {text}", c.spoken, c.unit));
        Ok(ActionResult { text, chosen, ..action })
    }

    async fn act(
        &self,
        clause: &Clause,
        id: String,
        state: &State,
        plan: &Plan,
        context: &Context,
    ) -> Result<ActionResult, Fault> {
        let frame = plan.observation.as_ref().and_then(|o| o.frame.as_ref());
        let masked = match clause.act() {
            Act::QuerySelection | Act::Describe => self.whole_scene(context).await,
            _ => None,
        };
        let step = match resolve::resolve(clause, masked.as_ref().unwrap_or(state), frame) {
            Ok(step) => step,
            // What an earlier try of the whole utterance has done may be why its words name nothing any more.
            Err(refusal) => {
                let done = self.known(&id, context).await?;
                return Ok(done.map_or_else(|| refused(refusal.message), |event| repeated(&id, &event)));
            }
        };
        let (action, units) = match step {
            Step::Answer { text, units } => {
                return Ok(ActionResult { ok: true, text, units, ..ActionResult::default() });
            }
            Step::Change { action, units } => (action, units),
        };
        let command = Command { id: id.clone(), expected_revision: 0, action: Some(action.clone()) };
        match self.bus.ask(&keys::SCENE_APPLY, &command, &context.next().with_id(id)).await {
            Ok(result) => {
                let text = account::done(clause, &action, state, &result);
                let units = if units.is_empty() { result.units.clone() } else { units };
                Ok(ActionResult {
                    ok: true,
                    text,
                    units,
                    command: Some(command),
                    result: Some(result),
                    ..ActionResult::default()
                })
            }
            Err(fault) if is_passing(&fault) => Err(of_scene(fault)),
            Err(fault) => Ok(ActionResult { command: Some(command), ..refused(fault.message) }),
        }
    }
}

fn refused(text: String) -> ActionResult {
    ActionResult { ok: false, text, ..ActionResult::default() }
}

/// The result of a command that an earlier try of the plan had sent.
fn repeated(id: &str, event: &Event) -> ActionResult {
    let result = CommandResult {
        id: id.to_owned(),
        revision: event.revision,
        summary: event.summary.clone(),
        repeated: true,
        ..CommandResult::default()
    };
    let command = Command { id: id.to_owned(), ..Command::default() };
    ActionResult {
        ok: true,
        text: account::summary(&event.summary),
        command: Some(command),
        result: Some(result),
        ..ActionResult::default()
    }
}

impl Actor for Doer {
    type Message = Message;
    type State = String;

    fn name(&self) -> &'static str {
        "doer"
    }

    fn state(&self) -> String {
        format!("{} plans, {} of them not carried out", self.told.answered, self.told.refused)
    }

    async fn handle(&mut self, message: Message) -> Result<(), String> {
        let Message::Execute { plan, context, reply } = message;
        // What nobody waits for any more is not done behind their back.
        let outcome = if context.remaining().is_zero() {
            Err(Fault::deadline("the plan waited past its deadline and was not tried"))
        } else {
            self.once(&plan, &context).await
        };
        self.told.answered += 1;
        self.told.refused += u64::from(outcome.as_ref().map_or(true, |r| r.actions.iter().any(|a| !a.ok)));
        if let Err(fault) = self.state.set(self.told.clone(), &context.next()).await {
            tracing::warn!(%fault, "the state could not be told");
        }
        let _ = reply.send(outcome);
        Ok(())
    }
}
