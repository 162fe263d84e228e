//! Structured logs.

use std::io;

use tracing_subscriber::EnvFilter;

/// Environment variable with the log filter, such as `debug` or `sg_scene=trace`.
pub const LOG: &str = "SUPERGAUSSIAN_LOG";

/// Logs of a service: one JSON object a line on standard error, where its supervisor collects them.
pub fn init_service(role: &str) {
    let subscriber = tracing_subscriber::fmt()
        .json()
        .flatten_event(true)
        .with_current_span(true)
        .with_span_list(false)
        // The bus warns of every client's end of a unix socket, which has no name and needs none.
        .with_env_filter(filter("info,zenoh=warn,zenoh_link_unixsock_stream=error"))
        // It would be said on the very stream that nobody reads any more, by a panic.
        .log_internal_errors(false)
        .with_writer(io::stderr);
    // A second call, as in tests that host several roles in one process, keeps the first subscriber.
    if subscriber.try_init().is_ok() {
        tracing::debug!(role, "logging started");
    }
}

/// Logs of a command for people: plain text on standard error, warnings only unless the filter says more.
pub fn init_command() {
    let subscriber = tracing_subscriber::fmt()
        .without_time()
        .with_target(false)
        .with_env_filter(filter("warn,zenoh=error"))
        // It would be said on the very stream that nobody reads any more, by a panic.
        .log_internal_errors(false)
        .with_writer(io::stderr);
    let _ = subscriber.try_init();
}

fn filter(default: &str) -> EnvFilter {
    EnvFilter::try_from_env(LOG).unwrap_or_else(|_| EnvFilter::new(default))
}
