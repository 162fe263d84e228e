//! What a sentence encoder's folder says of it: `config.json`, `sentence_bert_config.json`, `1_Pooling/config.json`.

use std::path::Path;

use candle_core::Tensor;
use serde::Deserialize;
use sg_input::file;
use sg_layers::{Activation, MAX_CONTEXT, MAX_VOCABULARY, read_json, within};

use crate::config::HUGGING_FACE_KEYS;
use crate::error::EncoderError;
use crate::hugging_face::named;
use crate::tokens::TextTokens;
use crate::transformer::TransformerConfig;

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
struct SentenceTokens {
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
pub(crate) enum Pooling {
    /// The mean of all tokens, marks included.
    Mean,
    /// The first token's.
    First,
}

/// A sentence encoder without its weights.
pub(crate) struct SentenceConfig {
    pub(crate) transformer: TransformerConfig,
    pub(crate) vocabulary: usize,
    /// Most tokens that there are positions for.
    pub(crate) positions: usize,
    pub(crate) segments: usize,
    /// Most tokens of a text.
    pub(crate) context: usize,
    pub(crate) pooling: Pooling,
    pub(crate) tokens: TextTokens,
}

impl SentenceConfig {
    /// Reads a folder's configurations and tokenizer.
    pub(crate) fn read(folder: &Path) -> Result<Self, EncoderError> {
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
        let context = match optional_json::<SentenceTokens>(&folder.join("sentence_bert_config.json"))? {
            Some(SentenceTokens { max_seq_length: Some(most) }) => {
                within(&folder.join("sentence_bert_config.json"), "max_seq_length", most, positions)?
            }
            _ => positions,
        };
        let pooling = read_pooling(&folder.join("1_Pooling/config.json"))?;
        let tokens = TextTokens::open(&folder.join("tokenizer.json"), context, vocabulary)?;
        Ok(Self { transformer, vocabulary, positions, segments, context, pooling, tokens })
    }
}

impl Pooling {
    /// Pooled rows (texts × width) of the tokens' rows (texts · length × width); `lengths` has each text's own tokens.
    pub(crate) fn apply(self, rows: &Tensor, lengths: &[usize], length: usize) -> Result<Tensor, EncoderError> {
        let pooled: Result<Vec<Tensor>, candle_core::Error> = lengths
            .iter()
            .enumerate()
            .map(|(at, own)| match self {
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
