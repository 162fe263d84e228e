//! Errors of language models.

use std::time::Duration;

use sg_endpoint::CallError;
use sg_language::prompt::{InvalidAnswer, MAX_PROMPT_BYTES};
use sg_proto::bus::Code;

/// Wait before the next request where no model answered and no fallback is allowed.
const RETRY_AFTER: Duration = Duration::from_secs(1);

/// A request to a language model failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LlmError {
    /// The model cannot be reached or is overloaded.
    #[error("the model is unavailable: {0}")]
    Unavailable(String),
    /// The model did not answer before the deadline.
    #[error("the model did not answer within {} ms", .0.as_millis())]
    Timeout(Duration),
    /// The model refused the request: a wrong key, an unknown model, an unknown parameter.
    #[error("the model refused: {0}")]
    Refused(String),
    /// The answer does not have the requested form.
    #[error("the model's answer is invalid: {0}")]
    InvalidAnswer(#[from] InvalidAnswer),
    /// The prompt is larger than [`MAX_PROMPT_BYTES`].
    #[error("the prompt has {0} bytes; the limit is {MAX_PROMPT_BYTES}")]
    PromptTooLarge(usize),
}

impl LlmError {
    /// Whether a repeated request may succeed.
    #[must_use]
    pub fn is_transient(&self) -> bool {
        matches!(self, Self::Unavailable(_) | Self::InvalidAnswer(_))
    }

    /// The status code of a request that failed with this error.
    ///
    /// It is never `Unavailable`: clients repeat such requests until their deadline, but the configured retries are
    /// over.
    #[must_use]
    pub fn code(&self) -> Code {
        match self {
            Self::Unavailable(_) | Self::InvalidAnswer(_) => Code::Aborted,
            Self::Timeout(_) => Code::DeadlineExceeded,
            Self::Refused(_) => Code::FailedPrecondition,
            Self::PromptTooLarge(_) => Code::ResourceExhausted,
        }
    }

    /// Wait before the next request, where one may succeed.
    #[must_use]
    pub fn retry_after(&self) -> Option<Duration> {
        self.is_transient().then_some(RETRY_AFTER)
    }

    /// The error as a sentence.
    #[must_use]
    pub fn sentence(&self) -> String {
        let mut text = self.to_string();
        if let Some(first) = text.get_mut(..1) {
            first.make_ascii_uppercase();
        }
        text + "."
    }
}

impl From<CallError> for LlmError {
    fn from(error: CallError) -> Self {
        match error {
            CallError::Unavailable(text) => Self::Unavailable(text),
            CallError::Refused(text) => Self::Refused(text),
            CallError::Timeout(after) => Self::Timeout(after),
            CallError::Invalid(text) => InvalidAnswer::new(text).into(),
        }
    }
}
