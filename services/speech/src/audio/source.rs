//! Where sound comes from: a device, or a file or pipe in its place.

use std::fs::File;
use std::io::{ErrorKind, Read as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::pcm::{PcmDecoder, PcmLayout};
use super::wav::read_wav;
use super::{AudioError, Recording, duration_of, samples_in};

/// Period of checks for bytes in a pipe.
const POLL_PERIOD: Duration = Duration::from_millis(5);

/// Bytes that are read of a pipe at once.
const PIPE_BYTES: usize = 1 << 14;

/// The outcome of a read.
#[derive(Debug, Clone, PartialEq)]
pub enum Block {
    /// The next samples, at least one.
    Samples(Vec<f32>),
    /// Nothing has come within the time.
    Silent,
    /// The source has ended for good.
    Ended,
}

/// A source of mono samples at one rate.
pub trait AudioSource: Send {
    /// Samples a second.
    fn rate(&self) -> u32;

    /// The next samples, after at most about `wait`.
    ///
    /// # Errors
    /// [`AudioError`]: the source is gone.
    fn read(&mut self, wait: Duration) -> Result<Block, AudioError>;
}

/// How fast a file plays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// As a microphone would: each sample at its time.
    RealTime,
    /// At once, for measurements.
    Unpaced,
}

/// A WAV file in place of a microphone.
pub struct WavSource {
    recording: Recording,
    at: usize,
    pace: Pace,
    /// Time of the first read.
    begun: Option<Instant>,
}

impl WavSource {
    /// Length of its blocks.
    const BLOCK: Duration = Duration::from_millis(20);

    /// Opens a WAV file of at most `longest`.
    ///
    /// # Errors
    /// As [`read_wav`].
    pub fn open(path: &Path, longest: Duration, pace: Pace) -> Result<Self, AudioError> {
        Ok(Self::of(read_wav(path, longest)?, pace))
    }

    /// A source of samples in memory.
    #[must_use]
    pub fn of(recording: Recording, pace: Pace) -> Self {
        Self { recording, at: 0, pace, begun: None }
    }
}

impl AudioSource for WavSource {
    fn rate(&self) -> u32 {
        self.recording.rate
    }

    fn read(&mut self, wait: Duration) -> Result<Block, AudioError> {
        let length = self.recording.samples.len();
        if self.at >= length {
            return Ok(Block::Ended);
        }
        let end = (self.at + samples_in(Self::BLOCK, self.recording.rate).max(1)).min(length);
        let begun = *self.begun.get_or_insert_with(Instant::now);
        if self.pace == Pace::RealTime {
            let due = duration_of(end, self.recording.rate).saturating_sub(begun.elapsed());
            std::thread::sleep(due.min(wait));
            if due > wait {
                return Ok(Block::Silent);
            }
        }
        let block = self.recording.samples[self.at..end].to_vec();
        self.at = end;
        Ok(Block::Samples(block))
    }
}

/// A named pipe of raw samples in place of a microphone. Writers may come and go.
pub struct PipeSource {
    path: PathBuf,
    pipe: File,
    layout: PcmLayout,
    decoder: PcmDecoder,
}

impl PipeSource {
    /// Opens a named pipe. Its writer may come later.
    ///
    /// # Errors
    /// [`AudioError`]: no such pipe, something else than a pipe, or a layout out of bounds.
    pub fn open(path: &Path, layout: PcmLayout) -> Result<Self, AudioError> {
        layout.check()?;
        let pipe = sg_input::file::open_pipe(path).map_err(|error| AudioError::file(path, error))?;
        Ok(Self { path: path.to_owned(), pipe, layout, decoder: PcmDecoder::new(layout) })
    }
}

impl AudioSource for PipeSource {
    fn rate(&self) -> u32 {
        self.layout.rate
    }

    fn read(&mut self, wait: Duration) -> Result<Block, AudioError> {
        let begun = Instant::now();
        let mut bytes = [0; PIPE_BYTES];
        loop {
            match self.pipe.read(&mut bytes) {
                // No writer: the next one begins with a whole frame.
                Ok(0) => self.decoder.reset(),
                Ok(count) => {
                    let mut samples = Vec::new();
                    self.decoder.push(&bytes[..count], &mut samples);
                    if !samples.is_empty() {
                        return Ok(Block::Samples(samples));
                    }
                }
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
                Err(error) => return Err(AudioError::file(&self.path, error)),
            }
            let left = wait.saturating_sub(begun.elapsed());
            if left.is_zero() {
                return Ok(Block::Silent);
            }
            std::thread::sleep(left.min(POLL_PERIOD));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use nix::sys::stat::Mode;
    use nix::unistd::mkfifo;

    use super::*;
    use crate::audio::wav::write_wav;

    const WAIT: Duration = Duration::from_secs(10);

    #[test]
    fn a_file_is_read_once_and_in_real_time_if_asked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.wav");
        write_wav(&path, &Recording { rate: 16_000, samples: vec![0.25; 1_700] }).unwrap();
        let mut source = WavSource::open(&path, WAIT, Pace::Unpaced).unwrap();
        let mut count = 0;
        while let Block::Samples(block) = source.read(WAIT).unwrap() {
            count += block.len();
        }
        assert_eq!((count, source.read(WAIT).unwrap()), (1_700, Block::Ended));
        let mut paced = WavSource::open(&path, WAIT, Pace::RealTime).unwrap();
        let begun = Instant::now();
        assert_eq!(paced.read(Duration::ZERO).unwrap(), Block::Silent);
        while paced.read(WAIT).unwrap() != Block::Ended {}
        assert!(begun.elapsed() >= Duration::from_millis(100), "{:?}", begun.elapsed());
    }

    #[test]
    fn a_pipe_outlives_its_writers() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("microphone");
        mkfifo(&path, Mode::S_IRWXU).unwrap();
        let mut source = PipeSource::open(&path, PcmLayout::mono(16_000)).unwrap();
        assert_eq!(source.read(Duration::from_millis(20)).unwrap(), Block::Silent);
        for value in [1_000_i16, -2_000] {
            let writer = std::thread::spawn({
                let path = path.clone();
                move || {
                    let mut pipe = std::fs::OpenOptions::new().write(true).open(path).unwrap();
                    // The last byte is half a sample: it must not shift what the next writer says.
                    let bytes: Vec<u8> = (0..100).flat_map(|_| value.to_le_bytes()).chain([7]).collect();
                    pipe.write_all(&bytes).unwrap();
                }
            });
            let mut samples = Vec::new();
            let begun = Instant::now();
            while samples.len() < 100 && begun.elapsed() < WAIT {
                if let Block::Samples(block) = source.read(WAIT).unwrap() {
                    samples.extend(block);
                }
            }
            writer.join().unwrap();
            assert_eq!(samples, vec![f32::from(value) / 32_768.0; 100]);
            assert_eq!(source.read(Duration::from_millis(20)).unwrap(), Block::Silent);
        }
    }

    #[test]
    fn only_a_pipe_is_a_pipe() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "x").unwrap();
        let refused = |path: &Path| PipeSource::open(path, PcmLayout::mono(16_000)).err().unwrap().to_string();
        assert!(refused(&path).ends_with("it is a regular file, not a named pipe; `mkfifo` makes one"));
        assert!(refused(&folder.path().join("none")).contains("No such file"));
        assert!(PipeSource::open(&path, PcmLayout::mono(3)).is_err());
    }
}
