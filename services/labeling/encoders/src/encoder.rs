//! What users of embeddings see of a model.

use crate::embedding::Embedding;
use crate::error::EncoderError;
use crate::image::RgbImage;
use crate::layout::Layout;

/// Embeddings of images.
pub trait ImageEncoder: Send + Sync {
    /// One embedding for each image, in their order. Many at once take less time for each than one by one.
    ///
    /// # Errors
    /// [`EncoderError`] for weights that give no direction.
    fn encode_images(&self, images: &[RgbImage]) -> Result<Vec<Embedding>, EncoderError>;

    /// Components of an embedding.
    fn dimension(&self) -> usize;
}

/// Embeddings of texts.
pub trait TextEncoder: Send + Sync {
    /// One embedding for each text, in their order. Texts longer than the model's context are cut at its end.
    ///
    /// # Errors
    /// [`EncoderError::Text`] for a text of more than 64 KiB or without tokens; others for weights that give no direction.
    fn encode_texts(&self, texts: &[&str]) -> Result<Vec<Embedding>, EncoderError>;

    /// Components of an embedding.
    fn dimension(&self) -> usize;
}

/// Embeddings of images and texts in one space.
pub trait ImageTextEncoder: ImageEncoder + TextEncoder {
    /// The layout that the model was read from.
    fn layout(&self) -> Layout;

    /// The model's own score of a pair by its cosine. For [`Layout::SigLip`], σ of it is the probability that both belong
    /// together. For the others, a softmax over several texts gives the probability of each.
    fn logit(&self, cosine: f32) -> f32;
}
