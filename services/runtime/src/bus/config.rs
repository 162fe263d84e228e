//! How the bus itself is set up: one router, everybody else its client, nothing found by itself.

use std::path::Path;

/// The endpoint of a unix socket.
#[must_use]
pub fn endpoint_of(socket: &Path) -> String {
    format!("unixsock-stream/{}", socket.display())
}

pub(super) fn config(endpoint: &str, router: bool) -> Result<zenoh::Config, String> {
    let mut config = zenoh::Config::default();
    let endpoints = serde_json::json!([endpoint]).to_string();
    let none = "[]".to_owned();
    let (listen, connect) = if router { (endpoints, none) } else { (none, endpoints) };
    let (mode, tells) = if router { ("\"router\"", "true") } else { ("\"client\"", "false") };
    for (key, value) in [
        ("mode", mode),
        ("listen/endpoints", &listen),
        ("connect/endpoints", &connect),
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "false"),
        // The router tells who has declared what, so that the contract can be checked on the living bus; nobody may
        // change it that way.
        ("adminspace/enabled", tells),
        ("adminspace/permissions", "{ read: true, write: false }"),
        // A process that is stopped rather than dead is noticed by its lease.
        ("transport/link/tx/lease", "2000"),
        ("transport/link/rx/max_message_size", "8388608"),
        // A stack has a dozen processes; who opens connections without end is cut off.
        ("transport/unicast/max_sessions", "128"),
        // Microseconds that a request may wait for room towards a reader that takes nothing, before that reader is cut off:
        // it would hold up whoever else the router serves.
        ("transport/link/tx/queue/congestion_control/block/wait_before_close", "1000000"),
    ] {
        config.insert_json5(key, value).map_err(|e| format!("setting {key}: {e}"))?;
    }
    Ok(config)
}
