//! How the bus itself is set up: one router, everybody else its client, nothing found by itself, nothing open to other
//! machines unless a launch file says so, and then by TLS with certificates of both sides.

use std::path::Path;

use serde_json::json;

use super::access;
use super::link::{Certificates, Link, Listen, TLS_PREFIX, endpoint_of};

/// How zenoh is configured, entry by entry.
type Entries = Vec<(&'static str, serde_json::Value)>;

pub(super) fn client(link: &Link) -> Result<zenoh::Config, String> {
    let mut entries = common();
    entries.extend([
        ("mode", json!("client")),
        ("listen/endpoints", json!([])),
        ("connect/endpoints", json!([link.endpoint])),
        ("adminspace/enabled", json!(false)),
        // A link that was cut is tried again soon: what waits for it has deadlines of seconds.
        ("connect/retry", json!({ "period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2 })),
    ]);
    if let Some(certificates) = &link.certificates {
        entries.extend([
            ("transport/link/tls/connect_certificate", json!(certificates.certificate)),
            ("transport/link/tls/connect_private_key", json!(certificates.key)),
        ]);
        entries.extend(both_sides(certificates));
    } else if link.is_remote() {
        return Err("another machine's bus is joined with certificates only".to_owned());
    }
    built(entries)
}

pub(super) fn router(session: &str, socket: &Path, listen: Option<&Listen>) -> Result<zenoh::Config, String> {
    let mut endpoints = vec![endpoint_of(socket)];
    endpoints.extend(listen.map(|l| l.endpoint.clone()));
    let mut entries = common();
    entries.extend([
        ("mode", json!("router")),
        ("listen/endpoints", json!(endpoints)),
        ("connect/endpoints", json!([])),
        // The router tells who has declared what, so that the contract can be checked on the living bus; nobody may
        // change it that way.
        ("adminspace/enabled", json!(true)),
        ("adminspace/permissions", json!({ "read": true, "write": false })),
    ]);
    if let Some(listen) = listen {
        if !listen.endpoint.starts_with(TLS_PREFIX) {
            return Err(format!("{}: other machines are listened to by `tls/ADDRESS:PORT` only", listen.endpoint));
        }
        entries.extend([
            ("transport/link/tls/listen_certificate", json!(listen.certificates.certificate)),
            ("transport/link/tls/listen_private_key", json!(listen.certificates.key)),
            ("access_control", access::rules(session, &listen.guests)),
        ]);
        entries.extend(both_sides(&listen.certificates));
    }
    built(entries)
}

fn both_sides(certificates: &Certificates) -> Entries {
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
        // A process that is stopped rather than dead is noticed by its lease.
        ("transport/link/tx/lease", json!(2000)),
        ("transport/link/rx/max_message_size", json!(8_388_608)),
        // A stack has a dozen processes; who opens connections without end is cut off.
        ("transport/unicast/max_sessions", json!(128)),
        // Microseconds that a request may wait for room towards a reader that takes nothing, before that reader is cut off:
        // it would hold up whoever else the router serves.
        ("transport/link/tx/queue/congestion_control/block/wait_before_close", json!(1_000_000)),
    ]
}

fn built(entries: Entries) -> Result<zenoh::Config, String> {
    let mut config = zenoh::Config::default();
    for (key, value) in entries {
        config.insert_json5(key, &value.to_string()).map_err(|e| format!("setting {key}: {e}"))?;
    }
    Ok(config)
}
