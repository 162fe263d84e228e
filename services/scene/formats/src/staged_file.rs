//! Atomic file replacement: files are written under a temporary name beside the target, then renamed.

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
    /// The system's error if no file can be created there.
    pub fn create(target: &Path) -> io::Result<Self> {
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
    fn a_missing_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(StagedFile::create(&folder.path().join("none/out.bin")).is_err());
    }
}
