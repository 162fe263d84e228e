//! API keys. They come from the environment and never appear in logs or messages.

use std::fmt;

use reqwest::header::HeaderValue;

/// Longest API key, bytes.
const MAX_KEY_BYTES: usize = 4096;

/// Longest name of a variable, bytes.
const MAX_NAME_BYTES: usize = 64;

/// A key could not be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum KeyError {
    /// `key_env` is not the name of a variable. The message does not repeat it: it may be the key itself.
    #[error(
        "`key_env` is the name of an environment variable, for example OPENAI_API_KEY; store the key in that variable"
    )]
    Name,
    /// The environment variable of the key is not set.
    #[error("`key_env`: the environment variable {0} is not set; set it before `up`")]
    Missing(String),
    /// The environment variable does not hold a key.
    #[error("`key_env`: the environment variable {0} does not hold an API key")]
    Invalid(String),
}

/// The API key of a provider.
pub struct ApiKey {
    secret: String,
    header: HeaderValue,
}

impl ApiKey {
    /// Checks the name of a variable.
    ///
    /// # Errors
    /// [`KeyError::Name`]: it is no name of capital letters, digits and underscores.
    pub fn check_name(variable: &str) -> Result<(), KeyError> {
        let starts = variable.bytes().next().is_some_and(|b| b.is_ascii_uppercase() || b == b'_');
        let fits = |b: u8| b.is_ascii_uppercase() || b.is_ascii_digit() || b == b'_';
        if starts && variable.len() <= MAX_NAME_BYTES && variable.bytes().all(fits) {
            Ok(())
        } else {
            Err(KeyError::Name)
        }
    }

    /// Reads the key from an environment variable.
    ///
    /// # Errors
    /// [`KeyError`]. It names the variable, never its value.
    pub fn from_environment(variable: &str) -> Result<Self, KeyError> {
        Self::check_name(variable)?;
        let secret = std::env::var(variable).unwrap_or_default().trim().to_owned();
        if secret.is_empty() {
            return Err(KeyError::Missing(variable.to_owned()));
        }
        let invalid = || KeyError::Invalid(variable.to_owned());
        if secret.len() > MAX_KEY_BYTES || !secret.bytes().all(|b| b.is_ascii_graphic()) {
            return Err(invalid());
        }
        let mut header = HeaderValue::from_str(&format!("Bearer {secret}")).map_err(|_| invalid())?;
        // Marked as sensitive, so that no log prints it.
        header.set_sensitive(true);
        Ok(Self { secret, header })
    }

    /// The value of the `Authorization` header.
    pub(crate) fn header(&self) -> HeaderValue {
        self.header.clone()
    }

    /// Replaces the key in a text from a server.
    pub(crate) fn redact(&self, text: &str) -> String {
        text.replace(&self.secret, "(key)")
    }
}

impl fmt::Debug for ApiKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ApiKey")
    }
}
