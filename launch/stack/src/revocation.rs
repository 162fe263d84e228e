//! The list of machines whose certificates are refused. It lies beside the certificate of the authority.
//!
//! The router knows a machine by the name in its certificate. So all certificates of a name are revoked together, and a revoked
//! name is not given to a machine again.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};

use sg_input::file;
use sg_input::limits::SMALL_TEXT_BYTES;
use sg_runtime::session::SessionDir;

/// First line of the list.
const TITLE: &str =
    "# Machines whose certificates are refused. `supergaussian certificates --revoke` writes this file.";

/// A list that cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", .path.display())]
pub struct RevocationError {
    /// The list.
    pub path: PathBuf,
    /// Reason.
    pub reason: String,
}

/// Path of the list of an authority.
#[must_use]
pub fn list_beside(authority: &Path) -> PathBuf {
    authority.with_file_name("revoked.txt")
}

/// Names of the revoked machines; none without a list.
///
/// # Errors
/// [`RevocationError`] for a file that cannot be read, or that `supergaussian certificates` has not written.
pub fn read(list: &Path) -> Result<BTreeSet<String>, RevocationError> {
    let fail = |reason: String| RevocationError { path: list.to_owned(), reason };
    let text = match file::read_text(list, SMALL_TEXT_BYTES) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(BTreeSet::new()),
        Err(error) => return Err(fail(error.to_string())),
    };
    let mut lines = text.lines();
    if lines.next() != Some(TITLE) {
        return Err(fail("no list of revoked machines; move it away".to_owned()));
    }
    lines
        .map(|line| match SessionDir::named(line) {
            Ok(_) => Ok(line.to_owned()),
            Err(_) => Err(fail(format!("`{}` is no name of a machine", line.escape_debug()))),
        })
        .collect()
}

/// Text of a list.
#[must_use]
pub fn text_of(machines: &BTreeSet<String>) -> String {
    std::iter::once(TITLE).chain(machines.iter().map(String::as_str)).map(|line| format!("{line}\n")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_is_read_as_written_and_others_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let list = list_beside(&folder.path().join("authority.pem"));
        assert!(read(&list).unwrap().is_empty());
        let machines = BTreeSet::from(["gpu1".to_owned(), "gpu2".to_owned()]);
        std::fs::write(&list, text_of(&machines)).unwrap();
        assert_eq!(read(&list).unwrap(), machines);
        for wrong in ["", "gpu1\n", &format!("{}../gpu\n", text_of(&machines))] {
            std::fs::write(&list, wrong).unwrap();
            assert!(read(&list).unwrap_err().to_string().contains("revoked.txt"), "{wrong}");
        }
    }
}
