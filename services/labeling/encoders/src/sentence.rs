//! Sentence encoders: BERT (Devlin et al. 2019) with pooling, as sentence-transformers has them (Reimers, Gurevych 2019).

use std::path::Path;

use candle_core::{Device, Tensor};
use serde::Deserialize;
use sg_input::file;
use sg_layers::{
    Activation, Batch, Hidden, Kind, LayerNorm, MAX_CONTEXT, MAX_VOCABULARY, Matrix, ModelError, Precision, Weights,
    read_json, within,
};

use crate::batches::encode_by_length;
use crate::config::HUGGING_FACE_KEYS;
use crate::embedding::Embedding;
use crate::encoder::TextEncoder;
use crate::error::EncoderError;
use crate::hugging_face::named;
use crate::tokens::TextTokens;
use crate::transformer::{BlockNames, NormOrder, QueryKeyValue, Transformer, TransformerConfig};

/// What tells kinds of configurations apart, whatever else they have.
#[derive(Deserialize)]
struct ModelKind {
    model_type: Option<String>,
}

#[derive(Deserialize)]
struct Config {
    vocab_size: usize,
    hidden_size: usize,
    intermediate_size: usize,
    num_hidden_layers: usize,
    num_attention_heads: usize,
    hidden_act: Activation,
    layer_norm_eps: f32,
    max_position_embeddings: usize,
    type_vocab_size: usize,
    position_embedding_type: Option<String>,
}

#[derive(Default, Deserialize)]
struct SentenceConfig {
    max_seq_length: Option<usize>,
}

/// `1_Pooling/config.json`. Only one way of pooling may be on.
#[derive(Deserialize)]
struct PoolingConfig {
    #[serde(default)]
    pooling_mode_mean_tokens: bool,
    #[serde(default)]
    pooling_mode_cls_token: bool,
    #[serde(default)]
    pooling_mode_max_tokens: bool,
    #[serde(default)]
    pooling_mode_mean_sqrt_len_tokens: bool,
}

/// Which outputs are the sentence's.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Pooling {
    /// The mean of all tokens, marks included.
    Mean,
    /// The first token's.
    First,
}

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
        let path = &folder.join("config.json");
        let wrong = |key: &str, problem: String| Err(EncoderError::config(path, key, problem));
        let ModelKind { model_type } = read_json(path)?;
        if model_type.as_deref() != Some("bert") {
            return wrong("model_type", format!("{}; a sentence encoder is a `bert`", named(model_type.as_deref())));
        }
        let config: Config = read_json(path)?;
        if let Some(other) = config.position_embedding_type.as_deref().filter(|kind| *kind != "absolute") {
            return wrong("position_embedding_type", format!("`{other}`; it can only be `absolute`"));
        }
        let transformer = TransformerConfig {
            width: config.hidden_size,
            layers: config.num_hidden_layers,
            heads: config.num_attention_heads,
            inner: config.intermediate_size,
            activation: config.hidden_act,
            epsilon: config.layer_norm_eps,
        };
        let transformer = transformer.checked(path, "", &HUGGING_FACE_KEYS)?;
        let vocabulary = within(path, "vocab_size", config.vocab_size, MAX_VOCABULARY)?;
        let positions = within(path, "max_position_embeddings", config.max_position_embeddings, MAX_CONTEXT)?;
        let segments = within(path, "type_vocab_size", config.type_vocab_size, MAX_VOCABULARY)?;
        let context = match optional_json::<SentenceConfig>(&folder.join("sentence_bert_config.json"))? {
            Some(SentenceConfig { max_seq_length: Some(most) }) => {
                within(&folder.join("sentence_bert_config.json"), "max_seq_length", most, positions)?
            }
            _ => positions,
        };
        let pooling = read_pooling(&folder.join("1_Pooling/config.json"))?;
        let tokens = TextTokens::open(&folder.join("tokenizer.json"), context, vocabulary)?;

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
        let pooled: Result<Vec<Tensor>, candle_core::Error> = lengths
            .iter()
            .enumerate()
            .map(|(at, own)| match self.pooling {
                Pooling::Mean => rows.narrow(0, at * length, *own)?.mean_keepdim(0),
                Pooling::First => rows.narrow(0, at * length, 1),
            })
            .collect();
        Ok(Tensor::cat(&pooled?, 0)?)
    }
}

/// Parses a file that need not be there.
fn optional_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<Option<T>, EncoderError> {
    match file::open(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        _ => Ok(read_json(path).map(Some)?),
    }
}

fn read_pooling(path: &Path) -> Result<Pooling, EncoderError> {
    let Some(config) = optional_json::<PoolingConfig>(path)? else { return Ok(Pooling::Mean) };
    let others = config.pooling_mode_max_tokens || config.pooling_mode_mean_sqrt_len_tokens;
    match (config.pooling_mode_mean_tokens, config.pooling_mode_cls_token, others) {
        (true, false, false) => Ok(Pooling::Mean),
        (false, true, false) => Ok(Pooling::First),
        _ => {
            let problem = "one of `pooling_mode_mean_tokens` and `pooling_mode_cls_token` is true, and no other mode";
            Err(EncoderError::file(path, problem))
        }
    }
}

impl TextEncoder for SentenceEncoder {
    fn encode_texts(&self, texts: &[&str]) -> Result<Vec<Embedding>, EncoderError> {
        encode_by_length(self.tokens.encode(texts)?, |batch| self.apply(batch))
    }

    fn dimension(&self) -> usize {
        self.width
    }
}
