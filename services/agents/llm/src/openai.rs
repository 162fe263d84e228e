//! HTTP client for OpenAI's chat completions.

use std::time::Duration;

use sg_endpoint::{ApiKey, ClientError, HttpClient};
use sg_language::prompt::{InvalidAnswer, MAX_ANSWER_BYTES, Prompt};

use crate::chat_completion::{self, PATH};
use crate::config::ModelConfig;
use crate::error::LlmError;
use crate::model::{Completion, CompletionFuture, LanguageModel};

/// Largest body of an answer, bytes: every byte escaped in JSON, and the metadata of the server.
const MAX_BODY_BYTES: usize = 6 * MAX_ANSWER_BYTES + (64 << 10);

/// A model behind an HTTP endpoint.
pub(crate) struct OpenAi {
    client: HttpClient,
    model: String,
    temperature: Option<f64>,
}

impl OpenAi {
    pub(crate) fn new(config: &ModelConfig, key: Option<ApiKey>) -> Result<Self, ClientError> {
        let client = HttpClient::new(&config.endpoint, key)?;
        Ok(Self { client, model: config.model.clone(), temperature: config.temperature })
    }

    async fn request(&self, prompt: &Prompt, seed: Option<u64>) -> Result<Completion, LlmError> {
        let body = chat_completion::request(prompt, &self.model, self.temperature, seed);
        let answer = self.client.post_json(PATH, body.to_string(), MAX_BODY_BYTES).await?;
        chat_completion::parse_answer(&answer)
    }

    /// An error without the key, in case the model repeated it.
    fn redacted(&self, error: LlmError) -> LlmError {
        match error {
            LlmError::Refused(text) => LlmError::Refused(self.client.redacted(&text)),
            LlmError::InvalidAnswer(error) => {
                LlmError::InvalidAnswer(InvalidAnswer::new(self.client.redacted(&error.0)))
            }
            LlmError::Unavailable(_) | LlmError::Timeout(_) | LlmError::PromptTooLarge(_) => error,
        }
    }
}

impl LanguageModel for OpenAi {
    fn complete<'a>(&'a self, prompt: &'a Prompt, seed: Option<u64>, _: Duration) -> CompletionFuture<'a> {
        Box::pin(async move { self.request(prompt, seed).await.map_err(|e| self.redacted(e)) })
    }
}
