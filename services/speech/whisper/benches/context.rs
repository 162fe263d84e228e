//! Milliseconds against error, for shorter audio contexts and for each precision of weights: a table for spoken commands.
//!
//! `cargo bench -p sg-whisper --bench context`. It takes the model that `ops/models.sh` gets, and flite's voice `slt`.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    dead_code,
    reason = "a bench prints its table and fails by panicking; the example uses the rest of its modules"
)]

#[path = "../examples/commands/sentences.rs"]
mod sentences;
#[path = "../examples/commands/voices.rs"]
mod voices;

use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use sentences::Spoken;
use sg_whisper::{Acceptance, AudioContext, Options, PhraseSearch, Precision, Source, Whisper, normalized};
use voices::voices;

static NEVER: AtomicBool = AtomicBool::new(false);
/// Frames of 20 ms: 30 s to 4 s.
const CONTEXTS: [usize; 6] = [1500, 1000, 750, 500, 350, 200];

fn main() {
    let cache = directories::ProjectDirs::from("", "", "supergaussian").unwrap().cache_dir().to_owned();
    let folder = cache.join("models/whisper-tiny.en");
    let spoken = Spoken::report().commands;
    let slt = voices().into_iter().next().unwrap();
    let sounds: Vec<Vec<f32>> = spoken.iter().map(|s| slt.speak(s)).collect();
    let known = sentences::known();
    println!("| weights | context | listening | free text | with sentences | free right | commands right |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    let cases = CONTEXTS.iter().map(|frames| (Precision::F32, *frames));
    for (precision, frames) in cases.chain([(Precision::F16, 500), (Precision::Int8, 500)]) {
        let model = Whisper::open(&folder, precision).unwrap();
        let phrases = model.phrases(&known).unwrap();
        let options = Options { prompt: Some(format!("{}.", sentences::labels().join(", "))), ..Options::default() };
        let (mut times, mut free_right, mut right) = ([Duration::ZERO; 3], 0, 0);
        for (sound, sentence) in sounds.iter().zip(&spoken) {
            let mut step = Instant::now();
            let mut lap = |at: usize| {
                times[at] += step.elapsed();
                step = Instant::now();
            };
            let hearing = model.listen(sound, AudioContext::Frames(frames), &NEVER).unwrap();
            lap(0);
            let free = model.transcribe(&hearing, &Options::default(), &NEVER).unwrap();
            lap(1);
            let (search, acceptance) = (PhraseSearch::default(), Acceptance::default());
            let found = model.recognize(&hearing, &phrases, search, acceptance, &options, &NEVER).unwrap();
            lap(2);
            free_right += usize::from(normalized(&free.text) == normalized(sentence));
            right += usize::from(found.source != Source::Free && normalized(&found.text) == normalized(sentence));
        }
        let mean = times.map(|time| format!("{:.0} ms", time.as_secs_f64() * 1e3 / spoken.len() as f64));
        let all = spoken.len();
        println!(
            "| {precision:?} | {frames} | {} | {} | {} | {free_right}/{all} | {right}/{all} |",
            mean[0], mean[1], mean[2]
        );
    }
}
