//! The launch-file language.
//!
//! ```toml
//! schema = 1
//! name = "demo"                       # session; by default the file's name
//!
//! [defaults]                          # any key of a service that says how it is watched
//! stop = 3
//!
//! [service.scene]
//! exec = "supergaussian-scene"        # beside the launcher, else on PATH; with a slash: from the file's folder
//! role = "scene"                      # by default the service's name
//! params = { scene = "skull.ply" }    # the service's own parameters
//! after = { other = "ready" }         # start order
//! restart = "always"                  # always | on-failure | never
//! backoff = { initial_ms = 100, max_ms = 5000 }
//! intensity = { restarts = 5, within_s = 30 }
//! ready = 60                          # seconds from start to readiness
//! liveness = 5                        # seconds of silence after which a ready service counts as hung
//! stop = 5                            # seconds between the request to stop and the kill
//! critical = true                     # when it ends for good, failed or done, the stack stops
//! memory_mib = 4096                   # resident memory above which it is restarted, as after a failure; by default none
//! env = { SUPERGAUSSIAN_LOG = "debug" }
//! on = "gpu1"                         # the machine it runs on; by default the launcher's own
//!
//! [bus]                               # other machines: only where this table is, and only with certificates of both sides
//! listen = "tls/0.0.0.0:7447"
//! authority = "tls/authority.pem"     # from the file's folder; `supergaussian certificates` makes them
//! certificate = "tls/home.pem"
//! key = "tls/home-key.pem"
//!
//! [node.gpu1]                         # a machine that may join, known by its certificate: `supergaussian join`
//! lease = 5                           # seconds without word from it, or to it, after which what it runs is over
//! ```

mod executables;
mod machines;
mod order;
mod read;

use std::path::PathBuf;
use std::time::Duration;

pub use executables::Search;
pub use read::{Source, read};

use crate::document::Place;

/// A launch file that was read, checked and can be started.
#[derive(Debug, Clone, PartialEq)]
pub struct LaunchFile {
    /// Name of the session, where the file gives one.
    pub name: Option<String>,
    /// Services; each stands after those it comes after, otherwise in the order of the file.
    pub services: Vec<Service>,
    /// Where other machines are listened to, where the file says so.
    pub listen: Option<Listening>,
    /// Machines that may join.
    pub nodes: Vec<Node>,
}

/// Where other machines are listened to, and the files by which both sides know each other (PEM, absolute paths).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listening {
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

impl LaunchFile {
    /// Roles that a node runs, in the order of the services.
    pub fn roles_on<'a>(&'a self, node: &'a str) -> impl Iterator<Item = &'a Service> {
        self.services.iter().filter(move |s| s.start.node.as_deref() == Some(node))
    }

    /// Keeps only the named services; conditions on the others are taken as met.
    ///
    /// # Errors
    /// A line that names what is no service.
    pub fn only(mut self, names: &[String]) -> Result<Self, String> {
        for name in names {
            if !self.services.iter().any(|s| s.name == *name) {
                let hint = crate::document::suggestion(name, self.services.iter().map(|s| s.name.as_str()));
                return Err(format!("--only {name}: no such service{hint}"));
            }
        }
        self.services.retain(|s| names.contains(&s.name));
        for service in &mut self.services {
            service.after.retain(|a| names.contains(a));
        }
        Ok(self)
    }
}
