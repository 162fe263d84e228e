//! Sentences that a synthetic voice speaks, for tests and benches of commands by voice.

#![allow(clippy::unwrap_used, reason = "a test without its voice has failed")]

use std::time::Duration;

use sg_speech::audio::resample::resample;
use sg_speech::audio::{Recording, SPEECH_RATE};
use sg_speech::child_process::Limits;
use sg_speech::recognizer::Synthesizer as _;
use sg_speech::synthesis::Flite;

/// A sentence by flite's voice `slt`, at 16 kHz.
///
/// # Panics
/// flite is not installed, or failed.
#[must_use]
pub fn spoken(sentence: &str) -> Recording {
    let flite = Flite::find(std::env::var_os("PATH").as_deref(), "slt").unwrap();
    let sound = flite.synthesize(sentence, &Limits::within(Duration::from_secs(30))).unwrap();
    resample(&sound, SPEECH_RATE).unwrap()
}
