//! What an agent thinks with, as its table of the launch file says.

use std::str::FromStr;
use std::time::Duration;

use serde::Deserialize;

use crate::endpoint::{Endpoint, Unfit};
use crate::grammar;

/// The parameters of an agent in a launch file.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Parameters {
    /// What the agent thinks with.
    pub backend: Backend,
    /// The model by its provider's name.
    pub model: Option<String>,
    /// Where the model answers.
    pub endpoint: Option<String>,
    /// Name of the environment variable that holds the key.
    pub key_env: Option<String>,
    /// Whether prompts may leave this machine unencrypted.
    pub insecure: Option<bool>,
    /// Longest wait for an answer that holds, further tries included, seconds.
    pub timeout_s: Option<f64>,
    /// Sampling temperature.
    pub temperature: Option<f64>,
    /// Seed of the sampling.
    pub seed: Option<u64>,
    /// Further tries where the model is away or its answer does not hold.
    pub retries: Option<u32>,
    /// What serves where the model does not.
    pub fallback: Option<Fallback>,
}

/// A backend by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(try_from = "String")]
pub enum Backend {
    /// The embedded deterministic grammar.
    #[default]
    Grammar,
    /// A model behind an HTTP endpoint that speaks as OpenAI's chat completions do.
    OpenAi,
    /// A model behind a program of one's own that serves `supergaussian.backend.v1.BackendService`.
    Grpc,
}

/// What serves where the model does not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fallback {
    /// The embedded grammar.
    #[default]
    Grammar,
    /// Nothing: the request fails with the reason.
    None,
}

/// A name that no backend has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no backend `{name}`; there are {known}{hint}", known = known())]
pub struct UnknownBackend {
    /// As it was given.
    pub name: String,
    hint: &'static str,
}

/// Parameters that do not fit together.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Wrong {
    /// A parameter of models, for the grammar.
    #[error("`{0}` means nothing to the backend `grammar`; leave it out, or choose the backend `openai` or `grpc`")]
    Superfluous(&'static str),
    /// A parameter that a backend cannot do without.
    #[error("the backend `{backend}` needs `{parameter}`, such as {example}")]
    Missing {
        /// The backend.
        backend: &'static str,
        /// The parameter.
        parameter: &'static str,
        /// How it may look.
        example: &'static str,
    },
    /// A number out of its range.
    #[error("`{parameter}` is {value}; it goes from {least} to {most}")]
    Range {
        /// The parameter.
        parameter: &'static str,
        /// As it was given.
        value: f64,
        /// Least value.
        least: f64,
        /// Greatest value.
        most: f64,
    },
    /// Not the name of a variable. What was given is not repeated: it may be the key itself.
    #[error("`key_env` is the name of an environment variable, such as OPENAI_API_KEY; the key itself stays in there")]
    KeyName,
    /// A text that is too long or empty.
    #[error("`model` is a name of 1 to {MAX_MODEL_BYTES} bytes without control characters")]
    ModelName,
    /// An address that cannot be used.
    #[error(transparent)]
    Endpoint(#[from] Unfit),
    /// An encrypted endpoint, for a backend that does not encrypt.
    #[error(
        "`endpoint`: the backend `grpc` does not speak TLS; write http://127.0.0.1:PORT or unix:/PATH, the near end of a tunnel"
    )]
    Encrypted,
    /// A socket, for a backend that speaks HTTP.
    #[error("`endpoint`: the backend `openai` speaks HTTP; write http://127.0.0.1:PORT/v1 or https://HOST/v1")]
    Socket,
}

/// Where OpenAI answers.
const OPENAI: &str = "https://api.openai.com/v1";
/// Longest name of a model, bytes.
const MAX_MODEL_BYTES: usize = 200;
/// Wait for an answer where none is given, seconds.
const TIMEOUT_S: f64 = 20.0;
/// Longest wait for an answer, seconds.
const MAX_TIMEOUT_S: f64 = 600.0;
/// Most further tries.
const MAX_RETRIES: u32 = 5;
/// Further tries where no number is given.
const RETRIES: u32 = 1;

/// A language model as a launch file chooses it.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// How it is spoken to.
    pub backend: Backend,
    /// The model by its provider's name; empty for the backend's own choice.
    pub model: String,
    /// Where it answers.
    pub endpoint: Endpoint,
    /// Name of the environment variable that holds the key.
    pub key_env: Option<String>,
    /// Longest wait for an answer that holds.
    pub timeout: Duration,
    /// Sampling temperature.
    pub temperature: Option<f64>,
    /// Seed of the sampling.
    pub seed: Option<u64>,
    /// Further tries.
    pub retries: u32,
    /// What serves where the model does not.
    pub fallback: Fallback,
}

impl Parameters {
    /// The model that is chosen; none for the grammar.
    ///
    /// # Errors
    /// [`Wrong`], one line that names the parameter.
    pub fn choice(&self) -> Result<Option<Choice>, Wrong> {
        if self.backend == Backend::Grammar {
            return self.for_models_only().map_or(Ok(None), |name| Err(Wrong::Superfluous(name)));
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
            return Err(Wrong::Socket);
        }
        let encrypted = matches!(&endpoint, Endpoint::Url(url) if url.scheme() == "https");
        if self.backend == Backend::Grpc && encrypted {
            return Err(Wrong::Encrypted);
        }
        let model = match (&self.model, self.backend) {
            (Some(name), _) => name.clone(),
            (None, Backend::OpenAi) => return Err(self.missing("model", "\"gpt-4o-mini\"")),
            (None, _) => String::new(),
        };
        let named = self.model.is_none() || (1..=MAX_MODEL_BYTES).contains(&model.len());
        if !named || model.chars().any(char::is_control) {
            return Err(Wrong::ModelName);
        }
        if self.key_env.as_ref().is_some_and(|name| !is_variable(name)) {
            return Err(Wrong::KeyName);
        }
        let timeout = within("timeout_s", self.timeout_s.unwrap_or(TIMEOUT_S), 0.05, MAX_TIMEOUT_S)?;
        let temperature = self.temperature.map(|t| within("temperature", t, 0.0, 2.0)).transpose()?;
        let retries = self.retries.unwrap_or(RETRIES);
        within("retries", retries.into(), 0.0, MAX_RETRIES.into())?;
        Ok(Some(Choice {
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

    /// A parameter that is set and speaks of models.
    fn for_models_only(&self) -> Option<&'static str> {
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

    fn missing(&self, parameter: &'static str, example: &'static str) -> Wrong {
        Wrong::Missing { backend: self.backend.name(), parameter, example }
    }
}

fn within(parameter: &'static str, value: f64, least: f64, most: f64) -> Result<f64, Wrong> {
    if (least..=most).contains(&value) { Ok(value) } else { Err(Wrong::Range { parameter, value, least, most }) }
}

fn is_variable(name: &str) -> bool {
    let starts = name.bytes().next().is_some_and(|b| b.is_ascii_uppercase() || b == b'_');
    starts && name.len() <= 64 && name.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit() || b == b'_')
}

impl Backend {
    /// All there are.
    pub const ALL: [Self; 3] = [Self::Grammar, Self::OpenAi, Self::Grpc];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Grammar => grammar::NAME,
            Self::OpenAi => "openai",
            Self::Grpc => "grpc",
        }
    }
}

fn known() -> String {
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
            "ollama" => " (Ollama also speaks as `openai` does, at http://127.0.0.1:11434/v1)",
            _ => "",
        };
        let found = Self::ALL.into_iter().find(|b| b.name() == name);
        found.ok_or_else(|| UnknownBackend { name: name.to_owned(), hint })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(json: &str) -> Result<Option<Choice>, String> {
        let parameters: Parameters = serde_json::from_str(json).map_err(|e| e.to_string())?;
        parameters.choice().map_err(|e| e.to_string())
    }

    fn refused(json: &str, part: &str) {
        let error = read(json).unwrap_err();
        assert!(error.contains(part) && !error.contains('\n'), "{json}: {error}");
    }

    #[test]
    fn the_grammar_is_what_there_is_without_a_word_and_takes_no_parameters_of_models() {
        assert_eq!(read("{}"), Ok(None));
        assert_eq!(read(r#"{"backend": "grammar"}"#), Ok(None));
        refused(r#"{"model": "m"}"#, "`model` means nothing to the backend `grammar`");
        refused(r#"{"backend": "grammar", "fallback": "none"}"#, "`fallback`");
    }

    #[test]
    fn a_backend_that_is_not_there_is_refused_with_those_that_are() {
        for name in ["gpt", "anthropic", "ollama"] {
            let line = format!(r#"{{"backend": "{name}"}}"#);
            refused(&line, &format!("there is no backend `{name}`; there are `grammar`, `openai`, `grpc`"));
        }
        refused(r#"{"backend": "ollama"}"#, "http://127.0.0.1:11434/v1");
        refused(r#"{"backened": "grpc"}"#, "unknown field `backened`, expected one of `backend`, `model`");
    }

    #[test]
    fn a_model_is_chosen_whole() {
        let choice = read(
            r#"{"backend": "openai", "model": "m", "endpoint": "http://127.0.0.1:8080/v1", "key_env": "MY_KEY",
                "timeout_s": 1.5, "temperature": 0, "seed": 7, "retries": 0, "fallback": "none"}"#,
        );
        let endpoint = Endpoint::parse("http://127.0.0.1:8080/v1", false).unwrap();
        let expected = Choice {
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
    fn what_does_not_fit_together_is_said_in_a_line() {
        refused(r#"{"backend": "grpc"}"#, "needs `endpoint`");
        refused(r#"{"backend": "openai", "endpoint": "http://127.0.0.1:1"}"#, "needs `model`");
        refused(r#"{"backend": "openai", "model": "m"}"#, "needs `key_env`");
        refused(r#"{"backend": "openai", "model": "m", "endpoint": "unix:/s"}"#, "speaks HTTP");
        refused(r#"{"backend": "grpc", "endpoint": "http://10.0.0.1:1"}"#, "insecure = true");
        refused(r#"{"backend": "grpc", "endpoint": "https://example.com"}"#, "does not speak TLS");
        let grpc = |more: &str| format!(r#"{{"backend": "grpc", "endpoint": "unix:/s", {more}}}"#);
        refused(&grpc(r#""timeout_s": 0"#), "`timeout_s` is 0; it goes from 0.05 to 600");
        refused(&grpc(r#""timeout_s": 1e300"#), "`timeout_s`");
        refused(&grpc(r#""temperature": -1"#), "`temperature`");
        refused(&grpc(r#""retries": 6"#), "`retries` is 6; it goes from 0 to 5");
        refused(&grpc(r#""retries": -1"#), "-1");
        refused(&grpc(r#""fallback": "openai""#), "grammar");
        refused(&grpc(r#""model": """#), "`model`");
    }

    #[test]
    fn a_key_in_place_of_its_name_is_refused_and_not_repeated() {
        let line = r#"{"backend": "grpc", "endpoint": "unix:/s", "key_env": "sk-5ecret"}"#;
        refused(line, "`key_env` is the name of an environment variable");
        assert!(!read(line).unwrap_err().contains("5ecret"));
    }
}
