//! The contents of a launch file as typed data.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::Duration;

use crate::document::Place;
use crate::suggestion::suggestion;

/// A launch file without mistakes, ready to start.
#[derive(Debug, Clone, PartialEq)]
pub struct LaunchFile {
    /// Name of the session, if the file gives one.
    pub name: Option<String>,
    /// Services in start order: each follows its dependencies, otherwise in the order of the file.
    pub services: Vec<Service>,
    /// Where other machines connect, if the file says so.
    pub listen: Option<ListenSettings>,
    /// Machines that may join.
    pub nodes: Vec<Node>,
}

/// Where other machines connect, and the certificates of this side (PEM, absolute paths).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ListenSettings {
    /// `tls/ADDRESS:PORT`.
    pub endpoint: String,
    /// Certificate of the authority that signed the certificates of both sides.
    pub authority: PathBuf,
    /// Certificate of this machine.
    pub certificate: PathBuf,
    /// Private key of this machine.
    pub key: PathBuf,
    /// Machines whose certificates are refused.
    pub revoked: BTreeSet<String>,
}

/// A machine that may join.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Node {
    /// Name, equal to the common name of its certificate.
    pub name: String,
    /// Silence in either direction after which its processes count as ended.
    pub lease: Duration,
}

/// One service of a launch file.
#[derive(Debug, Clone, PartialEq)]
pub struct Service {
    /// Name in the file.
    pub name: String,
    /// Role it serves.
    pub role: String,
    /// Executable, parameters and environment of its process.
    pub start: Start,
    /// Names of the services that must be ready before this one starts.
    pub after: Vec<String>,
    /// How it is supervised.
    pub policy: Policy,
    /// Place of its table.
    pub place: Place,
}

/// Executable, parameters and environment of a service's process. A change here swaps a running service. All other
/// changes take effect in place.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Start {
    /// Executable, as written.
    pub exec: String,
    /// Executable, as an absolute path.
    pub executable: PathBuf,
    /// The service's own parameters.
    pub params: serde_json::Map<String, serde_json::Value>,
    /// Environment variables beside those of the launcher.
    pub env: Vec<(String, String)>,
    /// Node that runs it; `None` for the launcher's machine. A node looks the executable up by name.
    pub node: Option<String>,
    /// How the kernel confines it.
    pub confinement: Confinement,
}

/// How the kernel confines a service, beyond what its role and its parameters tell (`service_rights.rs`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Confinement {
    /// Whether it is confined.
    pub confined: bool,
    /// Further files and folders that it may read and run programs of; absolute.
    pub read: Vec<PathBuf>,
    /// Further files and folders that it may read and change; absolute.
    pub write: Vec<PathBuf>,
}

impl Default for Confinement {
    fn default() -> Self {
        Self { confined: true, read: Vec::new(), write: Vec::new() }
    }
}

/// When an ended process is started again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Restart {
    /// After every end.
    Always,
    /// After an exit status other than 0, a missed readiness deadline, or a hang.
    OnFailure,
    /// Never.
    Never,
}

/// How one service is supervised.
#[derive(Debug, Clone, PartialEq)]
pub struct Policy {
    /// When it is started again.
    pub restart: Restart,
    /// Pause before the first restart. Each further restart doubles it.
    pub backoff_initial: Duration,
    /// Longest pause. After this time of readiness the pause starts over.
    pub backoff_max: Duration,
    /// Tolerated restarts …
    pub restarts: u32,
    /// … within this time.
    pub within: Duration,
    /// Longest time from start to readiness, or from the last progress that the loading service has reported.
    pub ready: Duration,
    /// Longest silence of a ready service.
    pub liveness: Duration,
    /// Longest time without progress in the work of a ready service.
    pub progress: Duration,
    /// Time between SIGTERM and SIGKILL.
    pub stop: Duration,
    /// Whether the stack stops when this service ends for good.
    pub critical: bool,
    /// Resident memory in bytes that triggers a restart, counted as a failure. The health messages report it every
    /// second.
    pub memory_bytes: Option<u64>,
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            restart: Restart::OnFailure,
            backoff_initial: Duration::from_millis(100),
            backoff_max: Duration::from_secs(5),
            restarts: 5,
            within: Duration::from_secs(30),
            ready: Duration::from_secs(60),
            liveness: Duration::from_secs(5),
            progress: Duration::from_secs(300),
            stop: Duration::from_secs(5),
            critical: false,
            memory_bytes: None,
        }
    }
}

/// A name that no service of the launch file has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("--only {name}: no such service{hint}")]
pub struct UnknownService {
    /// The name.
    pub name: String,
    /// A suggestion, as [`suggestion`] writes it; may be empty.
    pub hint: String,
}

impl LaunchFile {
    /// Services that run on a node, in start order.
    pub fn roles_on<'a>(&'a self, node: &'a str) -> impl Iterator<Item = &'a Service> {
        self.services.iter().filter(move |s| s.start.node.as_deref() == Some(node))
    }

    /// Keeps only the named services. Conditions on other services are dropped.
    ///
    /// # Errors
    /// [`UnknownService`] for the first name that no service has.
    pub fn only(mut self, names: &[String]) -> Result<Self, UnknownService> {
        for name in names {
            if !self.services.iter().any(|s| s.name == *name) {
                let hint = suggestion(name, self.services.iter().map(|s| s.name.as_str()));
                return Err(UnknownService { name: name.clone(), hint });
            }
        }
        self.services.retain(|s| names.contains(&s.name));
        for service in &mut self.services {
            service.after.retain(|a| names.contains(a));
        }
        Ok(self)
    }
}
