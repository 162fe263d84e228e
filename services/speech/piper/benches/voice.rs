//! Seconds to open a voice, milliseconds for sentences on one core and on two, memory, and the difference from ONNX Runtime.
//!
//! `cargo bench -p sg-piper --bench voice`. It takes the voice that `ops/models.sh` gets, or the file that is given as an argument.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a bench prints its table and fails by panicking")]

use std::path::PathBuf;
use std::time::{Duration, Instant};

use sg_piper::Piper;
use sg_speech::child_process::Limits;

/// Of about 1, 3 and 6 s.
const SENTENCES: [&str; 3] = [
    "The sac is red now.",
    "The quick brown fox jumps over the lazy dog near the river bank.",
    "I have made the aneurysm red, faded everything else to twenty percent, and turned the view so that the neck of the sac faces you.",
];
/// The fastest repetition counts, since others use the machine too.
const REPETITIONS: usize = 7;

#[derive(serde::Deserialize)]
struct Reference {
    sentence: String,
    samples: usize,
    step: usize,
    every: Vec<f32>,
}

fn main() {
    let cache = directories::ProjectDirs::from("", "", "supergaussian").unwrap().cache_dir().to_owned();
    let joe = cache.join("models/piper-en_US-joe-medium/en_US-joe-medium.onnx");
    let given = std::env::args().skip(1).find(|argument| !argument.starts_with("--")).map(PathBuf::from);
    let path = given.clone().unwrap_or(joe);
    let search_path = std::env::var_os("PATH");
    let began = Instant::now();
    let mut voice = Piper::open(&path, search_path.as_deref()).unwrap();
    println!("{}: opened in {:.2} s, load {}", path.display(), began.elapsed().as_secs_f64(), load());
    println!("| cores | sound | phonemes and sound | real-time factor |");
    println!("| --- | --- | --- | --- |");
    for cores in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(cores).build().unwrap();
        for sentence in SENTENCES {
            let mut best = Duration::MAX;
            let mut sound = Duration::ZERO;
            for _ in 0..REPETITIONS {
                let began = Instant::now();
                let spoken = pool.install(|| voice.speak(sentence, &Limits::within(Duration::from_secs(60)))).unwrap();
                best = best.min(began.elapsed());
                sound = spoken.duration();
            }
            let factor = best.as_secs_f64() / sound.as_secs_f64();
            println!("| {cores} | {:.2} s | {:.0} ms | {factor:.3} |", sound.as_secs_f64(), best.as_secs_f64() * 1e3);
        }
    }
    if given.is_none() {
        let reference = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/joe-medium.json");
        let reference: Reference = serde_json::from_slice(&std::fs::read(reference).unwrap()).unwrap();
        voice = voice.with_noise(0.0).unwrap();
        let sound = voice.speak(&reference.sentence, &Limits::within(Duration::from_secs(60))).unwrap();
        assert_eq!(sound.samples.len(), reference.samples);
        let pairs = sound.samples.iter().step_by(reference.step).zip(&reference.every);
        let most = pairs.map(|(found, exact)| (found - exact).abs()).fold(0.0, f32::max);
        println!("largest difference from ONNX Runtime: {most:.1e} of full scale");
    }
    println!("most memory: {} MB", most_memory() / 1000);
    let long = SENTENCES[2].trim_end_matches('.').to_owned() + ", ";
    let began = Instant::now();
    let sound = voice.speak(&long.repeat(8), &Limits::within(Duration::from_secs(120))).unwrap();
    let (seconds, elapsed) = (sound.duration().as_secs_f64(), began.elapsed().as_secs_f64());
    println!("one sentence of {seconds:.1} s: {elapsed:.1} s, most memory: {} MB", most_memory() / 1000);
}

fn load() -> String {
    std::fs::read_to_string("/proc/loadavg").unwrap().split(' ').take(1).collect()
}

/// In kB.
fn most_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}
