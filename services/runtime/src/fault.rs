//! Typed refusals: what travels instead of a reply.

use std::time::Duration;

use sg_proto::bus::{Code, Error as WireError};

/// A request that was not served: code, one line for a person, when to try again.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Fault {
    /// What kind of refusal (gRPC's canonical codes).
    pub code: Code,
    /// One line: what, where, and what to do.
    pub message: String,
    /// After how long another try is worthwhile.
    pub retry_after: Option<Duration>,
    /// Further facts, such as names that would have been valid.
    pub details: Vec<String>,
}

impl Fault {
    /// A refusal with a code and one line.
    #[must_use]
    pub fn new(code: Code, message: impl Into<String>) -> Self {
        Self { code, message: message.into(), retry_after: None, details: Vec::new() }
    }

    /// The request itself is wrong, whatever the state of the scene.
    #[must_use]
    pub fn invalid(message: impl Into<String>) -> Self {
        Self::new(Code::InvalidArgument, message)
    }

    /// Something named in the request does not exist.
    #[must_use]
    pub fn not_found(message: impl Into<String>) -> Self {
        Self::new(Code::NotFound, message)
    }

    /// The request does not fit the present state.
    #[must_use]
    pub fn precondition(message: impl Into<String>) -> Self {
        Self::new(Code::FailedPrecondition, message)
    }

    /// A fault of the service itself.
    #[must_use]
    pub fn internal(message: impl Into<String>) -> Self {
        Self::new(Code::Internal, message)
    }

    /// The answer came too late, or would have.
    #[must_use]
    pub fn deadline(message: impl Into<String>) -> Self {
        Self::new(Code::DeadlineExceeded, message)
    }

    /// A queue, quota or disk is full.
    #[must_use]
    pub fn exhausted(message: impl Into<String>) -> Self {
        Self::new(Code::ResourceExhausted, message)
    }

    /// Nobody serves the role at the moment.
    #[must_use]
    pub fn unavailable(message: impl Into<String>) -> Self {
        Self { retry_after: Some(Duration::from_millis(50)), ..Self::new(Code::Unavailable, message) }
    }

    /// The same with further facts.
    #[must_use]
    pub fn with_details(mut self, details: impl IntoIterator<Item = String>) -> Self {
        self.details.extend(details);
        self
    }

    /// As it travels.
    #[must_use]
    pub fn to_wire(&self) -> WireError {
        WireError {
            code: self.code.into(),
            message: self.message.clone(),
            retry_after_ms: self.retry_after.map_or(0, |d| u32::try_from(d.as_millis()).unwrap_or(u32::MAX)),
            details: self.details.clone(),
        }
    }

    /// From what travelled.
    #[must_use]
    pub fn from_wire(error: WireError) -> Self {
        let code = Code::try_from(error.code).ok().filter(|c| *c != Code::Unspecified).unwrap_or(Code::Unknown);
        Self {
            code,
            message: error.message,
            retry_after: (error.retry_after_ms > 0).then(|| Duration::from_millis(error.retry_after_ms.into())),
            details: error.details,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_survives_the_wire() {
        let fault = Fault::unavailable("the scene is away").with_details(["scene".to_owned()]);
        assert_eq!(Fault::from_wire(fault.to_wire()), fault);
    }

    #[test]
    fn an_unknown_code_is_unknown_not_ok() {
        let fault = Fault::from_wire(WireError { code: 99, ..WireError::default() });
        assert_eq!(fault.code, Code::Unknown);
    }
}
