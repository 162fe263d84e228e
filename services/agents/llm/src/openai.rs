//! HTTP client for OpenAI's chat completions.

use std::time::Duration;

use reqwest::Url;
use reqwest::header::{AUTHORIZATION, CONTENT_TYPE};
use reqwest::redirect::Policy;
use sg_language::prompt::{InvalidAnswer, MAX_ANSWER_BYTES, Prompt};

use crate::api_key::ApiKey;
use crate::chat_completion::{self, PATH};
use crate::config::{ConfigError, ModelConfig};
use crate::endpoint::Endpoint;
use crate::error::{LlmError, error_chain};
use crate::model::{Completion, CompletionFuture, LanguageModel};

/// Longest wait for a connection.
const CONNECT: Duration = Duration::from_secs(5);
/// Largest body of an answer, bytes: every byte escaped in JSON, and the metadata of the server.
const MAX_BODY_BYTES: usize = 6 * MAX_ANSWER_BYTES + (64 << 10);

/// A model behind an HTTP endpoint.
pub(crate) struct OpenAi {
    client: reqwest::Client,
    url: Url,
    key: Option<ApiKey>,
    model: String,
    temperature: Option<f64>,
}

impl OpenAi {
    pub(crate) fn new(config: &ModelConfig, key: Option<ApiKey>) -> Result<Self, ConfigError> {
        // The call fails if the provider is installed already; it is the same one.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let Endpoint::Url(mut url) = config.endpoint.clone() else {
            return Err(ConfigError::Socket);
        };
        if let Ok(mut path) = url.path_segments_mut() {
            path.pop_if_empty().extend(PATH.split('/'));
        }
        // Prompts and the key go only to the configured endpoint: no proxy, no redirect.
        let client = reqwest::Client::builder().no_proxy().redirect(Policy::none()).connect_timeout(CONNECT).build();
        let client = client.map_err(|e| ConfigError::HttpClient(error_chain(&e)))?;
        Ok(Self { client, url, key, model: config.model.clone(), temperature: config.temperature })
    }

    async fn request(&self, prompt: &Prompt, seed: Option<u64>) -> Result<Completion, LlmError> {
        let body = chat_completion::request(prompt, &self.model, self.temperature, seed);
        let mut request =
            self.client.post(self.url.clone()).header(CONTENT_TYPE, "application/json").body(body.to_string());
        if let Some(key) = &self.key {
            request = request.header(AUTHORIZATION, key.header());
        }
        let unavailable = |e: reqwest::Error| LlmError::Unavailable(error_chain(&e.without_url()));
        let mut response = request.send().await.map_err(unavailable)?;
        let status = response.status();
        let mut body = Vec::new();
        while let Some(chunk) = response.chunk().await.map_err(unavailable)? {
            if body.len() + chunk.len() > MAX_BODY_BYTES {
                return Err(InvalidAnswer::new(format!("it has over {MAX_BODY_BYTES} bytes")).into());
            }
            body.extend_from_slice(&chunk);
        }
        if status.is_success() {
            chat_completion::parse_answer(&body)
        } else {
            Err(chat_completion::parse_error(status.as_u16(), &body))
        }
    }

    /// An error without the key, in case the server repeated it.
    fn redacted(&self, error: LlmError) -> LlmError {
        let Some(key) = &self.key else { return error };
        match error {
            LlmError::Unavailable(text) => LlmError::Unavailable(key.redact(&text)),
            LlmError::Refused(text) => LlmError::Refused(key.redact(&text)),
            LlmError::InvalidAnswer(error) => LlmError::InvalidAnswer(InvalidAnswer::new(key.redact(&error.0))),
            LlmError::Timeout(_) | LlmError::PromptTooLarge(_) => error,
        }
    }
}

impl LanguageModel for OpenAi {
    fn complete<'a>(&'a self, prompt: &'a Prompt, seed: Option<u64>, _: Duration) -> CompletionFuture<'a> {
        Box::pin(async move { self.request(prompt, seed).await.map_err(|e| self.redacted(e)) })
    }
}
