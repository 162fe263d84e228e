//! A model of sentences: training and reading.

use std::ops::Range;

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::chain::Chain;
use crate::classifier::Classifier;
use crate::examples::{Examples, Slot};
use crate::words::{Kind, Names, words};

/// Times that each sentence is filled with other values.
const FILLINGS: usize = 3;

/// Most bytes of a sentence that is read.
const MOST_BYTES: usize = 1024;

/// Learned weights for the command of a sentence and for its slots.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    pub(crate) commands: Vec<String>,
    pub(crate) classifier: Classifier,
    pub(crate) chain: Chain,
}

/// What a sentence may mean.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading<'m> {
    /// The command, with its slots in braces.
    pub command: &'m str,
    /// The probability of the command among all, 0 to 1.
    pub probability: f32,
    /// Slots and their bytes in the sentence, in its order.
    pub slots: Vec<(Slot, Range<usize>)>,
    /// Whether the sentence has a number that stands in no slot.
    pub has_number_left: bool,
}

impl Model {
    /// Learns from examples. The result is the same for the same examples and seed.
    #[must_use]
    pub fn train(examples: &Examples, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let filled = examples.filled(FILLINGS, &mut random);
        let commands = examples.commands().to_vec();
        let classifier = Classifier::train(&filled, commands.len(), &mut random);
        Self { classifier, chain: Chain::train(&filled, &commands), commands }
    }

    /// The commands.
    #[must_use]
    pub fn commands(&self) -> &[String] {
        &self.commands
    }

    /// The likeliest meaning of a sentence in a scene with these names. `None`: there is no word, or the sentence has more than a
    /// kilobyte.
    #[must_use]
    pub fn read<'n>(&self, sentence: &str, names: impl IntoIterator<Item = &'n str>) -> Option<Reading<'_>> {
        if sentence.len() > MOST_BYTES {
            return None;
        }
        let words = words(sentence, &Names::of(names));
        if words.is_empty() {
            return None;
        }
        let probabilities = self.classifier.probabilities(&words);
        let (best, probability) = probabilities.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        let command = self.commands.get(best)?;
        let mut slots: Vec<(Slot, Range<usize>)> = Vec::new();
        let mut before = None;
        let mut has_number_left = false;
        for (word, slot) in words.iter().zip(self.chain.slots(&words, command)) {
            match (slot, slots.last_mut()) {
                (Some(slot), Some((_, place))) if before == Some(slot) => place.end = word.place.end,
                (Some(slot), _) => slots.push((slot, word.place.clone())),
                (None, _) => {}
            }
            has_number_left |= slot.is_none() && word.kind == Kind::Number;
            before = slot;
        }
        Some(Reading { command, probability: *probability, slots, has_number_left })
    }
}
