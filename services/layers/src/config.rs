//! Numbers of a model's configuration, within limits.

use std::path::Path;

use serde::de::DeserializeOwned;
use sg_input::{file, limits};

use crate::error::ModelError;

/// Most components of a token or an embedding.
pub const MAX_WIDTH: usize = 8192;
/// Most components between the layers of a perceptron.
pub const MAX_INNER: usize = 65_536;
/// Most blocks of a transformer.
pub const MAX_LAYERS: usize = 128;
/// Most tokens of a vocabulary.
pub const MAX_VOCABULARY: usize = 1 << 20;
/// Most tokens of a text.
pub const MAX_CONTEXT: usize = 4096;

/// Parses a JSON file.
///
/// # Errors
/// [`ModelError`] where the file is not there, too long or not of this shape.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, ModelError> {
    let text = file::read_text(path, limits::TEXT_BYTES).map_err(|error| ModelError::file(path, error.to_string()))?;
    serde_json::from_str(&text).map_err(|error| ModelError::file(path, error.to_string()))
}

/// Checks that a number is from 1 to `most`.
///
/// # Errors
/// [`ModelError`] with the key and both ends of the range.
pub fn within(path: &Path, key: &str, value: usize, most: usize) -> Result<usize, ModelError> {
    if (1..=most).contains(&value) {
        return Ok(value);
    }
    Err(ModelError::config(path, key, format!("{value}; it can be 1 to {most}")))
}
