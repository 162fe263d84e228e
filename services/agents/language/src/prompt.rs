//! What an agent asks of a language model, what comes back, and what may go wrong.

use serde_json::Value;

/// Largest prompt: both texts and the schema together, bytes.
pub const MAX_PROMPT_BYTES: usize = 64 << 10;

/// Largest answer that is read, bytes.
pub const MAX_ANSWER_BYTES: usize = 64 << 10;

/// Most names of units that one prompt lists.
pub const MAX_LISTED_NAMES: usize = 200;

/// Most bytes of names of units in one prompt.
const MAX_LISTED_BYTES: usize = 8 << 10;

/// A question to a language model.
#[derive(Debug, Clone, PartialEq)]
pub struct Prompt {
    /// Role of the agent that asks.
    pub agent: &'static str,
    /// What the model is to do. Holds nothing that a person or a file has named.
    pub system: String,
    /// What it is about: a JSON object, so that names and words are data whatever they say.
    pub user: String,
    /// JSON schema of the answer; free text without one.
    pub schema: Option<Value>,
    /// Most tokens of the answer that are of use.
    pub max_tokens: u32,
    /// Id of the request that this belongs to.
    pub id: String,
}

impl Prompt {
    /// Bytes of all of it.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.system.len() + self.user.len() + self.schema.as_ref().map_or(0, |s| s.to_string().len())
    }
}

/// An answer that cannot be taken: it does not hold what was asked for.
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

/// As many of the names, in their order, as one prompt lists.
#[must_use]
pub fn limit_names<'n>(names: &[&'n str]) -> Vec<&'n str> {
    let mut bytes = 0;
    let fits = |name: &&&str| {
        bytes += name.len();
        bytes <= MAX_LISTED_BYTES
    };
    names.iter().take(MAX_LISTED_NAMES).take_while(fits).copied().collect()
}

/// At most this many bytes of a text, cut between letters.
#[must_use]
pub fn clip(text: &str, bytes: usize) -> &str {
    text.get(..text.floor_char_boundary(bytes)).unwrap_or(text)
}

/// A line from elsewhere as it may stand in a log or a reply: one line, no control characters, at most 300 bytes.
#[must_use]
pub fn single_line(text: &str) -> String {
    let plain: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    clip(plain.trim(), 300).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_names_are_bounded_both_ways() {
        let short = vec!["a"; 1000];
        assert_eq!(limit_names(&short).len(), MAX_LISTED_NAMES);
        let long = "n".repeat(100);
        let long = vec![long.as_str(); 150];
        assert_eq!(limit_names(&long).len(), MAX_LISTED_BYTES / 100);
    }

    #[test]
    fn texts_are_cut_between_letters_and_lines_hold_no_control_characters() {
        assert_eq!(clip("größe", 3), "gr");
        assert_eq!(clip("größe", 4), "grö");
        assert_eq!(clip("sac", 9), "sac");
        assert_eq!(single_line(" one\ntwo\u{1b}[31m "), "one two [31m");
        assert!(single_line(&"é".repeat(400)).len() <= 300);
    }
}
