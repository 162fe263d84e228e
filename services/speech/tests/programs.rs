//! The installed programs: from text to sound and back. Without them these tests print `SKIPPED`.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test fails by panicking, and a skipped one says so")]

use std::ffi::OsString;
use std::path::Path;
use std::time::{Duration, Instant};

use rand::{RngExt as _, SeedableRng as _};
use sg_speech::audio::resample::resample;
use sg_speech::audio::sink::MemorySink;
use sg_speech::audio::{Recording, SPEECH_RATE};
use sg_speech::child_process::Limits;
use sg_speech::endpoint::{Endpoint, EndpointSettings, Endpointer};
use sg_speech::error::SpeechError;
use sg_speech::phrases::PhraseGrammar;
use sg_speech::recognizer::{Recognition, Recognizer as _, Synthesizer};
use sg_speech::sentences::sentences;
use sg_speech::speaker::speak;
use sg_speech::sphinx::pronunciation::LetterToSound;
use sg_speech::sphinx::{MODELS, Sphinx};
use sg_speech::synthesis::{Espeak, Flite};
use sg_speech::vad::GatedDetector;

fn path() -> Option<OsString> {
    std::env::var_os("PATH")
}

/// What is installed, or nothing with a line that says so.
fn installed<T>(found: Result<T, SpeechError>) -> Option<T> {
    match found {
        Ok(found) => Some(found),
        Err(missing) => {
            let required = std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1");
            assert!(!required, "{missing}, and SUPERGAUSSIAN_REQUIRE_TOOLS=1");
            eprintln!("SKIPPED: {missing}");
            None
        }
    }
}

fn limits() -> Limits {
    Limits::within(Duration::from_secs(60))
}

fn grammar() -> PhraseGrammar {
    let mut grammar = PhraseGrammar::new();
    // "isosurface" and "voxel_7" have words that the dictionary lacks.
    grammar.set_slot("unit", ["sac", "vessel", "isosurface", "voxel_7"]).unwrap();
    for template in
        ["hide the {unit}", "make the {unit} (red | blue)", "fade the {unit} to {percent} %", "undo", "zoom (in | out)"]
    {
        grammar.add(template).unwrap();
    }
    grammar.set_slot("percent", ["20", "50", "75"]).unwrap();
    grammar
}

/// A sentence at 16 kHz with half a second of silence around it.
fn said(synthesizer: &dyn Synthesizer, text: &str) -> Vec<f32> {
    let sound = resample(&synthesizer.synthesize(text, &limits()).unwrap(), SPEECH_RATE).unwrap();
    let silence = vec![0.0; SPEECH_RATE as usize / 2];
    [&silence[..], &sound.samples, &silence].concat()
}

fn recognized(sphinx: &mut Sphinx, samples: &[f32]) -> Recognition {
    sphinx.recognize(samples, &grammar(), &limits()).unwrap()
}

#[test]
fn commands_are_understood_and_talk_is_refused() {
    let Some(mut sphinx) = installed(Sphinx::find(path().as_deref(), Path::new(MODELS))) else { return };
    let Some(flite) = installed(Flite::find(path().as_deref(), "slt")) else { return };
    assert!(sphinx.prepare_grammar(&grammar(), &limits()).unwrap().is_empty());
    for command in [
        "hide the sac",
        "make the vessel red",
        "fade the sac to 20 %",
        "zoom out",
        "hide the isosurface",
        "make the voxel_7 blue",
    ] {
        let result = recognized(&mut sphinx, &said(&flite, command));
        assert!(result.accepted && result.text == command, "{command}: {result:?}");
        assert!(result.parts.windows(2).all(|pair| pair[0].end <= pair[1].start), "{result:?}");
    }
    for talk in ["what a nice day it is today", "i would like a cup of coffee please", "my sister is moving to canada"]
    {
        let result = recognized(&mut sphinx, &said(&flite, talk));
        assert!(!result.accepted, "{talk}: {result:?}");
    }
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    for amplitude in [0.0, 0.001, 0.1] {
        let noise: Vec<f32> = (0..SPEECH_RATE).map(|_| amplitude * rng.random_range(-1.0_f32..1.0)).collect();
        let result = recognized(&mut sphinx, &noise);
        assert!(!result.accepted, "noise of {amplitude}: {result:?}");
    }
    assert_eq!(recognized(&mut sphinx, &[]).text, "");
    assert!(sphinx.recognize(&vec![0.0; 61 * SPEECH_RATE as usize], &grammar(), &limits()).is_err());
    let nothing = sphinx.recognize(&said(&flite, "undo"), &PhraseGrammar::new(), &limits()).unwrap();
    assert_eq!(nothing, Recognition { elapsed: nothing.elapsed, ..Recognition::default() });
    let late = sphinx.recognize(&said(&flite, "undo"), &grammar(), &Limits::within(Duration::ZERO)).unwrap_err();
    assert!(matches!(late, SpeechError::Late { .. }), "{late}");
}

#[test]
fn text_reaches_the_program_as_text_alone() {
    let Some(espeak) = installed(Espeak::find(path().as_deref(), "en-us", 175)) else { return };
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("stolen.wav");
    for text in [format!("-w {}", target.display()), "--version".into(), "$(touch x); `touch x`".into()] {
        let sound = espeak.synthesize(&text, &limits()).unwrap();
        assert!(sound.samples.len() > SPEECH_RATE as usize / 5 && !target.exists(), "{text}");
    }
    // Neither phonemes nor markup: brackets change nothing.
    let of = |text: &str| espeak.synthesize(text, &limits()).unwrap().samples;
    assert_eq!(of("[[h@l'oU]] there"), of("  h@l'oU   there"));
    assert_eq!(of("<break time=\"3s\"/> there").len(), of(" break time=\"3s\"/  there").len());
    assert_eq!(of("…").len(), 0);
    if let Some(flite) = installed(Flite::find(path().as_deref(), "slt")) {
        assert!(flite.synthesize("-o x --help", &limits()).unwrap().samples.len() > 8_000);
    }
}

#[test]
fn a_reply_is_spoken_and_heard_as_sentences() {
    let Some(espeak) = installed(Espeak::find(path().as_deref(), "en-us", 175)) else { return };
    let mut sink = MemorySink::new(SPEECH_RATE);
    let reply = sentences("The sac is red now. It covers 3.5 % of the picture.");
    let spoken = speak(reply.into_iter(), &espeak, &mut sink, &limits()).unwrap();
    assert_eq!((spoken.sentences, spoken.stopped), (2, false));
    let stream = [sink.samples, vec![0.0; SPEECH_RATE as usize]].concat();
    let mut endpointer = Endpointer::new(Box::<GatedDetector>::default(), EndpointSettings::default());
    let events: Vec<Endpoint> = stream.chunks(333).flat_map(|block| endpointer.step(block)).collect();
    let ended = events.iter().filter(|event| matches!(event, Endpoint::SpeechEnded { .. })).count();
    assert!((1..=2).contains(&ended), "{ended} utterances");
}

#[test]
fn a_cancelled_reply_ends_its_program() {
    let Some(espeak) = installed(Espeak::find(path().as_deref(), "en-us", 80)) else { return };
    let limits = limits();
    let cancel = limits.cancel.clone();
    let begun = Instant::now();
    let canceller = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(5));
        cancel.store(true, std::sync::atomic::Ordering::Relaxed);
    });
    let long: Vec<String> = vec!["one two three four five six seven eight nine ten ".repeat(60); 50];
    let mut sink = MemorySink::new(SPEECH_RATE);
    let spoken = speak(long.into_iter(), &espeak, &mut sink, &limits).unwrap();
    canceller.join().unwrap();
    assert!(spoken.stopped && sink.stops == 1 && begun.elapsed() < Duration::from_secs(20), "{spoken:?}");
}

#[test]
fn letters_become_sounds() {
    let Some(rules) = installed(LetterToSound::find(path().as_deref())) else { return };
    let sounds = rules.pronounce(&["voxel", "isosurface", "don't"], &limits()).unwrap();
    assert_eq!(sounds[0].as_deref(), Some("V AA K S AH L"));
    assert!(sounds.iter().all(Option::is_some), "{sounds:?}");
    assert_eq!(rules.pronounce(&[], &limits()).unwrap(), []);
}

#[test]
fn the_sound_of_a_program_is_a_recording() {
    let Some(flite) = installed(Flite::find(path().as_deref(), "rms")) else { return };
    let Recording { rate, samples } = flite.synthesize("Good morning.", &limits()).unwrap();
    let peak = samples.iter().fold(0.0_f32, |peak, s| peak.max(s.abs()));
    assert!(rate == 16_000 && samples.len() > 8_000 && peak > 0.05, "{rate} {} {peak}", samples.len());
}
