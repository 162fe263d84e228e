//! The contents of a launch file as typed data.

use std::path::PathBuf;
use std::time::Duration;

use crate::document::Place;
use crate::suggestion::suggestion;

/// A launch file that was read, checked and can be started.
#[derive(Debug, Clone, PartialEq)]
pub struct LaunchFile {
    /// Name of the session, where the file gives one.
    pub name: Option<String>,
    /// Services; each stands after those it comes after, otherwise in the order of the file.
    pub services: Vec<Service>,
    /// Where other machines are listened to, where the file says so.
    pub listen: Option<ListenSettings>,
    /// Machines that may join.
    pub nodes: Vec<Node>,
}

/// Where other machines are listened to, and the files by which both sides know each other (PEM, absolute paths).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ListenSettings {
    /// `tls/ADDRESS:PORT`.
    pub endpoint: String,
    /// Certificate of the authority that has signed those of both sides.
    pub authority: PathBuf,
    /// Certificate of this machine.
    pub certificate: PathBuf,
    /// Private key of this machine.
    pub key: PathBuf,
}

/// A machine that may join.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Node {
    /// Name: the common name of its certificate.
    pub name: String,
    /// Silence in either direction after which whatever it runs is over.
    pub lease: Duration,
}

/// One service of a launch file.
#[derive(Debug, Clone, PartialEq)]
pub struct Service {
    /// Name within the file.
    pub name: String,
    /// Role it serves.
    pub role: String,
    /// What its process is started with.
    pub start: Start,
    /// Names of the services that must be ready before this one starts.
    pub after: Vec<String>,
    /// How it is watched.
    pub policy: Policy,
    /// Where it was written.
    pub place: Place,
}

/// What a service's process is started with. A running service whose start changes is swapped; everything else about it
/// changes in place.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Start {
    /// Executable as it was written.
    pub exec: String,
    /// Executable as it was found, absolute.
    pub executable: PathBuf,
    /// The service's own parameters.
    pub params: serde_json::Map<String, serde_json::Value>,
    /// Environment variables beside those of the launcher.
    pub env: Vec<(String, String)>,
    /// Machine that it runs on, where it is not the launcher's own; then the executable is a name that is looked up there.
    pub node: Option<String>,
}

/// When a process that ended is started again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Restart {
    /// However it ended.
    Always,
    /// When it ended with another status than 0, never got ready or hung.
    OnFailure,
    /// Not at all.
    Never,
}

/// How one service is watched.
#[derive(Debug, Clone, PartialEq)]
pub struct Policy {
    /// When it is started again.
    pub restart: Restart,
    /// Pause before the first restart; doubled with each further one.
    pub backoff_initial: Duration,
    /// Longest pause, and how long a service must have been ready for the pause to start over.
    pub backoff_max: Duration,
    /// Restarts that are tolerated …
    pub restarts: u32,
    /// … within this time.
    pub within: Duration,
    /// Longest time from start to readiness.
    pub ready: Duration,
    /// Longest silence of a ready service.
    pub liveness: Duration,
    /// Time between the request to stop and the kill.
    pub stop: Duration,
    /// Whether the stack stops when it has ended for good, failed or done.
    pub critical: bool,
    /// Resident memory in bytes above which it is stopped and started again, as after a failure; judged by what its
    /// health says, every second.
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
    /// Roles that a node runs, in the order of the services.
    pub fn roles_on<'a>(&'a self, node: &'a str) -> impl Iterator<Item = &'a Service> {
        self.services.iter().filter(move |s| s.start.node.as_deref() == Some(node))
    }

    /// Keeps only the named services; conditions on the others are taken as met.
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
