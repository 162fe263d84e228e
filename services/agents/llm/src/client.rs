//! The client of a language model: deadline, retries and fallback.

use std::time::{Duration, Instant};

use sg_endpoint::ApiKey;
use sg_language::grammar;
use sg_language::prompt::{InvalidAnswer, MAX_PROMPT_BYTES, Prompt};
use sg_proto::language::AgentState;

use crate::config::{Backend, ConfigError, Fallback, ModelConfig, Parameters};
use crate::error::LlmError;
use crate::grpc::Grpc;
use crate::model::{Completion, LanguageModel};
use crate::openai::OpenAi;

/// Wait before the first retry. It doubles for each further one.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
/// Shortest time that is enough for an answer.
const MIN_TIME: Duration = Duration::from_millis(20);

/// The client of the configured language model. Without a model the grammar serves.
pub struct LlmClient {
    model: Option<(ModelConfig, Box<dyn LanguageModel>)>,
    /// Whether the last request failed, so that the failure is logged once.
    failing: bool,
}

/// An accepted answer of a model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Answer<T> {
    /// The parsed answer.
    pub value: T,
    /// The model's own name, or else its name in the launch file.
    pub model: String,
}

impl LlmClient {
    /// Creates the client inside an async runtime. It connects with the first request, so the model may start later.
    ///
    /// # Errors
    /// [`ConfigError`]: invalid parameters, or a missing environment variable.
    pub fn new(parameters: &Parameters) -> Result<Self, ConfigError> {
        let Some(config) = parameters.model_config()? else {
            return Ok(Self { model: None, failing: false });
        };
        let key = config.key_env.as_deref().map(ApiKey::from_environment).transpose()?;
        let model: Box<dyn LanguageModel> = match config.backend {
            Backend::Grpc => Box::new(Grpc::new(&config, key)?),
            Backend::Grammar | Backend::OpenAi => Box::new(OpenAi::new(&config, key)?),
        };
        Ok(Self { model: Some((config, model)), failing: false })
    }

    /// Whether a model is configured.
    #[must_use]
    pub fn has_model(&self) -> bool {
        self.model.is_some()
    }

    /// Name of the backend.
    #[must_use]
    pub fn backend(&self) -> &'static str {
        self.model.as_ref().map_or(grammar::NAME, |(config, _)| config.backend.name())
    }

    /// The state of an agent that starts with this client.
    #[must_use]
    pub fn initial_state(&self) -> AgentState {
        let model = self.model.as_ref().map_or_else(String::new, |(config, _)| config.model.clone());
        AgentState { backend: self.backend().to_owned(), model, ..AgentState::default() }
    }

    /// Sends a prompt until `accept` takes an answer, with the configured retries and never past `deadline`.
    ///
    /// # Errors
    /// [`LlmError`] of the last try.
    pub async fn ask<T>(
        &self,
        prompt: &Prompt,
        deadline: Instant,
        accept: impl Fn(&str) -> Result<T, InvalidAnswer>,
    ) -> Result<Answer<T>, LlmError> {
        let Some((config, model)) = &self.model else {
            return Err(LlmError::Unavailable("no model is configured".to_owned()));
        };
        if prompt.bytes() > MAX_PROMPT_BYTES {
            return Err(LlmError::PromptTooLarge(prompt.bytes()));
        }
        let start = Instant::now();
        let deadline = deadline.min(start + config.timeout);
        let mut pause = FIRST_PAUSE;
        let mut last_error = None;
        for attempt in 0..=config.retries {
            let time = deadline.saturating_duration_since(Instant::now());
            if time < MIN_TIME {
                break;
            }
            // The same prompt with the same seed would get the same answer.
            let seed = config.seed.map(|seed| seed.wrapping_add(attempt.into()));
            let Ok(outcome) = tokio::time::timeout(time, model.complete(prompt, seed, time)).await else { break };
            let error = match outcome {
                Ok(Completion { text, model, prompt_tokens, answer_tokens }) => {
                    tracing::debug!(prompt_tokens, answer_tokens, "the model answered");
                    match accept(&text) {
                        Ok(value) => {
                            let model = if model.is_empty() { config.model.clone() } else { model };
                            return Ok(Answer { value, model });
                        }
                        Err(invalid) => LlmError::InvalidAnswer(invalid),
                    }
                }
                Err(error) => error,
            };
            if !error.is_transient() {
                return Err(error);
            }
            if matches!(error, LlmError::Unavailable(_)) && attempt < config.retries {
                tokio::time::sleep(pause.min(deadline.saturating_duration_since(Instant::now()))).await;
                pause *= 2;
            }
            last_error = Some(error);
        }
        Err(last_error.unwrap_or_else(|| LlmError::Timeout(start.elapsed())))
    }

    /// Records a success, so that the next failure is logged again.
    pub fn record_success(&mut self) {
        if std::mem::take(&mut self.failing) {
            tracing::info!("the model answers again");
        }
    }

    /// Records a failure. Returns the reason to report with the fallback, and counts it in `state`.
    ///
    /// # Errors
    /// The same error, where the launch file allows no fallback.
    pub fn fall_back(&mut self, error: LlmError, state: &mut AgentState) -> Result<String, LlmError> {
        let Some((config, _)) = &self.model else { return Ok(String::new()) };
        if config.fallback == Fallback::None {
            return Err(error);
        }
        let reason = error.to_string();
        state.fallbacks += 1;
        state.fallback.clone_from(&reason);
        if !std::mem::replace(&mut self.failing, true) {
            tracing::warn!(%error, endpoint = %config.endpoint, "the model failed; the grammar serves until it recovers");
        }
        Ok(reason)
    }
}
