//! A model of sentences: training and reading.

use std::collections::HashMap;
use std::ops::Range;

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::chain::Chain;
use crate::classifier::Classifier;
use crate::examples::{Examples, Filled, Slot};
use crate::table::feature;
use crate::words::{Kind, Names, Word, words};

/// Times that each sentence is filled with other values.
const FILLINGS: usize = 3;

/// Least number of sentences with a word that is known.
const LEAST_SENTENCES: usize = 3;

/// Most bytes of a sentence that is read.
const MOST_BYTES: usize = 1024;

/// Learned weights for the command of a sentence and for its slots.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    pub(crate) commands: Vec<String>,
    pub(crate) classifier: Classifier,
    pub(crate) chain: Chain,
    /// Hashes of the words that several sentences have, ascending.
    pub(crate) vocabulary: Vec<u64>,
    /// Hashes of the stems of words in names and descriptions of things, ascending.
    pub(crate) things: Vec<u64>,
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
    /// Numbers of the sentence that stand in no slot.
    pub numbers_left: usize,
    /// Colours of the sentence that stand in no slot.
    pub colors_left: usize,
    /// Names of the scene in the sentence that stand in no slot.
    pub names_left: usize,
}

/// The words that several sentences have. The same in other slots counts once.
fn vocabulary(filled: &[Filled]) -> Vec<u64> {
    let mut counts: HashMap<u64, (usize, usize)> = HashMap::new();
    for sentence in filled {
        let own = sentence.words.iter().zip(&sentence.slots).filter(|(_, slot)| slot.is_none());
        for (word, _) in own {
            let (count, last) = counts.entry(feature(&[&word.text])).or_insert((0, usize::MAX));
            *count += usize::from(*last != sentence.template);
            *last = sentence.template;
        }
    }
    let mut known: Vec<u64> =
        counts.into_iter().filter(|(_, (count, _))| *count >= LEAST_SENTENCES).map(|(word, _)| word).collect();
    known.sort_unstable();
    known
}

/// Words that stand in descriptions without describing.
const FUNCTION_WORDS: &str = "the a an of and or that this those these in on at with from my our your its one ones all both to for by is are \
 it them two three which what s 's everything else rest but except no not than as into";

fn is_content(word: &&Word) -> bool {
    word.kind == Kind::Color || (word.kind == Kind::Plain && FUNCTION_WORDS.split(' ').all(|other| other != word.text))
}

/// Words of things in the examples.
fn things(examples: &Examples) -> Vec<u64> {
    let none = Names::default();
    let of_thing = |said: &str| {
        words(said, &none).iter().filter(is_content).map(|word| feature(&[word.key()])).collect::<Vec<u64>>()
    };
    let mut things: Vec<u64> = examples.things().flat_map(of_thing).collect();
    things.sort_unstable();
    things.dedup();
    things
}

impl Model {
    /// Learns from examples. The result is the same for the same examples and seed.
    #[must_use]
    pub fn train(examples: &Examples, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let filled = examples.filled(FILLINGS, &mut random);
        let commands = examples.commands().to_vec();
        let classifier = Classifier::train(&filled, commands.len(), &mut random);
        let chain = Chain::train(&filled, &commands);
        let vocabulary = vocabulary(&filled);
        Self { classifier, chain, vocabulary, things: things(examples), commands }
    }

    /// The commands.
    #[must_use]
    pub fn commands(&self) -> &[String] {
        &self.commands
    }

    /// Whether a word in lower case occurs in several sentences of the examples, so that it is hardly misspelt.
    #[must_use]
    pub fn knows(&self, word: &str) -> bool {
        self.vocabulary.binary_search(&feature(&[word])).is_ok()
    }

    /// Whether some words may name or describe a part of a scene: the examples speak of such things. "The stock market" is none.
    #[must_use]
    pub fn may_be_thing(&self, said: &str) -> bool {
        let is_thing = |word: &Word| self.things.binary_search(&feature(&[word.key()])).is_ok();
        words(said, &Names::default()).iter().filter(is_content).any(is_thing)
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
        let mut left: Vec<Kind> = Vec::new();
        for (word, slot) in words.iter().zip(self.chain.slots(&words, command)) {
            match (slot, slots.last_mut()) {
                (Some(slot), Some((_, place))) if before == Some(slot) => place.end = word.place.end,
                (Some(slot), _) => slots.push((slot, word.place.clone())),
                (None, _) => {}
            }
            left.extend(slot.is_none().then_some(word.kind));
            before = slot;
        }
        let number_of = |kind: Kind| left.iter().filter(|other| **other == kind).count();
        Some(Reading {
            command,
            probability: *probability,
            slots,
            numbers_left: number_of(Kind::Number),
            colors_left: number_of(Kind::Color),
            names_left: number_of(Kind::Name),
        })
    }
}
