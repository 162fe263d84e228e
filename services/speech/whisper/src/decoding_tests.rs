//! Fast ways of decoding beside slow ones, on tiny random models and on tiny.en.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::sync::atomic::AtomicBool;

use sg_layers::Precision;

use crate::decoder::Branch;
use crate::parity_tests::{fixtures, sound};
use crate::probability::{log_add, log_sum};
use crate::rules::Rules;
use crate::spelling::spellings;
use crate::{Acceptance, AudioContext, Hearing, Options, PhraseSearch, Recognition, Whisper, WhisperError};

static NEVER: AtomicBool = AtomicBool::new(false);
const SENTENCES: [&str; 8] = [
    "make the sac red",
    "make the sac blue",
    "make the skin blue",
    "hide the bone",
    "hide the vessel",
    "show only the vessel",
    "fade it to 20 percent",
    "undo",
];

fn tiny(name: &str) -> (Whisper, Hearing) {
    let model = Whisper::open(&fixtures().join(name), Precision::F32).unwrap();
    let hearing = model.listen(&sound(7000), AudioContext::Whole, &NEVER).unwrap();
    (model, hearing)
}

/// A sentence's log-probability: each spelling by itself, in a tree of its own.
fn score_alone(model: &Whisper, hearing: &Hearing, sentence: &str) -> f32 {
    let rules = Rules::new(&model.vocabulary, &model.suppressed, false, hearing.frames);
    let prefix =
        model.vocabulary.prefix(None, 0, model.vocabulary.languages().first().map(|(_, id)| *id), false).unwrap();
    let (_, _, decoder) = model.parts();
    spellings(sentence).iter().fold(f32::NEG_INFINITY, |sum, spelling| {
        let text = model.vocabulary.ids(spelling).unwrap();
        let all: Vec<u32> = prefix.iter().chain(&text).copied().collect();
        let chain: Vec<Branch> =
            (0..all.len()).map(|at| Branch { parent: at.checked_sub(1), token: all[at] }).collect();
        let outputs = decoder.advance(&hearing.keys, &mut decoder.tree(), &chain).unwrap();
        let logits = decoder.logits(&outputs).unwrap();
        let rows = logits.chunks(decoder.vocabulary()).skip(prefix.len() - 1);
        let next = text.iter().copied().chain([model.vocabulary.end]);
        let of_spelling: f32 = rows
            .zip(next)
            .enumerate()
            .map(|(at, (row, token))| {
                let mut row = row.to_vec();
                rules.apply(&text[..at], &mut row);
                row[token as usize] - log_sum(&row)
            })
            .sum();
        log_add(sum, of_spelling)
    })
}

#[test]
fn the_tree_of_sentences_scores_each_as_by_itself() {
    for name in ["english", "multilingual"] {
        let (model, hearing) = tiny(name);
        let phrases = model.phrases(&SENTENCES).unwrap();
        let options = Options { language: Some("en".into()), ..Options::default() };
        let exact = model.score(&hearing, &phrases, PhraseSearch::Exact, &options, &NEVER).unwrap();
        assert_eq!(exact.len(), SENTENCES.len());
        assert!(exact.windows(2).all(|pair| pair[0].log_probability >= pair[1].log_probability));
        for score in &exact {
            let alone = score_alone(&model, &hearing, SENTENCES[score.sentence]);
            assert!((score.log_probability - alone).abs() < 1e-3, "{name}: {score:?}, but {alone} alone");
        }
        // A search that drops nothing is the exact one; a narrow one finds only what is there.
        let all = PhraseSearch::Beam { beams: 1000, margin: f32::MAX };
        assert_eq!(model.score(&hearing, &phrases, all, &options, &NEVER).unwrap(), exact);
        let narrow = PhraseSearch::Beam { beams: 2, margin: 5.0 };
        for score in model.score(&hearing, &phrases, narrow, &options, &NEVER).unwrap() {
            let of_exact = exact.iter().find(|other| other.sentence == score.sentence).unwrap();
            assert!(score.log_probability <= of_exact.log_probability + 1e-4);
        }
    }
}

#[test]
fn beams_find_nothing_less_likely_than_greed() {
    for name in ["english", "multilingual"] {
        let (model, hearing) = tiny(name);
        let with = |beams| {
            let options = Options { beams, most_tokens: 12, language: Some("en".into()), ..Options::default() };
            model.transcribe(&hearing, &options, &NEVER).unwrap()
        };
        let (greedy, wide) = (with(1), with(5));
        if greedy.complete && wide.complete {
            assert!(wide.average_log_probability >= greedy.average_log_probability - 1e-4, "{wide:?}, {greedy:?}");
        }
        assert!(wide.tokens.len() <= 12 && greedy.tokens.len() <= 12);
    }
}

#[test]
fn times_are_in_order_and_within_the_sound() {
    let (model, hearing) = tiny("english");
    let options = Options { timestamps: true, most_tokens: 30, ..Options::default() };
    let found = model.transcribe(&hearing, &options, &NEVER).unwrap();
    let first = model.vocabulary.first_time();
    let times: Vec<u32> = found.tokens.iter().copied().filter(|token| *token >= first).collect();
    assert!(found.tokens[0] >= first, "{found:?}");
    assert!(
        times.windows(2).all(|pair| pair[0] <= pair[1]) && times.iter().all(|time| time - first <= 50),
        "{times:?}"
    );
    for segment in &found.segments {
        assert!(segment.to.is_none_or(|to| to >= segment.from) && segment.from <= 1.0, "{segment:?}");
    }
}

#[test]
fn a_flag_stops_everything() {
    let (model, hearing) = tiny("english");
    let phrases = model.phrases(&SENTENCES).unwrap();
    let (options, flag) = (Options::default(), AtomicBool::new(true));
    let cancelled = |result: Result<(), WhisperError>| assert!(matches!(result, Err(WhisperError::Cancelled)));
    cancelled(model.listen(&sound(7000), AudioContext::Whole, &flag).map(drop));
    cancelled(model.transcribe(&hearing, &options, &flag).map(drop));
    cancelled(model.score(&hearing, &phrases, PhraseSearch::Exact, &options, &flag).map(drop));
}

#[test]
fn fewer_bits_move_scores_little() {
    let folder = fixtures().join("english");
    let scores = |precision| {
        let model = Whisper::open(&folder, precision).unwrap();
        let hearing = model.listen(&sound(7000), AudioContext::Whole, &NEVER).unwrap();
        let phrases = model.phrases(&SENTENCES).unwrap();
        let mut scores = model.score(&hearing, &phrases, PhraseSearch::Exact, &Options::default(), &NEVER).unwrap();
        scores.sort_by_key(|score| score.sentence);
        scores
    };
    let exact = scores(Precision::F32);
    // The fixture's weights are those of 16 bits.
    for (precision, bound) in [(Precision::F16, 1e-3), (Precision::Int8, 2.0)] {
        for (found, expected) in scores(precision).iter().zip(&exact) {
            let error = (found.log_probability - expected.log_probability).abs();
            assert!(error < bound, "{precision:?}: {found:?} in place of {expected:?}");
        }
    }
}

#[test]
fn beams_are_spent_where_no_sentence_fits_clearly() {
    let (model, hearing) = tiny("english");
    let phrases = model.phrases(&SENTENCES).unwrap();
    // Fewer tokens than the sound may have.
    let options = Options { beams: 4, most_tokens: 8, ..Options::default() };
    let recognize = |clear_ratio: f32, options: &Options| {
        let acceptance = Acceptance { least_ratio: f32::NEG_INFINITY, clear_ratio, ..Acceptance::default() };
        model.recognize(&hearing, &phrases, PhraseSearch::Exact, acceptance, options, &NEVER).unwrap()
    };
    let greedy = recognize(f32::NEG_INFINITY, &Options { beams: 1, ..options.clone() });
    let [clear, unclear] = [f32::NEG_INFINITY, f32::INFINITY].map(|ratio| recognize(ratio, &options));
    // A greedy text that does not end by itself leaves nothing clear.
    if greedy.free.complete {
        assert_eq!(clear, greedy);
    }
    assert_eq!(unclear.free, model.transcribe(&hearing, &options, &NEVER).unwrap());
    // More texts to compare with make no sentence likelier.
    let ratio = |found: &Recognition| found.best.unwrap().ratio;
    assert_eq!(unclear.source, greedy.source);
    assert!(ratio(&unclear) <= ratio(&greedy), "{unclear:?} {greedy:?}");
}
