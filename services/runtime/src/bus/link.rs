//! Endpoints and certificates of a session's router, and the machines that may connect to it.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use sg_input::file;
use sg_input::limits::SMALL_TEXT_BYTES;
use sg_proto::keys::Identity;

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

/// A certificate that does not name its machine.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {reason}; make it with `supergaussian certificates`")]
pub struct CertificateError {
    /// The certificate.
    pub path: PathBuf,
    /// Reason.
    pub reason: String,
}

/// What this project reads from a certificate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CertificateContent {
    /// Common name of its owner, if it has one.
    pub common_name: Option<String>,
    /// End of its validity.
    pub expires: SystemTime,
}

impl CertificateContent {
    /// Reads a certificate in PEM form.
    ///
    /// # Errors
    /// One line for text that is no certificate.
    pub fn of_pem(pem: &[u8]) -> Result<Self, String> {
        let (_, pem) = x509_parser::pem::parse_x509_pem(pem).map_err(|e| format!("no certificate: {e}"))?;
        let certificate = pem.parse_x509().map_err(|e| format!("no certificate: {e}"))?;
        let name = certificate.subject().iter_common_name().next().and_then(|n| n.as_str().ok());
        let seconds = u64::try_from(certificate.validity().not_after.timestamp()).unwrap_or_default();
        let expires = SystemTime::UNIX_EPOCH + Duration::from_secs(seconds);
        Ok(Self { common_name: name.map(str::to_owned), expires })
    }
}

impl Certificates {
    /// Name of the machine in its own certificate: the common name.
    ///
    /// # Errors
    /// [`CertificateError`] for a file that cannot be read, is no certificate or has no common name.
    pub fn machine(&self) -> Result<String, CertificateError> {
        let fail = |reason: String| CertificateError { path: self.certificate.clone(), reason };
        let pem = file::read(&self.certificate, SMALL_TEXT_BYTES).map_err(|e| fail(e.to_string()))?;
        let content = CertificateContent::of_pem(&pem).map_err(fail)?;
        content.common_name.ok_or_else(|| fail("it has no common name".to_owned()))
    }
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

    /// Identity of a process that connects by this link; `None` on the supervisor's machine.
    pub(super) fn identity(&self, role: &str, instance: Option<&str>) -> Result<Option<Identity>, String> {
        if !self.is_remote() {
            return Ok(None);
        }
        let certificates = self.certificates.as_ref().ok_or("a router on another machine needs certificates")?;
        let instance = instance.ok_or("a process on another machine needs an instance")?;
        let node = certificates.machine().map_err(|e| e.to_string())?;
        Ok(Some(Identity { node, role: role.to_owned(), instance: instance.to_owned() }))
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

/// Another machine. It has the rights of its roles in the contract's table, and sends under its own name only.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RemoteMachine {
    /// Common name of its certificate.
    pub name: String,
    /// Services that it runs for the session.
    pub services: Vec<RemoteService>,
}

/// A service on another machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RemoteService {
    /// Name; its instances are named after it ([`sg_proto::keys::instance_prefix`]).
    pub name: String,
    /// Role.
    pub role: String,
}
