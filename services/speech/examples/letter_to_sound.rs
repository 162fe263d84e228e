//! Phone errors of letter-to-sound on words of the dictionary.
//!
//! `cargo run --release -p sg-speech --example letter_to_sound`

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::expect_used,
    clippy::unwrap_used,
    reason = "a measurement prints and may stop"
)]

use std::path::Path;
use std::time::Duration;

use rand::seq::IndexedRandom as _;
use rand::{SeedableRng as _, rngs::StdRng};
use sg_speech::child_process::Limits;
use sg_speech::sphinx::MODELS;
use sg_speech::sphinx::pronunciation::{Dictionary, LetterToSound, phone_errors};

fn main() {
    let dictionary = Dictionary::read(&Path::new(MODELS).join("cmudict-en-us.dict")).expect("a dictionary");
    let mut words: Vec<&str> =
        dictionary.words().filter(|w| w.len() > 2 && w.chars().all(char::is_alphabetic)).collect();
    words.sort_unstable();
    let words: Vec<&str> = words.sample(&mut StdRng::seed_from_u64(3), 2_000).copied().collect();
    let rules = LetterToSound::find(std::env::var_os("PATH").as_deref()).expect("espeak-ng");
    let (mut errors, mut phones, mut exact, mut none) = (0, 0, 0, 0);
    for words in words.chunks(200) {
        let guessed = rules.pronounce(words, &Limits::within(Duration::from_secs(60))).expect("phonemes");
        for (word, guess) in words.iter().zip(guessed) {
            let Some(guess) = guess else {
                none += 1;
                continue;
            };
            let variants = dictionary.look_up(word);
            let (wrong, right) = variants.map(|right| (phone_errors(&guess, right), right)).min().unwrap();
            errors += wrong;
            phones += right.split(' ').count();
            exact += usize::from(wrong == 0);
        }
    }
    let (errors, phones, all) = (errors as f64, phones as f64, words.len() as f64);
    println!(
        "{all} words: {:.1} % of phones wrong, {:.1} % of words exact, {none} without",
        100.0 * errors / phones,
        100.0 * exact as f64 / all
    );
}
