//! The model beside the published implementation, on the fixtures of `tests/fixtures/make.py`.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use safetensors::SafeTensors;
use sg_layers::Precision;

use crate::decoder::Branch;
use crate::{AudioContext, Options, Whisper};

static NEVER: AtomicBool = AtomicBool::new(false);
const FRAMES: usize = 50;
/// Every so many frames of the spectrogram are kept.
const FRAME_STEP: usize = 11;
const SOUNDS: [(&str, usize); 2] = [("short", 7000), ("whole", FRAMES * 320)];

pub(crate) fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures")
}

/// `sound` of `make.py`.
pub(crate) fn sound(samples: usize) -> Vec<f32> {
    let sample = |at: usize| {
        let t = at as f64 / 16_000.0;
        let pulse = if t % 0.2 < 0.1 { 0.2 * (2.0 * PI * 3100.0 * t).sin() } else { 0.0 };
        let noise = (at * 7919 % 1009) as f64 / 1009.0 - 0.5;
        (0.3 * (2.0 * PI * (200.0 + 900.0 * t) * t).sin() + pulse + 0.02 * noise) as f32
    };
    (0..samples).map(sample).collect()
}

struct Expected(Vec<u8>);

impl Expected {
    fn open(folder: &str) -> Self {
        Self(std::fs::read(fixtures().join(folder).join("expected.safetensors")).unwrap())
    }

    fn values(&self, name: &str) -> Vec<f32> {
        let tensors = SafeTensors::deserialize(&self.0).unwrap();
        let tensor = tensors.tensor(name).unwrap();
        tensor.data().as_chunks::<4>().0.iter().map(|four| f32::from_le_bytes(*four)).collect()
    }

    fn tokens(&self, name: &str) -> Vec<u32> {
        self.values(name).iter().map(|value| value.to_bits()).collect()
    }
}

fn assert_near(what: &str, found: &[f32], expected: &[f32], bound: f32) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (at, (value, other)) in found.iter().zip(expected).enumerate() {
        assert!((value - other).abs() <= bound, "{what} {at}: {value} in place of {other}");
    }
}

/// A folder of a model, that of its expected values, and the language it is asked for.
const MODELS: [(&str, &str, Option<&str>); 3] =
    [("english", "english", None), ("multilingual", "multilingual", Some("de")), ("ctranslate2", "english", None)];

#[test]
fn spectrograms_are_the_published_ones() {
    for (folder, expected, _) in MODELS {
        let model = Whisper::open(&fixtures().join(folder), Precision::F32).unwrap();
        for (name, samples) in SOUNDS {
            let spectrogram = model.parts().0.spectrogram(&sound(samples), 2 * FRAMES).unwrap();
            let kept: Vec<f32> =
                spectrogram.values.chunks(spectrogram.bands).step_by(FRAME_STEP).flatten().copied().collect();
            assert_near(name, &kept, &Expected::open(expected).values(&format!("{name}.mel")), 1e-5);
        }
    }
}

#[test]
fn outputs_of_encoder_and_decoder_are_the_published_ones() {
    for (folder, expected, language) in MODELS {
        let model = Whisper::open(&fixtures().join(folder), Precision::F32).unwrap();
        let (filters, encoder, decoder) = model.parts();
        for (name, samples) in SOUNDS {
            let what = format!("{folder} {name}");
            let expected = Expected::open(expected);
            let spectrogram = filters.spectrogram(&sound(samples), 2 * FRAMES).unwrap();
            let encoded = encoder.apply(&spectrogram).unwrap();
            let values = encoded.flatten_all().unwrap().to_vec1::<f32>().unwrap();
            assert_near(&what, &values, &expected.values(&format!("{name}.encoded")), 1e-5);

            let keys = decoder.sound_keys(&encoded).unwrap();
            let languages = model.vocabulary.languages();
            let language = language.and_then(|code| languages.iter().find(|(own, _)| own == code)).map(|(_, id)| *id);
            let mut tokens = model.vocabulary.prefix(None, 0, language, false).unwrap();
            tokens.extend([20, 270, 3, 99]);
            let logits = expected.values(&format!("{name}.logits"));
            // All at once, and one by one by what is kept of those before.
            let chain: Vec<Branch> =
                (0..tokens.len()).map(|at| Branch { parent: at.checked_sub(1), token: tokens[at] }).collect();
            let mut tree = decoder.tree();
            let outputs = decoder.advance(&keys, &mut tree, &chain).unwrap();
            assert_near(&what, &decoder.logits(&outputs).unwrap(), &logits, 1e-4);
            let mut tree = decoder.tree();
            for (branch, expected) in chain.iter().zip(logits.chunks(decoder.vocabulary())) {
                let outputs = decoder.advance(&keys, &mut tree, &[*branch]).unwrap();
                assert_near(&what, &decoder.logits(&outputs).unwrap(), expected, 1e-4);
            }
        }
    }
}

#[test]
fn greedy_texts_are_the_published_ones() {
    for (folder, expected, language) in MODELS {
        let model = Whisper::open(&fixtures().join(folder), Precision::F32).unwrap();
        for (name, samples) in SOUNDS {
            let hearing = model.listen(&sound(samples), AudioContext::Whole, &NEVER).unwrap();
            let options = Options { most_tokens: 20, language: language.map(str::to_owned), ..Options::default() };
            let found = model.transcribe(&hearing, &options, &NEVER).unwrap();
            let expected = Expected::open(expected);
            let mut tokens = expected.tokens(&format!("{name}.greedy"));
            if found.complete {
                assert_eq!(tokens.pop(), Some(model.vocabulary.end));
            }
            let common = found.tokens.len();
            // A text that repeats itself ends early.
            assert!(
                common > 0 && tokens[..common] == found.tokens,
                "{folder} {name}: {found:?} in place of {tokens:?}"
            );
            if common == tokens.len() {
                let sum = expected.values(&format!("{name}.sum"))[0];
                assert!((found.log_probability - sum).abs() < 1e-3, "{folder} {name}");
            }
        }
    }
}
