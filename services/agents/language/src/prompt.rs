//! Prompts to language models, and limits on prompts and answers.

use serde_json::Value;

/// Largest prompt with its schema, bytes.
pub const MAX_PROMPT_BYTES: usize = 72 << 10;

/// Largest answer, bytes.
pub const MAX_ANSWER_BYTES: usize = 64 << 10;

/// Largest number of unit names in a prompt.
pub const MAX_LISTED_NAMES: usize = 200;

/// Largest total length of unit names in a prompt, bytes.
const MAX_LISTED_BYTES: usize = 8 << 10;

/// A prompt to a language model.
#[derive(Debug, Clone, PartialEq)]
pub struct Prompt {
    /// Role of the agent.
    pub agent: &'static str,
    /// The task. It holds no text from users or files.
    pub system: String,
    /// The input: a JSON object, so that the model can tell data from the task.
    pub user: String,
    /// JSON schema of the answer, or `None` for free text.
    pub schema: Option<Value>,
    /// Largest number of tokens of the answer.
    pub max_tokens: u32,
    /// Id of the request.
    pub id: String,
}

impl Prompt {
    /// Size of the prompt with its schema, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.system.len() + self.user.len() + self.schema.as_ref().map_or(0, |s| s.to_string().len())
    }
}

/// An answer that does not have the requested form.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct InvalidAnswer(pub String);

impl InvalidAnswer {
    /// An error with a reason.
    #[must_use]
    pub fn new(reason: impl Into<String>) -> Self {
        Self(reason.into())
    }
}

/// The first names, as many as fit into a prompt.
#[must_use]
pub fn limit_names<'n>(names: &[&'n str]) -> Vec<&'n str> {
    let mut bytes = 0;
    let fits = |name: &&&str| {
        bytes += name.len();
        bytes <= MAX_LISTED_BYTES
    };
    names.iter().take(MAX_LISTED_NAMES).take_while(fits).copied().collect()
}

/// The first `bytes` bytes of a text, cut at a character boundary.
#[must_use]
pub fn clip(text: &str, bytes: usize) -> &str {
    text.get(..text.floor_char_boundary(bytes)).unwrap_or(text)
}

/// A text from another program for a log or a reply: one line, no control characters, at most 300 bytes.
#[must_use]
pub fn single_line(text: &str) -> String {
    let plain: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    clip(plain.trim(), 300).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_and_length_of_names_are_limited() {
        let short = vec!["a"; 1000];
        assert_eq!(limit_names(&short).len(), MAX_LISTED_NAMES);
        let long = "n".repeat(100);
        let long = vec![long.as_str(); 150];
        assert_eq!(limit_names(&long).len(), MAX_LISTED_BYTES / 100);
    }

    #[test]
    fn texts_are_clipped_at_character_boundaries() {
        assert_eq!(clip("größe", 3), "gr");
        assert_eq!(clip("größe", 4), "grö");
        assert_eq!(clip("sac", 9), "sac");
        assert_eq!(single_line(" one\ntwo\u{1b}[31m "), "one two [31m");
        assert!(single_line(&"é".repeat(400)).len() <= 300);
    }
}
