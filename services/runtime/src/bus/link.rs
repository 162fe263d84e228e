//! Endpoints and certificates of a session's router, and the machines that may connect to it.

use std::path::{Path, PathBuf};

/// Endpoint of a unix socket: `unixsock-stream/PATH`.
#[must_use]
pub fn endpoint_of(socket: &Path) -> String {
    format!("unixsock-stream/{}", socket.display())
}

/// Prefix of an endpoint that other machines can reach.
pub const TLS_PREFIX: &str = "tls/";

/// Certificate files (PEM) of one side of a TLS connection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Certificates {
    /// Certificate of the authority that signed the certificates of both sides.
    pub authority: PathBuf,
    /// Own certificate.
    pub certificate: PathBuf,
    /// Own private key.
    pub key: PathBuf,
}

/// Endpoint of a session's router, with the certificates for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Link {
    /// `unixsock-stream/PATH` on the same machine, `tls/HOST:PORT` from another one.
    pub endpoint: String,
    /// Certificates for `tls/…`; absent for a unix socket.
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
    /// Whether the endpoint is that of another machine.
    #[must_use]
    pub fn is_remote(&self) -> bool {
        self.endpoint.starts_with(TLS_PREFIX)
    }
}

/// TLS listener of a router, and the machines that may connect.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TlsListener {
    /// `tls/ADDRESS:PORT`.
    pub endpoint: String,
    /// Certificates of the router.
    pub certificates: Certificates,
    /// Machines with rights. All others are denied everything.
    pub machines: Vec<RemoteMachine>,
}

/// Another machine. It has the rights of its roles in the contract's table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RemoteMachine {
    /// Common name of its certificate.
    pub name: String,
    /// Roles of the services that it runs for the session.
    pub roles: Vec<String>,
    /// Prefixes of its instance names, without the number.
    pub instances: Vec<String>,
}
