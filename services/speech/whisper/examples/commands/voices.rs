//! Spoken sentences: by flite and espeak-ng, at 16 kHz, with noise.

use std::f32::consts::PI;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sg_speech::audio::resample::resample;
use sg_speech::child_process::Limits;
use sg_speech::recognizer::Synthesizer;
use sg_speech::synthesis::{Espeak, Flite};
use sg_whisper::SAMPLE_RATE;

/// A program that speaks, with one of its voices.
pub(crate) struct Voice {
    pub(crate) name: &'static str,
    synthesizer: Box<dyn Synthesizer>,
}

/// flite's `slt` and `rms`, and espeak-ng's English.
pub(crate) fn voices() -> Vec<Voice> {
    let path = std::env::var_os("PATH");
    let installed = "flite and espeak-ng are installed by ops/setup-debian.sh";
    let flite = |voice| Box::new(Flite::find(path.as_deref(), voice).expect(installed));
    let espeak = Box::new(Espeak::find(path.as_deref(), "en-us", 175).expect(installed));
    vec![
        Voice { name: "flite slt", synthesizer: flite("slt") },
        Voice { name: "flite rms", synthesizer: flite("rms") },
        Voice { name: "espeak-ng", synthesizer: espeak },
    ]
}

/// Silence before and behind a sentence, in samples: 0.3 s.
const SILENCE: usize = SAMPLE_RATE * 3 / 10;

impl Voice {
    /// A sentence at 16 kHz, with silence around it.
    pub(crate) fn speak(&self, sentence: &str) -> Vec<f32> {
        let sound = self.synthesizer.synthesize(sentence, &Limits::within(Duration::from_secs(30))).expect(sentence);
        let silence = vec![0.0; SILENCE];
        let speech = resample(&sound, SAMPLE_RATE as u32).expect("a rate that speech programs write").samples;
        [&silence[..], &speech, &silence].concat()
    }
}

/// A sentence with white noise of so many decibels below the power of the speech between the silences.
pub(crate) fn with_noise(samples: &[f32], decibels: Option<f32>, seed: u64) -> Vec<f32> {
    let Some(decibels) = decibels else { return samples.to_vec() };
    let speech = &samples[SILENCE..samples.len() - SILENCE];
    let power = speech.iter().map(|x| x * x).sum::<f32>() / speech.len() as f32;
    let deviation = (power / 10_f32.powf(decibels / 10.0)).sqrt();
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || {
        // Box and Muller 1958.
        let (a, b): (f32, f32) = (generator.random_range(f32::MIN_POSITIVE..1.0), generator.random_range(0.0..1.0));
        (-2.0 * a.ln()).sqrt() * (2.0 * PI * b).cos()
    };
    samples.iter().map(|x| x + deviation * normal()).collect()
}
