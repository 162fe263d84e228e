//! Where sound comes from and goes to: devices, or WAV files and named pipes in their place.

use std::os::unix::fs::FileTypeExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use sg_speech::audio::paced::PacedSink;
use sg_speech::audio::pcm::PcmLayout;
use sg_speech::audio::sink::{AudioSink, PipeSink, WavSink};
use sg_speech::audio::source::{AudioSource, Pace, PipeSource, WavSource};
use sg_speech::audio::{AudioError, check_rate};

#[cfg(feature = "devices")]
use crate::sound_devices::{DeviceSink, DeviceSource};

/// Longest file that is heard.
const LONGEST: Duration = Duration::from_secs(600);

/// A source or sink of sound, as a parameter names it: `device`, `device:NAME`, a path, or nothing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Place {
    /// A sound device: the default one, or one by its name.
    Device(Option<String>),
    /// A named pipe.
    Pipe(PathBuf),
    /// A WAV file.
    File(PathBuf),
}

impl Place {
    /// The place that a parameter names; none for an empty one.
    pub(crate) fn of(parameter: &str) -> Option<Self> {
        let is_pipe = |path: &Path| std::fs::metadata(path).is_ok_and(|metadata| metadata.file_type().is_fifo());
        let (kind, name) = parameter.split_once(':').unwrap_or((parameter, ""));
        match kind {
            "" if name.is_empty() => None,
            "device" => Some(Self::Device((!name.is_empty()).then(|| name.to_owned()))),
            _ if is_pipe(Path::new(parameter)) => Some(Self::Pipe(parameter.into())),
            _ => Some(Self::File(parameter.into())),
        }
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Device(None) => write!(f, "the default device"),
            Self::Device(Some(name)) => write!(f, "device {name}"),
            Self::Pipe(path) => write!(f, "pipe {}", path.display()),
            Self::File(path) => write!(f, "file {}", path.display()),
        }
    }
}

/// Opens a device, a named pipe of samples at this rate, or a WAV file, which plays as a microphone would.
///
/// # Errors
/// [`AudioError`]: absent, damaged, or a rate out of bounds.
pub(crate) fn input(place: &Place, rate: u32) -> Result<Box<dyn AudioSource>, AudioError> {
    Ok(match place {
        #[cfg(feature = "devices")]
        Place::Device(name) => Box::new(DeviceSource::open(name.as_deref())?),
        #[cfg(not(feature = "devices"))]
        Place::Device(_) => return Err(no_devices()),
        Place::Pipe(path) => Box::new(PipeSource::open(path, PcmLayout::mono(rate))?),
        Place::File(path) => Box::new(WavSource::open(path, LONGEST, Pace::RealTime)?),
    })
}

/// Opens the output for one reply: a device, a named pipe, or a WAV file with the newest reply.
///
/// # Errors
/// [`AudioError`]: no such device or folder, or a rate out of bounds.
pub(crate) fn output(place: &Place, rate: u32) -> Result<Box<dyn AudioSink>, AudioError> {
    check_rate(rate)?;
    Ok(match place {
        #[cfg(feature = "devices")]
        Place::Device(name) => Box::new(DeviceSink::open(name.as_deref())?),
        #[cfg(not(feature = "devices"))]
        Place::Device(_) => return Err(no_devices()),
        Place::Pipe(path) => Box::new(PacedSink::new(PipeSink::open(path, PcmLayout::mono(rate))?)),
        Place::File(path) => Box::new(WavSink::create(path, rate)?),
    })
}

/// The devices, a line each.
///
/// # Errors
/// One line: the system's sound does not answer, or this build has no devices.
pub(crate) fn names() -> Result<Vec<String>, String> {
    #[cfg(feature = "devices")]
    return crate::sound_devices::names();
    #[cfg(not(feature = "devices"))]
    Err(no_devices().to_string())
}

#[cfg(not(feature = "devices"))]
fn no_devices() -> AudioError {
    let problem = "this build has no sound devices; build supergaussian-speech with `--features devices` (on Debian install \
                   libasound2-dev), or name a pipe";
    AudioError::File { path: "device".into(), problem: problem.to_owned() }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

    use super::*;

    #[test]
    fn parameters_name_places() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("microphone");
        nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRWXU).unwrap();
        let said = |parameter: &str| Place::of(parameter).map(|place| place.to_string());
        assert_eq!(said(""), None);
        assert_eq!(said("device").unwrap(), "the default device");
        assert_eq!(said("device:alsa:hw:1,0").unwrap(), "device alsa:hw:1,0");
        assert_eq!(said("/tmp/a:b.wav").unwrap(), "file /tmp/a:b.wav");
        assert_eq!(said(pipe.to_str().unwrap()).unwrap(), format!("pipe {}", pipe.display()));
    }

    #[cfg(not(feature = "devices"))]
    #[test]
    fn a_build_without_devices_says_how_to_get_them() {
        let refused = input(&Place::Device(None), 16_000).err().unwrap().to_string();
        assert!(refused.contains("--features devices"), "{refused}");
    }
}
