//! What each target does with its input.

pub(crate) mod arrays;
pub(crate) mod clusters;
pub(crate) mod edits;
pub(crate) mod encoders;
pub(crate) mod endpoints;
pub(crate) mod language;
pub(crate) mod messages;
pub(crate) mod projects;
pub(crate) mod scenes;
pub(crate) mod sounds;
pub(crate) mod texts;
pub(crate) mod volumes;

use std::fmt::Display;
use std::path::Path;

/// Whether a result is there. An error must be text that names the file.
fn accepted<T, E: Display>(result: Result<T, E>, path: &Path) -> Option<T> {
    match result {
        Ok(value) => Some(value),
        Err(error) => {
            let (text, name) = (error.to_string(), path.file_name().unwrap_or_default().to_string_lossy().into_owned());
            assert!(text.contains(&name), "the error does not name {name}: {text}");
            None
        }
    }
}
