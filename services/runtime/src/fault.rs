//! Typed errors of requests, sent in place of a reply.

use std::time::Duration;

use sg_proto::bus::{Code, Error as WireError};

/// Error of a request: a code, one line for a person, a retry hint.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Fault {
    /// One of gRPC's canonical codes.
    pub code: Code,
    /// One line: the problem, its place, and a remedy.
    pub message: String,
    /// Recommended pause before a retry; absent if a retry is useless.
    pub retry_after: Option<Duration>,
    /// Further facts, such as the valid names.
    pub details: Vec<String>,
}

impl Fault {
    /// Makes a fault from a code and one line.
    #[must_use]
    pub fn new(code: Code, message: impl Into<String>) -> Self {
        Self { code, message: message.into(), retry_after: None, details: Vec::new() }
    }

    /// `InvalidArgument`: the request is wrong in any state of the scene.
    #[must_use]
    pub fn invalid(message: impl Into<String>) -> Self {
        Self::new(Code::InvalidArgument, message)
    }

    /// `NotFound`: something named in the request does not exist.
    #[must_use]
    pub fn not_found(message: impl Into<String>) -> Self {
        Self::new(Code::NotFound, message)
    }

    /// `FailedPrecondition`: the request does not fit the current state.
    #[must_use]
    pub fn precondition(message: impl Into<String>) -> Self {
        Self::new(Code::FailedPrecondition, message)
    }

    /// `Internal`: an error of the service itself.
    #[must_use]
    pub fn internal(message: impl Into<String>) -> Self {
        Self::new(Code::Internal, message)
    }

    /// `DeadlineExceeded`: the answer is late.
    #[must_use]
    pub fn deadline(message: impl Into<String>) -> Self {
        Self::new(Code::DeadlineExceeded, message)
    }

    /// `ResourceExhausted`: a queue, quota or disk is full.
    #[must_use]
    pub fn exhausted(message: impl Into<String>) -> Self {
        Self::new(Code::ResourceExhausted, message)
    }

    /// `Unavailable`: no process serves the role at the moment. Suggests a retry after 50 ms.
    #[must_use]
    pub fn unavailable(message: impl Into<String>) -> Self {
        Self { retry_after: Some(Duration::from_millis(50)), ..Self::new(Code::Unavailable, message) }
    }

    /// Adds further facts.
    #[must_use]
    pub fn with_details(mut self, details: impl IntoIterator<Item = String>) -> Self {
        self.details.extend(details);
        self
    }

    /// Converts to the message on the wire.
    #[must_use]
    pub fn to_wire(&self) -> WireError {
        WireError {
            code: self.code.into(),
            message: self.message.clone(),
            retry_after_ms: self.retry_after.map_or(0, |d| u32::try_from(d.as_millis()).unwrap_or(u32::MAX)),
            details: self.details.clone(),
        }
    }

    /// Converts from the message on the wire. An unknown code becomes `Unknown`.
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
    fn a_fault_survives_encoding() {
        let fault = Fault::unavailable("the scene is away").with_details(["scene".to_owned()]);
        assert_eq!(Fault::from_wire(fault.to_wire()), fault);
    }

    #[test]
    fn an_unknown_code_becomes_unknown() {
        let fault = Fault::from_wire(WireError { code: 99, ..WireError::default() });
        assert_eq!(fault.code, Code::Unknown);
    }
}
