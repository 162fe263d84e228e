//! Models behind HTTP, in the language of OpenAI's chat completions.

use std::error::Error;
use std::time::Duration;

use reqwest::Url;
use reqwest::header::{AUTHORIZATION, CONTENT_TYPE};
use reqwest::redirect::Policy;
use sg_agents::backend::Choice;
use sg_agents::endpoint::Endpoint;
use sg_agents::openai;
use sg_agents::prompt::{Completion, MAX_ANSWER_BYTES, ModelError, Prompt, Rejected, line};

use super::key::Key;
use super::{Answering, Model};

/// Longest wait for a connection.
const CONNECT: Duration = Duration::from_secs(5);
/// Largest body of an answer, bytes: as escaped as JSON can be, and what a server says about itself.
const MAX_BODY_BYTES: usize = 6 * MAX_ANSWER_BYTES + (64 << 10);

/// A model by its endpoint.
pub(super) struct OpenAi {
    client: reqwest::Client,
    url: Url,
    key: Option<Key>,
    model: String,
    temperature: Option<f64>,
}

impl OpenAi {
    pub(super) fn new(choice: &Choice, key: Option<Key>) -> Result<Self, String> {
        // One who comes second finds the provider of the first, which is the same.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let Endpoint::Url(mut url) = choice.endpoint.clone() else {
            return Err(format!("`endpoint`: {} is no URL", choice.endpoint));
        };
        if let Ok(mut path) = url.path_segments_mut() {
            path.pop_if_empty().extend(openai::PATH.split('/'));
        }
        // Prompts and the key go where the launch file says, not where a variable of the environment or a server does.
        let client = reqwest::Client::builder().no_proxy().redirect(Policy::none()).connect_timeout(CONNECT).build();
        let client = client.map_err(|e| format!("no HTTP client: {}", chain(&e)))?;
        Ok(Self { client, url, key, model: choice.model.clone(), temperature: choice.temperature })
    }

    async fn ask(&self, prompt: &Prompt, seed: Option<u64>) -> Result<Completion, ModelError> {
        let body = openai::request(prompt, &self.model, self.temperature, seed);
        let mut request =
            self.client.post(self.url.clone()).header(CONTENT_TYPE, "application/json").body(body.to_string());
        if let Some(key) = &self.key {
            request = request.header(AUTHORIZATION, key.header().map_err(ModelError::Refused)?);
        }
        let away = |e: reqwest::Error| ModelError::Away(chain(&e.without_url()));
        let mut response = request.send().await.map_err(away)?;
        let status = response.status();
        let mut body = Vec::new();
        while let Some(chunk) = response.chunk().await.map_err(away)? {
            if body.len() + chunk.len() > MAX_BODY_BYTES {
                return Err(ModelError::Rejected(Rejected(format!("it has over {MAX_BODY_BYTES} bytes"))));
            }
            body.extend_from_slice(&chunk);
        }
        if status.is_success() { openai::answer(&body) } else { Err(openai::fault(status.as_u16(), &body)) }
    }

    /// An error without the key, should the server have repeated it.
    fn hidden(&self, error: ModelError) -> ModelError {
        let Some(key) = &self.key else { return error };
        match error {
            ModelError::Away(text) => ModelError::Away(key.hidden_in(&text)),
            ModelError::Refused(text) => ModelError::Refused(key.hidden_in(&text)),
            ModelError::Rejected(Rejected(text)) => ModelError::Rejected(Rejected(key.hidden_in(&text))),
            other => other,
        }
    }
}

impl Model for OpenAi {
    fn complete<'a>(&'a self, prompt: &'a Prompt, seed: Option<u64>, _: Duration) -> Answering<'a> {
        Box::pin(async move { self.ask(prompt, seed).await.map_err(|e| self.hidden(e)) })
    }
}

/// An error and what is behind it, on one line.
pub(super) fn chain(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(inner) = source {
        let inner_text = inner.to_string();
        if !text.contains(&inner_text) {
            text = format!("{text}: {inner_text}");
        }
        source = inner.source();
    }
    line(&text)
}
