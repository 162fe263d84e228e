//! The language model of an agent, as its table in the launch file configures it.

use std::str::FromStr;
use std::time::Duration;

use serde::Deserialize;
use sg_endpoint::{ApiKey, ClientError, Endpoint, EndpointError, KeyError, OPENAI};
use sg_language::grammar;
use sg_language::intent_schema::SchemaError;

/// The parameters of an agent in a launch file.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Parameters {
    /// The backend.
    pub backend: Backend,
    /// The provider's name of the model.
    pub model: Option<String>,
    /// Address of the model.
    pub endpoint: Option<String>,
    /// Environment variable that holds the API key.
    pub key_env: Option<String>,
    /// Whether prompts may leave this machine unencrypted.
    pub insecure: Option<bool>,
    /// Timeout of a request with all its retries, seconds.
    pub timeout_s: Option<f64>,
    /// Sampling temperature.
    pub temperature: Option<f64>,
    /// Sampling seed.
    pub seed: Option<u64>,
    /// Retries after transient errors.
    pub retries: Option<u32>,
    /// The fallback after the last retry.
    pub fallback: Option<Fallback>,
}

/// The kind of a backend.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(try_from = "String")]
pub enum Backend {
    /// The embedded deterministic grammar.
    #[default]
    Grammar,
    /// A model behind OpenAI's chat completions over HTTP.
    OpenAi,
    /// A program that serves `supergaussian.backend.v1.BackendService` over gRPC.
    Grpc,
}

/// The fallback when the model fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fallback {
    /// The embedded grammar.
    #[default]
    Grammar,
    /// No fallback: the request fails.
    None,
}

/// An unknown backend.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("backend `{name}` does not exist; use one of {known}{hint}", known = backend_names())]
pub struct UnknownBackend {
    /// The given name.
    pub name: String,
    hint: &'static str,
}

/// Invalid parameters of a language model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// The grammar has no such parameter.
    #[error("the backend `grammar` has no parameter `{0}`; remove it, or use the backend `openai` or `grpc`")]
    ModelParameter(&'static str),
    /// A required parameter is missing.
    #[error("the backend `{backend}` needs `{parameter}`, for example {example}")]
    Missing {
        /// The backend.
        backend: &'static str,
        /// The parameter.
        parameter: &'static str,
        /// An example value.
        example: &'static str,
    },
    /// A number is out of range.
    #[error("`{parameter}` is {value}; use a number from {min} to {max}")]
    OutOfRange {
        /// The parameter.
        parameter: &'static str,
        /// The given value.
        value: f64,
        /// Smallest allowed value.
        min: f64,
        /// Largest allowed value.
        max: f64,
    },
    /// The API key cannot be read.
    #[error(transparent)]
    Key(#[from] KeyError),
    /// The name of the model is empty, too long or has control characters.
    #[error("`model` is a name of 1 to {MAX_MODEL_BYTES} bytes without control characters")]
    ModelName,
    /// The endpoint is invalid.
    #[error(transparent)]
    Endpoint(#[from] EndpointError),
    /// The client cannot be created.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The JSON schema of intents could not be built.
    #[error(transparent)]
    Schema(#[from] SchemaError),
}

/// Longest name of a model, bytes.
const MAX_MODEL_BYTES: usize = 200;
/// Default timeout, seconds.
const TIMEOUT_S: f64 = 20.0;
/// Largest timeout, seconds.
const MAX_TIMEOUT_S: f64 = 600.0;
/// Largest number of retries.
const MAX_RETRIES: u32 = 5;
/// Default number of retries.
const RETRIES: u32 = 1;

/// A validated language model.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelConfig {
    /// The kind of the backend.
    pub backend: Backend,
    /// The provider's name of the model; empty for the default of the backend.
    pub model: String,
    /// Address of the model.
    pub endpoint: Endpoint,
    /// Environment variable that holds the API key.
    pub key_env: Option<String>,
    /// Timeout of a request with all its retries.
    pub timeout: Duration,
    /// Sampling temperature.
    pub temperature: Option<f64>,
    /// Sampling seed.
    pub seed: Option<u64>,
    /// Retries after transient errors.
    pub retries: u32,
    /// The fallback after the last retry.
    pub fallback: Fallback,
}

impl Parameters {
    /// Validates the parameters. The grammar has no model.
    ///
    /// # Errors
    /// [`ConfigError`]: one line that names the parameter.
    pub fn model_config(&self) -> Result<Option<ModelConfig>, ConfigError> {
        if self.backend == Backend::Grammar {
            return self.first_model_parameter().map_or(Ok(None), |name| Err(ConfigError::ModelParameter(name)));
        }
        let endpoint = match (&self.endpoint, self.backend) {
            (Some(text), _) => Endpoint::parse(text, self.insecure.unwrap_or(false))?,
            (None, Backend::OpenAi) => {
                if self.key_env.is_none() {
                    return Err(self.missing("key_env", "\"OPENAI_API_KEY\""));
                }
                Endpoint::parse(OPENAI, false)?
            }
            (None, _) => return Err(self.missing("endpoint", "\"http://127.0.0.1:50051\" or \"unix:/run/model.sock\"")),
        };
        if self.backend == Backend::OpenAi && matches!(endpoint, Endpoint::Unix(_)) {
            return Err(ClientError::Socket.into());
        }
        let encrypted = matches!(&endpoint, Endpoint::Url(url) if url.scheme() == "https");
        if self.backend == Backend::Grpc && encrypted {
            return Err(ClientError::Encrypted.into());
        }
        let model = match (&self.model, self.backend) {
            (Some(name), _) => name.clone(),
            (None, Backend::OpenAi) => return Err(self.missing("model", "\"gpt-4o-mini\"")),
            (None, _) => String::new(),
        };
        let named = self.model.is_none() || (1..=MAX_MODEL_BYTES).contains(&model.len());
        if !named || model.chars().any(char::is_control) {
            return Err(ConfigError::ModelName);
        }
        self.key_env.as_deref().map_or(Ok(()), ApiKey::check_name)?;
        let timeout = in_range("timeout_s", self.timeout_s.unwrap_or(TIMEOUT_S), 0.05, MAX_TIMEOUT_S)?;
        let temperature = self.temperature.map(|t| in_range("temperature", t, 0.0, 2.0)).transpose()?;
        let retries = self.retries.unwrap_or(RETRIES);
        in_range("retries", retries.into(), 0.0, MAX_RETRIES.into())?;
        Ok(Some(ModelConfig {
            backend: self.backend,
            model,
            endpoint,
            key_env: self.key_env.clone(),
            timeout: Duration::from_secs_f64(timeout),
            temperature,
            seed: self.seed,
            retries,
            fallback: self.fallback.unwrap_or_default(),
        }))
    }

    /// The first parameter that only models have.
    fn first_model_parameter(&self) -> Option<&'static str> {
        let set = [
            ("model", self.model.is_some()),
            ("endpoint", self.endpoint.is_some()),
            ("key_env", self.key_env.is_some()),
            ("insecure", self.insecure.is_some()),
            ("timeout_s", self.timeout_s.is_some()),
            ("temperature", self.temperature.is_some()),
            ("seed", self.seed.is_some()),
            ("retries", self.retries.is_some()),
            ("fallback", self.fallback.is_some()),
        ];
        set.into_iter().find(|(_, is_set)| *is_set).map(|(name, _)| name)
    }

    fn missing(&self, parameter: &'static str, example: &'static str) -> ConfigError {
        ConfigError::Missing { backend: self.backend.name(), parameter, example }
    }
}

fn in_range(parameter: &'static str, value: f64, min: f64, max: f64) -> Result<f64, ConfigError> {
    if (min..=max).contains(&value) { Ok(value) } else { Err(ConfigError::OutOfRange { parameter, value, min, max }) }
}

impl Backend {
    /// All backends.
    pub const ALL: [Self; 3] = [Self::Grammar, Self::OpenAi, Self::Grpc];

    /// Name in launch files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Grammar => grammar::NAME,
            Self::OpenAi => "openai",
            Self::Grpc => "grpc",
        }
    }
}

fn backend_names() -> String {
    Backend::ALL.map(|b| format!("`{}`", b.name())).join(", ")
}

impl TryFrom<String> for Backend {
    type Error = UnknownBackend;

    fn try_from(name: String) -> Result<Self, UnknownBackend> {
        name.parse()
    }
}

impl FromStr for Backend {
    type Err = UnknownBackend;

    fn from_str(name: &str) -> Result<Self, UnknownBackend> {
        let hint = match name {
            "ollama" => " (for Ollama use `openai` with the endpoint http://127.0.0.1:11434/v1)",
            _ => "",
        };
        let found = Self::ALL.into_iter().find(|b| b.name() == name);
        found.ok_or_else(|| UnknownBackend { name: name.to_owned(), hint })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(json: &str) -> Result<Option<ModelConfig>, String> {
        let parameters: Parameters = serde_json::from_str(json).map_err(|e| e.to_string())?;
        parameters.model_config().map_err(|e| e.to_string())
    }

    fn refused(json: &str, part: &str) {
        let error = read(json).unwrap_err();
        assert!(error.contains(part) && !error.contains('\n'), "{json}: {error}");
    }

    #[test]
    fn the_grammar_is_the_default_and_has_no_model_parameters() {
        assert_eq!(read("{}"), Ok(None));
        assert_eq!(read(r#"{"backend": "grammar"}"#), Ok(None));
        refused(r#"{"model": "m"}"#, "the backend `grammar` has no parameter `model`");
        refused(r#"{"backend": "grammar", "fallback": "none"}"#, "`fallback`");
    }

    #[test]
    fn an_unknown_backend_is_refused_with_the_known_names() {
        for name in ["gpt", "anthropic", "ollama"] {
            let line = format!(r#"{{"backend": "{name}"}}"#);
            refused(&line, &format!("backend `{name}` does not exist; use one of `grammar`, `openai`, `grpc`"));
        }
        refused(r#"{"backend": "ollama"}"#, "http://127.0.0.1:11434/v1");
        refused(r#"{"backened": "grpc"}"#, "unknown field `backened`, expected one of `backend`, `model`");
    }

    #[test]
    fn all_parameters_of_a_model_are_read() {
        let choice = read(
            r#"{"backend": "openai", "model": "m", "endpoint": "http://127.0.0.1:8080/v1", "key_env": "MY_KEY",
                "timeout_s": 1.5, "temperature": 0, "seed": 7, "retries": 0, "fallback": "none"}"#,
        );
        let endpoint = Endpoint::parse("http://127.0.0.1:8080/v1", false).unwrap();
        let expected = ModelConfig {
            backend: Backend::OpenAi,
            model: "m".into(),
            endpoint,
            key_env: Some("MY_KEY".into()),
            timeout: Duration::from_millis(1500),
            temperature: Some(0.0),
            seed: Some(7),
            retries: 0,
            fallback: Fallback::None,
        };
        assert_eq!(choice, Ok(Some(expected)));
        let socket = read(r#"{"backend": "grpc", "endpoint": "unix:/run/m.sock"}"#).unwrap().unwrap();
        assert_eq!((socket.retries, socket.fallback, socket.model.as_str()), (1, Fallback::Grammar, ""));
    }

    #[test]
    fn conflicting_parameters_are_refused_in_one_line() {
        refused(r#"{"backend": "grpc"}"#, "needs `endpoint`");
        refused(r#"{"backend": "openai", "endpoint": "http://127.0.0.1:1"}"#, "needs `model`");
        refused(r#"{"backend": "openai", "model": "m"}"#, "needs `key_env`");
        refused(r#"{"backend": "openai", "model": "m", "endpoint": "unix:/s"}"#, "needs an HTTP address");
        refused(r#"{"backend": "grpc", "endpoint": "http://10.0.0.1:1"}"#, "insecure = true");
        refused(r#"{"backend": "grpc", "endpoint": "https://example.com"}"#, "does not support TLS");
        let grpc = |more: &str| format!(r#"{{"backend": "grpc", "endpoint": "unix:/s", {more}}}"#);
        refused(&grpc(r#""timeout_s": 0"#), "`timeout_s` is 0; use a number from 0.05 to 600");
        refused(&grpc(r#""timeout_s": 1e300"#), "`timeout_s`");
        refused(&grpc(r#""temperature": -1"#), "`temperature`");
        refused(&grpc(r#""retries": 6"#), "`retries` is 6; use a number from 0 to 5");
        refused(&grpc(r#""retries": -1"#), "-1");
        refused(&grpc(r#""fallback": "openai""#), "grammar");
        refused(&grpc(r#""model": """#), "`model`");
    }

    #[test]
    fn a_key_instead_of_its_variable_is_refused_and_not_repeated() {
        let line = r#"{"backend": "grpc", "endpoint": "unix:/s", "key_env": "sk-5ecret"}"#;
        refused(line, "`key_env` is the name of an environment variable");
        assert!(!read(line).unwrap_err().contains("5ecret"));
    }
}
