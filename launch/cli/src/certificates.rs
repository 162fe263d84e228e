//! `certificates`: TLS certificates for machines that share a stack.

use std::fs::OpenOptions;
use std::io::Write as _;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose,
};

use crate::terminal::{self, CommandResult, Failure};

/// Name of the authority in its certificate.
const AUTHORITY: &str = "Super-Gaussian authority";
/// Tolerated clock difference.
const CLOCKS: Duration = Duration::from_secs(24 * 3600);

#[derive(Debug, clap::Args)]
pub(crate) struct CertificatesArgs {
    /// Folder for the files; created if missing; an existing authority is used again
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Names and addresses of the machine that runs `up`, as other machines reach it
    #[arg(long, value_delimiter = ',', required = true, value_name = "HOST")]
    home: Vec<String>,
    /// Name of a machine that may join, as in the launch file; repeatable
    #[arg(long = "node", value_delimiter = ',', value_name = "NAME")]
    nodes: Vec<String>,
    /// Validity of the certificates in days
    #[arg(long, default_value_t = 365, value_parser = clap::value_parser!(u64).range(1..=3650))]
    days: u64,
}

pub(crate) fn certificates(arguments: &CertificatesArgs) -> CommandResult {
    let CertificatesArgs { dir, home, nodes, days } = arguments;
    if let Some(bad) = nodes.iter().find(|n| sg_runtime::session::SessionDir::named(n).is_err() || *n == "home") {
        return Err(Failure::Input(format!("--node {bad}: use letters, digits, `-` or `_`, and not `home`")));
    }
    let fail = |e: std::io::Error| Failure::Work(format!("{}: {e}", dir.display()));
    std::fs::DirBuilder::new().recursive(true).mode(0o700).create(dir).map_err(fail)?;
    let authority = authority(dir, *days)?;
    let mut lines =
        vec![format!("{}: the authority; keep its key on this machine", dir.join("authority.pem").display())];
    let made = signed(dir, "home", home, ExtendedKeyUsagePurpose::ServerAuth, *days, &authority)?;
    lines.push(format!("{}: for `[bus]` of the launch file, reached as {}", made.display(), home.join(", ")));
    for node in nodes {
        let made = signed(dir, node, &[], ExtendedKeyUsagePurpose::ClientAuth, *days, &authority)?;
        lines.push(format!(
            "{}: for machine {node}, with its key and authority.pem; copy these three files there",
            made.display()
        ));
    }
    for line in lines {
        terminal::print_line(&line);
    }
    Ok(())
}

/// The authority of a folder. Creates one if there is none.
fn authority(dir: &Path, days: u64) -> Result<Issuer<'static, KeyPair>, Failure> {
    let (certificate, key) = (dir.join("authority.pem"), dir.join("authority-key.pem"));
    let mut params = params(AUTHORITY, &[], days)?;
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    match std::fs::read_to_string(&key) {
        Ok(pem) => {
            let pair = KeyPair::from_pem(&pem).map_err(|e| Failure::Input(format!("{}: {e}", key.display())))?;
            if !certificate.is_file() {
                write(&certificate, &params.self_signed(&pair).map_err(|e| refused(&e))?.pem(), 0o644)?;
            }
            Ok(Issuer::new(params, pair))
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let pair = KeyPair::generate().map_err(|e| refused(&e))?;
            write(&key, &pair.serialize_pem(), 0o600)?;
            write(&certificate, &params.self_signed(&pair).map_err(|e| refused(&e))?.pem(), 0o644)?;
            Ok(Issuer::new(params, pair))
        }
        Err(error) => Err(Failure::Work(format!("{}: {error}", key.display()))),
    }
}

/// Creates a certificate and its key, signed by this authority. Returns the path of the certificate.
fn signed(
    dir: &Path,
    name: &str,
    hosts: &[String],
    purpose: ExtendedKeyUsagePurpose,
    days: u64,
    authority: &Issuer<'_, KeyPair>,
) -> Result<PathBuf, Failure> {
    let mut params = params(name, hosts, days)?;
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.extended_key_usages = vec![purpose];
    params.use_authority_key_identifier_extension = true;
    let pair = KeyPair::generate().map_err(|e| refused(&e))?;
    let certificate = params.signed_by(&pair, authority).map_err(|e| refused(&e))?;
    write(&dir.join(format!("{name}-key.pem")), &pair.serialize_pem(), 0o600)?;
    let path = dir.join(format!("{name}.pem"));
    write(&path, &certificate.pem(), 0o644)?;
    Ok(path)
}

fn params(name: &str, hosts: &[String], days: u64) -> Result<CertificateParams, Failure> {
    let mut params = CertificateParams::new(hosts.to_vec())
        .map_err(|e| Failure::Input(format!("--home {}: {e}; give names or addresses", hosts.join(","))))?;
    params.distinguished_name.push(DnType::CommonName, name);
    let now = SystemTime::now();
    params.not_before = (now - CLOCKS).into();
    params.not_after = (now + Duration::from_secs(days * 24 * 3600)).into();
    Ok(params)
}

fn refused(error: &rcgen::Error) -> Failure {
    Failure::Work(format!("a certificate could not be made: {error}"))
}

fn write(path: &Path, text: &str, mode: u32) -> Result<(), Failure> {
    let part = path.with_extension("part");
    let written = OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(true)
        .mode(mode)
        .open(&part)
        .and_then(|mut file| file.write_all(text.as_bytes()))
        .and_then(|()| std::fs::rename(&part, path));
    written.map_err(|e| {
        // The file may not exist. The first error is the one to report.
        let _ = std::fs::remove_file(&part);
        Failure::Work(format!("{}: {e}", path.display()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn keys_are_the_owners_alone_and_an_authority_is_used_again() {
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path().join("tls");
        let arguments = |nodes: &[&str]| CertificatesArgs {
            dir: dir.clone(),
            home: vec!["lab.example.org".into(), "10.0.0.1".into()],
            nodes: nodes.iter().map(|n| (*n).to_owned()).collect(),
            days: 30,
        };
        certificates(&arguments(&["gpu1"])).unwrap();
        let read = |name: &str| std::fs::read_to_string(dir.join(name)).unwrap();
        let (authority, node) = (read("authority.pem"), read("gpu1.pem"));
        certificates(&arguments(&["gpu2"])).unwrap();
        assert_eq!((read("authority.pem"), read("gpu1.pem")), (authority, node));
        for entry in std::fs::read_dir(&dir).unwrap() {
            let entry = entry.unwrap();
            let open = entry.metadata().unwrap().permissions().mode() & 0o077;
            let is_key = entry.file_name().to_string_lossy().ends_with("-key.pem");
            assert_eq!(is_key, open == 0, "{:?}", entry.file_name());
        }
        assert!(certificates(&arguments(&["../gpu"])).is_err());
    }
}
