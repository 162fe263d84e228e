//! What understands utterances.

use std::str::FromStr;

use serde::Deserialize;
use sg_proto::language::{Intent, Observation};

use crate::grammar::{self, Refused};

/// The parameters of an agent in a launch file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Parameters {
    /// What understands utterances.
    pub backend: Backend,
}

/// A backend by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(try_from = "String")]
pub enum Backend {
    /// The embedded deterministic grammar.
    #[default]
    Grammar,
}

/// A name that no backend has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no backend `{0}`; use `{name}`", name = grammar::NAME)]
pub struct UnknownBackend(pub String);

impl Backend {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Grammar => grammar::NAME,
        }
    }

    /// Understands an utterance in front of a scene.
    ///
    /// # Errors
    /// [`Refused`]: an utterance that is empty or too long.
    pub fn understand(self, text: &str, observation: &Observation) -> Result<Intent, Refused> {
        match self {
            Self::Grammar => grammar::understand(text, observation),
        }
    }
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
        if name == grammar::NAME { Ok(Self::Grammar) } else { Err(UnknownBackend(name.to_owned())) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_backend_is_refused_with_those_that_exist() {
        assert_eq!("grammar".parse(), Ok(Backend::Grammar));
        let error = "gpt".parse::<Backend>().unwrap_err().to_string();
        assert!(error.contains("`gpt`") && error.contains("`grammar`"), "{error}");
    }

    #[test]
    fn parameters_of_a_launch_file() {
        let read = |json: &str| serde_json::from_str::<Parameters>(json).map_err(|e| e.to_string());
        assert_eq!(read("{}"), Ok(Parameters { backend: Backend::Grammar }));
        assert_eq!(read(r#"{"backend": "grammar"}"#), read("{}"));
        assert!(read(r#"{"backend": "gpt"}"#).unwrap_err().contains("use `grammar`"));
        assert!(read(r#"{"backened": "grammar"}"#).unwrap_err().contains("backend"));
    }
}
