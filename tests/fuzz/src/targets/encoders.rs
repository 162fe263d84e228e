//! Models that embed texts and pictures, pictures of queries, and stored embeddings.

use sg_encoders::{
    Embedding, EncoderError, ImageEncoder, ImageTextModel, Pixels, Precision, RgbImage, SentenceEncoder, TextEncoder,
};
use supergaussian_labeling::{embedding_cache, query_png};

use super::accepted;
use crate::parts::Parts;
use crate::stage::Stage;

/// Files of a right model, by name.
pub(crate) type Model = &'static [(&'static str, &'static [u8])];

macro_rules! fixture {
    ($path:literal) => {
        include_bytes!(concat!("../../../../services/labeling/encoders/tests/fixtures/", $path))
    };
}

pub(crate) const CLIP: Model = &[
    ("config.json", fixture!("clip-gelu/config.json")),
    ("preprocessor_config.json", fixture!("clip-gelu/preprocessor_config.json")),
    ("tokenizer.json", fixture!("clip-gelu/tokenizer.json")),
    ("model.safetensors", fixture!("clip-gelu/model.safetensors")),
];
pub(crate) const OPEN_CLIP: Model = &[
    ("open_clip_config.json", fixture!("open-clip/open_clip_config.json")),
    ("tokenizer.json", fixture!("open-clip/tokenizer.json")),
    ("open_clip_model.safetensors", fixture!("open-clip/open_clip_model.safetensors")),
];
pub(crate) const BERT: Model = &[
    ("config.json", fixture!("bert/config.json")),
    ("tokenizer.json", fixture!("bert/tokenizer.json")),
    ("model.safetensors", fixture!("bert/model.safetensors")),
];

/// The texts of a folder that the first byte chooses from: a model, whether it is of sentences, and a file of it.
pub(crate) const TEXTS: [(Model, bool, &str); 6] = [
    (CLIP, false, "config.json"),
    (CLIP, false, "preprocessor_config.json"),
    (CLIP, false, "tokenizer.json"),
    (OPEN_CLIP, false, "open_clip_config.json"),
    (BERT, true, "config.json"),
    (BERT, true, "tokenizer.json"),
];
/// The weights that the first byte chooses from.
pub(crate) const WEIGHTS: [(Model, bool, &str); 3] = [
    (BERT, true, "model.safetensors"),
    (CLIP, false, "model.safetensors"),
    (OPEN_CLIP, false, "open_clip_model.safetensors"),
];

/// A configuration or a tokenizer in a folder whose other files are right. The first byte chooses which.
pub(crate) fn encoder_text(stage: &Stage, input: &[u8]) -> bool {
    in_model(stage, &TEXTS, input)
}

/// Weights in a folder whose other files are right. The first byte chooses the model.
pub(crate) fn encoder_weights(stage: &Stage, input: &[u8]) -> bool {
    in_model(stage, &WEIGHTS, input)
}

fn in_model(stage: &Stage, choices: &[(Model, bool, &str)], input: &[u8]) -> bool {
    let mut parts = Parts(input);
    let (model, is_of_sentences, hostile) = choices[usize::from(parts.byte()) % choices.len()];
    let input = parts.rest();
    // The layout of a folder is told by the configurations in it.
    for (name, _) in CLIP.iter().chain(OPEN_CLIP) {
        stage.remove(name);
    }
    for (name, bytes) in model {
        stage.write(name, if *name == hostile { input } else { bytes });
    }
    let folder = stage.folder();
    if is_of_sentences {
        let Some(encoder) = accepted(SentenceEncoder::open(folder, Precision::F32), folder) else { return false };
        are_directions(encoder.encode_texts(&["a bone", "sac"]), 2);
        return true;
    }
    let Some(encoder) = accepted(ImageTextModel::open(folder, Precision::F32), folder) else { return false };
    are_directions(encoder.encode_texts(&["a bone", "sac"]), 2);
    let pixels = (0..3 * 64).map(|at| (at * 7 % 256) as u8).collect();
    let image = RgbImage::new(8, 8, Pixels::Bytes(pixels)).unwrap();
    are_directions(encoder.encode_images(&[image]), 1);
    true
}

/// Weights may be anything, so a model may say that it cannot. What it gives are unit vectors.
fn are_directions(encoded: Result<Vec<Embedding>, EncoderError>, count: usize) {
    let Ok(encoded) = encoded else { return };
    assert_eq!(encoded.len(), count);
    for embedding in encoded {
        let length = embedding.unit().iter().map(|value| f64::from(*value).powi(2)).sum::<f64>().sqrt();
        assert!((length - 1.0).abs() < 1e-3 && embedding.norm().is_normal(), "{length}");
    }
}

pub(crate) fn query_picture(_: &Stage, input: &[u8]) -> bool {
    match query_png::decode(input) {
        Ok(picture) => {
            let Pixels::Bytes(bytes) = picture.pixels() else { return false };
            assert_eq!(bytes.len(), 3 * picture.width() * picture.height());
            true
        }
        Err(error) => {
            let error = error.to_string();
            assert!(!error.is_empty() && !error.contains('\n'), "{error:?}");
            false
        }
    }
}

/// An entry without its checksum, which is added: the engine could not guess it.
pub(crate) fn stored_embedding(_: &Stage, input: &[u8]) -> bool {
    let entry = [input, blake3::hash(input).as_bytes()].concat();
    let Some((embedding, _)) = embedding_cache::decode(&entry) else { return false };
    are_directions(Ok(vec![embedding]), 1);
    // Another checksum is no entry.
    assert!(embedding_cache::decode(&[input, &[0; 32]].concat()).is_none());
    true
}
