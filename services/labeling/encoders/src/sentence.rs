//! Sentence encoders: BERT (Devlin et al. 2019) with pooling, as sentence-transformers has them (Reimers, Gurevych 2019).

use std::path::Path;

use candle_core::{Device, Tensor};
use sg_layers::{Batch, Hidden, Kind, LayerNorm, Matrix, ModelError, Precision, Weights};

use crate::batches::{embeddings, encode_by_length};
use crate::embedding::Embedding;
use crate::encoder::TextEncoder;
use crate::error::EncoderError;
use crate::sentence_config::{Pooling, SentenceConfig};
use crate::tokens::TextTokens;
use crate::transformer::{BlockNames, NormOrder, QueryKeyValue, Transformer};

const BLOCK: BlockNames = BlockNames {
    attention_norm: "attention.output.LayerNorm",
    query_key_value: QueryKeyValue::Separate(["attention.self.query", "attention.self.key", "attention.self.value"]),
    attention_output: "attention.output.dense",
    perceptron_norm: "output.LayerNorm",
    perceptron: ["intermediate.dense", "output.dense"],
};

/// A sentence encoder.
pub struct SentenceEncoder {
    words: Matrix,
    positions: Matrix,
    /// What the first kind of segment adds to every token, 1 × width.
    segment: Tensor,
    norm: LayerNorm,
    transformer: Transformer,
    tokens: TextTokens,
    pooling: Pooling,
    width: usize,
}

impl SentenceEncoder {
    /// Opens the model in a folder: `config.json` of `model_type` `bert`, `tokenizer.json`, `model.safetensors`, and where
    /// they are there, `sentence_bert_config.json` (most tokens) and `1_Pooling/config.json` (mean, or first token).
    ///
    /// # Errors
    /// [`EncoderError`] with the file, the place in it and the remedy.
    pub fn open(folder: &Path, precision: Precision) -> Result<Self, EncoderError> {
        let weights = Weights::open(&folder.join("model.safetensors"));
        Self::read(folder, weights, precision)
    }

    /// The model that a folder's configuration and tokenizer describe, with random weights in place of trained ones: for
    /// measurements of time. The same seed gives the same weights in every precision.
    ///
    /// # Errors
    /// As [`SentenceEncoder::open`].
    pub fn with_random_weights(folder: &Path, precision: Precision, seed: u64) -> Result<Self, EncoderError> {
        Self::read(folder, Ok(Weights::random(seed)), precision)
    }

    fn read(folder: &Path, weights: Result<Weights, ModelError>, precision: Precision) -> Result<Self, EncoderError> {
        let SentenceConfig { transformer, vocabulary, positions, segments, pooling, tokens, .. } =
            SentenceConfig::read(folder)?;
        let mut weights = weights?;
        let (width, epsilon) = (transformer.width, transformer.epsilon);
        // Files of models with further heads have their tensors under this name.
        let prefix = if weights.has("embeddings.word_embeddings.weight") { "" } else { "bert." };
        let mut values = |name: &str, rows: usize| {
            weights.values(&format!("{prefix}embeddings.{name}.weight"), &[rows, width], Kind::Table)
        };
        let words = Matrix::of_table(values("word_embeddings", vocabulary)?, vocabulary, width, precision)?;
        let places = Matrix::of_table(values("position_embeddings", positions)?, positions, width, precision)?;
        let segment = values("token_type_embeddings", segments)?;
        Ok(Self {
            words,
            positions: places,
            segment: Tensor::from_slice(&segment[..width], (1, width), &Device::Cpu)?,
            norm: LayerNorm::read(&mut weights, &format!("{prefix}embeddings.LayerNorm"), width, epsilon)?,
            transformer: Transformer::read(
                &mut weights,
                &format!("{prefix}encoder.layer."),
                &BLOCK,
                NormOrder::After,
                &transformer,
                precision,
            )?,
            tokens,
            pooling,
            width,
        })
    }

    /// Pooled outputs (texts × width) of token ids.
    fn apply(&self, texts: &[Vec<u32>]) -> Result<Tensor, EncoderError> {
        let lengths: Vec<usize> = texts.iter().map(Vec::len).collect();
        let length = lengths.iter().copied().max().unwrap_or_default();
        let batch = Batch { sequences: texts.len(), length };
        let filled = |ids: &Vec<u32>| ids.iter().copied().chain(std::iter::repeat(0)).take(length).collect::<Vec<_>>();
        let ids: Vec<u32> = texts.iter().flat_map(filled).collect();
        let positions: Vec<u32> = (0..length as u32).collect();
        let of_place = self.positions.take(&positions)?.broadcast_add(&self.segment)?;
        let tokens = self.words.take(&ids)?.reshape((texts.len(), length, self.width))?.broadcast_add(&of_place)?;
        let rows = self.norm.apply(&tokens.flatten(0, 1)?)?;
        let rows = self.transformer.apply(rows, batch, Hidden::Padding(&lengths))?;
        self.pooling.apply(&rows, &lengths, length)
    }
}

impl TextEncoder for SentenceEncoder {
    fn encode_texts(&self, texts: &[&str]) -> Result<Vec<Embedding>, EncoderError> {
        encode_by_length(self.tokens.encode(texts)?, |batch| embeddings(&self.apply(batch)?))
    }

    fn dimension(&self) -> usize {
        self.width
    }
}
