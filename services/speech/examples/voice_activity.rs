//! Misses, false starts and latency of the endpointer with both detectors, on sentences in noise.
//!
//! `cargo run --release -p sg-speech --example voice_activity`

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::expect_used,
    clippy::unwrap_used,
    reason = "a measurement prints and may stop"
)]

mod corpus;

use std::time::Instant;

use corpus::{Noise, add_noise, babble, calibration, report, say, speech_power, voices};
use sg_speech::audio::SPEECH_RATE;
use sg_speech::endpoint::{Endpoint, EndpointSettings, Endpointer};
use sg_speech::vad::{EnergyGate, GatedDetector, NeuralDetector, VoiceDetector};

/// Silence between sentences in samples.
const PAUSE: usize = 2 * SPEECH_RATE as usize;

/// Silence that `say` leaves around a sentence, in samples.
const AROUND: u64 = SPEECH_RATE as u64 * 3 / 10;

const CONDITIONS: [(&str, Noise, f64); 7] = [
    ("clean", Noise::None, 0.0),
    ("white 20 dB", Noise::White, 20.0),
    ("white 10 dB", Noise::White, 10.0),
    ("white 5 dB", Noise::White, 5.0),
    ("babble 20 dB", Noise::Babble, 20.0),
    ("babble 10 dB", Noise::Babble, 10.0),
    ("babble 5 dB", Noise::Babble, 5.0),
];

fn main() {
    let voices = voices();
    let (mut stream, mut spoken, mut powers) = (vec![0.0_f32; PAUSE], Vec::new(), Vec::new());
    for (k, sentence) in report::COMMANDS.iter().enumerate() {
        let sound = say(&voices[k % voices.len()], sentence);
        let begin = stream.len() as u64 + AROUND;
        spoken.push((begin, begin + sound.len() as u64 - 2 * AROUND));
        powers.push(speech_power(&sound));
        stream.extend(sound);
        stream.extend(vec![0.0; PAUSE]);
    }
    let power = powers.iter().sum::<f64>() / powers.len() as f64;
    let babble = babble(&voices, &calibration::OFF_TOPIC, stream.len() / SPEECH_RATE as usize + 1);
    println!("{} sentences, {} s", spoken.len(), stream.len() / SPEECH_RATE as usize);
    println!(
        "| detector | sound | missed | cut within | false starts | onset ms, median | end ms, median (90 %) | ms a second |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    for (name, noise, snr) in CONDITIONS {
        let mut sound = stream.clone();
        add_noise(&mut sound, power, noise, snr, &babble, 5);
        let detectors: [(&str, Box<dyn VoiceDetector>); 3] = [
            ("earshot", Box::<NeuralDetector>::default()),
            ("energy gate", Box::<EnergyGate>::default()),
            ("earshot behind the gate", Box::<GatedDetector>::default()),
        ];
        for (detector_name, detector) in detectors {
            let mut endpointer = Endpointer::new(detector, EndpointSettings::default());
            let began = Instant::now();
            let (mut onsets, mut found) = (Vec::new(), Vec::new());
            let mut events = Vec::new();
            for block in sound.chunks(160) {
                events.extend(endpointer.step(block).into_iter().map(|event| (endpointer.position(), event)));
            }
            events.extend(endpointer.finish().into_iter().map(|event| (sound.len() as u64, event)));
            let elapsed = began.elapsed();
            for (position, event) in events {
                match event {
                    Endpoint::SpeechStarted { .. } => onsets.push(position),
                    Endpoint::SpeechEnded { start, samples, .. } => {
                        found.push((start, start + samples.len() as u64, position));
                    }
                    _ => {}
                }
            }
            report_row(detector_name, name, &spoken, &onsets, &found, elapsed.as_secs_f64(), sound.len());
        }
    }
}

fn report_row(
    detector: &str,
    condition: &str,
    spoken: &[(u64, u64)],
    onsets: &[u64],
    found: &[(u64, u64, u64)],
    seconds: f64,
    samples: usize,
) {
    let ms = |samples: u64| samples as f64 * 1e3 / f64::from(SPEECH_RATE);
    let (mut missed, mut cut, mut onset_ms, mut end_ms) = (0, 0, Vec::new(), Vec::new());
    for (begin, end) in spoken {
        let touching: Vec<_> = found.iter().filter(|(start, stop, _)| start < end && stop > begin).collect();
        // All of the sentence is in one utterance, up to 50 ms at its ends.
        let slack = u64::from(SPEECH_RATE) / 20;
        let whole = touching.iter().find(|(start, stop, _)| *start <= begin + slack && stop + slack >= *end);
        match whole {
            None if touching.is_empty() => missed += 1,
            None => cut += 1,
            Some((_, _, position)) => end_ms.push(ms(position.saturating_sub(*end))),
        }
        let first = onsets.iter().find(|onset| *onset >= begin && *onset < end);
        onset_ms.extend(first.map(|onset| ms(onset - begin)));
    }
    // Utterances that hold no sentence, or that began more than half a second before one.
    let early = u64::from(SPEECH_RATE) / 2;
    let is_false = |onset: &&u64| !spoken.iter().any(|(begin, end)| **onset + early >= *begin && *onset < end);
    let false_starts = onsets.iter().filter(is_false).count();
    let at = |values: &mut Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        values.get((share * values.len().saturating_sub(1) as f64) as usize).map_or("–".into(), |v| format!("{v:.0}"))
    };
    println!(
        "| {detector} | {condition} | {missed} | {cut} | {false_starts} | {} | {} ({}) | {:.2} |",
        at(&mut onset_ms, 0.5),
        at(&mut end_ms, 0.5),
        at(&mut end_ms, 0.9),
        seconds * 1e3 * f64::from(SPEECH_RATE) / samples as f64
    );
}
