//! `certificates`: TLS certificates for machines that share a stack.

use std::fs::OpenOptions;
use std::io::Write as _;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose,
};

use sg_input::file;
use sg_input::limits::SMALL_TEXT_BYTES;

use sg_stack::revocation;

use crate::certificate_expiry::expiry;
use crate::terminal::{self, CommandResult, Failure};

/// Name of the authority in its certificate.
const AUTHORITY: &str = "Super-Gaussian authority";
/// File name of the authority, without the extension.
const AUTHORITY_FILE: &str = "authority";
/// File name of the machine that runs `up`, without the extension.
const HOME: &str = "home";
/// End of the file name of a key, before the extension.
const KEY_SUFFIX: &str = "-key";
/// Validity of a new authority in days; certificates never outlive it.
const AUTHORITY_DAYS: u64 = 3650;
/// A day in seconds.
const DAY: u64 = 24 * 3600;
/// Tolerated clock difference.
const CLOCKS: Duration = Duration::from_secs(DAY);

#[derive(Debug, clap::Args)]
pub(crate) struct CertificatesArgs {
    /// Folder for the files; created if missing; an existing authority is used again
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Names and addresses of the machine that runs `up`, as other machines reach it; renews its certificate
    #[arg(long, value_delimiter = ',', value_name = "HOST")]
    home: Vec<String>,
    /// Name of a machine that may join, as in the launch file; repeatable
    #[arg(long = "node", value_delimiter = ',', value_name = "NAME")]
    nodes: Vec<String>,
    /// Validity of the certificates in days
    #[arg(long, default_value_t = 365, value_parser = clap::value_parser!(u64).range(1..=3650))]
    days: u64,
    /// Make new keys, in files beside the old ones; the old certificates stay valid until they expire
    #[arg(long)]
    new_key: bool,
    /// Refuse all certificates of this machine from now on; repeatable. Then run `up` again to tell a running stack
    #[arg(long, value_delimiter = ',', value_name = "NAME", conflicts_with_all = ["home", "nodes", "days", "new_key"])]
    revoke: Vec<String>,
}

/// Signs a certificate for home and for every node, or revokes those of machines. Keys are never replaced; a later run renews
/// certificates on the same keys, or on new keys beside them.
///
/// Everything is read and signed before the first file is written, so that a refused command changes nothing.
pub(crate) fn certificates(arguments: &CertificatesArgs) -> CommandResult {
    let CertificatesArgs { dir, home, nodes, days, new_key, revoke: revoked } = arguments;
    if !revoked.is_empty() {
        return revoke(dir, revoked);
    }
    check_names("--node", nodes)?;
    let list = list_of(dir);
    let refused = revocation::read(&list).map_err(|e| Failure::Input(e.to_string()))?;
    if let Some(node) = nodes.iter().find(|node| refused.contains(*node)) {
        let text = format!("--node {node}: revoked in {}; give the machine another name", list.display());
        return Err(Failure::Input(text));
    }
    if home.is_empty() && (nodes.is_empty() || !key_path(dir, HOME).exists()) {
        let text = "--home HOST is missing; give the names of the machine that runs `up`, as other machines reach it";
        return Err(Failure::Input(text.to_owned()));
    }
    let authority = Authority::of(dir)?;
    let sign = |name: &str, hosts: &[String], purpose| {
        let generation = Generation::newest(dir, name);
        let generation = if *new_key { generation.next() } else { generation };
        authority.sign(dir, (name, generation), hosts, purpose, *days)
    };
    let at_home = match home.as_slice() {
        [] => None,
        hosts => Some(sign(HOME, hosts, ExtendedKeyUsagePurpose::ServerAuth)?),
    };
    let of_nodes =
        nodes.iter().map(|node| sign(node, &[], ExtendedKeyUsagePurpose::ClientAuth)).collect::<Result<Vec<_>, _>>()?;

    let fail = |e: std::io::Error| Failure::Work(format!("{}: {e}", dir.display()));
    std::fs::DirBuilder::new().recursive(true).mode(0o700).create(dir).map_err(fail)?;
    for files in std::iter::once(&authority.files).chain(&at_home).chain(&of_nodes) {
        files.write()?;
    }
    if in_days(*days) > authority.expires {
        terminal::print_status(&format!(
            "{}: expires before {days} days; the certificates end with it. Start a new authority in another folder in time",
            authority.files.certificate.display()
        ));
    }
    terminal::print_line(&format!(
        "{}: the authority; keep its key on this machine",
        authority.files.certificate.display()
    ));
    if let Some(at_home) = &at_home {
        terminal::print_line(&format!(
            "{}: for `[bus]` of the launch file, reached as {}",
            at_home.certificate.display(),
            home.join(", ")
        ));
    }
    for (node, files) in nodes.iter().zip(&of_nodes) {
        terminal::print_line(&format!(
            "{}: for machine {node}, with its key and authority.pem; copy these three files there",
            files.certificate.display()
        ));
    }
    Ok(())
}

/// Path of the list of revoked machines.
fn list_of(dir: &Path) -> PathBuf {
    revocation::list_beside(&dir.join(format!("{AUTHORITY_FILE}.pem")))
}

/// Adds machines to the list of revoked ones.
fn revoke(dir: &Path, names: &[String]) -> CommandResult {
    check_names("--revoke", names)?;
    let list = list_of(dir);
    let mut revoked = revocation::read(&list).map_err(|e| Failure::Input(e.to_string()))?;
    for name in names {
        // A mistyped name would leave the machine in.
        let certificate = dir.join(format!("{name}.pem"));
        if !certificate.is_file() {
            let text = format!("--revoke {name}: there is no {}; give the name of a machine", certificate.display());
            return Err(Failure::Input(text));
        }
        revoked.insert(name.clone());
    }
    replace(&list, &revocation::text_of(&revoked))?;
    for name in names {
        terminal::print_line(&format!(
            "{}: machine {name} is refused from now on; `supergaussian up FILE` tells a running stack",
            list.display()
        ));
    }
    Ok(())
}

/// Number of a machine's key: 1 for the first, whose files have no number in their names.
#[derive(Debug, Clone, Copy)]
struct Generation(u32);

impl Generation {
    /// The newest key of a machine; 0 for none.
    fn newest(dir: &Path, name: &str) -> Self {
        let is_there = |n: &u32| key_path(dir, &Self(*n).stem(name)).exists();
        Self((1..).take_while(is_there).last().unwrap_or(0))
    }

    fn next(self) -> Self {
        Self(self.0 + 1)
    }

    /// Name of the certificate's file, without the extension. Names of machines have no dot.
    fn stem(self, name: &str) -> String {
        if self.0 <= 1 { name.to_owned() } else { format!("{name}.{}", self.0) }
    }
}

/// Checks the names of machines that an option gives. A name must not lead to the file of another machine, of home or of the authority.
fn check_names(option: &str, nodes: &[String]) -> Result<(), Failure> {
    for (at, node) in nodes.iter().enumerate() {
        let problem = if sg_runtime::session::SessionDir::named(node).is_err() {
            "use letters, digits, `-` or `_`"
        } else if [HOME, AUTHORITY_FILE].contains(&node.as_str()) || node.ends_with(KEY_SUFFIX) {
            "`home`, `authority` and names that end with `-key` are reserved; choose another name"
        } else if nodes[..at].contains(node) {
            "the name is given twice"
        } else {
            continue;
        };
        return Err(Failure::Input(format!("{option} {node}: {problem}")));
    }
    Ok(())
}

/// A certificate and its key, signed but not written yet.
struct SignedFiles {
    certificate: PathBuf,
    pem: String,
    /// A new key and its path; `None` for a key that is there already.
    new_key: Option<(PathBuf, String)>,
}

impl SignedFiles {
    fn write(&self) -> Result<(), Failure> {
        if let Some((path, pem)) = &self.new_key {
            write_new(path, pem)?;
        }
        replace(&self.certificate, &self.pem)
    }
}

/// The authority of a folder, from its files or new.
struct Authority {
    issuer: Issuer<'static, KeyPair>,
    expires: SystemTime,
    files: SignedFiles,
}

impl Authority {
    fn of(dir: &Path) -> Result<Self, Failure> {
        let (pair, new_key) = key(dir, AUTHORITY_FILE)?;
        let mut params = params(AUTHORITY, &[], in_days(AUTHORITY_DAYS))?;
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        let certificate = dir.join(format!("{AUTHORITY_FILE}.pem"));
        let pem = match file::read_text(&certificate, SMALL_TEXT_BYTES) {
            Ok(pem) => pem,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                params.self_signed(&pair).map_err(|e| refused(&e))?.pem()
            }
            Err(error) => return Err(Failure::Input(format!("{}: {error}", certificate.display()))),
        };
        let expires = expiry(&pem).map_err(|e| Failure::Input(format!("{}: {e}", certificate.display())))?;
        if expires <= SystemTime::now() {
            return Err(Failure::Input(format!(
                "{}: has expired; start a new authority in another folder, and copy its files to every machine",
                certificate.display()
            )));
        }
        Ok(Self { issuer: Issuer::new(params, pair), expires, files: SignedFiles { certificate, pem, new_key } })
    }

    /// Signs a certificate that does not outlive the authority.
    fn sign(
        &self,
        dir: &Path,
        (name, generation): (&str, Generation),
        hosts: &[String],
        purpose: ExtendedKeyUsagePurpose,
        days: u64,
    ) -> Result<SignedFiles, Failure> {
        let stem = generation.stem(name);
        let expires = in_days(days).min(self.expires);
        let mut params = params(name, hosts, expires)?;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![purpose];
        params.use_authority_key_identifier_extension = true;
        let (pair, new_key) = key(dir, &stem)?;
        let pem = params.signed_by(&pair, &self.issuer).map_err(|e| refused(&e))?.pem();
        Ok(SignedFiles { certificate: dir.join(format!("{stem}.pem")), pem, new_key })
    }
}

/// Path of the key of this name.
fn key_path(dir: &Path, name: &str) -> PathBuf {
    dir.join(format!("{name}{KEY_SUFFIX}.pem"))
}

/// The key of this name: the one in the folder, or a new one with its path.
fn key(dir: &Path, name: &str) -> Result<(KeyPair, Option<(PathBuf, String)>), Failure> {
    let path = key_path(dir, name);
    match file::read_text(&path, SMALL_TEXT_BYTES) {
        Ok(pem) => {
            let pair = KeyPair::from_pem(&pem)
                .map_err(|e| Failure::Input(format!("{}: {e}; move the file away for a new key", path.display())))?;
            Ok((pair, None))
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let certificate = dir.join(format!("{name}.pem"));
            if certificate.exists() {
                return Err(Failure::Input(format!(
                    "{}: its key {} is missing; bring the key back, or move the certificate away",
                    certificate.display(),
                    path.display()
                )));
            }
            let pair = KeyPair::generate().map_err(|e| refused(&e))?;
            let pem = pair.serialize_pem();
            Ok((pair, Some((path, pem))))
        }
        Err(error) => Err(Failure::Work(format!("{}: {error}", path.display()))),
    }
}

/// The time in so many days.
fn in_days(days: u64) -> SystemTime {
    SystemTime::now() + Duration::from_secs(days * DAY)
}

fn params(name: &str, hosts: &[String], expires: SystemTime) -> Result<CertificateParams, Failure> {
    let mut params = CertificateParams::new(hosts.to_vec())
        .map_err(|e| Failure::Input(format!("--home {}: {e}; give names or addresses", hosts.join(","))))?;
    params.distinguished_name.push(DnType::CommonName, name);
    params.not_before = (SystemTime::now() - CLOCKS).into();
    params.not_after = expires.into();
    Ok(params)
}

fn refused(error: &rcgen::Error) -> Failure {
    Failure::Work(format!("a certificate could not be made: {error}"))
}

/// Writes a key, which only its owner may read. Never replaces a file.
fn write_new(path: &Path, text: &str) -> Result<(), Failure> {
    let written = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(path)
        .and_then(|mut file| file.write_all(text.as_bytes()).and_then(|()| file.sync_all()));
    written.map_err(|e| Failure::Work(format!("{}: {e}", path.display())))
}

/// Writes a certificate beside its place, and then replaces the former one.
fn replace(path: &Path, text: &str) -> Result<(), Failure> {
    let part = path.with_extension("part");
    let written = OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(true)
        .mode(0o644)
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
    use sg_runtime::bus::CertificateContent;
    use std::collections::BTreeMap;
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
            new_key: false,
            revoke: Vec::new(),
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

    /// Every file of a folder with its content.
    fn contents(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
        let files = std::fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().path());
        files.map(|path| (path.clone(), std::fs::read(path).unwrap())).collect()
    }

    #[test]
    fn a_refused_command_changes_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path().join("tls");
        let arguments = |nodes: &[&str], home: &str| CertificatesArgs {
            dir: dir.clone(),
            home: vec![home.to_owned()],
            nodes: nodes.iter().map(|n| (*n).to_owned()).collect(),
            days: 30,
            new_key: false,
            revoke: Vec::new(),
        };
        certificates(&arguments(&["gpu1"], "lab.example.org")).unwrap();
        let before = contents(&dir);
        for names in [&["authority"][..], &["home"], &["gpu1-key"], &["authority-key"], &["../gpu"], &["a", "a"]] {
            assert!(matches!(certificates(&arguments(names, "lab.example.org")), Err(Failure::Input(_))), "{names:?}");
            assert_eq!(contents(&dir), before, "{names:?}");
        }
        assert!(certificates(&arguments(&["gpu2"], "snowman \u{2603}")).is_err());
        assert_eq!(contents(&dir), before);

        std::fs::write(dir.join("gpu3.pem"), "from elsewhere").unwrap();
        let before = contents(&dir);
        assert!(matches!(certificates(&arguments(&["gpu3"], "lab.example.org")), Err(Failure::Input(_))));
        assert_eq!(contents(&dir), before, "a certificate without its key is not replaced");
    }

    #[test]
    fn a_later_run_renews_certificates_on_the_same_keys() {
        let folder = tempfile::tempdir().unwrap();
        let arguments = |days| CertificatesArgs {
            dir: folder.path().to_owned(),
            home: vec!["lab.example.org".to_owned()],
            nodes: vec!["gpu1".to_owned()],
            days,
            new_key: false,
            revoke: Vec::new(),
        };
        certificates(&arguments(30)).unwrap();
        let before = contents(folder.path());
        certificates(&arguments(60)).unwrap();
        let end = |files: &BTreeMap<PathBuf, Vec<u8>>, name: &str| {
            expiry(std::str::from_utf8(&files[&folder.path().join(name)]).unwrap()).unwrap()
        };
        let after = contents(folder.path());
        for name in ["authority-key.pem", "home-key.pem", "gpu1-key.pem", "authority.pem"] {
            assert_eq!(after[&folder.path().join(name)], before[&folder.path().join(name)], "{name}");
        }
        for name in ["home.pem", "gpu1.pem"] {
            let later = end(&after, name).duration_since(end(&before, name)).unwrap();
            assert!(later > Duration::from_secs(29 * DAY), "{name}: {later:?}");
        }
    }

    #[test]
    fn a_rotation_makes_new_files_and_changes_none() {
        let folder = tempfile::tempdir().unwrap();
        let arguments = |home: &[&str], new_key| CertificatesArgs {
            dir: folder.path().to_owned(),
            home: home.iter().map(|h| (*h).to_owned()).collect(),
            nodes: vec!["gpu1".to_owned()],
            days: 30,
            new_key,
            revoke: Vec::new(),
        };
        assert!(matches!(certificates(&arguments(&[], false)), Err(Failure::Input(text)) if text.contains("--home")));
        certificates(&arguments(&["lab"], false)).unwrap();
        let first = contents(folder.path());
        certificates(&arguments(&[], true)).unwrap();
        let second = contents(folder.path());
        assert!(first.iter().all(|(path, content)| second.get(path) == Some(content)));
        let added: Vec<_> = second.keys().filter(|p| !first.contains_key(*p)).map(|p| p.file_name().unwrap()).collect();
        assert_eq!(added, ["gpu1.2-key.pem", "gpu1.2.pem"]);
        let file = |name: &str| folder.path().join(name);
        let content = CertificateContent::of_pem(&second[&file("gpu1.2.pem")]).unwrap();
        assert_eq!(content.common_name.as_deref(), Some("gpu1"));
        // A renewal is of the newest key.
        certificates(&arguments(&[], false)).unwrap();
        let third = contents(folder.path());
        let changed: Vec<_> = third.keys().filter(|p| third[*p] != second[*p]).collect();
        assert_eq!(changed, [&file("gpu1.2.pem")]);
    }

    #[test]
    fn a_revoked_name_is_listed_and_not_used_again() {
        let folder = tempfile::tempdir().unwrap();
        let arguments = |nodes: &[&str], revoke: &[&str]| CertificatesArgs {
            dir: folder.path().to_owned(),
            home: if revoke.is_empty() { vec!["lab".to_owned()] } else { Vec::new() },
            nodes: nodes.iter().map(|n| (*n).to_owned()).collect(),
            days: 30,
            new_key: false,
            revoke: revoke.iter().map(|n| (*n).to_owned()).collect(),
        };
        certificates(&arguments(&["gpu1", "gpu2"], &[])).unwrap();
        let before = contents(folder.path());
        for wrong in [&["gpu3"][..], &["gpu1", "gpu3"], &["home"], &["../gpu1"]] {
            assert!(matches!(certificates(&arguments(&[], wrong)), Err(Failure::Input(_))), "{wrong:?}");
            assert_eq!(contents(folder.path()), before, "{wrong:?}");
        }
        certificates(&arguments(&[], &["gpu1"])).unwrap();
        let list = list_of(folder.path());
        assert_eq!(revocation::read(&list).unwrap().into_iter().collect::<Vec<_>>(), ["gpu1"]);
        let after = contents(folder.path());
        assert!(before.iter().all(|(path, content)| after.get(path) == Some(content)));
        assert!(
            matches!(certificates(&arguments(&["gpu1"], &[])), Err(Failure::Input(text)) if text.contains("revoked"))
        );
        certificates(&arguments(&[], &["gpu2"])).unwrap();
        assert_eq!(revocation::read(&list).unwrap().len(), 2);
        // A file of others is left alone.
        std::fs::write(&list, "my notes").unwrap();
        assert!(matches!(certificates(&arguments(&[], &["gpu2"])), Err(Failure::Input(_))));
        assert_eq!(std::fs::read_to_string(&list).unwrap(), "my notes");
    }

    #[test]
    fn a_certificate_ends_with_its_authority() {
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path();
        let pair = KeyPair::generate().unwrap();
        let write_authority = |expires: SystemTime| {
            let pem = params(AUTHORITY, &[], expires).unwrap().self_signed(&pair).unwrap().pem();
            std::fs::write(dir.join("authority.pem"), pem).unwrap();
        };
        std::fs::write(dir.join("authority-key.pem"), pair.serialize_pem()).unwrap();
        let arguments = CertificatesArgs {
            dir: dir.to_owned(),
            home: vec!["lab".to_owned()],
            nodes: Vec::new(),
            days: 365,
            new_key: false,
            revoke: Vec::new(),
        };

        write_authority(SystemTime::now() + Duration::from_secs(10 * DAY));
        certificates(&arguments).unwrap();
        let end = |name: &str| expiry(&std::fs::read_to_string(dir.join(name)).unwrap()).unwrap();
        assert_eq!(end("home.pem"), end("authority.pem"));

        write_authority(SystemTime::now() - Duration::from_secs(60));
        let before = contents(dir);
        assert!(matches!(certificates(&arguments), Err(Failure::Input(text)) if text.contains("expired")));
        assert_eq!(contents(dir), before);
    }
}
