//! Parameters of a service's process, in a file that only this user can read.
//!
//! Every user of a machine can read the arguments of all processes, and parameters may hold keys.

use std::fs::File;
use std::io::{self, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

/// Writes the parameters of an instance, a JSON object. Returns the path.
///
/// # Errors
/// The system's error.
pub(crate) fn write(run_dir: &Path, instance: &str, params: &str) -> io::Result<PathBuf> {
    let folder = folder(run_dir);
    std::fs::DirBuilder::new().recursive(true).mode(0o700).create(&folder)?;
    let path = path_of(run_dir, instance);
    remove(run_dir, instance);
    // A new file, so that nothing is written through a link.
    let mut file = File::options().write(true).create_new(true).mode(0o600).open(&path)?;
    file.write_all(params.as_bytes())?;
    Ok(path)
}

/// Removes the parameters of an instance that has ended.
pub(crate) fn remove(run_dir: &Path, instance: &str) {
    // There may be none.
    let _ = std::fs::remove_file(path_of(run_dir, instance));
}

/// Removes the parameters of all instances.
///
/// # Errors
/// The system's error.
pub(crate) fn remove_all(run_dir: &Path) -> io::Result<()> {
    match std::fs::remove_dir_all(folder(run_dir)) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

fn folder(run_dir: &Path) -> PathBuf {
    run_dir.join("params")
}

fn path_of(run_dir: &Path, instance: &str) -> PathBuf {
    folder(run_dir).join(format!("{instance}.json"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn only_this_user_reads_parameters_and_links_are_not_followed() {
        let run_dir = tempfile::tempdir().unwrap();
        let path = write(run_dir.path(), "core-1", "{\"key\": \"secret\"}").unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        let target = run_dir.path().join("target");
        std::fs::write(&target, "kept").unwrap();
        std::fs::remove_file(&path).unwrap();
        std::os::unix::fs::symlink(&target, &path).unwrap();
        assert_eq!(write(run_dir.path(), "core-1", "{}").unwrap(), path);
        assert_eq!(
            (std::fs::read(&target).unwrap().as_slice(), std::fs::read(&path).unwrap().as_slice()),
            (&b"kept"[..], &b"{}"[..])
        );
        remove(run_dir.path(), "core-1");
        assert!(!path.exists());
        remove_all(run_dir.path()).unwrap();
        remove_all(run_dir.path()).unwrap();
    }
}
