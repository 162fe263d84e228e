//! Utterances to intents with the configured backend: the model, or the grammar.

use std::time::Instant;

use sg_language::grammar::{self, UtteranceError};
use sg_language::intent_prompt::IntentPrompt;
use sg_proto::keys::role;
use sg_proto::language::{AgentState, Intent, IntentRequest};

use crate::client::LlmClient;
use crate::config::{ConfigError, Parameters};
use crate::error::LlmError;

/// An utterance could not be interpreted.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum InterpretError {
    /// The utterance is empty or too long.
    #[error(transparent)]
    Utterance(#[from] UtteranceError),
    /// The model failed and no fallback is allowed.
    #[error(transparent)]
    Llm(#[from] LlmError),
}

/// Interprets utterances.
pub struct Interpreter {
    client: LlmClient,
    prompt: IntentPrompt,
}

impl Interpreter {
    /// Creates the interpreter inside an async runtime.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn new(parameters: &Parameters) -> Result<Self, ConfigError> {
        let prompt = IntentPrompt::new()?;
        Ok(Self { client: LlmClient::new(parameters)?, prompt })
    }

    /// The state of an agent that starts with this interpreter.
    #[must_use]
    pub fn initial_state(&self) -> AgentState {
        self.client.initial_state()
    }

    /// Interprets an utterance before `deadline`. Fallbacks to the grammar are counted in `state`.
    ///
    /// # Errors
    /// [`InterpretError`].
    pub async fn interpret(
        &mut self,
        request: &IntentRequest,
        id: &str,
        deadline: Instant,
        state: &mut AgentState,
    ) -> Result<Intent, InterpretError> {
        let mut fallback = String::new();
        if self.client.has_model() {
            let prompt = self.prompt.build(role::AGENT_INTENT, request, id)?;
            match self.client.ask(&prompt, deadline, |answer| self.prompt.parse_answer(answer, request)).await {
                Ok(answer) => {
                    self.client.record_success();
                    let backend = self.client.backend().to_owned();
                    return Ok(Intent { backend, model: answer.model, ..answer.value });
                }
                Err(error) => fallback = self.client.fall_back(error, state)?,
            }
        }
        let intent = tokio::task::block_in_place(|| grammar::interpret(request))?;
        Ok(Intent { fallback, ..intent })
    }
}
