//! One line of a service's log, for people.

use serde_json::{Map, Value};

/// A line as a service wrote it, taken apart where it is a JSON object as `sg_runtime::telemetry` writes it.
#[derive(Debug, Clone, PartialEq)]
pub struct LogLine {
    /// ISO 8601, UTC; empty if the line does not say.
    pub timestamp: String,
    /// How grave it is.
    pub level: Level,
    /// What happened.
    pub message: String,
    /// Further facts in the order in which they were written.
    pub fields: Vec<(String, String)>,
}

/// Digits of a trace's id that people are shown.
const TRACE_DIGITS: usize = 8;

/// How grave a line is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Finest.
    Trace,
    /// Fine.
    Debug,
    /// Of interest.
    Info,
    /// Something is not as it should be.
    Warn,
    /// Something failed.
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
    /// Takes a line apart. What is no JSON object is a message of level `Info`.
    #[must_use]
    pub fn parse(line: &str) -> Self {
        let plain =
            || Self { timestamp: String::new(), level: Level::Info, message: printable(line), fields: Vec::new() };
        let Ok(Value::Object(mut object)) = serde_json::from_str(line) else { return plain() };
        let Some(level) = text(&mut object, "level").and_then(|l| level(&l)) else { return plain() };
        let timestamp = text(&mut object, "timestamp").unwrap_or_default();
        object.remove("target");
        let trace = object.remove("span").and_then(|span| span.get("trace_id")?.as_str().map(str::to_owned));
        Self {
            timestamp,
            level,
            message: text(&mut object, "message").map(|m| printable(&m)).unwrap_or_default(),
            fields: object
                .into_iter()
                .map(|(key, value)| match value {
                    Value::String(s) => (key, printable(&s)),
                    other => (key, other.to_string()),
                })
                // The last digits tell traces apart; the file has them all.
                .chain(trace.filter(|t| !t.is_empty()).map(|t| {
                    let tail = t.len().saturating_sub(TRACE_DIGITS);
                    ("trace".to_owned(), printable(t.get(tail..).unwrap_or(&t)))
                }))
                .collect(),
        }
    }

    /// `HH:MM:SS`; empty if the line does not say.
    #[must_use]
    pub fn time(&self) -> &str {
        // 2026-11-21T09:30:00.123456Z
        self.timestamp.get(11..19).unwrap_or_default()
    }

    /// Message and facts, `message k=v …`.
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

/// The text without control characters: a service's log must not steer the terminal.
fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() && c != '\t' { '·' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_structured_line_is_taken_apart() {
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
    fn anything_else_is_a_message_that_cannot_steer_the_terminal() {
        for (line, text) in [
            ("thread 'main' panicked", "thread 'main' panicked"),
            ("{\"level\":", "{\"level\":"),
            ("{\"a\":1}", "{\"a\":1}"),
            ("\u{1b}[2Jgone\r", "·[2Jgone·"),
            ("", ""),
        ] {
            let parsed = LogLine::parse(line);
            assert_eq!((parsed.text().as_str(), parsed.level, parsed.time()), (text, Level::Info, ""));
        }
    }
}
