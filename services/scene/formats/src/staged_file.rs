//! Atomic file replacement: files are written under a temporary name beside the target, then renamed.
//!
//! An output replaces only what an earlier run can have written. A device, a folder, or a file of another kind under the
//! same name is refused before anything is written.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile};

/// A file being written under a temporary name beside its target; dropped without [`StagedFile::commit`] it vanishes.
#[derive(Debug)]
pub struct StagedFile {
    out: BufWriter<NamedTempFile>,
    target: PathBuf,
}

impl StagedFile {
    /// Opens a temporary file in the folder of `target`. The folder must exist.
    ///
    /// # Errors
    /// The error of [`check_replaceable`], or the system's error if no file can be created there.
    pub fn create(target: &Path) -> io::Result<Self> {
        check_replaceable(target)?;
        let folder = match target.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let mut builder = Builder::new();
        builder.prefix(".staged-");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // The process's umask still applies, so the file ends up with the rights of any other output.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let file = builder.tempfile_in(folder)?;
        Ok(Self { out: BufWriter::with_capacity(1 << 18, file), target: target.to_path_buf() })
    }

    /// The final path.
    #[must_use]
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Flushes to the disk and takes the target's place.
    ///
    /// # Errors
    /// The system's error, for instance a full disk. The target is unchanged then.
    pub fn commit(self) -> io::Result<PathBuf> {
        let file = self.out.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.as_file().sync_all()?;
        file.persist(&self.target).map_err(|e| e.error)?;
        Ok(self.target)
    }
}

impl Write for StagedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.out.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// First bytes of the files that this project writes under an ending. Files of other endings have no fixed first bytes.
const SIGNATURES: [(&str, &[&[u8]]); 10] = [
    ("png", &[b"\x89PNG"]),
    ("npy", &[b"\x93NUMPY"]),
    ("ply", &[b"ply"]),
    ("json", &[b"{", b"["]),
    ("svg", &[b"<"]),
    ("spz", &[b"\x1f\x8b"]),
    ("gz", &[b"\x1f\x8b"]),
    ("zst", &[b"\x28\xb5\x2f\xfd"]),
    ("zip", &[b"PK"]),
    ("checkpoint", &[b"SGFITC"]),
];

/// Checks that a file may be replaced by an output: it does not exist, is empty, or begins as files of its ending do.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] for a device, a folder or a file of another kind; the system's error if the file cannot
/// be read.
pub fn check_replaceable(target: &Path) -> io::Result<()> {
    let taken = |message: String| Err(io::Error::new(io::ErrorKind::AlreadyExists, message));
    match std::fs::metadata(target) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error),
        Ok(found) if !found.is_file() => return taken("no regular file is there; give another name".to_owned()),
        Ok(found) if found.len() == 0 => return Ok(()),
        Ok(_) => {}
    }
    let ending = target.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).unwrap_or_default();
    let Some((_, signatures)) = SIGNATURES.iter().find(|(known, _)| *known == ending) else {
        return Ok(());
    };
    let first = sg_input::file::read_start(target, 6)?;
    if signatures.iter().any(|signature| first.starts_with(signature)) {
        return Ok(());
    }
    taken(format!("the file there is no {} file; move it away or give another name", ending.to_uppercase()))
}

/// An output that would destroy a file.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {reason}")]
pub struct OutputError {
    /// The output.
    pub path: PathBuf,
    /// The cause and the remedy.
    pub reason: String,
}

/// Checks all outputs of a command before it works: each may be replaced, none is an input, and no two are the same.
///
/// # Errors
/// The first output that fails one of these checks.
pub fn check_outputs<'a>(
    outputs: impl IntoIterator<Item = &'a Path>,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> Result<(), OutputError> {
    let inputs: Vec<PathBuf> = inputs.into_iter().filter_map(|path| path.canonicalize().ok()).collect();
    let mut places: Vec<PathBuf> = Vec::new();
    for output in outputs {
        let refuse = |reason: String| OutputError { path: output.to_path_buf(), reason };
        check_replaceable(output).map_err(|e| refuse(e.to_string()))?;
        let place =
            output.canonicalize().or_else(|_| std::path::absolute(output)).map_err(|e| refuse(e.to_string()))?;
        if inputs.contains(&place) {
            return Err(refuse("the command reads this file; give the output another name".to_owned()));
        }
        if places.contains(&place) {
            return Err(refuse("two outputs have this name; give each its own".to_owned()));
        }
        places.push(place);
    }
    Ok(())
}

/// Replaces a file's content at once.
///
/// # Errors
/// The system's error. The file is unchanged then.
pub fn replace(target: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = StagedFile::create(target)?;
    file.write_all(bytes)?;
    file.commit().map(|_| ())
}

/// Makes the folder of a file durable, so that a rename into it survives a power cut.
///
/// # Errors
/// The system's error.
pub fn sync_folder(of: &Path) -> io::Result<()> {
    match of.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => File::open(folder)?.sync_all(),
        _ => File::open(".")?.sync_all(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dropped_file_leaves_the_old_one_and_no_rest() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("out.bin");
        replace(&target, b"old").unwrap();
        let mut staged = StagedFile::create(&target).unwrap();
        staged.write_all(b"half of the n").unwrap();
        drop(staged);
        assert_eq!(std::fs::read(&target).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        replace(&target, b"new").unwrap();
        sync_folder(&target).unwrap();
        assert_eq!(std::fs::read(&target).unwrap(), b"new");
    }

    #[test]
    fn only_an_output_of_the_same_kind_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let picture = folder.path().join("view.PNG");
        std::fs::write(&picture, "notes of three years").unwrap();
        let refused = StagedFile::create(&picture).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(refused.to_string(), "the file there is no PNG file; move it away or give another name");
        assert_eq!(std::fs::read(&picture).unwrap(), b"notes of three years");
        for old in [&b""[..], b"\x89PNG of yesterday"] {
            std::fs::write(&picture, old).unwrap();
            replace(&picture, b"\x89PNG of today").unwrap();
        }
        assert!(StagedFile::create(Path::new("/dev/null")).is_err());
        assert!(StagedFile::create(folder.path()).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn no_output_is_an_input_or_another_output() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("in.csv"), "1").unwrap();
        std::os::unix::fs::symlink(at("in.csv"), at("link.csv")).unwrap();
        let check = |outputs: &[&str]| {
            let outputs: Vec<PathBuf> = outputs.iter().map(|name| at(name)).collect();
            let input = at("in.csv");
            check_outputs(outputs.iter().map(PathBuf::as_path), [input.as_path()]).map_err(|e| e.reason)
        };
        assert_eq!(check(&["a.csv", "b.csv"]), Ok(()));
        for input in ["in.csv", "link.csv"] {
            assert_eq!(
                check(&["a.csv", input]).unwrap_err(),
                "the command reads this file; give the output another name"
            );
        }
        assert_eq!(check(&["a.csv", "a.csv"]).unwrap_err(), "two outputs have this name; give each its own");
    }

    #[test]
    fn a_missing_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(StagedFile::create(&folder.path().join("none/out.bin")).is_err());
    }
}
