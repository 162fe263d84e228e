//! API keys. They come from the environment and never appear in logs or messages.

use std::fmt;

use reqwest::header::HeaderValue;

use crate::config::ConfigError;

/// Longest API key, bytes.
const MAX_KEY_BYTES: usize = 4096;

/// The API key of a provider.
pub(crate) struct ApiKey {
    secret: String,
    header: HeaderValue,
}

impl ApiKey {
    /// Reads the key from an environment variable.
    ///
    /// # Errors
    /// [`ConfigError::MissingKey`] or [`ConfigError::InvalidKey`]. Both name the variable, never its value.
    pub(crate) fn from_environment(variable: &str) -> Result<Self, ConfigError> {
        let secret = std::env::var(variable).unwrap_or_default().trim().to_owned();
        if secret.is_empty() {
            return Err(ConfigError::MissingKey(variable.to_owned()));
        }
        let invalid = || ConfigError::InvalidKey(variable.to_owned());
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
