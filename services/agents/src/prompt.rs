//! What an agent asks of a language model, what comes back, and what may go wrong.

use std::time::Duration;

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

/// What a model answered.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Completion {
    /// The answer.
    pub text: String,
    /// The model as it names itself; empty where it does not.
    pub model: String,
    /// Tokens read, 0 where nobody counted.
    pub prompt_tokens: u32,
    /// Tokens written, 0 where nobody counted.
    pub answer_tokens: u32,
}

/// An answer that cannot be taken: it does not hold what was asked for.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Rejected(pub String);

impl Rejected {
    pub(crate) fn new(reason: impl Into<String>) -> Self {
        Self(reason.into())
    }
}

/// Why a model gave no answer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ModelError {
    /// Not there, or not able to answer at the moment.
    #[error("the model is away: {0}")]
    Away(String),
    /// No answer in the time there was.
    #[error("the model did not answer within {} ms", .0.as_millis())]
    Late(Duration),
    /// It does not take this question from us: a wrong key, an unknown model, a parameter it does not know.
    #[error("the model refused: {0}")]
    Refused(String),
    /// The answer does not hold.
    #[error("the model's answer does not hold: {0}")]
    Rejected(#[from] Rejected),
    /// The prompt would be larger than [`MAX_PROMPT_BYTES`].
    #[error("the prompt would have {0} bytes, over the limit of {MAX_PROMPT_BYTES}")]
    Prompt(usize),
}

impl ModelError {
    /// Whether the same question may be answered another time.
    #[must_use]
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Away(_) | Self::Rejected(_))
    }
}

/// As many of the names, in their order, as one prompt lists.
#[must_use]
pub fn listed<'n>(names: &[&'n str]) -> Vec<&'n str> {
    let mut bytes = 0;
    let fits = |name: &&&str| {
        bytes += name.len();
        bytes <= MAX_LISTED_BYTES
    };
    names.iter().take(MAX_LISTED_NAMES).take_while(fits).copied().collect()
}

/// At most this many bytes of a text, cut between letters.
#[must_use]
pub fn clipped(text: &str, bytes: usize) -> &str {
    text.get(..text.floor_char_boundary(bytes)).unwrap_or(text)
}

/// A line from elsewhere as it may stand in a log or a reply: one line, no control characters, at most 300 bytes.
#[must_use]
pub fn line(text: &str) -> String {
    let plain: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    clipped(plain.trim(), 300).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_names_are_bounded_both_ways() {
        let short = vec!["a"; 1000];
        assert_eq!(listed(&short).len(), MAX_LISTED_NAMES);
        let long = "n".repeat(100);
        let long = vec![long.as_str(); 150];
        assert_eq!(listed(&long).len(), MAX_LISTED_BYTES / 100);
    }

    #[test]
    fn texts_are_cut_between_letters_and_lines_hold_no_control_characters() {
        assert_eq!(clipped("größe", 3), "gr");
        assert_eq!(clipped("größe", 4), "grö");
        assert_eq!(clipped("sac", 9), "sac");
        assert_eq!(line(" one\ntwo\u{1b}[31m "), "one two [31m");
        assert!(line(&"é".repeat(400)).len() <= 300);
    }
}
