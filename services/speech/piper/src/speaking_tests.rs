//! Voices of random weights that speak: sound is finite, bounded, always the same, and no matter how it is computed.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;

use sg_speech::child_process::Limits;
use sg_speech::recognizer::Synthesizer;
use sg_speech::synthesis::MAX_TEXT;

use crate::made_voice::{Kind, MadeVoice};
use crate::piper::Piper;

const PLAIN: Kind = Kind { two: false, speakers: 1 };

fn soon() -> Limits {
    Limits::within(Duration::from_secs(60))
}

fn spoken(voice: &Piper, text: &str) -> Vec<f32> {
    let sound = voice.synthesize(text, &soon()).unwrap();
    assert_eq!(sound.rate, 8000);
    assert!(sound.samples.iter().all(|sample| sample.is_finite() && sample.abs() <= 1.0));
    sound.samples
}

#[test]
fn every_kind_of_voice_speaks_the_same_sound_each_time() {
    let mut sounds = Vec::new();
    for kind in [PLAIN, Kind { two: true, speakers: 1 }, Kind { two: false, speakers: 3 }] {
        let written = MadeVoice::new(kind).write();
        let voice = Piper::open(&written.path(), None).unwrap();
        assert_eq!((voice.name(), voice.rate(), voice.speakers()), ("piper", 8000, kind.speakers));
        let sound = spoken(&voice, "make the sac red");
        // 16 letters and as many pads, and three marks, of more than a frame of 8 samples each.
        assert!(sound.len() >= 8 * 35 && sound.len().is_multiple_of(8), "{}", sound.len());
        assert!(sound.iter().any(|sample| sample.abs() > 0.01));
        assert_eq!(sound, spoken(&voice, "make the sac red"));
        assert_ne!(sound, spoken(&voice, "make the sac blue"));
        sounds.push(sound);
    }
    assert!(sounds[0] != sounds[1] && sounds[0] != sounds[2]);
}

#[test]
fn speakers_differ_and_are_found_by_name_or_number() {
    let written = MadeVoice::new(Kind { two: false, speakers: 3 }).write();
    let open = || Piper::open(&written.path(), None).unwrap();
    let by = |speaker: &str| spoken(&open().with_speaker(speaker).unwrap(), "undo");
    assert_eq!(by("anna"), spoken(&open(), "undo"));
    assert_eq!(by("ben"), by("1"));
    assert!(by("ben") != by("anna") && by("2") != by("ben"));
    for none in ["3", "carl", "-1", ""] {
        let error = open().with_speaker(none).err().unwrap().to_string();
        assert!(error.contains("take 0 to 2 (anna, ben)"), "{error}");
    }
    let error = Piper::open(&MadeVoice::new(PLAIN).write().path(), None).unwrap().with_speaker("ben").err().unwrap();
    assert!(error.to_string().contains("take 0 to 0"), "{error}");
}

#[test]
fn what_distinguishes_a_speaker_is_added_in_its_places() {
    let mut several = MadeVoice::new(Kind { two: false, speakers: 3 });
    let mut one = MadeVoice::new(PLAIN);
    // Without weights, only the biases of these layers are added: to the layer before, or to each of the layers in a row.
    let gates =
        |flow: &str| (format!("{flow}/cond_layer"), vec![format!("{flow}/in_layers.0"), format!("{flow}/in_layers.1")]);
    let places = [
        ("/dp/cond".to_owned(), vec!["/dp/pre".to_owned()]),
        ("/dec/cond".to_owned(), vec!["/dec/conv_pre".to_owned()]),
        gates("/flow/flows.0/enc"),
        gates("/flow/flows.2/enc"),
    ];
    let bias = |module: &str| format!("{}.bias", module[1..].replace('/', "."));
    for (layer, into) in places {
        several.weight(&format!("{layer}/Conv")).1.fill(0.0);
        let added = several.tensors[&bias(&layer)].1.clone();
        for (into, added) in into.iter().zip(added.chunks(added.len() / into.len())) {
            let (_, biases) = one.tensors.get_mut(&bias(into)).unwrap();
            biases.iter_mut().zip(added).for_each(|(bias, added)| *bias += added);
        }
    }
    let [several, one] = [several, one].map(|voice| Piper::open(&voice.write().path(), None).unwrap());
    let (found, expected) = (spoken(&several, "hide the bone"), spoken(&one, "hide the bone"));
    assert_eq!(found.len(), expected.len());
    let most = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(most < 1e-4, "{most}");
    assert!(most < expected.iter().fold(0.0, |most: f32, sample| most.max(sample.abs())) / 10.0);
}

#[test]
fn noise_varies_the_sound_and_can_be_left_out() {
    let written = MadeVoice::new(PLAIN).write();
    let with = |share: f32| Piper::open(&written.path(), None).unwrap().with_noise(share);
    let sounds = [0.0, 0.5, 1.0].map(|share| spoken(&with(share).unwrap(), "undo"));
    assert!(sounds[0] != sounds[1] && sounds[1] != sounds[2]);
    assert_eq!(sounds[2], spoken(&Piper::open(&written.path(), None).unwrap(), "undo"));
    for none in [-0.1, 1.1, f32::NAN] {
        assert!(with(none).err().unwrap().to_string().contains("take 0 to 1"));
    }
}

#[test]
fn speed_changes_the_length() {
    let written = MadeVoice::new(PLAIN).write();
    let at = |speed: f32| {
        let voice = Piper::open(&written.path(), None).unwrap().with_speed(speed);
        voice.map(|voice| spoken(&voice, "a long sentence about nothing").len())
    };
    let [slow, fast] = [at(0.5), at(2.0)].map(Result::unwrap);
    assert!(slow > 2 * fast, "{slow} {fast}");
    for none in [0.0, 3.0, f32::NAN, -1.0] {
        assert!(at(none).unwrap_err().to_string().contains("take 0.5 to 2"));
    }
}

#[test]
fn texts_are_bounded_and_work_ends_when_it_should() {
    let mut made = MadeVoice::new(PLAIN);
    let voice = Piper::open(&made.write().path(), None).unwrap();
    assert!(spoken(&voice, "… , !").is_empty() && spoken(&voice, "").is_empty());
    // 4,000 letters are more than a minute of this voice, and more phonemes than are spoken at once.
    let error = |voice: &Piper, text: &str, limits: &Limits| voice.synthesize(text, limits).unwrap_err().to_string();
    assert!(error(&voice, &"x".repeat(MAX_TEXT + 1), &soon()).contains("longer than the limit of 4000; split it"));
    assert!(error(&voice, &"x".repeat(MAX_TEXT), &soon()).contains("split it"));
    made.tensors.insert("dp.flows.0.m".into(), (vec![2, 1], vec![-8.0, 0.0]));
    let slow = Piper::open(&made.write().path(), None).unwrap();
    assert!(error(&slow, &"slow ".repeat(40), &soon()).contains("longer than a minute; split the text"));
    let limits = soon();
    limits.cancel.store(true, Ordering::Relaxed);
    assert_eq!(error(&voice, "undo", &limits), "the work was cancelled");
    let late = error(&voice, "undo", &Limits::within(Duration::ZERO));
    assert!(late.starts_with("piper was ended at its deadline"), "{late}");
}

#[test]
fn unknown_phonemes_are_left_out_and_counted() {
    let voice = Piper::open(&MadeVoice::new(PLAIN).write().path(), None).unwrap();
    // Decomposed, "ç" is known.
    let known = spoken(&voice, "ça va");
    assert_eq!(voice.unknown_phonemes(), 0);
    assert_eq!(spoken(&voice, "§ça§ va"), known);
    assert_eq!(voice.unknown_phonemes(), 2);
}

/// Files of a made voice that others start from, such as the fuzzer.
fn fixture() -> [(PathBuf, Vec<u8>); 2] {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let voice = MadeVoice::new(PLAIN);
    let config = format!("{:#}\n", voice.config).into_bytes();
    [(folder.join("made.onnx"), voice.onnx()), (folder.join("made.onnx.json"), config)]
}

#[test]
#[ignore = "writes tests/fixtures"]
fn write_the_fixture() {
    fixture().into_iter().for_each(|(path, bytes)| std::fs::write(path, bytes).unwrap());
}

#[test]
fn the_fixture_is_the_made_voice() {
    for (path, bytes) in fixture() {
        assert!(std::fs::read(&path).unwrap() == bytes, "{}: run the test `write_the_fixture`", path.display());
    }
}
