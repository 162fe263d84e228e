//! Endpoints of a session's router, and the machines that may use them.

use std::path::{Path, PathBuf};

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
