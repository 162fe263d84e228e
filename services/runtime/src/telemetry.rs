//! Structured logs.

use std::io;

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
        // zenoh warns about the missing name of every client socket.
        .with_env_filter(filter("info,zenoh=warn,zenoh_link_unixsock_stream=error"))
        // Such an error means that standard error is closed, so reporting it there would panic.
        .log_internal_errors(false)
        .with_writer(io::stderr);
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
        .with_writer(io::stderr);
    let _ = subscriber.try_init();
}

fn filter(default: &str) -> EnvFilter {
    EnvFilter::try_from_env(LOG).unwrap_or_else(|_| EnvFilter::new(default))
}
