//! Where sound comes from and goes to: WAV files and named pipes in place of devices.

use std::os::unix::fs::FileTypeExt as _;
use std::path::Path;
use std::time::Duration;

use sg_speech::audio::paced::PacedSink;
use sg_speech::audio::pcm::PcmLayout;
use sg_speech::audio::sink::{AudioSink, PipeSink, WavSink};
use sg_speech::audio::source::{AudioSource, Pace, PipeSource, WavSource};
use sg_speech::audio::{AudioError, check_rate};

/// Longest file that is heard.
const LONGEST: Duration = Duration::from_secs(600);

/// What a path is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Pipe,
    File,
}

fn kind_of(path: &Path) -> Kind {
    let is_pipe = std::fs::metadata(path).is_ok_and(|metadata| metadata.file_type().is_fifo());
    if is_pipe { Kind::Pipe } else { Kind::File }
}

/// The path with its kind, for a person.
pub(crate) fn description(path: &Path) -> String {
    let kind = match kind_of(path) {
        Kind::Pipe => "pipe",
        Kind::File => "file",
    };
    format!("{kind} {}", path.display())
}

/// Opens a WAV file, which plays as a microphone would, or a named pipe.
///
/// # Errors
/// [`AudioError`]: absent, damaged, or a rate out of bounds.
pub(crate) fn input(path: &Path, rate: u32) -> Result<Box<dyn AudioSource>, AudioError> {
    Ok(match kind_of(path) {
        Kind::Pipe => Box::new(PipeSource::open(path, PcmLayout::mono(rate))?),
        Kind::File => Box::new(WavSource::open(path, LONGEST, Pace::RealTime)?),
    })
}

/// Opens the output for one reply: a named pipe, or a WAV file with the newest reply.
///
/// # Errors
/// [`AudioError`]: no such folder, or a rate out of bounds.
pub(crate) fn output(path: &Path, rate: u32) -> Result<Box<dyn AudioSink>, AudioError> {
    check_rate(rate)?;
    Ok(match kind_of(path) {
        Kind::Pipe => Box::new(PacedSink::new(PipeSink::open(path, PcmLayout::mono(rate))?)),
        Kind::File => Box::new(WavSink::create(path, rate)?),
    })
}
