//! Keys of providers. They come from the environment and never show.

use std::fmt;

use reqwest::header::HeaderValue;

/// Longest key, bytes.
const MAX_KEY_BYTES: usize = 4096;

/// A provider's key.
pub(super) struct Key(String);

impl Key {
    /// The key in an environment variable.
    ///
    /// # Errors
    /// A line that names the variable, never its value.
    pub(super) fn from_environment(variable: &str) -> Result<Self, String> {
        let key = std::env::var(variable).unwrap_or_default().trim().to_owned();
        if key.is_empty() {
            return Err(format!("`key_env`: the environment variable {variable} is not set; set it before `up`"));
        }
        if key.len() > MAX_KEY_BYTES || !key.bytes().all(|b| b.is_ascii_graphic()) {
            return Err(format!("`key_env`: what the environment variable {variable} holds is no key"));
        }
        Ok(Self(key))
    }

    /// The value of an `Authorization` header, marked so that nothing prints it.
    ///
    /// # Errors
    /// A line; the key itself is not in it.
    pub(super) fn header(&self) -> Result<HeaderValue, String> {
        let mut value = HeaderValue::from_str(&format!("Bearer {}", self.0))
            .map_err(|_| "the key cannot be sent in a header".to_owned())?;
        value.set_sensitive(true);
        Ok(value)
    }

    /// A text from elsewhere without the key, should it repeat it.
    pub(super) fn hidden_in(&self, text: &str) -> String {
        text.replace(&self.0, "(key)")
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key")
    }
}
