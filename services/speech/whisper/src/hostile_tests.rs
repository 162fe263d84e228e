//! Folders of models that are damaged, huge or mixed up, and sounds and options that are none: each gives one line with the place
//! and the remedy.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use sg_layers::Precision;
use tempfile::TempDir;

use crate::parity_tests::{fixtures, sound};
use crate::{AudioContext, MAX_SENTENCES, Options, Whisper, WhisperError};

static NEVER: AtomicBool = AtomicBool::new(false);

/// A copy of a fixture to damage.
struct Copy(TempDir);

impl Copy {
    fn of(name: &str) -> Self {
        let copy = Self(tempfile::tempdir().unwrap());
        for file in fs::read_dir(fixtures().join(name)).unwrap() {
            let file = file.unwrap();
            copy.write(file.file_name().to_str().unwrap(), &fs::read(file.path()).unwrap());
        }
        copy
    }

    fn bytes(&self, file: &str) -> Vec<u8> {
        fs::read(self.0.path().join(file)).unwrap()
    }

    fn write(&self, file: &str, bytes: &[u8]) {
        fs::write(self.0.path().join(file), bytes).unwrap();
    }

    fn set(&self, file: &str, key: &str, value: Value) {
        let mut all: Value = serde_json::from_slice(&self.bytes(file)).unwrap();
        all[key] = value;
        self.write(file, all.to_string().as_bytes());
    }

    fn open(&self) -> Result<Whisper, WhisperError> {
        Whisper::open(self.0.path(), Precision::F32)
    }

    /// The error of opening the model, which comes at once, is one line and names a file of it.
    fn error(&self) -> String {
        let began = Instant::now();
        let error = self.open().err().unwrap().to_string();
        assert!(began.elapsed() < Duration::from_secs(2), "{error}");
        assert!(!error.contains('\n') && error.starts_with('/'), "{error}");
        error
    }
}

fn assert_names(error: &str, parts: &[&str]) {
    assert!(parts.iter().all(|part| error.contains(part)), "{error} lacks one of {parts:?}");
}

#[test]
fn a_configuration_out_of_bounds_is_refused_before_memory_is_taken() {
    let huge = 1_u64 << 40;
    for (key, value, parts) in [
        ("d_model", json!(huge), &["`d_model`", "8192"][..]),
        ("d_model", json!(8192), &["model.safetensors", "conv1.weight", "[8192, 80, 3]", "[16, 80, 3]"]),
        ("encoder_layers", json!(huge), &["`encoder_layers`", "128"]),
        ("decoder_layers", json!(3), &["no tensor `model.decoder.layers.2."]),
        ("decoder_attention_heads", json!(3), &["`decoder_attention_heads`", "do not divide"]),
        ("encoder_ffn_dim", json!(0), &["`encoder_ffn_dim`", "0; it can be 1"]),
        ("max_source_positions", json!(huge), &["`max_source_positions`"]),
        ("max_target_positions", json!(huge), &["`max_target_positions`", "4096"]),
        ("num_mel_bins", json!(huge), &["`num_mel_bins`", "512"]),
        ("vocab_size", json!(huge), &["`vocab_size`", "1048576"]),
        ("vocab_size", json!(200), &["tokenizer.json", "below 200"]),
        ("activation_function", json!("relu"), &["`activation_function`", "`relu`", "`gelu`"]),
        ("model_type", json!("clip"), &["`model_type`", "`clip`", "`whisper`"]),
        ("d_model", json!(-4), &["config.json"]),
    ] {
        let copy = Copy::of("english");
        copy.set("config.json", key, value);
        assert_names(&copy.error(), parts);
    }
}

#[test]
fn every_truncation_and_changed_byte_of_a_binary_is_an_error_or_a_model() {
    let copy = Copy::of("ctranslate2");
    let bytes = copy.bytes("model.bin");
    for at in (0..bytes.len()).step_by(1009).chain(0..60) {
        copy.write("model.bin", &bytes[..at]);
        assert_names(&copy.error(), &["model.bin", "not a whole model of CTranslate2: at byte", "get it again"]);
    }
    for at in (0..200).chain((200..bytes.len()).step_by(1511)) {
        let mut changed = bytes.clone();
        changed[at] ^= 0x95;
        copy.write("model.bin", &changed);
        // A changed weight is not noticed.
        if copy.open().is_err() {
            copy.error();
        }
    }
    copy.write("model.bin", &[&bytes[..], b"more"].concat());
    assert_names(&copy.error(), &["it should end"]);
}

#[test]
fn binaries_of_other_kinds_are_refused() {
    let copy = Copy::of("ctranslate2");
    let bytes = copy.bytes("model.bin");
    let mut other = bytes.clone();
    other[0] = 5;
    copy.write("model.bin", &other);
    assert_names(&copy.error(), &["model.bin", "its version is 5", "convert the model"]);
    let mut other = bytes.clone();
    other[6] = b'Z';
    copy.write("model.bin", &other);
    assert_names(&copy.error(), &["model.bin", "ZhisperSpec", "give a Whisper model"]);
    // The number of variables.
    let mut other = bytes.clone();
    other[22..26].copy_from_slice(&u32::MAX.to_le_bytes());
    copy.write("model.bin", &other);
    assert_names(&copy.error(), &["there would be 4294967295 variables"]);
}

#[test]
fn a_folder_says_what_it_lacks() {
    let copy = Copy::of("english");
    copy.write("tokenizer.json", b"{\"version\":\"1.0\"}");
    assert_names(&copy.error(), &["tokenizer.json", "not a tokenizer"]);
    fs::remove_file(copy.0.path().join("tokenizer.json")).unwrap();
    assert_names(&copy.error(), &["tokenizer.json", "No such file"]);
    fs::remove_file(copy.0.path().join("model.safetensors")).unwrap();
    assert_names(&copy.error(), &["neither model.safetensors nor model.bin", "name the folder"]);
}

#[test]
fn sounds_and_options_that_are_none_are_refused() {
    let model = Copy::of("english").open().unwrap();
    let listen = |samples: &[f32]| model.listen(samples, AudioContext::Whole, &NEVER);
    let error = |result: Result<(), WhisperError>| result.unwrap_err().to_string();
    assert_names(&error(listen(&[0.0; 16_001]).map(drop)), &["1.0 s", "more than 1 s", "cut it"]);
    assert_names(&error(listen(&[0.0, f32::INFINITY]).map(drop)), &["sample 1 is inf"]);
    // No sound at all is silence.
    let hearing = listen(&[]).unwrap();
    assert!(model.transcribe(&hearing, &Options::default(), &NEVER).is_ok());
    let hearing = listen(&sound(3000)).unwrap();
    let with = |options: Options| error(model.transcribe(&hearing, &options, &NEVER).map(drop));
    assert_names(&with(Options { beams: 0, ..Options::default() }), &["`beams`", "1 to 16"]);
    assert_names(&with(Options { most_tokens: 1000, ..Options::default() }), &["`most_tokens`", "224"]);
    assert_names(&with(Options { language: Some("de".into()), ..Options::default() }), &["`language`", "`de`"]);
    assert_names(&with(Options { prompt: Some("x".repeat(9000)), ..Options::default() }), &["`prompt`", "9001 bytes"]);
    // A long prompt is cut and leaves room.
    let prompt = Some("the sac and the bone ".repeat(20));
    assert!(model.transcribe(&hearing, &Options { prompt, ..Options::default() }, &NEVER).is_ok());

    let phrases = |sentences: &[&str]| error(model.phrases(sentences).map(drop));
    assert_names(&phrases(&[]), &["0 sentences"]);
    assert_names(&phrases(&["undo", " … "]), &["sentence 1", "no word"]);
    assert_names(&phrases(&["undo", &"make ".repeat(100)]), &["sentence 1", "tokens"]);
    assert_names(&phrases(&vec!["undo"; MAX_SENTENCES + 1]), &["20001 sentences"]);
}

#[test]
fn weights_that_are_not_finite_end_without_a_text() {
    let copy = Copy::of("english");
    let mut bytes = copy.bytes("model.safetensors");
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    for pair in bytes[header..].as_chunks_mut::<2>().0 {
        *pair = 0x7e00_u16.to_le_bytes();
    }
    copy.write("model.safetensors", &bytes);
    let model = copy.open().unwrap();
    let hearing = model.listen(&sound(3000), AudioContext::Whole, &NEVER).unwrap();
    let found = model.transcribe(&hearing, &Options::default(), &NEVER).unwrap();
    assert!(found.text.is_empty() && !found.complete, "{found:?}");
    let phrases = model.phrases(&["undo"]).unwrap();
    let found = model.recognize(
        &hearing,
        &phrases,
        crate::PhraseSearch::default(),
        crate::Acceptance::default(),
        &Options::default(),
        &NEVER,
    );
    assert_eq!(found.unwrap().source, crate::Source::Free);
}
