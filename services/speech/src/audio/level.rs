//! A level meter: loudness and peak, as panels show them.

use std::time::Duration;

use super::{samples_in, sane};

/// Level of silence, in decibels of full scale: one step of 16 bits is −90 dB.
pub const SILENCE_DB: f32 = -100.0;

/// Time constant of the loudness, as of a VU meter (IEC 60268-17).
const RMS_TIME: Duration = Duration::from_millis(300);

/// Fall of the peak, in decibels a second, as of a peak programme meter (IEC 60268-10, type I).
const PEAK_FALL_DB: f32 = 20.0 / 1.7;

/// Decibels of an amplitude, where 1 is full scale.
#[must_use]
pub fn decibels(amplitude: f32) -> f32 {
    if amplitude > 0.0 { (20.0 * amplitude.log10()).max(SILENCE_DB) } else { SILENCE_DB }
}

/// Loudness and peak in decibels of full scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// Root mean square over about 300 ms.
    pub rms_db: f32,
    /// Highest sample, falling slowly.
    pub peak_db: f32,
}

/// Meter of one stream. Its reading does not depend on how the stream is cut into blocks.
#[derive(Debug, Clone)]
pub struct LevelMeter {
    mean_square: f64,
    peak: f32,
    weight: f64,
    fall: f32,
}

impl LevelMeter {
    /// A meter of silence for samples at this rate.
    #[must_use]
    pub fn new(rate: u32) -> Self {
        let weight = 1.0 / samples_in(RMS_TIME, rate).max(1) as f64;
        let fall = 10_f32.powf(-PEAK_FALL_DB / 20.0 / rate.max(1) as f32);
        Self { mean_square: 0.0, peak: 0.0, weight, fall }
    }

    /// Takes the next samples.
    pub fn push(&mut self, block: &[f32]) {
        for sample in block {
            let sample = sane(*sample);
            self.mean_square += (f64::from(sample * sample) - self.mean_square) * self.weight;
            self.peak = (self.peak * self.fall).max(sample.abs());
        }
    }

    /// The reading now.
    #[must_use]
    pub fn level(&self) -> Level {
        Level { rms_db: decibels(self.mean_square.sqrt() as f32), peak_db: decibels(self.peak) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(amplitude: f32, seconds: usize) -> Vec<f32> {
        (0..16_000 * seconds).map(|n| amplitude * (n as f32 * 0.05).sin()).collect()
    }

    #[test]
    fn a_sine_has_its_level_and_silence_none() {
        let mut meter = LevelMeter::new(16_000);
        assert_eq!(meter.level(), Level { rms_db: SILENCE_DB, peak_db: SILENCE_DB });
        meter.push(&sine(0.5, 3));
        let level = meter.level();
        assert!((level.rms_db - (-9.03)).abs() < 0.1, "{level:?}");
        assert!((level.peak_db - (-6.02)).abs() < 0.1, "{level:?}");
        meter.push(&vec![0.0; 16_000]);
        let later = meter.level();
        assert!((level.peak_db - later.peak_db - PEAK_FALL_DB).abs() < 0.2, "{later:?}");
        assert!(level.rms_db - later.rms_db > 14.0, "{later:?}");
    }

    #[test]
    fn blocks_of_any_length_give_one_reading_and_nonsense_does_not_stick() {
        let sound = sine(0.3, 1);
        let (mut whole, mut parts) = (LevelMeter::new(16_000), LevelMeter::new(16_000));
        whole.push(&sound);
        sound.chunks(37).for_each(|chunk| parts.push(chunk));
        assert_eq!(whole.level(), parts.level());
        whole.push(&[f32::NAN, f32::INFINITY]);
        assert!(whole.level().rms_db.is_finite());
    }
}
