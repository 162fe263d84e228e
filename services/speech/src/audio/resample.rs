//! Resampling of a stream, and its exact twin.
//!
//! The fast one is `rubato`'s interpolation of a windowed sinc. The exact one evaluates a long windowed sinc in `f64` at every
//! output sample.

use audioadapter_buffers::direct::InterleavedSlice;
use rubato::{Async, FixedAsync, Indexing, Resampler as _, SincInterpolationParameters, WindowFunction};

use super::{AudioError, Recording, check_rate};

/// Input samples that are converted at once.
const CHUNK: usize = 256;

/// Shortest sinc in input samples.
const SINC_LENGTH: usize = 256;

/// Length of the sinc for a lower output rate, in output samples. Half of it is the delay: 3 ms at 16 kHz.
const SINC_OUTPUT_LENGTH: usize = 96;

/// Interpolation points between two input samples. `rubato` is early by one of them, 0.2 % of an input sample.
const OVERSAMPLING: usize = 512;

/// Zero crossings of the exact sinc on each side.
const EXACT_CROSSINGS: f64 = 512.0;

/// Converts a stream from one rate to another. A pulse keeps its time: the delay of the filter is taken off.
pub struct Resampler {
    from: u32,
    to: u32,
    /// Nothing for equal rates.
    filter: Option<Async<f32>>,
    waiting: Vec<f32>,
    scratch: Vec<f32>,
    /// Output samples of the delay that are still to be dropped.
    delay: usize,
    taken: u64,
    given: u64,
}

impl Resampler {
    /// A resampler at the start of a stream.
    ///
    /// # Errors
    /// [`AudioError::Rate`], [`AudioError::Resample`].
    pub fn new(from: u32, to: u32) -> Result<Self, AudioError> {
        check_rate(from)?;
        check_rate(to)?;
        let mut resampler =
            Self { from, to, filter: None, waiting: Vec::new(), scratch: Vec::new(), delay: 0, taken: 0, given: 0 };
        if from != to {
            let ratio = f64::from(to) / f64::from(from);
            let length = SINC_LENGTH.max(SINC_OUTPUT_LENGTH * from.div_ceil(to) as usize);
            let parameters = SincInterpolationParameters::new(length, WindowFunction::BlackmanHarris2)
                .oversampling_factor(OVERSAMPLING);
            let filter = Async::new_sinc(ratio, 1.0, &parameters, CHUNK, 1, FixedAsync::Input)
                .map_err(|error| resampler.failed(&error))?;
            // Silence in front makes the delay a whole number of output samples, so that no fraction of one is left. `rubato`
            // gives the first output sample one step late, so its delay is one less.
            let common = from / gcd(from, to);
            let half = length / 2;
            let silence = (common as usize - half % common as usize) % common as usize;
            resampler.waiting = vec![0.0; silence];
            resampler.delay = (half + silence) * to as usize / from as usize - 1;
            resampler.scratch = vec![0.0; filter.output_frames_max()];
            resampler.filter = Some(filter);
        }
        Ok(resampler)
    }

    fn failed(&self, error: &dyn std::fmt::Display) -> AudioError {
        AudioError::Resample { from: self.from, to: self.to, problem: error.to_string() }
    }

    /// Samples of the whole output for this many of the input.
    fn expected(&self, taken: u64) -> u64 {
        (u128::from(taken) * u128::from(self.to)).div_ceil(u128::from(self.from.max(1))) as u64
    }

    /// Takes the next input samples and appends the output samples that are ready.
    ///
    /// # Errors
    /// [`AudioError::Resample`].
    pub fn push(&mut self, block: &[f32], out: &mut Vec<f32>) -> Result<(), AudioError> {
        self.taken += block.len() as u64;
        if self.filter.is_none() {
            self.given += block.len() as u64;
            out.extend_from_slice(block);
            return Ok(());
        }
        self.waiting.extend_from_slice(block);
        self.convert(u64::MAX, out)
    }

    /// Converts all whole chunks that wait, until `most` output samples have been given since the start.
    fn convert(&mut self, most: u64, out: &mut Vec<f32>) -> Result<(), AudioError> {
        let mut at = 0;
        while self.waiting.len() - at >= CHUNK && self.given < most {
            let made = self.chunk(at).map_err(|problem| self.failed(&problem))?;
            at += CHUNK;
            let dropped = self.delay.min(made);
            self.delay -= dropped;
            let room = usize::try_from(most - self.given).unwrap_or(usize::MAX);
            let kept = (made - dropped).min(room);
            self.given += kept as u64;
            out.extend_from_slice(&self.scratch[dropped..dropped + kept]);
        }
        self.waiting.drain(..at);
        Ok(())
    }

    fn chunk(&mut self, at: usize) -> Result<usize, String> {
        let Some(filter) = self.filter.as_mut() else { return Ok(0) };
        let length = self.scratch.len();
        let input = InterleavedSlice::new(&self.waiting[at..at + CHUNK], 1, CHUNK).map_err(|e| e.to_string())?;
        let mut output = InterleavedSlice::new_mut(&mut self.scratch, 1, length).map_err(|e| e.to_string())?;
        let made =
            filter.process_into_buffer(&input, &mut output, Some(&Indexing::new())).map_err(|e| e.to_string())?;
        Ok(made.1)
    }

    /// Ends the stream: appends the samples that the filter holds back, and starts over. All of them together are as long as
    /// the input, to one sample.
    ///
    /// # Errors
    /// [`AudioError::Resample`].
    pub fn finish(&mut self, out: &mut Vec<f32>) -> Result<(), AudioError> {
        let most = self.expected(self.taken);
        while self.filter.is_some() && self.given < most {
            let filled = (self.waiting.len() / CHUNK + 1) * CHUNK;
            self.waiting.resize(filled, 0.0);
            self.convert(most, out)?;
        }
        *self = Self::new(self.from, self.to)?;
        Ok(())
    }
}

/// Converts a whole recording to another rate.
///
/// # Errors
/// As [`Resampler::push`].
pub fn resample(recording: &Recording, rate: u32) -> Result<Recording, AudioError> {
    let mut resampler = Resampler::new(recording.rate, rate)?;
    let mut samples = Vec::new();
    resampler.push(&recording.samples, &mut samples)?;
    resampler.finish(&mut samples)?;
    Ok(Recording { rate, samples })
}

/// The exact twin of [`resample`]: a sinc of 512 zero crossings on each side under a Blackman–Harris window (Harris 1978), in
/// `f64`. Its band ends at 97 % of the lower Nyquist frequency. Slow: for tests.
///
/// # Errors
/// [`AudioError::Rate`].
pub fn resample_exact(recording: &Recording, rate: u32) -> Result<Recording, AudioError> {
    check_rate(recording.rate)?;
    check_rate(rate)?;
    let step = f64::from(recording.rate) / f64::from(rate);
    let band = 0.97 * step.recip().min(1.0);
    let half = EXACT_CROSSINGS / band;
    let length = (recording.samples.len() as u64 * u64::from(rate)).div_ceil(u64::from(recording.rate));
    let sample = |n: u64| {
        let centre = n as f64 * step;
        let first = (centre - half).ceil().max(0.0) as usize;
        let last = ((centre + half).floor() as usize + 1).min(recording.samples.len());
        let inside = recording.samples.get(first..last).unwrap_or_default();
        let sum: f64 = inside
            .iter()
            .enumerate()
            .map(|(k, sample)| {
                let offset = (first + k) as f64 - centre;
                f64::from(*sample) * band * sinc(band * offset) * blackman_harris(offset / half)
            })
            .sum();
        sum as f32
    };
    Ok(Recording { rate, samples: (0..length).map(sample).collect() })
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

fn sinc(x: f64) -> f64 {
    let angle = std::f64::consts::PI * x;
    if x == 0.0 { 1.0 } else { angle.sin() / angle }
}

/// Window over −1 … 1.
fn blackman_harris(x: f64) -> f64 {
    let angle = std::f64::consts::PI * x;
    0.35875 + 0.48829 * angle.cos() + 0.14128 * (2.0 * angle).cos() + 0.01168 * (3.0 * angle).cos()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Tones below 6.8 kHz, with a soft begin and end.
    fn tones(rate: u32, seconds: f64, frequencies: &[f64]) -> Recording {
        let length = (f64::from(rate) * seconds) as usize;
        let samples = (0..length).map(|n| {
            let (t, share) = (n as f64 / f64::from(rate), n as f64 / length as f64);
            let envelope = (std::f64::consts::PI * share).sin().powi(2);
            let sum: f64 = frequencies.iter().map(|f| (std::f64::consts::TAU * f * t).sin()).sum();
            (envelope * sum * 0.9 / frequencies.len() as f64) as f32
        });
        Recording { rate, samples: samples.collect() }
    }

    fn worst(a: &Recording, b: &Recording) -> f32 {
        assert_eq!((a.rate, a.samples.len()), (b.rate, b.samples.len()));
        a.samples.iter().zip(&b.samples).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn it_agrees_with_the_exact_twin_and_with_the_sound_itself() {
        let frequencies = [90.0, 310.0, 1_250.0, 3_100.0, 6_700.0];
        for rate in [16_000, 22_050, 24_000, 44_100, 48_000, 96_000] {
            let sound = tones(rate, 0.1, &frequencies);
            let (fast, exact) = (resample(&sound, 16_000).unwrap(), resample_exact(&sound, 16_000).unwrap());
            let truth = tones(16_000, 0.1, &frequencies);
            assert!(worst(&fast, &exact) < 2e-3, "{rate} Hz: {}", worst(&fast, &exact));
            let off = exact.samples.iter().zip(&truth.samples).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 1e-3, "{rate} Hz: {off} from the truth");
        }
    }

    #[test]
    fn what_16_khz_cannot_hold_is_filtered_out() {
        let power = |r: &Recording| r.samples.iter().map(|s| f64::from(s * s)).sum::<f64>() / r.samples.len() as f64;
        for frequency in [9_500.0, 12_000.0, 20_000.0] {
            let sound = tones(48_000, 0.1, &[frequency]);
            let (fast, exact) = (resample(&sound, 16_000).unwrap(), resample_exact(&sound, 16_000).unwrap());
            let loss = |r: &Recording| 10.0 * (power(&sound) / power(r)).log10();
            assert!(loss(&fast) > 80.0 && loss(&exact) > 80.0, "{frequency} Hz: {} {}", loss(&fast), loss(&exact));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn blocks_of_any_length_give_the_same_samples(
            length in 0_usize..3_000,
            cuts in proptest::collection::vec(1_usize..700, 1..20),
            rate in proptest::sample::select(vec![8_000_u32, 16_000, 44_100, 48_000]),
        ) {
            let sound = Recording { rate, samples: (0..length).map(|n| ((n * n) as f32 * 0.001).sin()).collect() };
            let whole = resample(&sound, 16_000).unwrap();
            let mut resampler = Resampler::new(rate, 16_000).unwrap();
            // Twice: `finish` starts over.
            for _ in 0..2 {
                let (mut parts, mut rest, mut cuts) = (Vec::new(), &sound.samples[..], cuts.iter().cycle());
                while !rest.is_empty() {
                    let (part, after) = rest.split_at((*cuts.next().unwrap()).min(rest.len()));
                    resampler.push(part, &mut parts).unwrap();
                    rest = after;
                }
                resampler.finish(&mut parts).unwrap();
                prop_assert_eq!(&parts, &whole.samples);
            }
            let expected = (length as u64 * 16_000).div_ceil(u64::from(rate));
            prop_assert_eq!(whole.samples.len() as u64, expected);
        }
    }

    #[test]
    fn rates_out_of_bounds_are_refused() {
        assert!(Resampler::new(0, 16_000).is_err() && Resampler::new(16_000, 1_000_000).is_err());
        assert!(resample_exact(&Recording { rate: 0, samples: vec![] }, 16_000).is_err());
    }
}
