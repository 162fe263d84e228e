//! Commands and other sentences, spoken by three voices, with noise, and what the model makes of them.
//!
//! `cargo run --release -p sg-whisper --example commands -- [--calibrate] [--context FRAMES] [--snr DECIBELS]... [--model FOLDER]
//! [--precision f16|int8] [--voice NAME] [--decoding NUMBER]... [--details]`. Without a folder it takes the model that `ops/models.sh`
//! gets. `--calibrate` prints the ratios of the calibration sentences, for the threshold of acceptance; the report speaks others.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    clippy::panic,
    reason = "a measurement prints its table and fails by panicking"
)]

mod sentences;
mod voices;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use sentences::Spoken;
use sg_speech::accuracy::edit_distance;
use sg_whisper::{Acceptance, AudioContext, Options, PhraseSearch, Phrases, Precision, Source, Whisper, normalized};
use voices::{Voice, voices, with_noise};

struct Arguments {
    calibrate: bool,
    details: bool,
    context: AudioContext,
    noise: Vec<Option<f32>>,
    model: PathBuf,
    precision: Precision,
    voices: Vec<Voice>,
    /// Places in [`DECODINGS`]; all of them if there is none.
    decodings: Vec<usize>,
}

fn arguments() -> Arguments {
    let cache = directories::ProjectDirs::from("", "", "supergaussian").unwrap().cache_dir().to_owned();
    let mut all = Arguments {
        calibrate: false,
        details: false,
        context: AudioContext::Whole,
        noise: Vec::new(),
        model: cache.join("models/whisper-tiny.en"),
        precision: Precision::F32,
        voices: voices(),
        decodings: Vec::new(),
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().expect("a value follows");
        match word.as_str() {
            "--calibrate" => all.calibrate = true,
            "--details" => all.details = true,
            "--context" => all.context = AudioContext::Frames(value().parse().unwrap()),
            "--snr" => all.noise.push(value().parse().ok()),
            "--model" => all.model = value().into(),
            "--decoding" => all.decodings.push(value().parse().unwrap()),
            "--voice" => {
                let name = value();
                all.voices.retain(|voice| voice.name.contains(&name));
            }
            "--precision" => {
                all.precision = match value().as_str() {
                    "f16" => Precision::F16,
                    "int8" => Precision::Int8,
                    _ => Precision::F32,
                }
            }
            other => panic!("unknown argument {other}"),
        }
    }
    if all.noise.is_empty() {
        all.noise.push(None);
    }
    all
}

/// Word errors of a text: substitutions, insertions and deletions.
fn word_errors(text: &str, expected: &str) -> usize {
    let words = |text: &str| normalized(text).split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    edit_distance(&words(text), &words(expected))
}

/// What one decoding made of all sentences of a voice.
#[derive(Default)]
struct Tally {
    errors: usize,
    words: usize,
    right: usize,
    wrong: usize,
    false_commands: usize,
    milliseconds: f64,
    seconds: f64,
    sentences: usize,
}

impl Tally {
    fn row(&self, name: &str, commands: usize, others: usize) {
        let wer = 100.0 * self.errors as f64 / self.words.max(1) as f64;
        let mean = self.milliseconds / self.sentences.max(1) as f64;
        let factor = self.milliseconds / 1e3 / self.seconds.max(1e-9);
        let (right, wrong, false_commands) = (self.right, self.wrong, self.false_commands);
        println!(
            "| {name} | {wer:.1} % | {right}/{commands} | {wrong} | {false_commands}/{others} | {factor:.3} | {mean:.0} |"
        );
    }
}

static NEVER: AtomicBool = AtomicBool::new(false);

fn main() {
    let arguments = arguments();
    let began = Instant::now();
    let model = Whisper::open(&arguments.model, arguments.precision).unwrap_or_else(|error| panic!("{error}"));
    let opened = began.elapsed();
    let began = Instant::now();
    let phrases = model.phrases(&sentences::known()).unwrap();
    println!(
        "model opened in {:.2} s; {} sentences, {} tokens in {:.0} ms; context {:?}; {:?}",
        opened.as_secs_f64(),
        phrases.sentences().len(),
        phrases.tokens(),
        began.elapsed().as_secs_f64() * 1e3,
        arguments.context,
        arguments.precision,
    );
    if arguments.calibrate {
        calibrate(&model, &phrases, &arguments);
    } else {
        report(&model, &phrases, &arguments);
    }
}

fn prompt() -> Options {
    Options { prompt: Some(format!("{}.", sentences::labels().join(", "))), ..Options::default() }
}

/// Bonuses for each token that are tried.
const BONUSES: [f32; 3] = [1.0, 1.5, 2.0];

/// Prints the best sentence's numbers for each sentence of the calibration.
fn calibrate(model: &Whisper, phrases: &Phrases, arguments: &Arguments) {
    let spoken = Spoken::calibration();
    println!("voice\tsnr\tkind\tright\tbonus\tratio\ttotal\tlead\tfree-average\tno-speech\tsaid\tfree\tbest");
    for voice in &arguments.voices {
        for noise in &arguments.noise {
            let all = spoken.commands.iter().map(|s| (s, true)).chain(spoken.others.iter().map(|s| (s, false)));
            for (at, (sentence, command)) in all.enumerate() {
                let samples = with_noise(&voice.speak(sentence), *noise, at as u64);
                let hearing = model.listen(&samples, arguments.context, &NEVER).unwrap();
                for token_bonus in BONUSES {
                    let acceptance = Acceptance { token_bonus, least_ratio: -40.0, ..Acceptance::default() };
                    let search = PhraseSearch::default();
                    let found = model.recognize(&hearing, phrases, search, acceptance, &prompt(), &NEVER).unwrap();
                    let best = found.best.map(|best| phrases.sentences()[best.sentence].as_str()).unwrap_or_default();
                    let right = normalized(best) == normalized(sentence);
                    let ratio = found.best.map_or(f32::NEG_INFINITY, |best| best.ratio);
                    let total =
                        found.best.map_or(f32::NEG_INFINITY, |best| best.log_probability) - found.free.log_probability;
                    println!(
                        "{}\t{noise:?}\t{}\t{right}\t{token_bonus}\t{ratio:.3}\t{total:.2}\t{:.2}\t{:.3}\t{:.3}\t{sentence}\t{}\t{best}",
                        voice.name,
                        if command { "command" } else { "other" },
                        found.lead.unwrap_or(f32::INFINITY),
                        found.free.average_log_probability,
                        found.free.no_speech,
                        found.free.text,
                    );
                }
            }
        }
    }
}

const DECODINGS: [&str; 5] = ["greedy", "5 beams", "greedy, prompt", "knows commands", "knows commands, prompt"];

fn report(model: &Whisper, phrases: &Phrases, arguments: &Arguments) {
    let spoken = Spoken::report();
    println!(
        "| voice, noise, decoding | word errors | commands right | wrong commands | false commands | real-time factor | ms |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    for voice in &arguments.voices {
        for noise in &arguments.noise {
            let mut tallies: [Tally; 5] = Default::default();
            let all = spoken.commands.iter().map(|s| (s, true)).chain(spoken.others.iter().map(|s| (s, false)));
            for (at, (sentence, command)) in all.enumerate() {
                let samples = with_noise(&voice.speak(sentence), *noise, at as u64);
                let beams = Options { beams: 5, ..Options::default() };
                for (place, tally) in tallies.iter_mut().enumerate() {
                    if !arguments.decodings.is_empty() && !arguments.decodings.contains(&place) {
                        continue;
                    }
                    let began = Instant::now();
                    let hearing = model.listen(&samples, arguments.context, &NEVER).unwrap();
                    let (search, acceptance) = (PhraseSearch::default(), Acceptance::default());
                    let free = |options: &Options| {
                        let text = model.transcribe(&hearing, options, &NEVER).unwrap().text;
                        let source = phrases.find(&text).map_or(Source::Free, Source::Command);
                        (text, source)
                    };
                    let known = |options: &Options| {
                        let found = model.recognize(&hearing, phrases, search, acceptance, options, &NEVER).unwrap();
                        (found.text, found.source)
                    };
                    let (text, source) = match place {
                        0 => free(&Options::default()),
                        1 => free(&beams),
                        2 => free(&prompt()),
                        3 => known(&Options::default()),
                        _ => known(&prompt()),
                    };
                    tally.milliseconds += began.elapsed().as_secs_f64() * 1e3;
                    tally.seconds += f64::from(hearing.seconds);
                    tally.sentences += 1;
                    tally.errors += word_errors(&text, sentence);
                    tally.words += normalized(sentence).split(' ').count();
                    let is_command = source != Source::Free;
                    let right = is_command && normalized(&text) == normalized(sentence);
                    tally.right += usize::from(command && right);
                    tally.wrong += usize::from(command && is_command && !right);
                    tally.false_commands += usize::from(!command && is_command);
                    if arguments.details && (command != right || !command && is_command) {
                        println!("    {}: {sentence} -> {text} ({source:?})", DECODINGS[place]);
                    }
                }
            }
            let noise = noise.map_or_else(|| "clean".to_owned(), |decibels| format!("{decibels} dB"));
            for (tally, decoding) in tallies.iter().zip(DECODINGS).filter(|(tally, _)| tally.sentences > 0) {
                let name = format!("{}, {noise}, {decoding}", voice.name);
                tally.row(&name, spoken.commands.len(), spoken.others.len());
            }
        }
    }
}
