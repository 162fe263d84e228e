//! Sound as mono samples: files, pipes, resampling, level.
//!
//! A sample is an `f32` between −1 and 1. A block is any number of samples of one channel, in the order of time.

pub mod level;
pub mod paced;
pub mod pcm;
pub mod resample;
pub mod sink;
pub mod source;
pub mod wav;

use std::path::PathBuf;
use std::time::Duration;

/// Rate of all samples that detectors and recognizers take, in hertz.
pub const SPEECH_RATE: u32 = 16_000;

/// Lowest and highest rate that is read, in hertz.
pub const RATES: std::ops::RangeInclusive<u32> = 4_000..=192_000;

/// Most channels that are read. They are averaged.
pub const MAX_CHANNELS: u16 = 8;

/// Mono samples with their rate.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// Samples a second.
    pub rate: u32,
    /// Samples between −1 and 1, in the order of time.
    pub samples: Vec<f32>,
}

impl Recording {
    /// Its length.
    #[must_use]
    pub fn duration(&self) -> Duration {
        duration_of(self.samples.len(), self.rate)
    }
}

/// Time that samples of one channel take; zero for a rate of zero.
#[must_use]
pub fn duration_of(samples: usize, rate: u32) -> Duration {
    if rate == 0 { Duration::ZERO } else { Duration::from_secs_f64(samples as f64 / f64::from(rate)) }
}

/// Samples of one channel in this time, rounded down.
#[must_use]
pub fn samples_in(time: Duration, rate: u32) -> usize {
    let samples = time.as_nanos() * u128::from(rate) / 1_000_000_000;
    usize::try_from(samples).unwrap_or(usize::MAX)
}

/// Why sound was not read, written or converted. Each message is one line with the file and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum AudioError {
    /// A file or pipe is absent, damaged, too long or not what its name says.
    #[error("{}: {problem}", .path.display())]
    File {
        /// The file or pipe.
        path: PathBuf,
        /// What is wrong, and the remedy.
        problem: String,
    },
    /// A rate is out of bounds.
    #[error("a rate of {0} Hz is not supported; take {low} to {high} Hz", low = RATES.start(), high = RATES.end())]
    Rate(u32),
    /// A number of channels is out of bounds.
    #[error("{0} channels are not supported; take 1 to {MAX_CHANNELS}")]
    Channels(u16),
    /// The resampling library has refused its own parameters.
    #[error("resampling from {from} to {to} Hz failed: {problem}")]
    Resample {
        /// Rate of the input in hertz.
        from: u32,
        /// Rate of the output in hertz.
        to: u32,
        /// What the library said.
        problem: String,
    },
}

impl AudioError {
    pub(crate) fn file(path: &std::path::Path, problem: impl std::fmt::Display) -> Self {
        Self::File { path: path.to_owned(), problem: problem.to_string() }
    }
}

/// Checks a rate against [`RATES`].
///
/// # Errors
/// [`AudioError::Rate`].
pub fn check_rate(rate: u32) -> Result<(), AudioError> {
    if RATES.contains(&rate) { Ok(()) } else { Err(AudioError::Rate(rate)) }
}

/// A sample that every part of this crate can take: not a number becomes silence, the rest is clamped to −1 … 1.
#[must_use]
pub fn sane(sample: f32) -> f32 {
    if sample.is_nan() { 0.0 } else { sample.clamp(-1.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_in_time_and_samples_agree() {
        assert_eq!(duration_of(8_000, 16_000), Duration::from_millis(500));
        assert_eq!(duration_of(8_000, 0), Duration::ZERO);
        assert_eq!(samples_in(Duration::from_millis(500), 16_000), 8_000);
        assert_eq!(samples_in(Duration::MAX, u32::MAX), usize::MAX);
    }

    #[test]
    fn samples_become_sane() {
        assert_eq!([f32::NAN, f32::INFINITY, -7.0, 0.25].map(sane), [0.0, 1.0, -1.0, 0.25]);
    }
}
