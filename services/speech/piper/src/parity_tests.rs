//! A real voice, which `ops/models.sh` gets, beside ONNX Runtime and beside Piper's own phonemes.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;
use sg_speech::child_process::Limits;

use crate::config::Config;
use crate::network::{Network, Request, Scales};
use crate::phonemes::{Phonemizer, ids_of};
use crate::piper::{LONGEST, Piper};

/// Largest difference of a sample from ONNX Runtime's.
const TOLERANCE: f32 = 1e-4;

/// What `tests/reference.py` writes.
#[derive(Deserialize)]
struct Reference {
    sentence: String,
    ids: Vec<u32>,
    durations: Vec<usize>,
    samples: usize,
    step: usize,
    every: Vec<f32>,
    window: usize,
    energies: Vec<f32>,
}

impl Reference {
    fn read() -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/joe-medium.json");
        serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
    }
}

/// The voice that `ops/models.sh` gets. Without it a test skips, after a message. With `SUPERGAUSSIAN_REQUIRE_TOOLS=1`, that is a
/// failure.
fn joe() -> Option<PathBuf> {
    let cache = directories::ProjectDirs::from("", "", "supergaussian").unwrap().cache_dir().to_owned();
    let voice = cache.join("models/piper-en_US-joe-medium/en_US-joe-medium.onnx");
    skip_unless(voice.is_file(), "no piper-en_US-joe-medium, run ops/models.sh").then_some(voice)
}

fn espeak(config: &Config) -> Option<Phonemizer> {
    let found = Phonemizer::find(config, std::env::var_os("PATH").as_deref());
    skip_unless(found.is_ok(), "no espeak-ng, run ops/setup-debian.sh").then(|| found.unwrap())
}

fn skip_unless(found: bool, problem: &str) -> bool {
    let required = std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1");
    assert!(found || !required, "{problem}; SUPERGAUSSIAN_REQUIRE_TOOLS=1");
    if !found {
        eprintln!("SKIPPED: {problem}");
    }
    found
}

fn soon() -> Limits {
    Limits::within(Duration::from_secs(120))
}

#[test]
fn a_real_voice_sounds_as_by_onnx_runtime() {
    let Some(path) = joe() else { return };
    let reference = Reference::read();
    let network = Network::read(&path).unwrap();
    assert_eq!((network.symbols(), network.speakers()), (256, 1));
    let request = Request {
        ids: &reference.ids,
        speaker: 0,
        scales: Scales { noise: 0.0, length: 1.0, duration_noise: 0.0 },
        most: 22_050 * LONGEST.as_secs() as usize,
        seed: 1,
        go_on: &|| Ok(()),
    };
    assert_eq!(network.durations(&request).unwrap(), reference.durations);
    let samples = network.speak(&request).unwrap();
    assert_eq!(samples.len(), reference.samples);
    let pairs = samples.iter().step_by(reference.step).zip(&reference.every);
    let most = pairs.map(|(found, exact)| (found - exact).abs()).fold(0.0, f32::max);
    assert!(most < TOLERANCE, "{most}");
    assert_eq!(samples.chunks_exact(reference.window).len(), reference.energies.len());
    for (window, exact) in samples.chunks_exact(reference.window).zip(&reference.energies) {
        let found = window.iter().map(|sample| sample * sample).sum::<f32>() / window.len() as f32;
        assert!((found - exact).abs() < 1e-4 * exact + 1e-9, "{found} {exact}");
    }
    eprintln!("largest difference from ONNX Runtime: {most:e}");
}

#[test]
fn phonemes_are_those_of_piper() {
    let Some(path) = joe() else { return };
    let config = Config::read(&path).unwrap();
    let Some(espeak) = espeak(&config) else { return };
    let reference = Reference::read();
    let sentences = espeak.sentences(&reference.sentence, &soon()).unwrap();
    assert_eq!(sentences, ["ðə kwˈɪk bɹˈaʊn fˈɑːks dʒˈʌmps ˌoʊvɚ ðə lˈeɪzi dˈɑːɡ nˌɪɹ ðə ɹˈɪvɚ bˈæŋk."]);
    let found = ids_of(&sentences[0], &config);
    assert_eq!((found.ids, found.unknown), (reference.ids, 0));
    // As piper-tts 1.8.0 gives them.
    for (text, expected) in [
        ("Hello, world! It costs 5 (about).", &["həlˈoʊ, wˈɜːld!", "ɪt kˈɔsts fˈaɪv ɐbˈaʊt."][..]),
        ("3.5 mm; 12:30", &["θɹˈiː pɔɪnt fˈaɪv ˌɛmˈɛm; twˈɛlv θˈɜːɾi"]),
        ("He said: yes.", &["hiː sˈɛd: jˈɛs."]),
        ("Well,no", &["wˈɛl nˈoʊ"]),
        ("Dr. Smith", &["dˈɑːktɚ.", "smˈɪθ"]),
        ("It is \"good\", yes.", &["ɪɾ ɪz ɡˈʊd, jˈɛs."]),
        ("…", &[]),
    ] {
        assert_eq!(espeak.sentences(text, &soon()).unwrap(), expected, "{text}");
    }
    // The program sees several clauses in a long one.
    let long = format!("{}, {}!", "red bone ".repeat(150).trim(), "blue sac ".repeat(40).trim());
    let sentences = espeak.sentences(&long, &soon()).unwrap();
    assert_eq!(sentences.len(), 1);
    let words = |sentence: &str, part: &str| sentence.matches(part).count();
    assert_eq!((words(&sentences[0], "bˈoʊn"), words(&sentences[0], "sˈæk")), (150, 40), "{}", sentences[0]);
    assert!(sentences[0].contains(", ") && sentences[0].ends_with('!'));
    // Words of other languages are marked; the marks are no phonemes. Accents are signs of their own.
    let french = espeak.sentences("Déjà vu, garçon", &soon()).unwrap().join("");
    assert!(!french.contains(['(', ')', 'ç']), "{french}");
}

#[test]
fn a_real_voice_speaks_commands() {
    let Some(path) = joe() else { return };
    let config = Config::read(&path).unwrap();
    let Some(_) = espeak(&config) else { return };
    let voice = Piper::open(&path, std::env::var_os("PATH").as_deref()).unwrap();
    let sound = voice.speak("The sac is red. The bone is hidden.", &soon()).unwrap();
    assert_eq!((sound.rate, voice.unknown_phonemes()), (22_050, 0));
    let seconds = sound.duration().as_secs_f64();
    assert!((1.2..5.0).contains(&seconds), "{seconds} s");
    let loudness =
        (sound.samples.iter().map(|sample| sample * sample).sum::<f32>() / sound.samples.len() as f32).sqrt();
    assert!((0.01..0.3).contains(&loudness), "{loudness}");
    assert_eq!(sound, voice.speak("The sac is red. The bone is hidden.", &soon()).unwrap());
}
