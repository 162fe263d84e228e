//! Models that embed images and texts in one space: CLIP (Radford et al. 2021), OpenCLIP, `SigLIP` (Zhai et al. 2023).

use std::path::Path;

use candle_core::{Device, Tensor};
use sg_input::file;
use sg_layers::{Precision, Weights};

use crate::batches::{embeddings, encode_by_length};
use crate::config::ImageTextConfig;
use crate::embedding::Embedding;
use crate::encoder::{ImageEncoder, ImageTextEncoder, TextEncoder};
use crate::error::EncoderError;
use crate::image::RgbImage;
use crate::layout::Layout;
use crate::logit::Logit;
use crate::text::TextTower;
use crate::tokens::TextTokens;
use crate::vision::VisionTower;
use crate::{hugging_face, open_clip};

/// Most images in one pass. More of them take memory and no less time for each.
pub(crate) const IMAGES: usize = 16;

/// A model with an image and a text tower.
pub struct ImageTextModel {
    config: ImageTextConfig,
    vision: VisionTower,
    text: TextTower,
    tokens: TextTokens,
    logit: Logit,
}

impl ImageTextModel {
    /// Opens the model in a folder: configuration, `tokenizer.json` and weights. With a `config.json` the layout is Hugging
    /// Face's, and the folder has `preprocessor_config.json` and `model.safetensors` too. Else it is OpenCLIP's, with
    /// `open_clip_config.json` and `open_clip_model.safetensors`.
    ///
    /// # Errors
    /// [`EncoderError`] with the file, the place in it and the remedy.
    pub fn open(folder: &Path, precision: Precision) -> Result<Self, EncoderError> {
        let config = read_config(folder)?;
        let weights = Weights::open(&folder.join(config.layout.weights_file()))?;
        Self::read(folder, config, weights, precision)
    }

    /// The model that a folder's configuration and tokenizer describe, with random weights in place of trained ones: for
    /// measurements of time. The same seed gives the same weights in every precision.
    ///
    /// # Errors
    /// As [`ImageTextModel::open`].
    pub fn with_random_weights(folder: &Path, precision: Precision, seed: u64) -> Result<Self, EncoderError> {
        Self::read(folder, read_config(folder)?, Weights::random(seed), precision)
    }

    fn read(
        folder: &Path,
        config: ImageTextConfig,
        mut weights: Weights,
        precision: Precision,
    ) -> Result<Self, EncoderError> {
        let (layout, dimension) = (config.layout, config.dimension);
        let tokens = TextTokens::open(&folder.join("tokenizer.json"), config.text.context, config.text.vocabulary)?;
        let vision = VisionTower::read(&mut weights, layout, &config.vision, dimension, precision)?;
        let text = TextTower::read(&mut weights, layout, &config.text, dimension, precision)?;
        let logit = Logit::read(&mut weights, layout)?;
        Ok(Self { config, vision, text, tokens, logit })
    }
}

/// The configuration of a folder, in the layout that it has.
pub(crate) fn read_config(folder: &Path) -> Result<ImageTextConfig, EncoderError> {
    let is_there = |name: &str| file::open(&folder.join(name)).is_ok();
    match (is_there("config.json"), is_there("open_clip_config.json")) {
        (true, _) => hugging_face::read_image_text(folder),
        (false, true) => open_clip::read_image_text(folder),
        (false, false) => {
            let problem = "neither config.json nor open_clip_config.json can be read in it; name the folder of a model";
            Err(EncoderError::file(folder, problem))
        }
    }
}

impl ImageEncoder for ImageTextModel {
    fn encode_images(&self, images: &[RgbImage]) -> Result<Vec<Embedding>, EncoderError> {
        let patch = self.config.vision.patch_size;
        let mut encoded = Vec::with_capacity(images.len());
        for batch in images.chunks(IMAGES) {
            let patches = self.config.preprocess.patches(batch, patch);
            let patches = Tensor::from_vec(
                patches,
                (self.config.vision.patches() * batch.len(), 3 * patch * patch),
                &Device::Cpu,
            )?;
            encoded.extend(embeddings(&self.vision.apply(&patches, batch.len())?)?);
        }
        Ok(encoded)
    }

    fn dimension(&self) -> usize {
        self.config.dimension
    }
}

impl TextEncoder for ImageTextModel {
    fn encode_texts(&self, texts: &[&str]) -> Result<Vec<Embedding>, EncoderError> {
        encode_by_length(self.tokens.encode(texts)?, |batch| embeddings(&self.text.apply(batch)?))
    }

    fn dimension(&self) -> usize {
        self.config.dimension
    }
}

impl ImageTextEncoder for ImageTextModel {
    fn layout(&self) -> Layout {
        self.config.layout
    }

    fn logit(&self, cosine: f32) -> f32 {
        self.logit.of(cosine)
    }
}
