//! What a model's configuration says, within limits.

use std::path::Path;

use sg_layers::{MAX_INNER, MAX_LAYERS, MAX_WIDTH, within};

use crate::error::EncoderError;
use crate::layout::Layout;
use crate::preprocess::Preprocess;
use crate::transformer::TransformerConfig;

/// Size of an image tower.
#[derive(Clone, Debug)]
pub(crate) struct VisionConfig {
    pub(crate) transformer: TransformerConfig,
    /// Pixels on a side of the square image.
    pub(crate) image_size: usize,
    /// Pixels on a side of a patch.
    pub(crate) patch_size: usize,
}

impl VisionConfig {
    /// Patches in an image. A rest at the right and below is not looked at.
    pub(crate) fn patches(&self) -> usize {
        (self.image_size / self.patch_size).pow(2)
    }
}

/// Size of a text tower.
#[derive(Clone, Debug)]
pub(crate) struct TextConfig {
    pub(crate) transformer: TransformerConfig,
    /// Number of tokens that there are.
    pub(crate) vocabulary: usize,
    /// Most tokens of a text.
    pub(crate) context: usize,
    pub(crate) pooling: TextPooling,
}

/// Which token's output is the text's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TextPooling {
    /// The first one with this id, that of the end of text. The tower is causal.
    First(u32),
    /// The one with the highest id, which is the end of text in vocabularies without additions. The tower is causal.
    Highest,
    /// The last one of a text filled up to the context by `padding`. The tower is not causal.
    Last { padding: u32 },
}

/// A model with an image and a text tower.
#[derive(Clone, Debug)]
pub(crate) struct ImageTextConfig {
    pub(crate) layout: Layout,
    pub(crate) vision: VisionConfig,
    pub(crate) text: TextConfig,
    /// Components of an embedding.
    pub(crate) dimension: usize,
    pub(crate) preprocess: Preprocess,
}

/// Most pixels on a side of the image that a tower takes.
pub(crate) const MAX_IMAGE: usize = 2048;

impl TransformerConfig {
    /// Checks all numbers; `part` is the key of the object that they stand in, with a dot behind it, or nothing.
    pub(crate) fn checked(self, path: &Path, part: &str, keys: &TransformerKeys) -> Result<Self, EncoderError> {
        let key = |name: &str| format!("{part}{name}");
        within(path, &key(keys.width), self.width, MAX_WIDTH)?;
        within(path, &key(keys.inner), self.inner, MAX_INNER)?;
        within(path, &key(keys.layers), self.layers, MAX_LAYERS)?;
        within(path, &key(keys.heads), self.heads, self.width)?;
        if !self.width.is_multiple_of(self.heads) {
            let problem = format!("{} heads do not divide a width of {}", self.heads, self.width);
            return Err(EncoderError::config(path, &key(keys.heads), problem));
        }
        if !(self.epsilon >= 0.0 && self.epsilon < 1.0) {
            let problem = format!("{}; it can be 0 to 1", self.epsilon);
            return Err(EncoderError::config(path, &key(keys.epsilon), problem));
        }
        Ok(self)
    }
}

/// Names of a transformer's numbers in one kind of configuration.
pub(crate) struct TransformerKeys {
    pub(crate) width: &'static str,
    pub(crate) inner: &'static str,
    pub(crate) layers: &'static str,
    pub(crate) heads: &'static str,
    pub(crate) epsilon: &'static str,
}

/// Those of Hugging Face's transformers.
pub(crate) const HUGGING_FACE_KEYS: TransformerKeys = TransformerKeys {
    width: "hidden_size",
    inner: "intermediate_size",
    layers: "num_hidden_layers",
    heads: "num_attention_heads",
    epsilon: "layer_norm_eps",
};
