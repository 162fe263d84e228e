//! The command of a sentence: multinomial logistic regression, learned by AdaGrad.

use std::collections::{HashMap, HashSet};

use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;

use crate::examples::Filled;
use crate::table::{Index, Table, feature};
use crate::words::{Kind, Word};

/// Times that each filled sentence is learned from.
const ROUNDS: usize = 3;

/// Length of a step, relative to the root of the squared gradients so far.
const RATE: f32 = 0.2;

/// Weight of the square of the weights.
const DECAY: f32 = 1e-4;

/// Share of the probability that is spread over all commands, so that no example is taken for certain.
const SMOOTHING: f32 = 0.05;

/// Squared gradient from which a step begins.
const FIRST_SQUARE: f32 = 1e-2;

/// Length of the vector of features of a sentence.
const LENGTH: f32 = 3.0;

/// Weight of a part of a word beside 1 of a word.
const PART: f32 = 0.35;

/// Weight of the constant feature.
const CONSTANT: f32 = 0.3;

/// Letters of a part of a word.
const PART_LETTERS: usize = 4;

/// Least number of sentences that have a feature of more than one word.
const LEAST_SENTENCES: u32 = 2;

/// Rows of smaller weights are left out.
const LEAST_WEIGHT: f32 = 0.05;

/// A feature with its weight in a sentence.
type Weighted = (u64, f32);

/// The features of a sentence. `true` marks those of one word.
fn features(words: &[Word], mut each: impl FnMut(Weighted, bool)) {
    let mut keys: Vec<&str> = vec!["^"];
    for word in words {
        // A name, a colour or a number of several words counts once, and of the marks those that tell something.
        let is_repeated = !matches!(word.kind, Kind::Plain | Kind::Mark) && keys.last() == Some(&word.key());
        let is_mark = word.kind == Kind::Mark && !matches!(word.key(), "?" | "%");
        if !is_repeated && !is_mark {
            keys.push(word.key());
        }
    }
    keys.push("$");
    let inner = keys.get(1..keys.len() - 1).unwrap_or_default();
    inner.iter().for_each(|key| each((feature(&["1", key]), 1.0), true));
    keys.windows(2).for_each(|two| each((feature(&["2", two[0], two[1]]), 1.0), false));
    for three in keys.windows(3) {
        each((feature(&["1+1", three[0], three[2]]), 1.0), false);
        each((feature(&["3", three[0], three[1], three[2]]), 1.0), false);
    }
    for word in words.iter().filter(|word| word.kind == Kind::Plain) {
        let letters: Vec<char> = std::iter::once('<').chain(word.text.chars()).chain(['>']).collect();
        if letters.len() > PART_LETTERS + 1 {
            for part in letters.windows(PART_LETTERS) {
                each((feature(&["part", &part.iter().collect::<String>()]), PART), false);
            }
        }
    }
}

/// The vector of the known features of a sentence, each with its row.
fn vector<R: Copy + Ord>(words: &[Word], row_of: impl Fn(u64) -> Option<R>) -> Vec<(R, f32)> {
    let mut vector: Vec<(R, f32)> = Vec::new();
    features(words, |(hash, weight), _| vector.extend(row_of(hash).map(|row| (row, weight))));
    vector.sort_unstable_by_key(|(row, _)| *row);
    vector.dedup_by_key(|(row, _)| *row);
    let length = vector.iter().map(|(_, weight)| weight * weight).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
    vector.iter_mut().for_each(|(_, weight)| *weight *= LENGTH / length);
    vector
}

/// The features that enough sentences have.
fn index(filled: &[Filled]) -> Index {
    // Fillings of a template count once.
    let mut counts: HashMap<u64, (u32, usize, bool)> = HashMap::new();
    for sentence in filled {
        let mut seen = HashSet::new();
        features(&sentence.words, |(hash, _), is_word| {
            if seen.insert(hash) {
                let (count, last, _) = counts.entry(hash).or_insert((0, usize::MAX, is_word));
                *count += u32::from(*last != sentence.template);
                *last = sentence.template;
            }
        });
    }
    let mut kept: Vec<u64> = counts
        .into_iter()
        .filter(|(_, (count, _, is_word))| *is_word || *count >= LEAST_SENTENCES)
        .map(|(hash, _)| hash)
        .collect();
    // The order of a hash map differs from run to run.
    kept.sort_unstable();
    (0..).zip(kept).map(|(row, hash)| (hash, row)).collect()
}

/// Learned weights of the commands.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Classifier {
    pub(crate) table: Table,
    pub(crate) constants: Vec<f32>,
}

impl Classifier {
    pub(crate) fn train(filled: &[Filled], commands: usize, random: &mut ChaCha8Rng) -> Self {
        let index = index(filled);
        let constant = index.len();
        let mut weights = vec![0.0_f32; (constant + 1) * commands];
        let mut squares = vec![FIRST_SQUARE; weights.len()];
        let mut examples: Vec<(Vec<(usize, f32)>, usize)> = Vec::with_capacity(filled.len());
        for sentence in filled {
            let mut known = vector(&sentence.words, |hash| index.get(&hash).map(|row| *row as usize));
            known.push((constant, CONSTANT));
            examples.push((known, sentence.command));
        }
        let mut errors = vec![0.0_f32; commands];
        for _ in 0..ROUNDS {
            examples.shuffle(random);
            for (known, command) in &examples {
                errors.fill(0.0);
                for (row, by) in known {
                    let row = &weights[row * commands..(row + 1) * commands];
                    errors.iter_mut().zip(row).for_each(|(sum, weight)| *sum += by * weight);
                }
                to_probabilities(&mut errors);
                let spread = SMOOTHING / commands as f32;
                errors.iter_mut().for_each(|error| *error -= spread);
                errors[*command] -= 1.0 - SMOOTHING;
                for (row, by) in known {
                    let places = row * commands..(row + 1) * commands;
                    let (row, squares) = (&mut weights[places.clone()], &mut squares[places]);
                    for ((weight, square), error) in row.iter_mut().zip(squares).zip(&errors) {
                        let gradient = error * by + DECAY * *weight;
                        *square += gradient * gradient;
                        *weight -= RATE * gradient / square.sqrt();
                    }
                }
            }
        }
        let constants = weights[constant * commands..].iter().map(|weight| weight * CONSTANT).collect();
        Self { table: Table::of(&index, &weights, commands, LEAST_WEIGHT), constants }
    }

    /// The probability of each command.
    pub(crate) fn probabilities(&self, words: &[Word]) -> Vec<f32> {
        let mut sums = self.constants.clone();
        for (row, by) in vector(words, |hash| self.table.row_of(hash)) {
            self.table.add(row, by, &mut sums);
        }
        to_probabilities(&mut sums);
        sums
    }
}

/// Sums of weights to probabilities.
fn to_probabilities(sums: &mut [f32]) {
    let most = sums.iter().copied().fold(f32::MIN, f32::max);
    sums.iter_mut().for_each(|sum| *sum = (*sum - most).exp());
    let all: f32 = sums.iter().sum();
    sums.iter_mut().for_each(|sum| *sum /= all);
}
