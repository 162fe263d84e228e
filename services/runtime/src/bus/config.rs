//! How the bus itself is set up: one router, everybody else its client, nothing found by itself, nothing open to other
//! machines unless a launch file says so, and then by TLS with certificates of both sides.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::access;

/// The endpoint of a unix socket.
#[must_use]
pub fn endpoint_of(socket: &Path) -> String {
    format!("unixsock-stream/{}", socket.display())
}

/// What an endpoint of other machines begins with.
pub const TLS_PREFIX: &str = "tls/";

/// The files by which one side of a TLS connection proves who it is and knows the other, PEM.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Certificates {
    /// Certificate of the authority that has signed those of both sides.
    pub authority: PathBuf,
    /// Own certificate.
    pub certificate: PathBuf,
    /// Own private key.
    pub key: PathBuf,
}

/// The way to a session's router.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Link {
    /// `unixsock-stream/PATH` on the same machine, `tls/HOST:PORT` from another.
    pub endpoint: String,
    /// For `tls/…`.
    pub certificates: Option<Certificates>,
}

impl From<&str> for Link {
    fn from(endpoint: &str) -> Self {
        Self { endpoint: endpoint.to_owned(), certificates: None }
    }
}

impl From<&String> for Link {
    fn from(endpoint: &String) -> Self {
        endpoint.as_str().into()
    }
}

impl Link {
    /// Whether the router is on another machine, as far as the endpoint tells.
    #[must_use]
    pub fn is_remote(&self) -> bool {
        self.endpoint.starts_with(TLS_PREFIX)
    }
}

/// Where a router listens for other machines, and what each of them may do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listen {
    /// `tls/ADDRESS:PORT`.
    pub endpoint: String,
    /// Its own.
    pub certificates: Certificates,
    /// Who may come in; nobody else does anything.
    pub guests: Vec<Guest>,
}

/// Another machine and what it may do: what the contract's table allows the roles that it runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Guest {
    /// Common name of its certificate.
    pub name: String,
    /// Roles that it runs for the session.
    pub roles: Vec<String>,
    /// Beginnings of the names of its instances, up to the number.
    pub instances: Vec<String>,
}

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
