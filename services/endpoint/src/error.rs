//! Errors of clients and requests.

use std::error::Error;
use std::time::Duration;

/// Longest text of an error of a server, bytes.
const MAX_TEXT_BYTES: usize = 300;

/// A client could not be created.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ClientError {
    /// The endpoint cannot be used by the client.
    #[error("`endpoint`: {endpoint}: {reason}")]
    Unusable {
        /// The endpoint.
        endpoint: String,
        /// The reason.
        reason: String,
    },
    /// The gRPC client does not encrypt.
    #[error(
        "`endpoint`: the backend `grpc` does not support TLS; use http://127.0.0.1:PORT or unix:/PATH with a local tunnel"
    )]
    Encrypted,
    /// The HTTP client does not connect to sockets.
    #[error("`endpoint`: the backend `openai` needs an HTTP address: http://127.0.0.1:PORT/v1 or https://HOST/v1")]
    Socket,
    /// The HTTP client could not be created.
    #[error("the HTTP client could not be created: {0}")]
    Http(String),
}

/// A request failed. The texts are one line without the API key.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CallError {
    /// The server cannot be reached or is overloaded. A repeated request may succeed.
    #[error("unavailable: {0}")]
    Unavailable(String),
    /// The server refused the request: a wrong key, an unknown model, an unknown parameter.
    #[error("refused: {0}")]
    Refused(String),
    /// The server did not answer in time.
    #[error("no answer within {} ms", .0.as_millis())]
    Timeout(Duration),
    /// The answer is too large, or is no message of the protocol.
    #[error("invalid answer: {0}")]
    Invalid(String),
}

/// An error and its causes on one line.
pub(crate) fn error_chain(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        let cause_text = cause.to_string();
        if !text.contains(&cause_text) {
            text = format!("{text}: {cause_text}");
        }
        source = cause.source();
    }
    one_line(&text)
}

/// A text of a server as part of a message: one line of a bounded length.
pub(crate) fn one_line(text: &str) -> String {
    let plain: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let plain = plain.trim();
    let end = (0..=MAX_TEXT_BYTES.min(plain.len())).rev().find(|at| plain.is_char_boundary(*at));
    plain[..end.unwrap_or(0)].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_servers_are_one_short_line() {
        assert_eq!(one_line(" no such\nmodel "), "no such model");
        assert_eq!(one_line(&"ö".repeat(200)).len(), 300);
        assert_eq!(one_line(&format!("x{}", "ö".repeat(200))).len(), 299);
    }
}
