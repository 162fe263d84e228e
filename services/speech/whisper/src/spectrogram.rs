//! The log-mel spectrogram that Whisper hears (Radford et al. 2022, section 2.2).
//!
//! Frames of 25 ms every 10 ms are weighted by a Hann window. Their power is summed in triangular bands of equal steps on Slaney's mel
//! scale. Its logarithm is cut 8 decades below the loudest value, and scaled to about −1 to 1.

use std::f64::consts::PI;
use std::sync::Arc;

use rayon::prelude::*;
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};

use crate::error::WhisperError;

/// Samples in a second.
pub const SAMPLE_RATE: usize = 16_000;
/// Samples of a frame.
const FRAME: usize = 400;
/// Samples between the starts of frames.
const HOP: usize = 160;
/// Frequencies of a frame's spectrum.
const FREQUENCIES: usize = FRAME / 2 + 1;
/// Power below which there is silence.
const FLOOR: f64 = 1e-10;
/// Decades below the loudest value that are heard.
const RANGE: f64 = 8.0;
/// Frames of the spectrogram for one frame of the encoder, whose second convolution has a stride of 2.
pub(crate) const FRAMES_OF_CONTEXT: usize = 2;
/// Samples for one frame of the encoder.
pub(crate) const SAMPLES_OF_CONTEXT: usize = FRAMES_OF_CONTEXT * HOP;

/// Log-mel values, frame by frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrogram {
    /// Number of mel bands.
    pub bands: usize,
    /// Number of frames.
    pub frames: usize,
    /// `frames` × `bands` values, a frame's bands one behind the other.
    pub values: Vec<f32>,
}

/// Computes spectrograms with one number of bands.
pub struct MelFilters {
    window: Vec<f64>,
    transform: Arc<dyn Fft<f64>>,
    bands: Vec<Band>,
}

/// A triangle over neighbouring frequencies.
struct Band {
    first: usize,
    weights: Vec<f64>,
}

impl MelFilters {
    /// Filters for `bands` mel bands from 0 to 8 kHz: 80 for tiny to large-v2, 128 for large-v3.
    #[must_use]
    pub fn new(bands: usize) -> Self {
        let window = (0..FRAME).map(|at| 0.5 - 0.5 * (2.0 * PI * at as f64 / FRAME as f64).cos()).collect();
        Self { window, transform: FftPlanner::new().plan_fft_forward(FRAME), bands: triangles(bands) }
    }

    /// The spectrogram of a sound at 16 kHz, followed by silence up to `frames` frames. What lies behind them is not heard.
    ///
    /// # Errors
    /// [`WhisperError::Sound`] for a sample that is not finite.
    pub fn spectrogram(&self, samples: &[f32], frames: usize) -> Result<Spectrogram, WhisperError> {
        if let Some(at) = samples.iter().position(|sample| !sample.is_finite()) {
            let problem = format!("sample {at} is {}; give finite samples from -1 to 1", samples[at]);
            return Err(WhisperError::Sound(problem));
        }
        let length = frames * HOP;
        let samples = &samples[..samples.len().min(length)];
        // Frames from here on see silence alone. Those at the very end mirror what lies before them.
        let heard = (samples.len() + FRAME / 2).div_ceil(HOP).min(frames);
        let mirrored = (length - FRAME / 2) / HOP;
        let bands = self.bands.len();
        let mut powers = vec![FLOOR; frames * bands];
        let sample = |at: isize| {
            let last = length as isize - 1;
            let at = if at < 0 {
                -at
            } else if at > last {
                2 * last - at
            } else {
                at
            };
            usize::try_from(at).ok().and_then(|at| samples.get(at)).map_or(0.0, |sample| f64::from(*sample))
        };
        powers.par_chunks_mut(bands).enumerate().filter(|(at, _)| *at < heard || *at >= mirrored).for_each_init(
            || (vec![Complex::default(); FRAME], vec![Complex::default(); self.transform.get_inplace_scratch_len()]),
            |(frame, scratch), (at, powers)| {
                // Frames are centred at multiples of the hop.
                let start = (at * HOP) as isize - (FRAME / 2) as isize;
                for (offset, (value, weight)) in frame.iter_mut().zip(&self.window).enumerate() {
                    *value = Complex::new(sample(start + offset as isize) * weight, 0.0);
                }
                self.transform.process_with_scratch(frame, scratch);
                for (power, band) in powers.iter_mut().zip(&self.bands) {
                    let spectrum = &frame[band.first..][..band.weights.len()];
                    let sum: f64 =
                        spectrum.iter().zip(&band.weights).map(|(value, weight)| value.norm_sqr() * weight).sum();
                    *power = sum.max(FLOOR);
                }
            },
        );
        powers.par_iter_mut().for_each(|power| *power = power.log10());
        let loudest = powers.iter().copied().fold(FLOOR.log10(), f64::max);
        let values = powers.iter().map(|power| ((power.max(loudest - RANGE) + 4.0) / 4.0) as f32).collect();
        Ok(Spectrogram { bands, frames, values })
    }
}

/// Mel of hertz: linear up to 1 kHz, logarithmic above.
fn mel(hertz: f64) -> f64 {
    if hertz < 1000.0 { hertz * 3.0 / 200.0 } else { 15.0 + (hertz / 1000.0).ln() * 27.0 / 6.4_f64.ln() }
}

fn hertz(mel: f64) -> f64 {
    if mel < 15.0 { mel * 200.0 / 3.0 } else { 1000.0 * ((mel - 15.0) * 6.4_f64.ln() / 27.0).exp() }
}

/// Triangles of equal area, whose corners have equal steps in mel.
fn triangles(bands: usize) -> Vec<Band> {
    let top = mel(SAMPLE_RATE as f64 / 2.0);
    let corner = |at: usize| hertz(top * at as f64 / (bands + 1) as f64);
    let step = SAMPLE_RATE as f64 / FRAME as f64;
    let band = |at: usize| {
        let [low, middle, high] = [corner(at), corner(at + 1), corner(at + 2)];
        let weight = |frequency: usize| {
            let hertz = frequency as f64 * step;
            let height = ((hertz - low) / (middle - low)).min((high - hertz) / (high - middle));
            height.max(0.0) * 2.0 / (high - low)
        };
        let inside = |frequency: &usize| weight(*frequency) > 0.0;
        let first = (0..FREQUENCIES).find(inside).unwrap_or_default();
        Band { first, weights: (first..FREQUENCIES).map(weight).take_while(|weight| *weight > 0.0).collect() }
    };
    (0..bands).map(band).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tone_is_loudest_in_its_band() {
        let filters = MelFilters::new(80);
        for frequency in [300.0, 1000.0, 3000.0, 6500.0] {
            let tone: Vec<f32> = (0..SAMPLE_RATE)
                .map(|at| (2.0 * PI * frequency * at as f64 / SAMPLE_RATE as f64).sin() as f32 * 0.5)
                .collect();
            let spectrogram = filters.spectrogram(&tone, 200).unwrap();
            let frame = &spectrogram.values[50 * 80..51 * 80];
            let loudest = (0..80).max_by(|a, b| frame[*a].total_cmp(&frame[*b])).unwrap();
            let expected = mel(frequency) / mel(8000.0) * 81.0 - 1.0;
            assert!((loudest as f64 - expected).abs() <= 1.0, "{frequency} Hz in band {loudest}, not {expected}");
            // Silence behind it lies 8 decades below.
            let last = spectrogram.values[150 * 80];
            assert!((frame[loudest] - last - 2.0).abs() < 0.1);
        }
    }

    #[test]
    fn silence_and_no_sound_are_the_floor() {
        let filters = MelFilters::new(128);
        for samples in [&[][..], &[0.0; 5000]] {
            let spectrogram = filters.spectrogram(samples, 64).unwrap();
            assert_eq!(spectrogram.values.len(), 64 * 128);
            assert!(spectrogram.values.iter().all(|value| (value + 1.5).abs() < 1e-6));
        }
        let error = filters.spectrogram(&[0.0, f32::NAN], 64).unwrap_err().to_string();
        assert!(error.contains("sample 1 is NaN"), "{error}");
    }

    #[test]
    fn frames_of_silence_that_are_left_out_are_those_that_hear_it() {
        // A sound followed by written silence, and by silence that is not there.
        let sound: Vec<f32> = (0..3333).map(|at| ((at * at) % 977) as f32 / 977.0 - 0.5).collect();
        let filters = MelFilters::new(80);
        let padded = [&sound[..], &[0.0; 16_000]].concat();
        assert_eq!(filters.spectrogram(&sound, 90).unwrap(), filters.spectrogram(&padded, 90).unwrap());
    }
}
