//! Milliseconds of each step against the error of the text, for shorter audio contexts and other precisions.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a bench prints its table and fails by panicking")]
use sg_whisper::*;
use std::sync::atomic::AtomicBool;
use std::time::Instant;
fn main() {
    let cache = directories::ProjectDirs::from("", "", "supergaussian").unwrap().cache_dir().to_owned();
    let model = Whisper::open(&cache.join("models/whisper-tiny.en"), Precision::F32).unwrap();
    let never = AtomicBool::new(false);
    let wav = std::fs::read("/tmp/w/a.wav").unwrap();
    let samples: Vec<f32> =
        wav[44..].as_chunks::<2>().0.iter().map(|p| f32::from(i16::from_le_bytes(*p)) / 32768.0).collect();
    let text = std::fs::read_to_string("/tmp/w/phr.txt").unwrap();
    let s: Vec<&str> = text.lines().collect();
    let phrases = model.phrases(&s).unwrap();
    for frames in [1500, 750, 400, 250] {
        for _ in 0..2 {
            let t = Instant::now();
            let hearing = model.listen(&samples, AudioContext::Frames(frames), &never).unwrap();
            let a = t.elapsed();
            let t = Instant::now();
            let text = model.transcribe(&hearing, &Options::default(), &never).unwrap();
            let b = t.elapsed();
            let t = Instant::now();
            let sc = model.score(&hearing, &phrases, PhraseSearch::default(), &Options::default(), &never).unwrap();
            let c = t.elapsed();
            println!(
                "{frames} listen {a:?} transcribe {b:?} score {c:?} {} {} {:?} {}",
                text.tokens.len(),
                text.text,
                sc[0],
                sc.len()
            );
        }
    }
}
