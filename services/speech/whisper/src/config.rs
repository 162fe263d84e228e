//! What a model's files say of its size and its tokens, within limits.

use std::path::Path;

use serde::Deserialize;
use sg_layers::{MAX_CONTEXT, MAX_INNER, MAX_LAYERS, MAX_VOCABULARY, MAX_WIDTH, ModelError, read_json, within};

/// ε of all norms.
pub(crate) const EPSILON: f32 = 1e-5;
/// Most mel bands.
const MAX_BANDS: usize = 512;
/// Most frames of the encoder.
const MAX_FRAMES: usize = 8192;
/// First size of a vocabulary with other languages than English.
const MULTILINGUAL_VOCABULARY: usize = 51_865;

/// Size of a Whisper model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ModelSize {
    pub(crate) bands: usize,
    /// Frames of the encoder for 30 s.
    pub(crate) frames: usize,
    /// Components of a frame or token.
    pub(crate) width: usize,
    pub(crate) encoder: StackSize,
    pub(crate) decoder: StackSize,
    pub(crate) vocabulary: usize,
    /// Most tokens that the decoder attends to.
    pub(crate) context: usize,
}

/// Size of the encoder or the decoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct StackSize {
    pub(crate) layers: usize,
    pub(crate) heads: usize,
    /// Width between a perceptron's two layers.
    pub(crate) inner: usize,
}

/// Tokens that free text does not have, by the model's files.
#[derive(Clone, Debug, Default)]
pub(crate) struct Suppressed {
    pub(crate) always: Vec<u32>,
    pub(crate) at_start: Vec<u32>,
}

/// The keys that sizes have in a file, for messages.
pub(crate) struct SizeKeys {
    pub(crate) bands: &'static str,
    pub(crate) frames: &'static str,
    pub(crate) width: &'static str,
    pub(crate) encoder: [&'static str; 3],
    pub(crate) decoder: [&'static str; 3],
    pub(crate) vocabulary: &'static str,
    pub(crate) context: &'static str,
}

impl ModelSize {
    /// Checks all numbers.
    pub(crate) fn checked(self, path: &Path, keys: &SizeKeys) -> Result<Self, ModelError> {
        within(path, keys.bands, self.bands, MAX_BANDS)?;
        within(path, keys.frames, self.frames, MAX_FRAMES)?;
        within(path, keys.width, self.width, MAX_WIDTH)?;
        within(path, keys.vocabulary, self.vocabulary, MAX_VOCABULARY)?;
        within(path, keys.context, self.context, MAX_CONTEXT)?;
        for (stack, [layers, heads, inner]) in [(self.encoder, keys.encoder), (self.decoder, keys.decoder)] {
            within(path, layers, stack.layers, MAX_LAYERS)?;
            within(path, heads, stack.heads, self.width)?;
            within(path, inner, stack.inner, MAX_INNER)?;
            if !self.width.is_multiple_of(stack.heads) {
                let problem = format!("{} heads do not divide a width of {}", stack.heads, self.width);
                return Err(ModelError::config(path, heads, problem));
            }
        }
        Ok(self)
    }
}

/// A model in the layout of Hugging Face's transformers.
#[derive(Debug)]
pub(crate) struct HuggingFaceConfig {
    pub(crate) size: ModelSize,
    pub(crate) suppressed: Suppressed,
    pub(crate) multilingual: bool,
}

#[derive(Deserialize)]
struct Config {
    model_type: Option<String>,
    num_mel_bins: usize,
    max_source_positions: usize,
    d_model: usize,
    encoder_layers: usize,
    encoder_attention_heads: usize,
    encoder_ffn_dim: usize,
    decoder_layers: usize,
    decoder_attention_heads: usize,
    decoder_ffn_dim: usize,
    vocab_size: usize,
    max_target_positions: usize,
    activation_function: Option<String>,
    suppress_tokens: Option<Vec<u32>>,
    begin_suppress_tokens: Option<Vec<u32>>,
}

#[derive(Default, Deserialize)]
struct GenerationConfig {
    suppress_tokens: Option<Vec<u32>>,
    begin_suppress_tokens: Option<Vec<u32>>,
    is_multilingual: Option<bool>,
}

const HUGGING_FACE_KEYS: SizeKeys = SizeKeys {
    bands: "num_mel_bins",
    frames: "max_source_positions",
    width: "d_model",
    encoder: ["encoder_layers", "encoder_attention_heads", "encoder_ffn_dim"],
    decoder: ["decoder_layers", "decoder_attention_heads", "decoder_ffn_dim"],
    vocabulary: "vocab_size",
    context: "max_target_positions",
};

impl HuggingFaceConfig {
    /// Reads `config.json`, and `generation_config.json` where it is there.
    pub(crate) fn read(folder: &Path) -> Result<Self, ModelError> {
        let path = &folder.join("config.json");
        let config: Config = read_json(path)?;
        if let Some(other) = config.model_type.filter(|kind| kind != "whisper") {
            return Err(ModelError::config(path, "model_type", format!("`{other}`; a model of speech is a `whisper`")));
        }
        if let Some(other) = config.activation_function.filter(|function| function != "gelu") {
            return Err(ModelError::config(path, "activation_function", format!("`{other}`; it can only be `gelu`")));
        }
        let size = ModelSize {
            bands: config.num_mel_bins,
            frames: config.max_source_positions,
            width: config.d_model,
            encoder: StackSize {
                layers: config.encoder_layers,
                heads: config.encoder_attention_heads,
                inner: config.encoder_ffn_dim,
            },
            decoder: StackSize {
                layers: config.decoder_layers,
                heads: config.decoder_attention_heads,
                inner: config.decoder_ffn_dim,
            },
            vocabulary: config.vocab_size,
            context: config.max_target_positions,
        };
        let size = size.checked(path, &HUGGING_FACE_KEYS)?;
        let of_generation = folder.join("generation_config.json");
        let generation: GenerationConfig =
            if of_generation.exists() { read_json(&of_generation)? } else { GenerationConfig::default() };
        let suppressed = Suppressed {
            always: generation.suppress_tokens.or(config.suppress_tokens).unwrap_or_default(),
            at_start: generation.begin_suppress_tokens.or(config.begin_suppress_tokens).unwrap_or_default(),
        };
        let multilingual = generation.is_multilingual.unwrap_or(size.vocabulary >= MULTILINGUAL_VOCABULARY);
        Ok(Self { size, suppressed, multilingual })
    }
}

/// `config.json` of CTranslate2: tokens alone.
#[derive(Default, Deserialize)]
struct CTranslate2Config {
    #[serde(default)]
    suppress_ids: Vec<u32>,
    #[serde(default)]
    suppress_ids_begin: Vec<u32>,
}

/// Reads the suppressed tokens of a model in CTranslate2's layout, and whether it is multilingual.
pub(crate) fn read_ctranslate2(folder: &Path, size: &ModelSize) -> Result<(Suppressed, bool), ModelError> {
    let path = folder.join("config.json");
    let config: CTranslate2Config = if path.exists() { read_json(&path)? } else { CTranslate2Config::default() };
    let suppressed = Suppressed { always: config.suppress_ids, at_start: config.suppress_ids_begin };
    Ok((suppressed, size.vocabulary >= MULTILINGUAL_VOCABULARY))
}
