//! Word errors, commands right, false commands, time: sphinx on spoken sentences, clean and in noise.
//!
//! `cargo run --release -p sg-speech --example recognition -- [EVERY]` takes every EVERYth sentence in noise, all when clean.

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::expect_used,
    clippy::unwrap_used,
    reason = "a measurement prints and may stop"
)]

mod corpus;

use std::path::Path;
use std::time::{Duration, Instant};

use corpus::{Noise, babble, calibration, grammar, noisy, report, say, voices};
use nix::sys::resource::{UsageWho, getrusage};
use sg_speech::accuracy::Accuracy;
use sg_speech::audio::{SPEECH_RATE, duration_of};
use sg_speech::child_process::Limits;
use sg_speech::recognizer::Recognizer as _;
use sg_speech::sphinx::{MODELS, Sphinx};

const CONDITIONS: [(&str, Noise, f64); 5] = [
    ("clean", Noise::None, 0.0),
    ("white 20 dB", Noise::White, 20.0),
    ("white 10 dB", Noise::White, 10.0),
    ("white 5 dB", Noise::White, 5.0),
    ("babble 20 dB", Noise::Babble, 20.0),
];

/// Seconds of processor time of all children so far.
fn children_seconds() -> f64 {
    let usage = getrusage(UsageWho::RUSAGE_CHILDREN).expect("usage");
    let seconds = |time: nix::sys::time::TimeVal| time.tv_sec() as f64 + time.tv_usec() as f64 * 1e-6;
    seconds(usage.user_time()) + seconds(usage.system_time())
}

fn main() {
    let every: usize = std::env::args().nth(1).map_or(1, |n| n.parse().expect("a number"));
    let grammar = grammar(&report::LABELS);
    let mut sphinx = Sphinx::find(std::env::var_os("PATH").as_deref(), Path::new(MODELS)).expect("pocketsphinx");
    let limits = || Limits::within(Duration::from_secs(60));
    let unpronounceable = sphinx.prepare_grammar(&grammar, &limits()).expect("a grammar");
    assert!(unpronounceable.is_empty(), "{unpronounceable:?}");
    for command in report::COMMANDS {
        assert!(grammar.written(command).is_some(), "not in the grammar: {command}");
    }
    let voices = voices();
    let babble = babble(&voices, &calibration::OFF_TOPIC, 40);
    println!(
        "| voice | sound | WER | commands right | wrong | false: other commands | false: off topic | CPU s | latency ms, median (90 %) |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for (voice, (name, noise, snr)) in voices.iter().flat_map(|voice| CONDITIONS.iter().map(move |c| (voice, *c))) {
        let step = if noise == Noise::None { 1 } else { every };
        let (mut accuracy, mut others) = (Accuracy::default(), Accuracy::default());
        let (mut cpu, mut count, mut seconds, mut latencies) = (0.0, 0, 0.0, Vec::new());
        let groups = [&report::COMMANDS[..], &report::OTHER_COMMANDS, &report::OFF_TOPIC];
        for (group, sentences) in groups.into_iter().enumerate() {
            for (k, sentence) in sentences.iter().enumerate().step_by(step) {
                let sound = noisy(&say(voice, sentence), noise, snr, &babble, 1_000 + k as u64);
                let (began, before) = (Instant::now(), children_seconds());
                let result = sphinx.recognize(&sound, &grammar, &limits()).expect("a result");
                cpu += children_seconds() - before;
                count += 1;
                seconds += duration_of(sound.len(), SPEECH_RATE).as_secs_f64();
                latencies.push(began.elapsed().as_secs_f64() * 1e3);
                match group {
                    0 => accuracy.count_command(sentence, &result.text, result.accepted),
                    1 => others.count_off_topic(result.accepted),
                    _ => accuracy.count_off_topic(result.accepted),
                }
                let wrong = result.accepted != (group == 0) || group == 0 && result.text != *sentence;
                if wrong {
                    eprintln!("{} {name}: “{sentence}” as “{}” {:.2}", voice.name, result.text, result.confidence);
                }
            }
        }
        latencies.sort_by(f64::total_cmp);
        let at = |share: f64| latencies[(share * (latencies.len() - 1) as f64) as usize];
        println!(
            "| {} | {name} | {:.3} | {}/{} | {} | {}/{} | {}/{} | {:.2} for {:.1} s | {:.0} ({:.0}) |",
            voice.name,
            accuracy.word_error_rate(),
            accuracy.commands_right,
            accuracy.commands,
            accuracy.commands_wrong,
            others.false_commands,
            others.off_topic,
            accuracy.false_commands,
            accuracy.off_topic,
            cpu / f64::from(count),
            seconds / f64::from(count),
            at(0.5),
            at(0.9),
        );
    }
}
