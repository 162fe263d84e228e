//! Fits the weights of sphinx's confidence on sentences that the report does not use.
//!
//! `cargo run --release -p sg-speech --example calibrate`

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::expect_used,
    clippy::unwrap_used,
    clippy::needless_range_loop,
    reason = "a measurement prints and may stop; matrices are written with indices"
)]

mod corpus;

use std::path::Path;
use std::time::Duration;

use corpus::{Noise, babble, calibration, calibration_voices, grammar, noisy, say};
use sg_speech::child_process::Limits;
use sg_speech::sphinx::{MODELS, Sphinx};

const CONDITIONS: [(Noise, f64); 3] = [(Noise::None, 0.0), (Noise::White, 15.0), (Noise::Babble, 15.0)];

/// One result: features with an intercept, whether it was right, and the condition.
struct Sample {
    x: [f64; 3],
    right: bool,
    condition: usize,
}

fn main() {
    let grammar = grammar(&calibration::LABELS);
    let mut sphinx = Sphinx::find(std::env::var_os("PATH").as_deref(), Path::new(MODELS)).expect("pocketsphinx");
    let voices = calibration_voices();
    let babble = babble(&voices, &calibration::OFF_TOPIC, 40);
    let mut samples = Vec::new();
    let groups =
        [(&calibration::COMMANDS[..], true), (&calibration::OTHER_COMMANDS, false), (&calibration::OFF_TOPIC, false)];
    for (v, voice) in voices.iter().enumerate() {
        for (sentences, is_command) in groups {
            for (k, sentence) in sentences.iter().enumerate() {
                let clean = say(voice, sentence);
                // One condition of each sentence and voice, in turn.
                let condition = (k + v) % CONDITIONS.len();
                if let Some((noise, snr)) = CONDITIONS.get(condition) {
                    let sound = noisy(&clean, *noise, *snr, &babble, k as u64);
                    let limits = Limits::within(Duration::from_secs(60));
                    let result = sphinx.recognize_with_features(&sound, &grammar, &limits).expect("a result");
                    let Some(features) = result.features else { continue };
                    let said = sg_speech::spoken::words(sentence);
                    let right = is_command && sg_speech::spoken::words(&result.recognition.text) == said;
                    let x = [1.0, features.loss, features.worst_word].map(f64::from);
                    println!(
                        "{}\t{condition}\t{right}\t{is_command}\t{sentence}\t{}\t{x:.2?}",
                        voice.name, result.recognition.text
                    );
                    samples.push(Sample { x, right, condition });
                }
            }
        }
    }
    let weights = fit(&samples);
    println!("weights: {weights:.4?}");
    for threshold in [0.3, 0.5, 0.7] {
        for condition in 0..CONDITIONS.len() {
            let of = |right: bool| samples.iter().filter(move |s| s.condition == condition && s.right == right);
            let accepted = |right: bool| of(right).filter(|s| probability(&weights, &s.x) >= threshold).count();
            println!(
                "threshold {threshold}, {:?}: right accepted {}/{}, wrong accepted {}/{}",
                CONDITIONS[condition],
                accepted(true),
                of(true).count(),
                accepted(false),
                of(false).count()
            );
        }
    }
}

fn probability(weights: &[f64; 3], x: &[f64; 3]) -> f64 {
    let sum: f64 = weights.iter().zip(x).map(|(w, x)| w * x).sum();
    1.0 / (1.0 + (-sum).exp())
}

/// Logistic regression by Newton's method, with a small penalty on the weights (McCullagh and Nelder 1989, ch. 4).
fn fit(samples: &[Sample]) -> [f64; 3] {
    let mut weights = [0.0; 3];
    for _ in 0..50 {
        let mut gradient = [0.0; 3];
        let mut hessian = [[0.0; 3]; 3];
        for sample in samples {
            let p = probability(&weights, &sample.x);
            for i in 0..3 {
                gradient[i] += (f64::from(u8::from(sample.right)) - p) * sample.x[i];
                for j in 0..3 {
                    hessian[i][j] += p * (1.0 - p) * sample.x[i] * sample.x[j];
                }
            }
        }
        for i in 0..3 {
            gradient[i] -= 0.01 * weights[i];
            hessian[i][i] += 0.01;
        }
        let step = solve(hessian, gradient);
        for i in 0..3 {
            weights[i] += step[i];
        }
    }
    weights
}

/// Gaussian elimination with pivots.
fn solve(mut a: [[f64; 3]; 3], mut b: [f64; 3]) -> [f64; 3] {
    for i in 0..3 {
        let pivot = (i..3).max_by(|x, y| a[*x][i].abs().total_cmp(&a[*y][i].abs())).unwrap();
        a.swap(i, pivot);
        b.swap(i, pivot);
        for row in i + 1..3 {
            let factor = a[row][i] / a[i][i];
            for column in i..3 {
                a[row][column] -= factor * a[i][column];
            }
            b[row] -= factor * b[i];
        }
    }
    for i in (0..3).rev() {
        for column in i + 1..3 {
            b[i] -= a[i][column] * b[column];
        }
        b[i] /= a[i][i];
    }
    b
}
