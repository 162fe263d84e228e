//! Recognizers and synthesizers in other programs, on this machine or another one.
//!
//! Data leave this process only for the endpoints that the launch file names. A recognizer gets samples, names of units and
//! expected sentences. A synthesizer gets replies.

mod grpc;
mod openai;

use std::future::Future;
use std::time::{Duration, Instant};

use serde::Deserialize;
use sg_endpoint::{ApiKey, CallError, Endpoint, EndpointError, KeyError, OPENAI};
use sg_speech::audio::{Recording, SPEECH_RATE};
use sg_speech::child_process::Limits;
use sg_speech::error::SpeechError;
use sg_speech::phrases::PhraseGrammar;
use sg_speech::recognizer::Recognition;
use tokio::runtime::Handle;

pub(crate) use grpc::Grpc;
pub(crate) use openai::OpenAi;

/// Longest name of a model or a voice, bytes.
const MAX_NAME_BYTES: usize = 200;
/// Longest wait for an answer without a parameter.
const USUAL_TIMEOUT: Duration = Duration::from_secs(8);
/// Period of checks for a cancellation.
const POLL_PERIOD: Duration = Duration::from_millis(5);
/// Wait before a server that is unavailable is asked once more.
const PAUSE: Duration = Duration::from_millis(100);
/// Largest answer with a text, bytes.
const MAX_TEXT_BYTES: usize = 1 << 20;
/// Largest sound of a sentence, bytes: two minutes in 16 bits at 48 kHz.
const MAX_SOUND_BYTES: usize = 12 << 20;
/// Longest sound of a sentence.
const LONGEST: Duration = Duration::from_secs(120);
/// Most names of units that are sent.
const MAX_NAMES: usize = 100;

/// A server of speech, as the launch file or the command line names it.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct ServerParams {
    /// Its address; empty for OpenAI's own.
    pub(crate) endpoint: String,
    /// The provider's name of the model.
    pub(crate) model: String,
    /// Name of the environment variable that holds the API key.
    pub(crate) key_env: Option<String>,
    /// Whether data may leave this machine unencrypted.
    pub(crate) insecure: bool,
    /// Longest wait for an answer, seconds.
    pub(crate) timeout: Option<f64>,
}

/// A server that the parameters do not describe. One line with the parameter.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum ServerError {
    #[error("`endpoint` is missing, for example http://127.0.0.1:8000/v1; OpenAI's own needs `key_env`")]
    NoEndpoint,
    #[error("`endpoint` is missing, for example http://127.0.0.1:50051 or unix:/run/speech.sock")]
    NoGrpcEndpoint,
    #[error("`model` is missing, for example {0}")]
    NoModel(&'static str),
    #[error("`{0}` is a name of at most {MAX_NAME_BYTES} bytes without control characters")]
    Name(&'static str),
    #[error("`timeout` is {0}; take 0.1 to 60 seconds")]
    Timeout(f64),
    #[error(transparent)]
    Endpoint(#[from] EndpointError),
    #[error(transparent)]
    Key(#[from] KeyError),
    #[error(transparent)]
    Client(#[from] sg_endpoint::ClientError),
}

/// Where a server is, and how long it may take.
struct Server {
    name: &'static str,
    endpoint: Endpoint,
    model: String,
    timeout: Duration,
    runtime: Handle,
}

impl ServerParams {
    /// The parameters of a server that speaks OpenAI's protocol, with its key. `example`: a model of this kind.
    fn openai(&self, example: &'static str, runtime: &Handle) -> Result<(Server, Option<ApiKey>), ServerError> {
        if self.endpoint.is_empty() && self.key_env.is_none() {
            return Err(ServerError::NoEndpoint);
        }
        if self.model.is_empty() {
            return Err(ServerError::NoModel(example));
        }
        let address = if self.endpoint.is_empty() { OPENAI } else { &self.endpoint };
        self.server("openai", address, runtime)
    }

    /// The parameters of a program that serves `supergaussian.backend.v1.SpeechBackendService`, with its key.
    fn grpc(&self, runtime: &Handle) -> Result<(Server, Option<ApiKey>), ServerError> {
        if self.endpoint.is_empty() {
            return Err(ServerError::NoGrpcEndpoint);
        }
        self.server("grpc", &self.endpoint, runtime)
    }

    fn server(
        &self,
        name: &'static str,
        address: &str,
        runtime: &Handle,
    ) -> Result<(Server, Option<ApiKey>), ServerError> {
        check_name("model", &self.model)?;
        let timeout = match self.timeout {
            None => USUAL_TIMEOUT,
            Some(seconds) if (0.1..=60.0).contains(&seconds) => Duration::from_secs_f64(seconds),
            Some(seconds) => return Err(ServerError::Timeout(seconds)),
        };
        let key = self.key_env.as_deref().map(ApiKey::from_environment).transpose()?;
        let endpoint = Endpoint::parse(address, self.insecure)?;
        let (model, runtime) = (self.model.clone(), runtime.clone());
        Ok((Server { name, endpoint, model, timeout, runtime }, key))
    }
}

fn check_name(parameter: &'static str, name: &str) -> Result<(), ServerError> {
    if name.len() <= MAX_NAME_BYTES && !name.chars().any(char::is_control) {
        Ok(())
    } else {
        Err(ServerError::Name(parameter))
    }
}

impl Server {
    /// Time that an answer may take.
    fn time(&self, limits: &Limits) -> Duration {
        limits.deadline.saturating_duration_since(Instant::now()).min(self.timeout)
    }

    /// Waits for an answer within the limits. A server that is unavailable is asked once more.
    ///
    /// Blocks its thread, which must be none of the async runtime.
    fn wait<T, F>(&self, limits: &Limits, call: impl Fn() -> F) -> Result<T, SpeechError>
    where
        F: Future<Output = Result<T, CallError>>,
    {
        let time = self.time(limits);
        let attempts = async {
            match call().await {
                Err(CallError::Unavailable(_)) => {
                    tokio::time::sleep(PAUSE).await;
                    call().await
                }
                outcome => outcome,
            }
        };
        self.runtime.block_on(async {
            tokio::select! {
                outcome = tokio::time::timeout(time, attempts) => match outcome {
                    Ok(outcome) => outcome.map_err(|error| self.error(error)),
                    Err(_) => Err(self.error(CallError::Timeout(time))),
                },
                () = cancelled(limits) => Err(SpeechError::Cancelled),
            }
        })
    }

    fn error(&self, error: CallError) -> SpeechError {
        let program = format!("`{}` at {}", self.name, self.endpoint);
        match error {
            CallError::Timeout(after) => SpeechError::Late { program, after },
            other => SpeechError::Failed { program, problem: other.to_string() },
        }
    }
}

async fn cancelled(limits: &Limits) {
    while !limits.is_cancelled() {
        tokio::time::sleep(POLL_PERIOD).await;
    }
}

/// A sound without samples, where a sentence has nothing to say.
fn silence_of(sentence: &str) -> Option<Recording> {
    let is_silent = !sentence.chars().any(char::is_alphanumeric);
    is_silent.then(|| Recording { rate: SPEECH_RATE, samples: Vec::new() })
}

/// Names of units that may be spoken of.
fn names(phrases: &PhraseGrammar) -> impl Iterator<Item = &str> {
    phrases.slot("unit").take(MAX_NAMES)
}

/// The text of a server: a sentence of the grammar where it is one, else free text.
fn recognition(text: &str, confidence: f32, phrases: &PhraseGrammar, began: Instant) -> Recognition {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let expected = phrases.written(&text);
    let accepted = expected.is_some();
    Recognition {
        text: expected.unwrap_or(text),
        confidence: confidence.clamp(0.0, 1.0),
        accepted,
        elapsed: began.elapsed(),
        ..Recognition::default()
    }
}

#[cfg(test)]
mod tests;
