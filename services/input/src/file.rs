//! Regular files, opened without waiting and read within a limit.
//!
//! Opening a pipe waits for its writer, a device may never end, and either can act on being opened. So the kind of a path
//! is known before it is opened, and is looked at again on the open descriptor: nothing can change it in between.

use std::fs::{File, FileType, Metadata, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::Path;

use nix::fcntl::OFlag;
use nix::unistd::{Whence, lseek};

use crate::limits;

/// Bytes of a block in [`MetadataExt::blocks`].
const BLOCK: u64 = 512;

/// An open regular file.
#[derive(Debug)]
pub struct RegularFile {
    /// The file, at its start.
    pub file: File,
    /// Its length in bytes when it was opened.
    pub length: u64,
    /// Device and inode: equal for two names of one file.
    pub identity: (u64, u64),
}

/// Opens a regular file for reading. Never waits: neither for a writer of a pipe nor for a device.
///
/// # Errors
/// The system's error, or one line that says what stands there instead of a regular file. The line does not name the path.
pub fn open(path: &Path) -> io::Result<RegularFile> {
    check_kind(&std::fs::metadata(path)?)?;
    let flags = OFlag::O_NONBLOCK | OFlag::O_NOCTTY | OFlag::O_CLOEXEC;
    let file = OpenOptions::new().read(true).custom_flags(flags.bits()).open(path)?;
    let metadata = file.metadata()?;
    check_kind(&metadata)?;
    check_holes(&file, &metadata)?;
    Ok(RegularFile { length: metadata.len(), identity: identity_of(&metadata), file })
}

/// Opens a named pipe for reading. Never waits for its writer: a read gives no bytes while there is none, and
/// [`io::ErrorKind::WouldBlock`] while the writer has written nothing.
///
/// # Errors
/// The system's error, or one line that says what stands there instead of a pipe. The line does not name the path.
pub fn open_pipe(path: &Path) -> io::Result<File> {
    check_is_pipe(&std::fs::metadata(path)?)?;
    let flags = OFlag::O_NONBLOCK | OFlag::O_NOCTTY | OFlag::O_CLOEXEC;
    let file = OpenOptions::new().read(true).custom_flags(flags.bits()).open(path)?;
    check_is_pipe(&file.metadata()?)?;
    Ok(file)
}

fn check_is_pipe(metadata: &Metadata) -> io::Result<()> {
    let what = match metadata.file_type() {
        kind if kind.is_fifo() => return Ok(()),
        kind if kind.is_file() => "a regular file",
        kind if kind.is_dir() => "a folder",
        kind => special(kind),
    };
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("it is {what}, not a named pipe; `mkfifo` makes one")))
}

/// Device and inode of a file: equal for two names of one file.
#[must_use]
pub fn identity_of(metadata: &Metadata) -> (u64, u64) {
    (metadata.dev(), metadata.ino())
}

/// Refuses everything except regular files and folders, before anything is done with the path.
///
/// # Errors
/// As [`open`].
pub fn check_file_or_folder(path: &Path) -> io::Result<()> {
    let metadata = std::fs::metadata(path)?;
    if metadata.is_dir() { Ok(()) } else { check_kind(&metadata) }
}

/// Reads a regular file of at most `most` bytes, or of more if [`limits::RAISED`] allows it.
///
/// # Errors
/// As [`open`]; one line with the limit and the remedy for a longer file.
pub fn read(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.read_until(&mut bytes, u64::MAX, most)?;
    Ok(bytes)
}

/// The first bytes of a regular file, at most `most` of them.
///
/// # Errors
/// As [`open`].
pub fn read_start(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.file.take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

impl RegularFile {
    /// Reads on until `bytes`, the start of the file so far, holds its first `until` bytes or the file ends.
    ///
    /// # Errors
    /// The system's error; one line with the limit and the remedy for more than `most` bytes.
    pub fn read_until(&self, bytes: &mut Vec<u8>, until: u64, most: u64) -> io::Result<()> {
        let most = limits::at_least(most);
        let too_long = |length: u64| {
            let remedy = limits::remedy(length);
            io::Error::new(io::ErrorKind::FileTooLarge, format!("longer than the limit of {most} bytes; {remedy}"))
        };
        let wanted = until.min(self.length);
        if wanted > most {
            return Err(too_long(wanted));
        }
        let missing = usize::try_from(wanted).map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
        let missing = missing.saturating_sub(bytes.len());
        bytes.try_reserve_exact(missing).map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
        // A file can grow meanwhile, and files of the kernel have no length.
        let room = until.min(most.saturating_add(1)).saturating_sub(bytes.len() as u64);
        (&self.file).take(room).read_to_end(bytes)?;
        if bytes.len() as u64 > most { Err(too_long(bytes.len() as u64)) } else { Ok(()) }
    }
}

/// Reads a regular file of UTF-8 text.
///
/// # Errors
/// As [`read`]; one line with the place of the first byte that is no UTF-8.
pub fn read_text(path: &Path, most: u64) -> io::Result<String> {
    String::from_utf8(read(path, most)?).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let line = 1 + error.as_bytes().iter().take(at).filter(|b| **b == b'\n').count();
        io::Error::new(io::ErrorKind::InvalidData, format!("line {line}, byte {at}: the text is not UTF-8"))
    })
}

fn check_kind(metadata: &Metadata) -> io::Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    let (kind, what) = match metadata.file_type() {
        kind if kind.is_dir() => (io::ErrorKind::IsADirectory, "a folder"),
        kind => (io::ErrorKind::InvalidInput, special(kind)),
    };
    Err(io::Error::new(kind, format!("it is {what}, not a regular file")))
}

fn special(kind: FileType) -> &'static str {
    match kind {
        kind if kind.is_fifo() => "a pipe",
        kind if kind.is_socket() => "a socket",
        kind if kind.is_char_device() || kind.is_block_device() => "a device",
        _ => "something else",
    }
}

/// Holes read as zeros that are stored nowhere, so a file of holes is as large as its writer likes.
fn check_holes(file: &File, metadata: &Metadata) -> io::Result<()> {
    let stored = metadata.blocks().saturating_mul(BLOCK);
    if metadata.len() <= limits::expanded(stored) {
        return Ok(());
    }
    // Some file systems count no blocks. Those know no holes either: the first hole is then the file's end.
    let hole = lseek(file, 0, Whence::SeekHole).map_err(io::Error::from)?;
    lseek(file, 0, Whence::SeekSet).map_err(io::Error::from)?;
    if u64::try_from(hole).is_ok_and(|hole| hole < metadata.len()) {
        let (length, remedy) = (metadata.len(), limits::remedy(metadata.len()));
        let what = format!("{length} bytes long, but only {stored} bytes are stored; {remedy}");
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, what));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nix::sys::stat::Mode;
    use nix::unistd::mkfifo;
    use std::time::{Duration, Instant};

    #[test]
    fn only_regular_files_are_read_and_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        mkfifo(&at("pipe"), Mode::S_IRWXU).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        std::os::unix::fs::symlink("/dev/zero", at("zero")).unwrap();
        std::os::unix::fs::symlink(at("pipe"), at("link")).unwrap();
        std::os::unix::fs::symlink(at("loop"), at("loop")).unwrap();
        let began = Instant::now();
        for (name, part) in [
            ("pipe", "it is a pipe, not a regular file"),
            ("link", "it is a pipe"),
            ("socket", "it is a socket"),
            ("zero", "it is a device"),
            (".", "it is a folder"),
            ("loop", "symbolic link"),
            ("none", "No such file"),
        ] {
            let error = read(&at(name), 10).unwrap_err().to_string();
            assert!(error.contains(part), "{name}: {error}");
        }
        assert!(open_pipe(&at("pipe")).is_ok() && open_pipe(&at("link")).is_ok());
        for (name, part) in [
            ("socket", "it is a socket, not a named pipe"),
            ("zero", "it is a device"),
            (".", "it is a folder"),
            ("none", "No such file"),
        ] {
            let error = open_pipe(&at(name)).unwrap_err().to_string();
            assert!(error.contains(part), "{name}: {error}");
        }
        assert!(began.elapsed() < Duration::from_secs(1));
        assert!(check_file_or_folder(folder.path()).is_ok() && check_file_or_folder(&at("pipe")).is_err());
    }

    #[test]
    fn a_file_is_read_up_to_its_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("text");
        std::fs::write(&path, "ab\nc\u{e9}").unwrap();
        assert_eq!(read_text(&path, 6).unwrap(), "ab\nc\u{e9}");
        assert_eq!(read_start(&path, 2).unwrap(), b"ab");
        let error = read(&path, 5).unwrap_err().to_string();
        assert!(error.contains("limit of 5 bytes") && error.contains(limits::RAISED), "{error}");
        std::fs::write(&path, b"ab\nc\xff").unwrap();
        assert!(read_text(&path, 6).unwrap_err().to_string().contains("line 2, byte 4"));
        assert_eq!(open(&path).unwrap().identity, identity_of(&std::fs::metadata(&path).unwrap()));
    }

    #[test]
    fn files_without_a_length_are_limited_too() {
        assert!(read(Path::new("/proc/self/maps"), 10).is_err());
        assert!(!read_text(Path::new("/proc/self/stat"), 4096).unwrap().is_empty());
    }

    #[test]
    fn a_file_of_holes_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("holes");
        File::create(&path).unwrap().set_len(1 << 40).unwrap();
        let error = read_start(&path, 10).unwrap_err().to_string();
        assert!(error.contains("only 0 bytes are stored"), "{error}");
        File::create(&path).unwrap().set_len(1 << 20).unwrap();
        assert_eq!(read(&path, 1 << 20).unwrap().len(), 1 << 20);
    }
}
