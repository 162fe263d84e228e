//! Arguments of the service mode.

use std::path::PathBuf;

use crate::bus::{Certificates, Link};

/// Arguments of the service mode of every executable. The supervisor sets them.
#[derive(Debug, Clone, clap::Args)]
pub struct ServeArgs {
    /// Session to join
    #[arg(long)]
    pub session: String,
    /// Role to serve
    #[arg(long)]
    pub role: String,
    /// Instance name, unique within the session
    #[arg(long)]
    pub instance: String,
    /// Endpoint of the session's router
    #[arg(long)]
    pub connect: String,
    /// Certificate of the authority (PEM), for a router on another machine
    #[arg(long, requires_all = ["certificate", "key"])]
    pub authority: Option<PathBuf>,
    /// Certificate of this machine (PEM)
    #[arg(long, requires = "authority")]
    pub certificate: Option<PathBuf>,
    /// Private key of this machine (PEM)
    #[arg(long, requires = "authority")]
    pub key: Option<PathBuf>,
    /// Folder of the session (socket, logs, pictures)
    #[arg(long)]
    pub run_dir: PathBuf,
    /// Parameters from the launch file, as JSON
    #[arg(long, default_value = "{}")]
    pub params: String,
    /// Process id of the supervisor; the process exits with it
    #[arg(long)]
    pub supervisor_pid: Option<i32>,
    /// Epoch of the role, granted by the supervisor; 0 for none
    #[arg(long, default_value_t = 0)]
    pub epoch: u64,
    /// Serve under the instance only, until promoted
    #[arg(long)]
    pub standby: bool,
    /// Time to finish accepted work after a request to stop, milliseconds
    #[arg(long, default_value_t = 3000)]
    pub grace_ms: u64,
}

impl ServeArgs {
    /// Endpoint and certificates of the session's router.
    #[must_use]
    pub fn link(&self) -> Link {
        let Self { authority, certificate, key, .. } = self;
        let certificates = authority.clone().zip(certificate.clone()).zip(key.clone());
        let certificates =
            certificates.map(|((authority, certificate), key)| Certificates { authority, certificate, key });
        Link { endpoint: self.connect.clone(), certificates }
    }
}
