//! Sounds, and models that listen to them.

use std::io::Cursor;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use sg_piper::Piper;
use sg_speech::audio::Recording;
use sg_speech::audio::wav::{decode_streamed_wav, decode_wav, read_wav};
use sg_speech::child_process::Limits;
use sg_whisper::{AudioContext, Options, Precision, SAMPLE_RATE, Whisper};

use super::accepted;
use crate::parts::Parts;
use crate::stage::Stage;

/// Longest sound.
const LONGEST: Duration = Duration::from_secs(10);
/// Longest work of a voice.
const SPEAKING: Duration = Duration::from_millis(500);

fn is_sound(recording: &Recording) -> bool {
    assert!(recording.samples.iter().all(|sample| sample.is_finite()), "a sample is no number");
    assert!(recording.duration() <= LONGEST, "{:?}", recording.duration());
    true
}

/// A file, and the same bytes as a stream whose header claims too much.
pub(crate) fn wav(stage: &Stage, input: &[u8]) -> bool {
    let path = stage.write("in.wav", input);
    let whole = accepted(read_wav(&path, LONGEST), &path);
    let decoded = decode_wav(Cursor::new(input), LONGEST).ok();
    assert_eq!(whole, decoded, "a file and its bytes are the same sound");
    let streamed = decode_streamed_wav(input.to_vec(), LONGEST);
    whole.iter().chain(streamed.iter()).all(is_sound) && (whole.is_some() || streamed.is_ok())
}

/// A model of CTranslate2 whose other files are right. One that opens listens to a sound.
pub(crate) fn whisper_model(stage: &Stage, input: &[u8]) -> bool {
    stage.write("model.bin", input);
    stage.keep("config.json", || {
        include_bytes!("../../../../services/speech/whisper/tests/fixtures/ctranslate2/config.json").to_vec()
    });
    stage.keep("tokenizer.json", || {
        include_bytes!("../../../../services/speech/whisper/tests/fixtures/ctranslate2/tokenizer.json").to_vec()
    });
    let Some(model) = accepted(Whisper::open(stage.folder(), Precision::F32), stage.folder()) else { return false };
    let never = AtomicBool::new(false);
    let sound: Vec<f32> = (0..SAMPLE_RATE / 10).map(|at| (at as f32 * 0.1).sin()).collect();
    let Ok(hearing) = model.listen(&sound, AudioContext::Frames(10), &never) else { return true };
    let options = Options { most_tokens: 3, ..Options::default() };
    if let Ok(text) = model.transcribe(&hearing, &options, &never) {
        assert!(text.tokens.len() <= 3, "{} tokens", text.tokens.len());
    }
    true
}

/// The texts beside models of speech that the first byte chooses from: three of Whisper, and the description of a voice.
pub(crate) const TEXTS: [(&str, &[u8]); 4] = [
    ("config.json", include_bytes!("../../../../services/speech/whisper/tests/fixtures/english/config.json")),
    ("tokenizer.json", include_bytes!("../../../../services/speech/whisper/tests/fixtures/english/tokenizer.json")),
    (
        "generation_config.json",
        include_bytes!("../../../../services/speech/whisper/tests/fixtures/english/generation_config.json"),
    ),
    ("made.onnx.json", include_bytes!("../../../../services/speech/piper/tests/fixtures/made.onnx.json")),
];

/// A text beside a model of speech whose other files are right. The first byte chooses which.
pub(crate) fn speech_text(stage: &Stage, input: &[u8]) -> bool {
    let mut parts = Parts(input);
    let chosen = usize::from(parts.byte()) % TEXTS.len();
    let input = parts.rest();
    for (at, (name, right)) in TEXTS.into_iter().enumerate() {
        stage.write(name, if at == chosen { input } else { right });
    }
    stage.keep("model.safetensors", || {
        include_bytes!("../../../../services/speech/whisper/tests/fixtures/english/model.safetensors").to_vec()
    });
    let voice = stage
        .keep("made.onnx", || include_bytes!("../../../../services/speech/piper/tests/fixtures/made.onnx").to_vec());
    if TEXTS[chosen].0 == "made.onnx.json" {
        // The error may be about the program that a voice needs.
        return Piper::open(&voice, None).is_ok();
    }
    accepted(Whisper::open(stage.folder(), Precision::F32), stage.folder()).is_some()
}

/// A voice whose description is right. One that opens speaks.
pub(crate) fn piper_voice(stage: &Stage, input: &[u8]) -> bool {
    let path = stage.write("made.onnx", input);
    stage.keep("made.onnx.json", || {
        include_bytes!("../../../../services/speech/piper/tests/fixtures/made.onnx.json").to_vec()
    });
    let Some(voice) = accepted(Piper::open(&path, None), &path) else { return false };
    // Weights may be anything, so a voice may also say that it cannot, or take too long.
    if let Ok(sound) = voice.speak("abc", &Limits::within(SPEAKING)) {
        assert!(sound.samples.iter().all(|sample| sample.is_finite() && sample.abs() <= 1.0), "a sample is no number");
        assert!(sound.duration() <= sg_piper::LONGEST, "{:?}", sound.duration());
    }
    true
}
