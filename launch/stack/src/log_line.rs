//! One line of a service's log, formatted for people.

use serde_json::{Map, Value};

/// A log line. JSON objects of `sg_runtime::telemetry` are split into parts.
#[derive(Debug, Clone, PartialEq)]
pub struct LogLine {
    /// ISO 8601 in UTC; empty if missing.
    pub timestamp: String,
    /// Severity.
    pub level: Level,
    /// The message.
    pub message: String,
    /// Further fields, in order.
    pub fields: Vec<(String, String)>,
}

/// Digits of a trace id on the terminal.
const TRACE_DIGITS: usize = 8;

/// Severity of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Finest.
    Trace,
    /// Fine.
    Debug,
    /// Informational.
    Info,
    /// A problem that does not stop the work.
    Warn,
    /// A failure.
    Error,
}

impl Level {
    /// Five letters or fewer, upper case.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Trace => "TRACE",
            Self::Debug => "DEBUG",
            Self::Info => "INFO",
            Self::Warn => "WARN",
            Self::Error => "ERROR",
        }
    }
}

impl LogLine {
    /// Parses a line. Any other text than a JSON object becomes a message of level `Info`.
    #[must_use]
    pub fn parse(line: &str) -> Self {
        let plain =
            || Self { timestamp: String::new(), level: Level::Info, message: printable(line), fields: Vec::new() };
        let Ok(Value::Object(mut object)) = serde_json::from_str(line) else { return plain() };
        let Some(level) = text(&mut object, "level").and_then(|l| level(&l)) else { return plain() };
        let timestamp = text(&mut object, "timestamp").map(|t| printable(&t)).unwrap_or_default();
        object.remove("target");
        let trace = object.remove("span").and_then(|span| span.get("trace_id")?.as_str().map(str::to_owned));
        Self {
            timestamp,
            level,
            message: text(&mut object, "message").map(|m| printable(&m)).unwrap_or_default(),
            fields: object
                .into_iter()
                .map(|(key, value)| match value {
                    Value::String(s) => (printable(&key), printable(&s)),
                    other => (printable(&key), printable(&other.to_string())),
                })
                // The last digits suffice on a terminal. The file has the full id.
                .chain(trace.filter(|t| !t.is_empty()).map(|t| {
                    let tail = t.len().saturating_sub(TRACE_DIGITS);
                    ("trace".to_owned(), printable(t.get(tail..).unwrap_or(&t)))
                }))
                .collect(),
        }
    }

    /// `HH:MM:SS`; empty if the timestamp is missing.
    #[must_use]
    pub fn time(&self) -> &str {
        // 2026-11-21T09:30:00.123456Z
        self.timestamp.get(11..19).unwrap_or_default()
    }

    /// Message and fields: `message k=v …`.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = self.message.clone();
        for (key, value) in &self.fields {
            if !text.is_empty() {
                text.push(' ');
            }
            let quote = if value.contains(' ') { "\"" } else { "" };
            text.push_str(&format!("{key}={quote}{value}{quote}"));
        }
        text
    }
}

fn text(object: &mut Map<String, Value>, key: &str) -> Option<String> {
    match object.remove(key)? {
        Value::String(s) => Some(s),
        other => Some(other.to_string()),
    }
}

fn level(name: &str) -> Option<Level> {
    [Level::Trace, Level::Debug, Level::Info, Level::Warn, Level::Error].into_iter().find(|l| l.name() == name)
}

/// [`sg_input::printable`], so that a service's log cannot control the terminal.
fn printable(text: &str) -> String {
    sg_input::printable(text).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structured_line_is_split() {
        let line = LogLine::parse(
            r#"{"timestamp":"2026-11-21T09:30:05.123456Z","level":"WARN","message":"slow","ms":12.5,"file":"a b","target":"x"}"#,
        );
        assert_eq!((line.time(), line.level), ("09:30:05", Level::Warn));
        assert_eq!(line.text(), "slow file=\"a b\" ms=12.5");
        let traced = LogLine::parse(
            r#"{"level":"INFO","message":"done","span":{"key":"cmd/apply","trace_id":"0197a000000000000000000012345678","name":"serve"}}"#,
        );
        assert_eq!(traced.text(), "done trace=12345678");
    }

    #[test]
    fn plain_text_cannot_control_the_terminal() {
        for (line, text) in [
            ("thread 'main' panicked", "thread 'main' panicked"),
            ("{\"level\":", "{\"level\":"),
            ("{\"a\":1}", "{\"a\":1}"),
            ("\u{1b}[2Jgone\r", "\\u001b[2Jgone\\r"),
            ("", ""),
        ] {
            let parsed = LogLine::parse(line);
            assert_eq!((parsed.text().as_str(), parsed.level, parsed.time()), (text, Level::Info, ""));
        }
    }
}
