//! Log files of services and supervisors: bounded, with a few previous generations, readable while they are written.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use sg_input::file;

/// Size at which a log is rotated.
const MAX_BYTES: u64 = 4 << 20;
/// Number of previous generations. Each start of a stack begins one, so the log of a crash outlives several starts.
const GENERATIONS: usize = 5;

/// A log that a supervisor writes.
#[derive(Debug)]
pub(crate) struct LogFile {
    path: PathBuf,
    file: Option<File>,
    bytes: u64,
    /// Lines lost so far.
    lost: u64,
}

/// Path of the log of a service.
pub fn path_of(folder: &Path, service: &str) -> PathBuf {
    folder.join(format!("{service}.log"))
}

/// Path of a previous generation: 1 is the newest.
fn previous_path(path: &Path, generation: usize) -> PathBuf {
    path.with_extension(format!("log.{generation}"))
}

/// All generations that may exist, oldest first.
fn generations(path: &Path) -> impl Iterator<Item = PathBuf> {
    (1..=GENERATIONS).rev().map(|generation| previous_path(path, generation)).chain([path.to_owned()])
}

impl LogFile {
    /// Starts a new log. An existing one becomes the previous generation.
    pub(crate) fn create(path: PathBuf) -> Self {
        let mut log = Self { path, file: None, bytes: 0, lost: 0 };
        log.rotate();
        log
    }

    fn rotate(&mut self) {
        // An empty log is no generation of its own.
        if std::fs::symlink_metadata(&self.path).is_ok_and(|m| m.len() > 0) {
            let paths: Vec<_> = generations(&self.path).collect();
            for (older, newer) in paths.iter().zip(paths.iter().skip(1)) {
                // A missing log cannot be renamed. Other errors show when the new file is created.
                let _ = std::fs::rename(newer, older);
            }
        }
        self.file = File::create(&self.path).ok();
        self.bytes = 0;
    }

    /// Writes a line. The error is the number of lines lost so far, for example on a full disk.
    pub(crate) fn line(&mut self, line: &str) -> Result<(), u64> {
        if self.file.is_none() || self.bytes >= MAX_BYTES {
            self.rotate();
        }
        let written = self.file.as_mut().is_some_and(|f| f.write_all(format!("{line}\n").as_bytes()).is_ok());
        if written {
            self.bytes += line.len() as u64 + 1;
            return Ok(());
        }
        self.lost += 1;
        Err(self.lost)
    }
}

/// Reads a log across rotations.
#[derive(Debug)]
pub struct LogReader {
    path: PathBuf,
    file: Option<BufReader<File>>,
    inode: u64,
    part: String,
}

impl LogReader {
    /// A reader that begins with the oldest generation.
    pub fn open(path: PathBuf) -> Self {
        Self { path, file: None, inode: 0, part: String::new() }
    }

    /// The generation after the present one.
    fn next_generation(&self) -> Option<PathBuf> {
        let existing = |path: PathBuf| Some((std::fs::symlink_metadata(&path).ok()?.ino(), path));
        let all: Vec<_> = generations(&self.path).filter_map(existing).collect();
        // The open file keeps its inode number from being reused. A generation that is gone was older than all others.
        let present = all.iter().position(|(inode, _)| self.file.is_some() && *inode == self.inode);
        all.into_iter().nth(present.map_or(0, |index| index + 1)).map(|(_, path)| path)
    }

    fn attach(&mut self, path: &Path) -> bool {
        let Ok(opened) = file::open(path) else { return false };
        self.inode = opened.identity.1;
        self.file = Some(BufReader::new(opened.file));
        true
    }

    /// Complete lines since the last call.
    ///
    /// # Errors
    /// The log cannot be read.
    pub fn lines(&mut self) -> io::Result<Vec<String>> {
        let mut lines = Vec::new();
        loop {
            self.read_into(&mut lines)?;
            // Finish this generation before the next one begins.
            let Some(next) = self.next_generation() else { return Ok(lines) };
            self.read_into(&mut lines)?;
            if !self.attach(&next) {
                return Ok(lines);
            }
        }
    }

    fn read_into(&mut self, lines: &mut Vec<String>) -> io::Result<()> {
        let Some(file) = &mut self.file else { return Ok(()) };
        let mut bytes = Vec::new();
        while file.by_ref().take(MAX_BYTES).read_until(b'\n', &mut bytes)? > 0 {
            self.part.push_str(&String::from_utf8_lossy(&bytes));
            if self.part.ends_with('\n') {
                self.part.pop();
                lines.push(std::mem::take(&mut self.part));
            }
            bytes.clear();
        }
        // A buffered reader does not read past an earlier end of file. Seek to reset it.
        let at = file.stream_position()?;
        file.seek(SeekFrom::Start(at))?;
        Ok(())
    }
}

/// Names of the services and supervisors that have a log in this folder, sorted.
pub fn services(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<_> =
        entries.filter_map(|e| e.file_name().into_string().ok()?.strip_suffix(".log").map(str::to_owned)).collect();
    names.sort();
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_is_bounded_and_a_reader_misses_nothing_at_a_rotation() {
        let folder = tempfile::tempdir().unwrap();
        let path = path_of(folder.path(), "scene");
        let mut log = LogFile::create(path.clone());
        let mut reader = LogReader::open(path.clone());
        let line = "y".repeat(100_000);
        let mut seen = 0;
        for i in 0..200 {
            log.line(&format!("{i} {line}")).unwrap();
            if i % 7 == 0 {
                seen += reader.lines().unwrap().len();
            }
        }
        seen += reader.lines().unwrap().len();
        assert_eq!(seen, 200);
        let sizes: Vec<_> = generations(&path).map(|p| std::fs::metadata(p).map_or(0, |m| m.len())).collect();
        assert!(sizes.iter().all(|s| *s <= MAX_BYTES + 200_000), "{sizes:?}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), sizes.iter().filter(|s| **s > 0).count());
        assert_eq!(services(folder.path()), ["scene"]);
    }

    #[test]
    fn the_log_of_a_crash_outlives_several_starts_and_is_read_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = path_of(folder.path(), "scene");
        for start in 0..=GENERATIONS {
            LogFile::create(path.clone()).line(&format!("start {start}")).unwrap();
            // A start that says nothing takes no generation.
            drop(LogFile::create(path.clone()));
        }
        let lines = LogReader::open(path.clone()).lines().unwrap();
        let all: Vec<_> = (1..=GENERATIONS).map(|start| format!("start {start}")).collect();
        assert!(lines.ends_with(&all) && lines.len() <= GENERATIONS + 1, "{lines:?}");
    }

    #[test]
    fn a_line_is_read_once_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = path_of(folder.path(), "a");
        std::fs::write(&path, "one\ntw").unwrap();
        let mut reader = LogReader::open(path.clone());
        assert_eq!(reader.lines().unwrap(), ["one"]);
        std::fs::OpenOptions::new().append(true).open(&path).unwrap().write_all(b"o\n").unwrap();
        assert_eq!(reader.lines().unwrap(), ["two"]);
        assert_eq!(reader.lines().unwrap(), Vec::<String>::new());
    }

    #[test]
    fn unwritable_log_counts_lost_lines() {
        let folder = tempfile::tempdir().unwrap();
        let mut log = LogFile::create(folder.path().join("no/such/folder.log"));
        assert_eq!(log.line("x"), Err(1));
        assert_eq!(log.line("x"), Err(2));
    }
}
