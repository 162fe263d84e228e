//! The interface of language models.

use std::future::Future;
use std::pin::Pin;
use std::time::Duration;

use sg_language::prompt::Prompt;

use crate::error::LlmError;

/// The answer of a language model.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Completion {
    /// The answer.
    pub(crate) text: String,
    /// The model's own name; may be empty.
    pub(crate) model: String,
    /// Tokens of the prompt; 0 if unknown.
    pub(crate) prompt_tokens: u32,
    /// Tokens of the answer; 0 if unknown.
    pub(crate) answer_tokens: u32,
}

/// A pending completion.
pub(crate) type CompletionFuture<'a> = Pin<Box<dyn Future<Output = Result<Completion, LlmError>> + Send + 'a>>;

/// A language model behind some protocol.
pub(crate) trait LanguageModel: Send + Sync {
    /// Completes a prompt within `timeout`. Dropping the future cancels the request.
    fn complete<'a>(&'a self, prompt: &'a Prompt, seed: Option<u64>, timeout: Duration) -> CompletionFuture<'a>;
}
