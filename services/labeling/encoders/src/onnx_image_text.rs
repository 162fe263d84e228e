//! CLIP and `SigLIP` whose towers are graphs of ONNX.

use std::num::NonZeroUsize;
use std::path::Path;

use sg_input::file;

use crate::batches::{encode_by_length, rows};
use crate::config::{ImageTextConfig, TextPooling};
use crate::embedding::Embedding;
use crate::encoder::{ImageEncoder, ImageTextEncoder, TextEncoder};
use crate::error::EncoderError;
use crate::image::RgbImage;
use crate::image_text::{IMAGES, read_config};
use crate::layout::Layout;
use crate::logit::Logit;
use crate::onnx_graph::{Filling, Graph, Port};
use crate::onnx_runtime::OnnxRuntime;
use crate::tokens::TextTokens;

const VISION: &str = "onnx/vision_model.onnx";
const TEXT: &str = "onnx/text_model.onnx";

/// A model with an image and a text tower, run by ONNX Runtime. It gives the embeddings of
/// [`ImageTextModel`](crate::ImageTextModel).
pub struct OnnxImageTextModel {
    config: ImageTextConfig,
    vision: Graph,
    text: Graph,
    tokens: TextTokens,
    logit: Logit,
}

impl OnnxImageTextModel {
    /// Opens the model in a folder as Hugging Face's Optimum and transformers.js export it: configuration and `tokenizer.json`
    /// as for [`ImageTextModel`](crate::ImageTextModel), `onnx/vision_model.onnx` and `onnx/text_model.onnx` in f32 with a free
    /// batch size. Each tower has `threads` threads.
    ///
    /// The score of a pair needs a factor that graphs lack. `model.safetensors` has it, if it is there. Else the keys
    /// `logit_scale` and `logit_bias` of `config.json` state the values of those tensors. Else CLIP has the factor 100.
    ///
    /// # Errors
    /// [`EncoderError`] with the file, the name in it and the remedy.
    pub fn open(folder: &Path, runtime: &OnnxRuntime, threads: NonZeroUsize) -> Result<Self, EncoderError> {
        let config = read_config(folder)?;
        let (layout, dimension) = (config.layout, config.dimension);
        let tokens = TextTokens::open(&folder.join("tokenizer.json"), config.text.context, config.text.vocabulary)?;
        let outputs = |name| {
            let name = if layout == Layout::SigLip { "pooler_output" } else { name };
            vec![Port::floats(name, &[dimension])]
        };
        let (side, context) = (config.vision.image_size, config.text.context);
        let vision = Graph::of_images(&folder.join(VISION), runtime, threads, side, outputs("image_embeds"))?;
        let text = Graph::of_texts(&folder.join(TEXT), runtime, threads, context, outputs("text_embeds"))?;
        Ok(Self { vision, text, tokens, logit: Logit::beside_graphs(folder, layout)?, config })
    }

    /// Whether a folder has both graphs.
    #[must_use]
    pub fn is_in(folder: &Path) -> bool {
        [VISION, TEXT].iter().all(|name| file::open(&folder.join(name)).is_ok())
    }

    fn encode_tokens(&self, texts: &[Vec<u32>]) -> Result<Vec<Embedding>, EncoderError> {
        let (context, pooling) = (self.config.text.context, self.config.text.pooling);
        let (length, token) = pooling.filled(texts, context);
        let length = if self.text.has_fixed_length() { context } else { length };
        let filling = Filling { length, token, is_seen: matches!(pooling, TextPooling::Last { .. }) };
        let dimension = self.config.dimension;
        rows(&self.text.run_texts(texts, filling, &[dimension])?, dimension)
    }
}

impl ImageEncoder for OnnxImageTextModel {
    fn encode_images(&self, images: &[RgbImage]) -> Result<Vec<Embedding>, EncoderError> {
        let (side, dimension) = (self.config.vision.image_size, self.config.dimension);
        let mut encoded = Vec::with_capacity(images.len());
        for batch in images.chunks(IMAGES) {
            // One patch of the whole image is the image, channel by channel.
            let pixels = self.config.preprocess.patches(batch, side);
            encoded.extend(rows(&self.vision.run_images(pixels, [batch.len(), 3, side, side], dimension)?, dimension)?);
        }
        Ok(encoded)
    }

    fn dimension(&self) -> usize {
        self.config.dimension
    }
}

impl TextEncoder for OnnxImageTextModel {
    fn encode_texts(&self, texts: &[&str]) -> Result<Vec<Embedding>, EncoderError> {
        encode_by_length(self.tokens.encode(texts)?, |batch| self.encode_tokens(batch))
    }

    fn dimension(&self) -> usize {
        self.config.dimension
    }
}

impl ImageTextEncoder for OnnxImageTextModel {
    fn layout(&self) -> Layout {
        self.config.layout
    }

    fn logit(&self, cosine: f32) -> f32 {
        self.logit.of(cosine)
    }
}
