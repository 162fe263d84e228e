//! Where a reply goes: a device, or a file or pipe in its place.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use super::pcm::PcmLayout;
use super::wav::{WavStream, part_beside};
use super::{AudioError, samples_in};

/// Longest file that a [`WavSink`] writes, in seconds.
const MAX_SECONDS: u64 = 3_600;

/// Takes mono samples at one rate.
pub trait AudioSink: Send {
    /// Samples a second.
    fn rate(&self) -> u32;

    /// Takes the next samples. May wait as long as they play.
    ///
    /// # Errors
    /// [`AudioError`]: the sink is gone or full.
    fn write(&mut self, block: &[f32]) -> Result<(), AudioError>;

    /// Drops what was taken but has not yet been heard, as for barge-in.
    fn stop(&mut self);

    /// Waits until all has been heard, or puts the file in place.
    ///
    /// # Errors
    /// As [`AudioSink::write`].
    fn finish(&mut self) -> Result<(), AudioError>;
}

/// A WAV file in place of a loudspeaker. It stands at its path after [`AudioSink::finish`].
pub struct WavSink {
    path: PathBuf,
    rate: u32,
    part: Option<(tempfile::TempPath, WavStream<BufWriter<File>>)>,
    /// Samples that still fit.
    room: u64,
}

impl WavSink {
    /// A sink of samples at this rate.
    ///
    /// # Errors
    /// [`AudioError`]: the folder cannot be written to, or a rate out of bounds.
    pub fn create(path: &Path, rate: u32) -> Result<Self, AudioError> {
        let (file, part) = part_beside(path)?.into_parts();
        let stream = WavStream::new(BufWriter::new(file), rate).map_err(|problem| AudioError::file(path, problem))?;
        Ok(Self { path: path.to_owned(), rate, part: Some((part, stream)), room: u64::from(rate) * MAX_SECONDS })
    }
}

impl AudioSink for WavSink {
    fn rate(&self) -> u32 {
        self.rate
    }

    fn write(&mut self, block: &[f32]) -> Result<(), AudioError> {
        let Some((_, stream)) = self.part.as_mut() else {
            return Err(AudioError::file(&self.path, "the file is finished already"));
        };
        self.room = self.room.checked_sub(block.len() as u64).ok_or_else(|| {
            AudioError::file(&self.path, format!("longer than the limit of {MAX_SECONDS} s; begin another file"))
        })?;
        stream.write(block).map_err(|problem| AudioError::file(&self.path, problem))
    }

    fn stop(&mut self) {}

    fn finish(&mut self) -> Result<(), AudioError> {
        let Some((part, stream)) = self.part.take() else { return Ok(()) };
        stream.finish().map_err(|problem| AudioError::file(&self.path, problem))?;
        part.persist(&self.path).map_err(|error| AudioError::file(&self.path, error.error))
    }
}

/// A named pipe in place of a loudspeaker: raw mono samples. Without a reader, samples are dropped and counted.
pub struct PipeSink {
    path: PathBuf,
    layout: PcmLayout,
    pipe: Option<File>,
    dropped: u64,
    /// Bytes of a frame that the pipe had no room for.
    rest: Vec<u8>,
}

impl PipeSink {
    /// A sink that looks for a reader at each write.
    ///
    /// # Errors
    /// [`AudioError`]: something else than a pipe, or a layout out of bounds.
    pub fn open(path: &Path, layout: PcmLayout) -> Result<Self, AudioError> {
        layout.check()?;
        // Opened for reading to look at its kind; the descriptor goes at once.
        sg_input::file::open_pipe(path).map_err(|error| AudioError::file(path, error))?;
        Ok(Self { path: path.to_owned(), layout, pipe: None, dropped: 0, rest: Vec::new() })
    }

    /// Samples that nobody has read.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    fn reader(&mut self) -> Option<&mut File> {
        use std::os::unix::fs::OpenOptionsExt as _;
        if self.pipe.is_none() {
            let flags = nix::fcntl::OFlag::O_NONBLOCK | nix::fcntl::OFlag::O_CLOEXEC;
            // Without a reader the system refuses to open it.
            self.pipe = std::fs::OpenOptions::new().write(true).custom_flags(flags.bits()).open(&self.path).ok();
            self.rest.clear();
        }
        self.pipe.as_mut()
    }
}

impl AudioSink for PipeSink {
    fn rate(&self) -> u32 {
        self.layout.rate
    }

    /// Writes what the pipe has room for; the rest is dropped. A slow reader hears gaps, and nobody waits for it.
    fn write(&mut self, block: &[f32]) -> Result<(), AudioError> {
        let size = self.layout.frame_bytes().max(1);
        let mut bytes = std::mem::take(&mut self.rest);
        let (layout, began) = (self.layout, bytes.len());
        bytes.extend(layout.encode(block));
        let Some(pipe) = self.reader() else {
            self.dropped += block.len() as u64;
            return Ok(());
        };
        // Pieces of one page, which a pipe takes whole or not at all (POSIX, PIPE_BUF).
        let mut sent = 0;
        let mut gone = false;
        for piece in bytes.chunks(4_096 / size * size) {
            match pipe.write(piece) {
                Ok(count) if count == piece.len() => sent += count,
                Ok(count) => {
                    sent += count;
                    break;
                }
                Err(error) => {
                    gone = error.kind() != std::io::ErrorKind::WouldBlock;
                    break;
                }
            }
        }
        if gone {
            self.pipe = None;
        } else {
            // The end of a frame that was begun must follow, or all later samples are shifted.
            let split = sent.div_ceil(size) * size;
            self.rest = bytes.get(sent..split.min(bytes.len())).unwrap_or_default().to_vec();
        }
        let unsent = bytes.len().saturating_sub(sent.max(began)) / size;
        self.dropped += unsent as u64;
        Ok(())
    }

    fn stop(&mut self) {}

    fn finish(&mut self) -> Result<(), AudioError> {
        Ok(())
    }
}

/// Gathers a reply in memory, up to a minute: for tests and measurements.
#[derive(Debug, Clone, Default)]
pub struct MemorySink {
    /// What was written since the start or the last stop.
    pub samples: Vec<f32>,
    /// Number of stops.
    pub stops: usize,
    rate: u32,
}

impl MemorySink {
    /// An empty sink.
    #[must_use]
    pub fn new(rate: u32) -> Self {
        Self { samples: Vec::new(), stops: 0, rate }
    }
}

impl AudioSink for MemorySink {
    fn rate(&self) -> u32 {
        self.rate
    }

    fn write(&mut self, block: &[f32]) -> Result<(), AudioError> {
        let most = samples_in(std::time::Duration::from_secs(60), self.rate);
        let room = most.saturating_sub(self.samples.len());
        self.samples.extend(block.iter().take(room));
        Ok(())
    }

    fn stop(&mut self) {
        self.stops += 1;
    }

    fn finish(&mut self) -> Result<(), AudioError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;
    use std::time::Duration;

    use nix::sys::stat::Mode;
    use nix::unistd::mkfifo;

    use super::*;
    use crate::audio::wav::{MAX_DURATION, read_wav};

    #[test]
    fn a_file_stands_there_when_it_is_finished() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("reply.wav");
        let mut sink = WavSink::create(&path, 22_050).unwrap();
        sink.write(&[0.5; 100]).unwrap();
        sink.write(&[-0.5; 100]).unwrap();
        assert!(!path.exists());
        sink.finish().unwrap();
        let read = read_wav(&path, MAX_DURATION).unwrap();
        assert_eq!((read.rate, read.samples.len()), (22_050, 200));
        assert!(sink.write(&[0.0]).is_err() && sink.finish().is_ok());
        drop(WavSink::create(&folder.path().join("other.wav"), 16_000).unwrap());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        assert!(WavSink::create(Path::new("/no/such/folder/a.wav"), 16_000).is_err());
    }

    #[test]
    fn a_pipe_never_waits_for_its_reader() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("loudspeaker");
        mkfifo(&path, Mode::S_IRWXU).unwrap();
        let mut sink = PipeSink::open(&path, PcmLayout::mono(16_000)).unwrap();
        sink.write(&[0.1; 50]).unwrap();
        assert_eq!(sink.dropped(), 50);
        let mut reader = sg_input::file::open_pipe(&path).unwrap();
        sink.write(&[0.5; 50]).unwrap();
        let mut bytes = [0; 200];
        assert_eq!(reader.read(&mut bytes).unwrap(), 100);
        // More than a pipe holds.
        let begun = std::time::Instant::now();
        sink.write(&vec![0.0; 1 << 20]).unwrap();
        assert!(begun.elapsed() < Duration::from_secs(1) && sink.dropped() > 900_000, "{}", sink.dropped());
        drop(reader);
        let before = sink.dropped();
        sink.write(&[0.0; 10]).unwrap();
        assert_eq!(sink.dropped(), before + 10);
    }
}
