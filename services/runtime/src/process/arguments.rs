//! Arguments of the service mode.

use std::path::PathBuf;

use sg_input::file;
use sg_input::limits::SMALL_TEXT_BYTES;

use super::start_error::StartError;
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
    /// Parameters as JSON, where a file is not worth it; other users of the machine can read them
    #[arg(long, default_value = "{}", conflicts_with = "params_file")]
    pub params: String,
    /// File with the parameters from the launch file, as JSON
    #[arg(long)]
    pub params_file: Option<PathBuf>,
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
    /// Reads the parameters from their file, if they have one. A second call changes nothing.
    ///
    /// # Errors
    /// [`StartError::Input`] for a file that cannot be read, is no regular file, or is larger than 1 MiB.
    pub fn read_params(&mut self) -> Result<(), StartError> {
        let Some(path) = self.params_file.take() else { return Ok(()) };
        let text = file::read_text(&path, SMALL_TEXT_BYTES);
        self.params = text.map_err(|e| StartError::Input(format!("{}: {e}", path.display())))?;
        Ok(())
    }

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
