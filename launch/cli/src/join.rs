//! `join`: runs services on this machine for a stack of another machine.

use std::path::{Path, PathBuf};

use sg_runtime::bus::{Certificates, Link, TLS_PREFIX};
use sg_stack::file::Confinement;
use sg_stack::node::{self, NodeSettings};

use crate::certificate_expiry::check_expiry;
use crate::terminal::{CommandResult, Failure};

#[derive(Debug, clap::Args)]
pub(crate) struct JoinArgs {
    /// Endpoint of the stack, as in its launch file: tls/HOST:PORT
    #[arg(value_name = "ENDPOINT")]
    endpoint: String,
    /// Name of this machine in the launch file
    #[arg(long)]
    name: String,
    /// Certificate of the authority
    #[arg(long, value_name = "FILE")]
    authority: PathBuf,
    /// Certificate of this machine, with its name
    #[arg(long, value_name = "FILE")]
    certificate: PathBuf,
    /// Private key of this machine
    #[arg(long, value_name = "FILE")]
    key: PathBuf,
    /// Further file or folder that the services here may read and run programs of; repeatable
    #[arg(long, value_name = "PATH")]
    read: Vec<PathBuf>,
    /// Further file or folder that they may change; repeatable
    #[arg(long, value_name = "PATH")]
    write: Vec<PathBuf>,
    /// Let the services do what this user may
    #[arg(long, conflicts_with_all = ["read", "write"])]
    unconfined: bool,
}

pub(crate) async fn join(session: Option<&str>, arguments: &JoinArgs) -> CommandResult {
    let session = session.ok_or_else(|| {
        Failure::Input("--session NAME is missing; give the session's name, as `up` prints it".to_owned())
    })?;
    if !arguments.endpoint.starts_with(TLS_PREFIX) {
        let text = format!("`{}`: write the endpoint as tls/HOST:PORT", arguments.endpoint);
        return Err(Failure::Input(text));
    }
    let certificates = Certificates {
        authority: absolute(&arguments.authority)?,
        certificate: absolute(&arguments.certificate)?,
        key: absolute(&arguments.key)?,
    };
    check_expiry([certificates.authority.as_path(), certificates.certificate.as_path()])?;
    let certified = certificates.machine().map_err(|e| Failure::Input(e.to_string()))?;
    if certified != arguments.name {
        return Err(Failure::Input(format!(
            "{}: the certificate of `{certified}`, not of `{}`; give the certificate of this machine, or --name {certified}",
            arguments.certificate.display(),
            arguments.name
        )));
    }
    let link = Link { endpoint: arguments.endpoint.clone(), certificates: Some(certificates) };
    let all = |paths: &[PathBuf]| paths.iter().map(|path| absolute(path)).collect::<Result<Vec<_>, _>>();
    let confinement =
        Confinement { confined: !arguments.unconfined, read: all(&arguments.read)?, write: all(&arguments.write)? };
    node::run(NodeSettings { session: session.to_owned(), name: arguments.name.clone(), link, confinement }).await?;
    Ok(())
}

fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    std::fs::canonicalize(path).map_err(|e| Failure::Input(format!("{}: {e}", path.display())))
}
