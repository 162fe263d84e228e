//! The slots of words: a linear chain, learned by an averaged perceptron and decoded by Viterbi's algorithm.

use crate::examples::{Filled, Slot};
use crate::table::{Index, Table, feature};
use crate::words::{Kind, Word};

/// Labels of words: none, and each slot.
pub(crate) const LABELS: usize = Slot::ALL.len() + 1;

/// Times that each filled sentence is learned from.
const ROUNDS: usize = 4;

/// Rows of smaller weights are left out.
const LEAST_WEIGHT: f32 = 0.05;

/// Scores of one label behind another.
pub(crate) type Transitions = [[f32; LABELS]; LABELS];

/// The labels that a command allows.
pub(crate) type Allowed = [bool; LABELS];

fn label(slot: Option<Slot>) -> usize {
    slot.and_then(|slot| Slot::ALL.iter().position(|other| *other == slot)).map_or(0, |at| at + 1)
}

/// The labels that a command allows: none, and its slots.
pub(crate) fn allowed(command: &str) -> Allowed {
    let mut allowed = [false; LABELS];
    allowed[0] = true;
    for slot in Slot::ALL {
        allowed[label(Some(slot))] = command.contains(&slot.marked());
    }
    allowed
}

/// The features of a word in a sentence of a command.
fn features(words: &[Word], command: &str, at: usize, mut each: impl FnMut(u64)) {
    let word = |by: isize| at.checked_add_signed(by).and_then(|at| words.get(at));
    let key = |by: isize| word(by).map_or("-", Word::key);
    let kind = |by: isize| match word(by).map(|word| word.kind) {
        None => "-",
        Some(Kind::Plain) => "plain",
        Some(Kind::Number) => "number",
        Some(Kind::Color) => "color",
        Some(Kind::Name) => "name",
        Some(Kind::Mark) => "mark",
    };
    let here = word(0).map_or("", |word| word.text.as_str());
    let ending = here.char_indices().rev().nth(2).map_or(here, |(cut, _)| &here[cut..]);
    for parts in [
        &["constant"][..],
        &["kind", kind(0)],
        &["kinds", kind(-1), kind(0), kind(1)],
        &["0", key(0)],
        &["-1", key(-1)],
        &["+1", key(1)],
        &["-2", key(-2)],
        &["+2", key(2)],
        &["-1 0", key(-1), key(0)],
        &["0 +1", key(0), key(1)],
        &["-2 -1", key(-2), key(-1)],
        &["+1 +2", key(1), key(2)],
        &["command", command],
        &["command kind", command, kind(0)],
        &["command 0", command, key(0)],
        &["command -1", command, key(-1)],
        &["command +1", command, key(1)],
        &["ending", ending],
    ] {
        each(feature(parts));
    }
}

/// Learned weights of the slots.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Chain {
    pub(crate) table: Table,
    pub(crate) transitions: Transitions,
}

/// Weights while they are learned, with their sums over time.
struct Learning {
    weights: Vec<f32>,
    /// Changes of the weights, each times its time.
    sums: Vec<f32>,
    transitions: Transitions,
    transition_sums: Transitions,
    time: f32,
}

impl Learning {
    fn local(&self, rows: &[usize]) -> [f32; LABELS] {
        let mut sums = [0.0; LABELS];
        for row in rows {
            let weights = &self.weights[row * LABELS..(row + 1) * LABELS];
            sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight);
        }
        sums
    }

    /// Changes the weights of a label at one place, and of its transition.
    fn change(&mut self, rows: &[usize], before: usize, label: usize, by: f32) {
        for row in rows {
            self.weights[row * LABELS + label] += by;
            self.sums[row * LABELS + label] += by * self.time;
        }
        self.transitions[before][label] += by;
        self.transition_sums[before][label] += by * self.time;
    }

    /// The mean of the weights over time.
    fn average(&mut self) {
        let mean = |weight: &mut f32, sum: &f32| *weight -= sum / self.time;
        self.weights.iter_mut().zip(&self.sums).for_each(|(weight, sum)| mean(weight, sum));
        let sums = self.transition_sums.iter().flatten();
        self.transitions.iter_mut().flatten().zip(sums).for_each(|(weight, sum)| mean(weight, sum));
    }
}

impl Chain {
    pub(crate) fn train(filled: &[Filled], commands: &[String]) -> Self {
        let allowed: Vec<Allowed> = commands.iter().map(|command| allowed(command)).collect();
        let taught = filled.iter().filter(|sentence| allowed[sentence.command].iter().filter(|is| **is).count() > 1);
        let mut index = Index::new();
        let mut examples: Vec<(Vec<Vec<usize>>, Vec<usize>, usize)> = Vec::new();
        for sentence in taught {
            let rows_at = |at: usize| {
                let mut rows = Vec::new();
                features(&sentence.words, &commands[sentence.command], at, |hash| {
                    let next = index.len() as u32;
                    rows.push(*index.entry(hash).or_insert(next) as usize);
                });
                rows
            };
            let rows: Vec<Vec<usize>> = (0..sentence.words.len()).map(rows_at).collect();
            let labels = sentence.slots.iter().map(|slot| label(*slot)).collect();
            examples.push((rows, labels, sentence.command));
        }
        let size = index.len() * LABELS;
        let transitions = [[0.0; LABELS]; LABELS];
        let (weights, sums) = (vec![0.0; size], vec![0.0; size]);
        let mut learning = Learning { weights, sums, transitions, transition_sums: transitions, time: 1.0 };
        for _ in 0..ROUNDS {
            for (rows, labels, command) in &examples {
                let local: Vec<[f32; LABELS]> = rows.iter().map(|rows| learning.local(rows)).collect();
                let said = best(&local, &learning.transitions, &allowed[*command]);
                learning.time += 1.0;
                if said == *labels {
                    continue;
                }
                let (mut right_before, mut said_before) = (0, 0);
                for ((rows, right), said) in rows.iter().zip(labels).zip(said) {
                    if *right != said || right_before != said_before {
                        learning.change(rows, right_before, *right, 1.0);
                        learning.change(rows, said_before, said, -1.0);
                    }
                    (right_before, said_before) = (*right, said);
                }
            }
        }
        learning.average();
        Self { table: Table::of(&index, &learning.weights, LABELS, LEAST_WEIGHT), transitions: learning.transitions }
    }

    /// The slot of each word of a sentence that means a command.
    pub(crate) fn slots(&self, words: &[Word], command: &str) -> Vec<Option<Slot>> {
        let local = |at: usize| {
            let mut sums = [0.0; LABELS];
            features(words, command, at, |hash| {
                if let Some(row) = self.table.row_of(hash) {
                    self.table.add(row, 1.0, &mut sums);
                }
            });
            sums
        };
        let local: Vec<[f32; LABELS]> = (0..words.len()).map(local).collect();
        let labels = best(&local, &self.transitions, &allowed(command));
        labels.into_iter().map(|label| label.checked_sub(1).and_then(|at| Slot::ALL.get(at).copied())).collect()
    }
}

/// The labels with the largest sum of scores, by Viterbi's algorithm.
fn best(local: &[[f32; LABELS]], transitions: &Transitions, allowed: &Allowed) -> Vec<usize> {
    let is_allowed = |label: &usize| allowed[*label];
    let mut scores = [f32::MIN; LABELS];
    scores[0] = 0.0;
    let mut back: Vec<[usize; LABELS]> = Vec::with_capacity(local.len());
    for (at, here) in local.iter().enumerate() {
        let mut next = [f32::MIN; LABELS];
        let mut from = [0; LABELS];
        for label in (0..LABELS).filter(is_allowed) {
            // Before the first word stands no slot. Of equal scores the last counts, which is that of no slot.
            let before = (0..LABELS).rev().filter(|before| if at == 0 { *before == 0 } else { allowed[*before] });
            let score = |before: usize| scores[before] + transitions[before][label];
            let Some(best) = before.max_by(|a, b| score(*a).total_cmp(&score(*b))) else { continue };
            (next[label], from[label]) = (score(best) + here[label], best);
        }
        scores = next;
        back.push(from);
    }
    let mut label = (0..LABELS).rev().filter(is_allowed).max_by(|a, b| scores[*a].total_cmp(&scores[*b])).unwrap_or(0);
    let mut labels = vec![0; local.len()];
    for (at, from) in back.iter().enumerate().rev() {
        labels[at] = label;
        label = from[label];
    }
    labels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn viterbi_finds_the_best_of_all_chains() {
        // Scores without a pattern.
        let number = |k: usize| ((k * 7919 + 13) % 101) as f32 / 10.0 - 5.0;
        let mut transitions = [[0.0; LABELS]; LABELS];
        for (k, score) in transitions.iter_mut().flatten().enumerate() {
            *score = number(k + 1000);
        }
        let mut labels = [false; LABELS];
        [0, 1, 4].into_iter().for_each(|label: usize| labels[label] = true);
        let mut local = [[0.0; LABELS]; 5];
        for (k, score) in local.iter_mut().flatten().enumerate() {
            *score = number(k);
        }
        let score = |chain: &[usize]| {
            let mut before = 0;
            let mut sum = 0.0;
            for (at, label) in chain.iter().enumerate() {
                sum += transitions[before][*label] + local[at][*label];
                before = *label;
            }
            sum
        };
        let found = best(&local, &transitions, &labels);
        for k in 0..3_usize.pow(5) {
            let chain: Vec<usize> = (0..5).map(|at| [0, 1, 4][k / 3_usize.pow(at) % 3]).collect();
            assert!(score(&chain) <= score(&found) + 1e-4, "{chain:?} beats {found:?}");
        }
    }
}
