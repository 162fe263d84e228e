//! Spoken sentences: by flite and espeak-ng, at 16 kHz, with noise.

use std::f32::consts::PI;
use std::path::Path;
use std::process::Command;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sg_whisper::SAMPLE_RATE;

/// A program that speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Voice {
    /// flite with one of its voices.
    Flite(&'static str),
    /// espeak-ng's English.
    Espeak,
}

pub(crate) const VOICES: [Voice; 3] = [Voice::Flite("slt"), Voice::Flite("rms"), Voice::Espeak];

/// Silence before and behind a sentence, in samples: 0.3 s.
const SILENCE: usize = SAMPLE_RATE * 3 / 10;

impl Voice {
    pub(crate) fn name(self) -> String {
        match self {
            Self::Flite(voice) => format!("flite {voice}"),
            Self::Espeak => "espeak-ng".to_owned(),
        }
    }

    /// A sentence at 16 kHz, with silence around it.
    pub(crate) fn speak(self, sentence: &str, folder: &Path) -> Vec<f32> {
        let file = folder.join("sentence.wav");
        let mut command = match self {
            Self::Flite(voice) => {
                let mut command = Command::new("flite");
                command.args(["-voice", voice, "-t", sentence, "-o"]).arg(&file);
                command
            }
            Self::Espeak => {
                let mut command = Command::new("espeak-ng");
                command.args(["-v", "en-us", "-w"]).arg(&file).arg(sentence);
                command
            }
        };
        let done = command.status().expect("flite and espeak-ng are installed by ops/setup-debian.sh");
        assert!(done.success(), "{command:?}");
        let (rate, samples) = read_wav(&std::fs::read(&file).unwrap());
        let silence = vec![0.0; SILENCE];
        [&silence[..], &resampled(&samples, rate), &silence[..]].concat()
    }
}

/// Rate and samples of a WAV file with one channel of 16 bits.
fn read_wav(bytes: &[u8]) -> (usize, Vec<f32>) {
    assert_eq!(&bytes[..4], b"RIFF");
    let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let (mut at, mut rate) = (12, 0);
    loop {
        let (kind, length) = (&bytes[at..at + 4], number(at + 4));
        if kind == b"fmt " {
            assert_eq!((number(at + 8), number(at + 20) >> 16), (0x1_0001, 16), "PCM of one channel and 16 bits");
            rate = number(at + 12);
        }
        if kind == b"data" {
            let data = &bytes[at + 8..(at + 8 + length).min(bytes.len())];
            let pairs = data.as_chunks::<2>().0.iter();
            return (rate, pairs.map(|pair| f32::from(i16::from_le_bytes(*pair)) / 32768.0).collect());
        }
        at += 8 + length + length % 2;
    }
}

/// Samples at 16 kHz, by a sinc of 32 zeros to each side under a Hann window, below both rates' highest frequencies.
fn resampled(samples: &[f32], rate: usize) -> Vec<f32> {
    if rate == SAMPLE_RATE {
        return samples.to_vec();
    }
    let step = rate as f32 / SAMPLE_RATE as f32;
    let cutoff = (1.0 / step).min(1.0);
    let reach = 32.0 / cutoff;
    let length = (samples.len() as f32 / step) as usize;
    let value = |at: usize| {
        let center = at as f32 * step;
        let (from, to) = ((center - reach).ceil().max(0.0) as usize, (center + reach).floor() as usize);
        (from..=to.min(samples.len() - 1))
            .map(|at| {
                let distance = at as f32 - center;
                let x = PI * distance * cutoff;
                let sinc = if x.abs() < 1e-6 { 1.0 } else { x.sin() / x };
                samples[at] * sinc * cutoff * (0.5 + 0.5 * (PI * distance / reach).cos())
            })
            .sum()
    };
    (0..length).map(value).collect()
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
