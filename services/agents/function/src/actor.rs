//! The function agent on the bus: a plan in, scene commands out, one published result per clause.

use std::collections::HashMap;
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

use lru::LruCache;
use sg_language::resolution::Step;
use sg_language::{commands, proposed_regions, query, report, request_ids, resolved_names, unit_choice, unit_names};
use sg_llm::{Answer, LlmClient, LlmError};
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::labeling::ProposedRegion;
use sg_proto::language::{Act, ActionResult, AgentState, Clause, Plan, PlanResult, ResolvedName};
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    ChangesRequest, Command, CommandResult, Event, MeasureRequest, SetView, State, Target, set_view,
};
use sg_proto::selection::{StrokesReply, StrokesRequest};
use sg_runtime::actor::{Actor, ActorError, Reply};
use sg_runtime::bus::{Bus, RetainedValue};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{Host, StartError};

use crate::action_result::{failure, stored_result};
use crate::file_requests::FileRequests;
use crate::labels::{Labels, Meaning};

/// Length of the request queue.
const QUEUE: usize = 16;
/// Most clauses of one plan.
const MAX_CLAUSES: usize = 256;
/// Results and faults kept for repeated requests.
const CACHED_RESULTS: NonZeroUsize = NonZeroUsize::MIN.saturating_add(63);
/// Choices of the model kept for repeated plans.
const CACHED_CHOICES: NonZeroUsize = NonZeroUsize::MIN.saturating_add(255);
/// Most unknown names of one clause that the model resolves.
const MAX_CHOICES: usize = 8;
/// Most units of one answer that are measured.
const MAX_MEASURED: usize = 8;
/// Shortest time that is enough to repeat a failed plan.
const MIN_RETRY_TIME: Duration = Duration::from_millis(400);
/// Time reserved for the reply.
const MARGIN: Duration = Duration::from_millis(100);

pub(crate) async fn start(host: Host) -> Result<(), StartError> {
    if host.role() != role::AGENT_FUNCTION {
        return Err(StartError::Input(format!(
            "role `{}`: this executable serves `{}`",
            host.role(),
            role::AGENT_FUNCTION
        )));
    }
    let llm = LlmClient::new(&host.params()?)
        .map_err(|e| StartError::Input(format!("parameters of `{}`: {e}", host.role())))?;
    let agent_state = llm.initial_state();
    let published_state = host.bus().retain(&keys::FUNCTION_STATE, agent_state.clone()).await?;
    let agent = FunctionAgent {
        bus: host.bus().clone(),
        files: FileRequests::new(host.bus().clone()),
        labels: Labels::watch(host.bus().clone()).await?,
        llm,
        agent_state,
        published_state,
        choices: LruCache::new(CACHED_CHOICES),
        results: LruCache::new(CACHED_RESULTS),
        faults: LruCache::new(CACHED_RESULTS),
    };
    let (mailbox, _) = host.spawn(agent, QUEUE);
    host.route(&keys::EXECUTE, QUEUE, &mailbox, |plan, context, reply| Message::Execute { plan, context, reply })
        .await?;
    Ok(())
}

enum Message {
    Execute { plan: Plan, context: Context, reply: Reply<PlanResult> },
}

struct FunctionAgent {
    bus: Bus,
    /// Saves and opens files.
    files: FileRequests,
    /// Finds units by other names.
    labels: Labels,
    llm: LlmClient,
    agent_state: AgentState,
    published_state: RetainedValue<AgentState>,
    /// What the model chose, by plan and spoken name.
    choices: LruCache<String, ModelChoice>,
    /// Results by plan id, for repeated requests.
    results: LruCache<String, PlanResult>,
    /// Transient faults by plan id, for repeated requests without time for another try.
    faults: LruCache<String, Fault>,
}

/// A clause whose names are those of units, or a question about one of them.
enum Chosen {
    /// The clause, and the names in it that were replaced.
    Clause(Box<Clause>, Vec<ResolvedName>),
    /// A name may mean several units.
    Question(String),
    /// A name means no unit, and perhaps one of these regions.
    Regions(String, Vec<ProposedRegion>),
}

/// The model's answer to a name.
#[derive(Clone)]
enum ModelChoice {
    Unit(ResolvedName),
    NoUnit,
    /// No answer.
    Failed,
}

/// Whether the same plan may succeed later.
fn is_transient(fault: &Fault) -> bool {
    matches!(fault.code, Code::Unavailable | Code::DeadlineExceeded | Code::ResourceExhausted | Code::Cancelled)
}

/// A transient fault of a service as a sentence. Its details name the role.
fn service_fault(role: &str, fault: Fault) -> Fault {
    let message = match fault.code {
        Code::Unavailable => format!("The {role} service is unavailable; try again in a moment."),
        Code::DeadlineExceeded => format!("The {role} service did not answer in time; try again in a moment."),
        _ => return fault,
    };
    Fault { message, ..fault }.with_details([role.to_owned()])
}

/// The reply where the model failed and no fallback is allowed.
fn llm_fault(error: &LlmError) -> Fault {
    Fault { retry_after: error.retry_after(), ..Fault::new(error.code(), error.sentence()) }
        .with_details([role::AGENT_FUNCTION.to_owned()])
}

impl FunctionAgent {
    /// Executes a plan, or repeats its stored result.
    async fn execute_once(&mut self, plan: &Plan, context: &Context) -> Result<PlanResult, Fault> {
        if let Some(result) = self.results.get(&context.id) {
            return Ok(result.clone());
        }
        if let Some(fault) = self.faults.get(&context.id).filter(|_| context.remaining() < MIN_RETRY_TIME) {
            return Err(fault.clone());
        }
        let outcome = self.execute(plan, context).await;
        if !context.id.is_empty() {
            match &outcome {
                Ok(result) => {
                    self.results.put(context.id.clone(), result.clone());
                }
                Err(fault) => {
                    self.faults.put(context.id.clone(), fault.clone());
                }
            }
        }
        outcome
    }

    /// Executes a plan. A transient fault fails the whole plan, so that the client repeats it under the same id. Commands
    /// that the scene has applied already are found by their ids and not repeated. Any other fault fails its clause.
    async fn execute(&mut self, plan: &Plan, context: &Context) -> Result<PlanResult, Fault> {
        if plan.clauses.len() > MAX_CLAUSES {
            return Err(Fault::invalid(format!(
                "the plan has {} clauses; the limit is {MAX_CLAUSES}",
                plan.clauses.len()
            )));
        }
        let inner = context.clone().within(context.remaining().saturating_sub(MARGIN));
        let mut outcome = PlanResult::default();
        let asks_scene = plan.clauses.iter().any(|c| c.act() != Act::Help);
        let observed = || plan.observation.as_ref().and_then(|o| o.scene.clone()).unwrap_or_default();
        let mut state = if asks_scene { self.scene(&inner).await? } else { observed() };
        let applied = self.applied_commands(plan, &state, &inner).await?;
        for (index, clause) in plan.clauses.iter().enumerate() {
            let id = request_ids::command(&context.id, index);
            let mut action = match applied.get(&id) {
                Some(event) => stored_result(&id, event),
                None => self.execute_clause(clause, id, &state, plan, &inner).await.map_err(|fault| {
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
                // The command may have changed names, focus or selection.
                state = self.scene(&inner).await?;
            }
        }
        outcome.revision = state.revision;
        Ok(outcome)
    }

    /// The current scene, without masks.
    async fn scene(&self, context: &Context) -> Result<State, Fault> {
        self.bus.newest(&keys::SCENE_STATE, &context.next()).await.map_err(|fault| service_fault(role::SCENE, fault))
    }

    /// The current scene with masks, if it fits into one message.
    async fn scene_with_masks(&self, context: &Context) -> Option<State> {
        let request = ChangesRequest { from: 0, snapshot: true };
        let changes = self.bus.ask(&keys::SCENE_CHANGES, &request, &context.next()).await;
        changes.inspect_err(|fault| tracing::debug!(%fault, "no snapshot")).ok()?.snapshot
    }

    /// Commands of this plan that the scene applied in an earlier try.
    async fn applied_commands(
        &self,
        plan: &Plan,
        state: &State,
        context: &Context,
    ) -> Result<HashMap<String, Event>, Fault> {
        let observed = plan.observation.as_ref().and_then(|o| o.scene.as_ref()).map(|s| s.revision);
        let Some(from) = observed.filter(|observed| *observed < state.revision) else { return Ok(HashMap::new()) };
        let request = ChangesRequest { from, snapshot: false };
        let changes = self
            .bus
            .ask(&keys::SCENE_CHANGES, &request, &context.next())
            .await
            .map_err(|fault| service_fault(role::SCENE, fault))?;
        Ok(changes.events.into_iter().map(|event| (event.command_id.clone(), event)).collect())
    }

    /// Replaces unknown names in a clause by units: those that the labeling service finds, else one that the model chooses.
    async fn choose_units(&mut self, clause: &Clause, state: &State, context: &Context) -> Result<Chosen, Fault> {
        let (mut chosen, mut resolved_names) = (clause.clone(), Vec::new());
        let mut is_model_working = self.llm.has_model();
        let mut proposed = None;
        for spoken in unit_choice::unknown_names(clause, state).into_iter().take(MAX_CHOICES) {
            let searched = unit_choice::searched(spoken, state);
            let found = self.labels.find(&searched, state.revision, context).await;
            let mut regions = Vec::new();
            let mut meant = match found.map_err(|fault| service_fault(role::LABELING, fault))? {
                Meaning::Units(units) => units,
                Meaning::Question(question) => return Ok(Chosen::Question(question)),
                Meaning::Unknown(proposals) if is_model_working => {
                    regions = proposals;
                    match self.model_choice(spoken, clause, state, context).await? {
                        ModelChoice::Unit(unit) => vec![unit],
                        ModelChoice::NoUnit => Vec::new(),
                        // The other names are not sent to it.
                        ModelChoice::Failed => {
                            is_model_working = false;
                            Vec::new()
                        }
                    }
                }
                Meaning::Unknown(proposals) => {
                    regions = proposals;
                    Vec::new()
                }
            };
            // A unit that was chosen in an earlier try may be deleted by now.
            let names = unit_names::all(state);
            meant.retain(|name| names.contains(&name.unit.as_str()));
            if !meant.is_empty() {
                let units: Vec<&str> = meant.iter().map(|name| name.unit.as_str()).collect();
                chosen = unit_choice::substitute(chosen, spoken, &units);
                resolved_names.extend(meant);
            } else if !regions.is_empty() {
                proposed = Some((spoken.to_owned(), regions));
            }
        }
        if let Some((spoken, regions)) = proposed {
            return Ok(Chosen::Regions(spoken, regions));
        }
        Ok(Chosen::Clause(Box::new(chosen), resolved_names))
    }

    /// The unit that the model chooses for a name.
    async fn model_choice(
        &mut self,
        spoken: &str,
        clause: &Clause,
        state: &State,
        context: &Context,
    ) -> Result<ModelChoice, Fault> {
        let id = request_ids::derived(&context.id, &format!("unit for {spoken}"));
        if let Some(choice) = self.choices.get(&id) {
            return Ok(choice.clone());
        }
        let Some(prompt) = unit_choice::prompt(role::AGENT_FUNCTION, spoken, clause, state, &id) else {
            return Ok(ModelChoice::NoUnit);
        };
        // Half of the time is left for the execution.
        let deadline = Instant::now() + context.remaining() / 2;
        match self.llm.ask(&prompt, deadline, |answer| unit_choice::parse_answer(answer, state)).await {
            Ok(Answer { value, model }) => {
                self.llm.record_success();
                let name = |unit| ResolvedName { spoken: spoken.to_owned(), unit, model, ..ResolvedName::default() };
                let choice = value.map_or(ModelChoice::NoUnit, |unit| ModelChoice::Unit(name(unit)));
                self.choices.put(id, choice.clone());
                Ok(choice)
            }
            Err(error) => {
                self.llm.fall_back(error, &mut self.agent_state).map_err(|error| llm_fault(&error))?;
                Ok(ModelChoice::Failed)
            }
        }
    }

    /// The stored result of the command with this id. A command without action is never applied: the scene only looks up
    /// its id.
    async fn stored_event(&self, id: &str, context: &Context) -> Result<Option<Event>, Fault> {
        let probe = Command { id: id.to_owned(), ..Command::default() };
        match self.bus.ask(&keys::SCENE_APPLY, &probe, &context.next().with_id(id)).await {
            Ok(CommandResult { revision, summary, .. }) => {
                Ok(Some(Event { revision, command_id: id.to_owned(), summary, changes: Vec::new() }))
            }
            Err(fault) if is_transient(&fault) => Err(service_fault(role::SCENE, fault)),
            Err(_) => Ok(None),
        }
    }

    async fn execute_clause(
        &mut self,
        clause: &Clause,
        id: String,
        state: &State,
        plan: &Plan,
        context: &Context,
    ) -> Result<ActionResult, Fault> {
        let (clause, resolved_names) = match self.choose_units(clause, state, context).await? {
            Chosen::Clause(clause, resolved_names) => (clause, resolved_names),
            Chosen::Question(question) => {
                // An earlier try may have renamed one of several units.
                let stored = self.stored_event(&id, context).await?;
                return Ok(stored.map_or_else(|| failure(question), |event| stored_result(&id, &event)));
            }
            Chosen::Regions(spoken, regions) => {
                return match proposed_regions::selection(clause, &spoken, &regions) {
                    Some(request) => {
                        let reply = self.select(&request, id, context).await?;
                        let text = match reply.ok {
                            true => proposed_regions::selected(&spoken, &regions),
                            false => reply.text,
                        };
                        Ok(ActionResult { text, ..reply })
                    }
                    None => Ok(failure(proposed_regions::question(&spoken, &regions))),
                };
            }
        };
        let action = self.apply_clause(&clause, id, state, plan, context).await?;
        let text = match resolved_names::interpretation(&resolved_names) {
            Some(interpretation) => format!("{interpretation} {}", action.text),
            None => action.text,
        };
        Ok(ActionResult { text, resolved_names, ..action })
    }

    /// The answer to a question about units or the selection with their sizes, where the file gives a length unit, and their
    /// looks, where the session has a labeling service.
    async fn with_measures(
        &self,
        clause: &Clause,
        text: String,
        units: &[String],
        revision: u64,
        context: &Context,
    ) -> String {
        let unit = |name: &String| Target { units: vec![name.clone()], ..Target::default() };
        let targets: Vec<Target> = match clause.act() {
            Act::Describe => units.iter().take(MAX_MEASURED).map(unit).collect(),
            Act::QuerySelection => vec![Target { selection: true, ..Target::default() }],
            _ => Vec::new(),
        };
        let several = targets.len() > 1;
        let mut measures = Vec::new();
        for target in targets {
            let unit = target.units.first().map_or("", String::as_str);
            measures.extend(query::look(&target, &self.labels.look(unit, revision, context).await));
            let request = MeasureRequest { target: Some(target.clone()) };
            match self.bus.ask(&keys::SCENE_MEASURE, &request, &context.next()).await {
                Ok(size) => {
                    let missing = || query::without_unit(&clause.words, &target, &size);
                    // One reason is enough for several units.
                    let line = query::size(&target, &size).or_else(missing);
                    measures.extend(line.filter(|line| !measures.contains(line)));
                }
                // Nothing selected, or a scene service that measures nothing.
                Err(fault) => tracing::debug!(%fault, "no size"),
            }
        }
        measures.into_iter().fold(text, |text, measure| match text.strip_suffix('.').unwrap_or(&text) {
            lines if several || lines.contains('\n') => format!("{text}\n{measure}"),
            line => format!("{line}. {measure}"),
        })
    }

    async fn apply_clause(
        &self,
        clause: &Clause,
        id: String,
        state: &State,
        plan: &Plan,
        context: &Context,
    ) -> Result<ActionResult, Fault> {
        let frame = plan.observation.as_ref().and_then(|o| o.frame.as_ref());
        let with_masks = match clause.act() {
            Act::QuerySelection | Act::Describe => self.scene_with_masks(context).await,
            _ => None,
        };
        let step = match commands::resolve(clause, with_masks.as_ref().unwrap_or(state), frame) {
            Ok(step) => step,
            // An earlier try may have applied the command already, for example renamed the unit.
            Err(refusal) => {
                let stored = self.stored_event(&id, context).await?;
                return Ok(stored.map_or_else(|| failure(refusal.message), |event| stored_result(&id, &event)));
            }
        };
        let (action, units) = match step {
            Step::Answer { text, units } => {
                let text = self.with_measures(clause, text, &units, state.revision, context).await;
                return Ok(ActionResult { ok: true, text, units, ..ActionResult::default() });
            }
            Step::Change { action, units } => (action, units),
            Step::Strokes(request) => return self.select(&request, id, context).await,
            Step::BestView(target) => return self.show_best(clause, target, id, state, context).await,
            // The core agent, which asked, has the tour.
            Step::Tour { stops, .. } => {
                let text = report::tour_begins(&stops);
                return Ok(ActionResult { ok: true, text, units: stops, ..ActionResult::default() });
            }
            other => return Ok(self.files.carry_out(other, context).await),
        };
        self.change(clause, (action, units), id, state, context).await
    }

    /// Looks at a target from the direction that shows most of it.
    async fn show_best(
        &self,
        clause: &Clause,
        target: Target,
        id: String,
        state: &State,
        context: &Context,
    ) -> Result<ActionResult, Fault> {
        let found = match self.labels.best_view(&target, state.revision, context).await {
            Ok(found) => found,
            Err(fault) if is_transient(&fault) => return Err(service_fault(role::LABELING, fault)),
            Err(fault) => return Ok(failure(report::sentence(&fault.message))),
        };
        let Some((found, view)) = found.and_then(|found| found.view.map(|view| (found, view))) else {
            return Ok(failure(report::NO_BEST_VIEW.to_owned()));
        };
        let action = Action::SetView(SetView { change: Some(set_view::Change::View(view)) });
        let done = self.change(clause, (action, target.units.clone()), id, state, context).await?;
        let text = if done.ok { report::best_view(&target, found.unhidden) } else { done.text };
        Ok(ActionResult { text, ..done })
    }

    /// Applies a command to the scene.
    async fn change(
        &self,
        clause: &Clause,
        (action, units): (Action, Vec<String>),
        id: String,
        state: &State,
        context: &Context,
    ) -> Result<ActionResult, Fault> {
        let command = Command { id: id.clone(), expected_revision: 0, action: Some(action.clone()) };
        match self.bus.ask(&keys::SCENE_APPLY, &command, &context.next().with_id(id.clone())).await {
            Ok(result) => {
                let text = report::action(clause, &action, state, &result);
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
            Err(fault) if is_transient(&fault) => Err(service_fault(role::SCENE, fault)),
            Err(fault) => {
                // An earlier try may have applied the clause, which resolves to another command now.
                let is_taken = fault.code == Code::AlreadyExists;
                let stored = if is_taken { self.stored_event(&id, context).await? } else { None };
                Ok(stored.map_or_else(
                    || ActionResult { command: Some(command), ..failure(fault.message) },
                    |event| stored_result(&id, &event),
                ))
            }
        }
    }
}

impl FunctionAgent {
    /// Has the selection service take steps. A repeated request has the same id, and takes effect once.
    async fn select(&self, request: &StrokesRequest, id: String, context: &Context) -> Result<ActionResult, Fault> {
        match self.bus.ask(&keys::SELECTION_STROKES, request, &context.next().with_id(id.clone())).await {
            Ok(reply) => {
                let StrokesReply { revision, selection_hash, summary, .. } = reply.clone();
                let result =
                    CommandResult { id: id.clone(), revision, summary, selection_hash, ..CommandResult::default() };
                Ok(ActionResult {
                    ok: true,
                    text: report::other_answer(&reply),
                    command: Some(Command { id, ..Command::default() }),
                    result: Some(result),
                    ..ActionResult::default()
                })
            }
            Err(fault) if is_transient(&fault) => Err(service_fault(role::SELECTION, fault)),
            Err(fault) => Ok(failure(report::sentence(&fault.message))),
        }
    }
}

impl Actor for FunctionAgent {
    type Message = Message;
    type State = String;

    fn name(&self) -> &'static str {
        "function"
    }

    fn state(&self) -> String {
        format!("{} plans, {} failed", self.agent_state.answered, self.agent_state.refused)
    }

    async fn handle(&mut self, message: Message) -> Result<(), ActorError> {
        let Message::Execute { plan, context, reply } = message;
        // No client waits for the result, so the plan is not executed.
        let outcome = if context.remaining().is_zero() {
            Err(Fault::deadline("the plan passed its deadline in the queue and was not executed"))
        } else {
            self.execute_once(&plan, &context).await
        };
        self.agent_state.answered += 1;
        self.agent_state.refused += u64::from(outcome.as_ref().map_or(true, |r| r.actions.iter().any(|a| !a.ok)));
        if let Err(fault) = self.published_state.set(self.agent_state.clone(), &context.next()).await {
            tracing::warn!(%fault, "the state could not be published");
        }
        let _ = reply.send(outcome);
        Ok(())
    }
}
