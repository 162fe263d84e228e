//! Configuration of zenoh: one router, all other processes are its clients, no discovery.
//!
//! Other machines connect only where a launch file allows it, by TLS with certificates on both sides. They have a router of
//! their own. Its access rules can change while the session runs: it is closed and opened again.

use std::path::Path;

use serde_json::json;

use super::access;
use super::link::{Certificates, Link, TLS_PREFIX, TlsListener, endpoint_of};

/// Longest time for a router of this machine to accept a connection, milliseconds. If it ends, the attempt fails at once.
const OPEN_MS: u64 = 24 * 3_600_000;

/// Configuration entries of zenoh: path and value.
type Entries = Vec<(&'static str, serde_json::Value)>;

pub(super) fn client(link: &Link) -> Result<zenoh::Config, String> {
    let mut entries = common();
    entries.extend([
        ("mode", json!("client")),
        ("listen/endpoints", json!([])),
        ("connect/endpoints", json!([link.endpoint])),
        ("adminspace/enabled", json!(false)),
        // Reconnect soon: callers have deadlines of seconds.
        ("connect/retry", json!({ "period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2 })),
    ]);
    if !link.is_remote() {
        // A router of this machine that does not answer stands still. An attempt that is given up just as the router goes on
        // leaves half a connection behind, and the router refuses every further one.
        entries.push(("transport/unicast/open_timeout", json!(OPEN_MS)));
    }
    if let Some(certificates) = &link.certificates {
        entries.extend([
            ("transport/link/tls/connect_certificate", json!(certificates.certificate)),
            ("transport/link/tls/connect_private_key", json!(certificates.key)),
        ]);
        entries.extend(mutual_tls(certificates));
    } else if link.is_remote() {
        return Err("a router on another machine needs certificates".to_owned());
    }
    build(entries)
}

/// The router of a session: processes of this machine connect to it.
pub(super) fn router(socket: &Path) -> Result<zenoh::Config, String> {
    let mut entries = common();
    entries.extend([
        ("mode", json!("router")),
        ("listen/endpoints", json!([endpoint_of(socket)])),
        ("connect/endpoints", json!([])),
        // Readable, so that `contract check` can list the declared keys of a running session; not writable.
        ("adminspace/enabled", json!(true)),
        ("adminspace/permissions", json!({ "read": true, "write": false })),
    ]);
    build(entries)
}

/// The router of other machines, beside that of the session: nodes connect to it, and it connects to the other one.
pub(super) fn node_router(session: &str, socket: &Path, listener: &TlsListener) -> Result<zenoh::Config, String> {
    if !listener.endpoint.starts_with(TLS_PREFIX) {
        return Err(format!("{}: use `tls/ADDRESS:PORT` to listen for other machines", listener.endpoint));
    }
    let mut entries = common();
    entries.extend([
        ("mode", json!("router")),
        ("listen/endpoints", json!([listener.endpoint])),
        ("connect/endpoints", json!([endpoint_of(socket)])),
        ("connect/timeout_ms", json!(2000)),
        ("connect/exit_on_failure", json!(true)),
        ("adminspace/enabled", json!(false)),
        ("transport/link/tls/listen_certificate", json!(listener.certificates.certificate)),
        ("transport/link/tls/listen_private_key", json!(listener.certificates.key)),
        ("access_control", access::rules(session, &listener.machines)),
    ]);
    entries.extend(mutual_tls(&listener.certificates));
    build(entries)
}

fn mutual_tls(certificates: &Certificates) -> Entries {
    vec![
        ("transport/link/tls/root_ca_certificate", json!(certificates.authority)),
        ("transport/link/tls/enable_mtls", json!(true)),
        ("transport/link/tls/verify_name_on_connect", json!(true)),
        ("transport/link/tls/close_link_on_expiration", json!(true)),
    ]
}

fn common() -> Entries {
    vec![
        ("scouting/multicast/enabled", json!(false)),
        ("scouting/gossip/enabled", json!(false)),
        // Milliseconds after which a stopped (not dead) process counts as disconnected.
        ("transport/link/tx/lease", json!(2000)),
        ("transport/link/rx/max_message_size", json!(8_388_608)),
        // A session has about a dozen processes. The limit stops a process that opens connections without end.
        ("transport/unicast/max_sessions", json!(128)),
        // Microseconds that a request waits for a blocked reader before that reader is disconnected. Without this limit a
        // blocked reader delays all others.
        ("transport/link/tx/queue/congestion_control/block/wait_before_close", json!(1_000_000)),
    ]
}

fn build(entries: Entries) -> Result<zenoh::Config, String> {
    let mut config = zenoh::Config::default();
    for (key, value) in entries {
        config.insert_json5(key, &value.to_string()).map_err(|e| format!("setting {key}: {e}"))?;
    }
    Ok(config)
}
