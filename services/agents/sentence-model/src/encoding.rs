//! A trained model as bytes.

use crate::chain::{Chain, LABELS, Transitions};
use crate::classifier::Classifier;
use crate::model::Model;
use crate::table::Table;

/// First bytes of an encoded model.
const MAGIC: &[u8; 8] = b"sgsent03";

/// Most features, commands and bytes of a command that are read.
const MOST_FEATURES: usize = 1 << 22;
const MOST_COMMANDS: usize = 1 << 10;
const MOST_COMMAND_BYTES: usize = 1 << 10;

/// Bytes that are no model.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ModelError {
    /// The bytes begin otherwise.
    #[error("these bytes are no sentence model of this version")]
    OtherFormat,
    /// The bytes end early, or go on behind the end.
    #[error("the sentence model has {0} bytes, which is not its length")]
    Length(usize),
    /// A count is above its limit, or a text is no UTF-8.
    #[error("the sentence model has a {0} that is out of range")]
    Value(&'static str),
}

impl Model {
    /// The model as bytes, little endian.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        count(&mut bytes, self.commands.len());
        for command in &self.commands {
            count(&mut bytes, command.len());
            bytes.extend(command.as_bytes());
        }
        floats(&mut bytes, &self.classifier.constants);
        table(&mut bytes, &self.classifier.table);
        self.chain.transitions.iter().for_each(|row| floats(&mut bytes, row));
        table(&mut bytes, &self.chain.table);
        for words in [&self.vocabulary, &self.things] {
            count(&mut bytes, words.len());
            words.iter().for_each(|word| bytes.extend(word.to_le_bytes()));
        }
        bytes
    }

    /// The model that some bytes encode.
    ///
    /// # Errors
    /// [`ModelError`]: the bytes are no model of this version, or they are damaged.
    pub fn decode(bytes: &[u8]) -> Result<Self, ModelError> {
        let rest = bytes.strip_prefix(MAGIC).ok_or(ModelError::OtherFormat)?;
        let mut input = Input { rest, all: bytes.len() };
        let number = input.count(MOST_COMMANDS, "number of commands")?;
        let mut commands = Vec::with_capacity(number);
        for _ in 0..number {
            let length = input.count(MOST_COMMAND_BYTES, "length of a command")?;
            let text = std::str::from_utf8(input.take(length)?).map_err(|_| ModelError::Value("command"))?;
            commands.push(text.to_owned());
        }
        let constants = input.floats(number)?;
        let classifier = Classifier { constants, table: input.table(number)? };
        let mut transitions: Transitions = [[0.0; LABELS]; LABELS];
        for row in &mut transitions {
            row.copy_from_slice(&input.floats(LABELS)?);
        }
        let chain = Chain { transitions, table: input.table(LABELS)? };
        let number = input.count(MOST_FEATURES, "number of words")?;
        let vocabulary = input.hashes(number)?;
        let number = input.count(MOST_FEATURES, "number of things")?;
        let things = input.hashes(number)?;
        if !input.rest.is_empty() {
            return Err(ModelError::Length(bytes.len()));
        }
        Ok(Self { commands, classifier, chain, vocabulary, things })
    }
}

fn count(bytes: &mut Vec<u8>, count: usize) {
    // Counts are below the limits of reading.
    bytes.extend(u32::try_from(count).unwrap_or(u32::MAX).to_le_bytes());
}

fn floats(bytes: &mut Vec<u8>, values: &[f32]) {
    values.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
}

fn table(bytes: &mut Vec<u8>, table: &Table) {
    count(bytes, table.features.len());
    table.features.iter().for_each(|feature| bytes.extend(feature.to_le_bytes()));
    floats(bytes, &table.scales);
    bytes.extend(table.weights.iter().map(|weight| weight.to_le_bytes()[0]));
}

/// Bytes that are left to read.
struct Input<'b> {
    rest: &'b [u8],
    all: usize,
}

impl<'b> Input<'b> {
    fn take(&mut self, length: usize) -> Result<&'b [u8], ModelError> {
        let (taken, rest) = self.rest.split_at_checked(length).ok_or(ModelError::Length(self.all))?;
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], ModelError> {
        self.take(N)?.try_into().map_err(|_| ModelError::Length(self.all))
    }

    fn count(&mut self, most: usize, of: &'static str) -> Result<usize, ModelError> {
        let count = u32::from_le_bytes(self.array()?) as usize;
        if count <= most { Ok(count) } else { Err(ModelError::Value(of)) }
    }

    fn floats(&mut self, number: usize) -> Result<Vec<f32>, ModelError> {
        let values: Result<Vec<f32>, _> = (0..number).map(|_| Ok(f32::from_le_bytes(self.array()?))).collect();
        let values = values?;
        if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(ModelError::Value("weight")) }
    }

    fn hashes(&mut self, number: usize) -> Result<Vec<u64>, ModelError> {
        let hashes: Result<Vec<u64>, _> = (0..number).map(|_| Ok(u64::from_le_bytes(self.array()?))).collect();
        let hashes = hashes?;
        if hashes.is_sorted() { Ok(hashes) } else { Err(ModelError::Value("order of hashes")) }
    }

    fn table(&mut self, width: usize) -> Result<Table, ModelError> {
        let number = self.count(MOST_FEATURES, "number of features")?;
        let features = self.hashes(number)?;
        let scales = self.floats(number)?;
        let weights = self.take(number * width)?.iter().map(|byte| i8::from_le_bytes([*byte])).collect();
        Ok(Table { width, features, scales, weights })
    }
}
