//! tiny.en, which `ops/models.sh` gets, on sentences that flite speaks.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use sg_speech::child_process::Limits;
use sg_speech::recognizer::Synthesizer as _;
use sg_speech::synthesis::Flite;
use sg_whisper::{
    Acceptance, AudioContext, Options, PhraseSearch, Precision, SAMPLE_RATE, Source, Whisper, normalized,
};

static NEVER: AtomicBool = AtomicBool::new(false);
const SENTENCES: [&str; 8] = [
    "make the sac red",
    "make the sac blue",
    "make the skin blue",
    "hide the bone",
    "hide the vessel",
    "show only the vessel",
    "fade it to 20 percent",
    "undo",
];

/// The folder of tiny.en that `ops/models.sh` makes. Without it a test skips, after a message. With
/// `SUPERGAUSSIAN_REQUIRE_TOOLS=1`, that is a failure.
fn tiny_en() -> Option<PathBuf> {
    let cache = directories::ProjectDirs::from("", "", "supergaussian").unwrap().cache_dir().to_owned();
    let folder = cache.join("models/whisper-tiny.en");
    let found = folder.join("model.bin").is_file();
    let required = std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1");
    assert!(found || !required, "no whisper-tiny.en, and SUPERGAUSSIAN_REQUIRE_TOOLS=1; run ops/models.sh");
    if !found {
        eprintln!("SKIPPED: no whisper-tiny.en, run ops/models.sh");
    }
    found.then_some(folder)
}

/// A sentence by flite, at 16 kHz; none where flite is not installed.
fn spoken(voice: &str, sentence: &str) -> Option<Vec<f32>> {
    let flite = Flite::find(std::env::var_os("PATH").as_deref(), voice);
    let required = std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1");
    assert!(flite.is_ok() || !required, "no flite, and SUPERGAUSSIAN_REQUIRE_TOOLS=1; run ops/setup-debian.sh");
    let Ok(flite) = flite else {
        eprintln!("SKIPPED: no flite, run ops/setup-debian.sh");
        return None;
    };
    let sound = flite.synthesize(sentence, &Limits::within(Duration::from_secs(30))).unwrap();
    assert_eq!(sound.rate as usize, SAMPLE_RATE);
    Some(sound.samples)
}

#[derive(serde::Deserialize)]
struct Heard {
    tokens: Vec<u32>,
    text: String,
    average_log_probability: f32,
    no_speech: f32,
}

#[test]
fn real_weights_give_the_tokens_of_another_program() {
    let Some(folder) = tiny_en() else { return };
    let model = Whisper::open(&folder, Precision::F32).unwrap();
    let text = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/tiny-en.json")).unwrap();
    let heard: std::collections::BTreeMap<String, Heard> = serde_json::from_slice(&text).unwrap();
    assert!(heard.len() >= 6);
    for (key, expected) in heard {
        let (voice, sentence) = key.split_once(": ").unwrap();
        let Some(samples) = spoken(voice, sentence) else { return };
        let hearing = model.listen(&samples, AudioContext::Whole, &NEVER).unwrap();
        let found = model.transcribe(&hearing, &Options::default(), &NEVER).unwrap();
        assert_eq!(found.tokens, expected.tokens, "{key}: {} in place of {}", found.text, expected.text);
        assert_eq!(found.text, expected.text);
        // The other program leaves times a chance, which ours bars where no times are wanted.
        assert!((found.average_log_probability - expected.average_log_probability).abs() < 5e-3, "{key}: {found:?}");
        assert!((found.no_speech - expected.no_speech).abs() < 1e-4, "{key}: {found:?}");
    }
}

#[test]
fn real_weights_hear_commands_and_refuse_other_sentences() {
    let Some(folder) = tiny_en() else { return };
    let model = Whisper::open(&folder, Precision::F32).unwrap();
    let phrases = model.phrases(&SENTENCES).unwrap();
    for (sentence, command) in [
        ("make the sac red", true),
        ("hide the vessel", true),
        ("what a nice day", false),
        ("please lock the door", false),
    ] {
        let Some(samples) = spoken("slt", sentence) else { return };
        let hearing = model.listen(&samples, AudioContext::Frames(400), &NEVER).unwrap();
        let [pruned, exact] = [PhraseSearch::default(), PhraseSearch::Exact].map(|search| {
            let acceptance = Acceptance::default();
            let options = Options { beams: 4, ..Options::default() };
            model.recognize(&hearing, &phrases, search, acceptance, &options, &NEVER).unwrap()
        });
        // Beams find other texts where no sentence fits clearly.
        assert_eq!(pruned.free.others.is_empty(), command, "{sentence}: {pruned:?}");
        assert_eq!((&pruned.text, pruned.source), (&exact.text, exact.source), "{sentence}");
        assert_eq!(pruned.source != Source::Free, command, "{sentence}: {pruned:?}");
        if command {
            assert_eq!(normalized(&pruned.text), sentence);
        }
    }
}
