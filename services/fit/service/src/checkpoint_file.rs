//! The file of a training's state, beside its scene.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use sg_fit::training::Training;
use sg_fit::training::checkpoint::{Checkpoint, Origin};
use sg_formats::staged_file::StagedFile;
use sg_input::file;
use sg_input::print::status as print_line;

use crate::failure::{Failure, input};

/// The place of the checkpoint in the folder of the scene.
pub(crate) fn checkpoint_path(folder: &Path) -> PathBuf {
    folder.join("training.checkpoint")
}

/// The file, and when it was written.
pub(crate) struct CheckpointFile {
    path: PathBuf,
    origin: Origin,
    /// Time between two checkpoints; `None` for no regular ones.
    period: Option<Duration>,
    newest: Instant,
    has_failed: bool,
}

impl CheckpointFile {
    /// The file of a training. `period` is in seconds, 0 for no regular checkpoints.
    pub(crate) fn new(folder: &Path, origin: Origin, period: u32) -> Self {
        let period = (period > 0).then(|| Duration::from_secs(period.into()));
        Self { path: checkpoint_path(folder), origin, period, newest: Instant::now(), has_failed: false }
    }

    /// Reads what an interrupted training has left.
    pub(crate) fn read(&self) -> Result<Checkpoint, Failure> {
        let refused = |what: &dyn std::fmt::Display| {
            let remedy = "give the command of the interrupted training, or leave --resume out to begin anew";
            input(format!("{}: {what}; {remedy}", self.path.display()))
        };
        let bytes = file::read(&self.path, self.origin.most_bytes()).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => refused(&"there is no checkpoint"),
            _ => refused(&error),
        })?;
        Checkpoint::read(&bytes, &self.origin).map_err(|error| refused(&error))
    }

    /// Says that the checkpoint of another run will be replaced, if there is one.
    pub(crate) fn note_other(&self) {
        if self.path.exists() {
            print_line(&format!("note: {} of an interrupted training will be replaced", self.path.display()));
        }
    }

    /// Writes a checkpoint if the newest one is old.
    pub(crate) fn keep_if_due(&mut self, training: &Training<'_>) {
        if self.period.is_some_and(|period| self.newest.elapsed() >= period) && !training.is_over() {
            self.keep(training);
        }
    }

    /// Writes a checkpoint; false if that failed. The training goes on without, and the first failure is told.
    pub(crate) fn keep(&mut self, training: &Training<'_>) -> bool {
        let written = self.write(training);
        // The next one is due a whole period after the end of a slow write.
        self.newest = Instant::now();
        if let Err(error) = &written
            && !self.has_failed
        {
            self.has_failed = true;
            print_line(&format!("note: {}: {error}; the training has no checkpoint", self.path.display()));
        }
        written.is_ok()
    }

    fn write(&self, training: &Training<'_>) -> io::Result<()> {
        if let Some(folder) = self.path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        let mut file = StagedFile::create(&self.path)?;
        training.write_checkpoint(&mut file, &self.origin)?;
        file.commit().map(drop)
    }

    /// Removes the file.
    pub(crate) fn remove(&self) {
        if let Err(error) = std::fs::remove_file(&self.path)
            && error.kind() != io::ErrorKind::NotFound
        {
            print_line(&format!("note: {}: {error}; the checkpoint is of no more use", self.path.display()));
        }
    }
}
