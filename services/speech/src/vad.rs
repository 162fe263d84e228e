//! Voice activity: how likely a frame holds speech.

use std::collections::VecDeque;
use std::time::Duration;

use crate::audio::level::{SILENCE_DB, decibels};
use crate::audio::{SPEECH_RATE, duration_of, sane};

/// Samples of a frame at 16 kHz: 16 ms.
pub const FRAME: usize = 256;

/// Frames of the window in which the energy gate looks for the noise floor: 1.6 s, longer than most words without a pause.
const FLOOR_FRAMES: usize = 100;

/// How far speech stands above the noise floor, in decibels, where the gate says 0.5.
const MARGIN_DB: f32 = 7.0;

/// Width of the gate's slope in decibels.
const SLOPE_DB: f32 = 1.5;

/// Lowest noise floor that the gate assumes, so that the first rustle after digital silence is no speech.
const LOWEST_FLOOR_DB: f32 = -66.0;

/// Says how likely a frame holds speech.
pub trait VoiceDetector: Send {
    /// Probability of speech, 0 to 1, of the next 256 samples at 16 kHz.
    fn probability(&mut self, frame: &[f32; FRAME]) -> f32;

    /// Forgets the past, as after a gap.
    fn reset(&mut self);
}

/// The small recurrent network of `earshot`, embedded in the program.
#[derive(Default)]
pub struct NeuralDetector(Box<earshot::Detector>);

impl VoiceDetector for NeuralDetector {
    fn probability(&mut self, frame: &[f32; FRAME]) -> f32 {
        let frame = frame.map(sane);
        sane(self.0.predict_f32(&frame)).max(0.0)
    }

    fn reset(&mut self) {
        self.0.reset();
    }
}

/// A gate on the energy above an adaptive noise floor, which is the minimum of smoothed energies of the last 1.6 s (minimum
/// statistics, Martin 2001). Only the band of the voice counts: hum below 100 Hz and hiss above 1.5 kHz are filtered.
#[derive(Debug, Clone)]
pub struct EnergyGate {
    energies: VecDeque<f32>,
    smooth_db: Option<f32>,
    margin_db: f32,
    low: f32,
    high: f32,
}

/// Coefficients of one-pole low passes at 1.5 kHz and 100 Hz for samples at 16 kHz: 1 − exp(−2π f / 16000).
const LOW_PASS: (f32, f32) = (0.445, 0.038_5);

impl Default for EnergyGate {
    fn default() -> Self {
        Self::with_margin(MARGIN_DB)
    }
}

impl EnergyGate {
    /// A gate that says 0.5 where the sound stands this many decibels above the noise floor.
    #[must_use]
    pub fn with_margin(margin_db: f32) -> Self {
        Self { energies: VecDeque::with_capacity(FLOOR_FRAMES), smooth_db: None, margin_db, low: 0.0, high: 0.0 }
    }
}

impl VoiceDetector for EnergyGate {
    fn probability(&mut self, frame: &[f32; FRAME]) -> f32 {
        let mut sum = 0.0;
        for sample in frame {
            self.low += LOW_PASS.0 * (sane(*sample) - self.low);
            self.high += LOW_PASS.1 * (self.low - self.high);
            let band = self.low - self.high;
            sum += band * band;
        }
        let energy = decibels((sum / FRAME as f32).sqrt()).max(SILENCE_DB);
        let smooth = self.smooth_db.map_or(energy, |before| before + 0.4 * (energy - before));
        self.smooth_db = Some(smooth);
        if self.energies.len() == FLOOR_FRAMES {
            self.energies.pop_front();
        }
        self.energies.push_back(smooth);
        let floor = self.energies.iter().copied().fold(f32::INFINITY, f32::min).max(LOWEST_FLOOR_DB);
        1.0 / (1.0 + (-(smooth - floor - self.margin_db) / SLOPE_DB).exp())
    }

    fn reset(&mut self) {
        *self = Self::with_margin(self.margin_db);
    }
}

/// The network behind the gate: the lower of both probabilities. The network knows voices from noise, and the gate knows the
/// voice at this microphone from those behind it.
#[derive(Default)]
pub struct GatedDetector {
    network: NeuralDetector,
    gate: EnergyGate,
}

impl VoiceDetector for GatedDetector {
    fn probability(&mut self, frame: &[f32; FRAME]) -> f32 {
        self.network.probability(frame).min(self.gate.probability(frame))
    }

    fn reset(&mut self) {
        self.network.reset();
        self.gate.reset();
    }
}

/// Time of voice in 16 kHz samples, by the network.
#[must_use]
pub fn voiced(samples: &[f32]) -> Duration {
    let mut network = NeuralDetector::default();
    let (frames, _) = samples.as_chunks::<FRAME>();
    let voiced = frames.iter().filter(|frame| network.probability(frame) >= 0.5).count();
    duration_of(voiced * FRAME, SPEECH_RATE)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};

    use super::*;

    fn noise(amplitude: f32, frames: usize, seed: u64) -> Vec<[f32; FRAME]> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        (0..frames).map(|_| std::array::from_fn(|_| amplitude * rng.random_range(-1.0_f32..1.0))).collect()
    }

    fn detectors() -> [Box<dyn VoiceDetector>; 3] {
        [Box::<NeuralDetector>::default(), Box::<EnergyGate>::default(), Box::<GatedDetector>::default()]
    }

    #[test]
    fn steady_noise_and_silence_are_no_speech() {
        for amplitude in [0.0, 1e-4, 0.01, 0.3] {
            for mut detector in detectors() {
                let spoken = noise(amplitude, 200, 7).iter().filter(|f| detector.probability(f) > 0.5).count();
                assert!(spoken <= 10, "{amplitude}: {spoken} of 200 frames");
            }
        }
    }

    #[test]
    fn the_gate_opens_above_its_floor_and_adapts_to_louder_noise() {
        let mut gate = EnergyGate::default();
        noise(0.01, 100, 1).iter().for_each(|f| assert!(gate.probability(f) >= 0.0));
        let burst: Vec<f32> = noise(0.1, 30, 2).iter().map(|f| gate.probability(f)).collect();
        assert!(burst[5..].iter().all(|p| *p > 0.9), "{burst:?}");
        noise(0.1, 100, 3).iter().for_each(|f| assert!(gate.probability(f) >= 0.0));
        assert!(noise(0.1, 50, 4).iter().all(|f| gate.probability(f) < 0.5));
    }

    #[test]
    fn a_reset_forgets_and_nonsense_stays_a_probability() {
        for mut detector in detectors() {
            let frames = noise(0.2, 20, 5);
            let fresh: Vec<f32> = frames.iter().map(|f| detector.probability(f)).collect();
            for bad in [f32::NAN, f32::INFINITY, -3.0] {
                let p = detector.probability(&[bad; FRAME]);
                assert!((0.0..=1.0).contains(&p), "{p}");
            }
            detector.reset();
            assert_eq!(fresh, frames.iter().map(|f| detector.probability(f)).collect::<Vec<_>>());
        }
    }
}
