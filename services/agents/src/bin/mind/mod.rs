//! How the agents ask language models: with a deadline, a bounded number of tries, and something to fall back on.
//!
//! One trait, and one file for each way to speak to a model. What is asked and which answers hold is the library's.

mod grpc;
mod key;
mod openai;

use std::future::Future;
use std::pin::Pin;
use std::time::{Duration, Instant};

use sg_agents::backend::{Backend, Choice, Fallback, Parameters};
use sg_agents::grammar;
use sg_agents::prompt::{Completion, MAX_PROMPT_BYTES, ModelError, Prompt, Rejected};
use sg_proto::bus::Code;
use sg_proto::language::AgentState;
use sg_runtime::fault::Fault;

/// Wait before the second try of a model that is away; doubled for each further one.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
/// Less time than this is not enough for an answer.
const LEAST_TIME: Duration = Duration::from_millis(20);
/// After how long a person may say it again where no model answered and nothing else may.
const AGAIN: Duration = Duration::from_secs(1);

/// A completion to come.
type Answering<'a> = Pin<Box<dyn Future<Output = Result<Completion, ModelError>> + Send + 'a>>;

/// A language model, however it is spoken to.
trait Model: Send + Sync {
    /// Completes a prompt within a time. Dropping the future withdraws the question.
    fn complete<'a>(&'a self, prompt: &'a Prompt, seed: Option<u64>, time: Duration) -> Answering<'a>;
}

/// What an agent thinks with: the model that its table of the launch file chooses, or none and hence the grammar.
pub(crate) struct Mind {
    model: Option<(Choice, Box<dyn Model>)>,
    /// Whether the model did not serve the last time, so that this is logged once.
    failing: bool,
}

/// Something that a model's answer held.
pub(crate) struct Thought<T> {
    /// What it held.
    pub(crate) value: T,
    /// The model that answered, as it names itself, else as the launch file does.
    pub(crate) model: String,
}

impl Mind {
    /// Makes ready to ask, within the async runtime; nobody is connected to yet, for a model may come later than its agent.
    ///
    /// # Errors
    /// A line on what is wrong with the parameters, or which environment variable is missing.
    pub(crate) fn new(parameters: &Parameters) -> Result<Self, String> {
        let Some(choice) = parameters.choice().map_err(|e| e.to_string())? else {
            return Ok(Self { model: None, failing: false });
        };
        let key = choice.key_env.as_deref().map(key::Key::from_environment).transpose()?;
        let model: Box<dyn Model> = match choice.backend {
            Backend::Grpc => Box::new(grpc::Grpc::new(&choice, key)?),
            Backend::Grammar | Backend::OpenAi => Box::new(openai::OpenAi::new(&choice, key)?),
        };
        Ok(Self { model: Some((choice, model)), failing: false })
    }

    /// Whether there is a model to ask.
    pub(crate) fn has_model(&self) -> bool {
        self.model.is_some()
    }

    /// Name of the backend.
    pub(crate) fn backend(&self) -> &'static str {
        self.model.as_ref().map_or(grammar::NAME, |(choice, _)| choice.backend.name())
    }

    /// The state of an agent that begins with this mind.
    pub(crate) fn told(&self) -> AgentState {
        let model = self.model.as_ref().map_or_else(String::new, |(choice, _)| choice.model.clone());
        AgentState { backend: self.backend().to_owned(), model, ..AgentState::default() }
    }

    /// Asks the model until an answer holds: as often as the launch file allows, and never past `deadline`.
    ///
    /// # Errors
    /// [`ModelError`] of the last try.
    pub(crate) async fn ask<T>(
        &self,
        prompt: &Prompt,
        deadline: Instant,
        accept: impl Fn(&str) -> Result<T, Rejected>,
    ) -> Result<Thought<T>, ModelError> {
        let Some((choice, model)) = &self.model else { return Err(ModelError::Away("there is none".to_owned())) };
        if prompt.bytes() > MAX_PROMPT_BYTES {
            return Err(ModelError::Prompt(prompt.bytes()));
        }
        let begun = Instant::now();
        let until = deadline.min(begun + choice.timeout);
        let mut pause = FIRST_PAUSE;
        let mut failed = None;
        for attempt in 0..=choice.retries {
            let time = until.saturating_duration_since(Instant::now());
            if time < LEAST_TIME {
                break;
            }
            // The same question under the same seed would get the same answer.
            let seed = choice.seed.map(|seed| seed.wrapping_add(attempt.into()));
            let Ok(outcome) = tokio::time::timeout(time, model.complete(prompt, seed, time)).await else { break };
            let error = match outcome {
                Ok(Completion { text, model, prompt_tokens, answer_tokens }) => {
                    tracing::debug!(prompt_tokens, answer_tokens, "the model answered");
                    match accept(&text) {
                        Ok(value) => {
                            let model = if model.is_empty() { choice.model.clone() } else { model };
                            return Ok(Thought { value, model });
                        }
                        Err(rejected) => ModelError::Rejected(rejected),
                    }
                }
                Err(error) => error,
            };
            if !error.is_passing() {
                return Err(error);
            }
            if matches!(error, ModelError::Away(_)) && attempt < choice.retries {
                tokio::time::sleep(pause.min(until.saturating_duration_since(Instant::now()))).await;
                pause *= 2;
            }
            failed = Some(error);
        }
        Err(failed.unwrap_or_else(|| ModelError::Late(begun.elapsed())))
    }

    /// The model served: what is logged once may be logged again.
    pub(crate) fn served(&mut self) {
        if std::mem::take(&mut self.failing) {
            tracing::info!("the model serves again");
        }
    }

    /// What is to be done where the model did not serve: the reason for which the grammar does, counted in `told` and
    /// logged when it begins.
    ///
    /// # Errors
    /// The fault to answer with, where the launch file wants no fallback.
    pub(crate) fn instead(&mut self, error: &ModelError, told: &mut AgentState) -> Result<String, Fault> {
        let Some((choice, _)) = &self.model else { return Ok(String::new()) };
        if choice.fallback == Fallback::None {
            return Err(fault(error));
        }
        let reason = error.to_string();
        told.fallbacks += 1;
        told.fallback.clone_from(&reason);
        if !std::mem::replace(&mut self.failing, true) {
            tracing::warn!(%error, endpoint = %choice.endpoint, "the grammar serves until the model does");
        }
        Ok(reason)
    }
}

/// Where no fallback is wanted. Not `Unavailable`, at which every asker tries again until its deadline: the tries that the
/// launch file allows are over.
fn fault(error: &ModelError) -> Fault {
    let code = match error {
        ModelError::Away(_) | ModelError::Rejected(_) => Code::Aborted,
        ModelError::Late(_) => Code::DeadlineExceeded,
        ModelError::Refused(_) => Code::FailedPrecondition,
        ModelError::Prompt(_) => Code::ResourceExhausted,
    };
    let mut message = error.to_string();
    if let Some(first) = message.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    Fault { retry_after: error.is_passing().then_some(AGAIN), ..Fault::new(code, message + ".") }
}
