//! Structured logs.

use std::io::{self, Write};

use sg_input::printable_lines;
use tracing_subscriber::EnvFilter;

/// Environment variable with the log filter, such as `debug` or `sg_scene=trace`.
pub const LOG: &str = "SUPERGAUSSIAN_LOG";

/// Starts the logs of a service: one JSON object per line on standard error. The supervisor collects them.
pub fn init_service(role: &str) {
    let subscriber = tracing_subscriber::fmt()
        .json()
        .flatten_event(true)
        .with_current_span(true)
        .with_span_list(false)
        // zenoh warns about the missing name of every client socket. wgpu lists what a card can do.
        .with_env_filter(filter("info,wgpu_core=warn,wgpu_hal=warn,zenoh=warn,zenoh_link_unixsock_stream=error"))
        // Such an error means that standard error is closed, so reporting it there would panic.
        .log_internal_errors(false)
        .with_writer(|| PrintableWriter(io::stderr()));
    // A second call keeps the first subscriber. Tests host several roles in one process.
    if subscriber.try_init().is_ok() {
        tracing::debug!(role, "logging started");
    }
}

/// Starts the logs of a command: plain text on standard error, warnings and errors unless [`LOG`] is set.
pub fn init_command() {
    let subscriber = tracing_subscriber::fmt()
        .without_time()
        .with_target(false)
        .with_env_filter(filter("warn,zenoh=error"))
        // Such an error means that standard error is closed, so reporting it there would panic.
        .log_internal_errors(false)
        .with_writer(|| PrintableWriter(io::stderr()))
        .with_ansi(false);
    let _ = subscriber.try_init();
}

fn filter(default: &str) -> EnvFilter {
    EnvFilter::try_from_env(LOG).unwrap_or_else(|_| EnvFilter::new(default))
}

/// Escapes what could act on a terminal: names from files and messages are part of the lines. Each line comes as one write.
struct PrintableWriter<W>(W);

impl<W: Write> Write for PrintableWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(bytes);
        self.0.write_all(printable_lines(&text).as_bytes())?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_line_stays_json_of_the_same_value() {
        let value = serde_json::json!({"message": "unit \u{1b}[2J\u{9b}\u{202e}x"});
        let mut out = Vec::new();
        writeln!(PrintableWriter(&mut out), "{value}").unwrap();
        let line = String::from_utf8(out).unwrap();
        assert!(line.is_ascii(), "{line}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&line).unwrap(), value);
    }
}
