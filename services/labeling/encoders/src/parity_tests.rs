//! The models beside the published implementations, on the fixtures of `tests/fixtures/make.py`.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use safetensors::SafeTensors;

use crate::encoder::{ImageEncoder, ImageTextEncoder, TextEncoder};
use crate::image::{Pixels, RgbImage};
use crate::tokens::TextTokens;
use crate::{Embedding, ImageTextModel, Layout, Precision, SentenceEncoder, hugging_face, open_clip};

const MODELS: [(&str, Layout); 4] = [
    ("clip-quick-gelu", Layout::Clip),
    ("clip-gelu", Layout::Clip),
    ("open-clip", Layout::OpenClip),
    ("siglip", Layout::SigLip),
];
/// Bound of every difference from the published values.
const BOUND: f32 = 1e-5;
const IMAGE_SIZES: [(usize, usize); 4] = [(50, 37), (32, 32), (41, 91), (20, 27)];

pub(crate) fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures")
}

/// `image` of `make.py`.
fn test_image((width, height): (usize, usize)) -> RgbImage {
    let level =
        |x: usize, y: usize, c: usize| (x * 7 + y * 13 + c * 50 + (x * y) % 17 * 9 + (x / 8 + y / 8) % 2 * 120) % 256;
    let at = |at: usize| level(at / 3 % width, at / 3 / width, at % 3) as u8;
    RgbImage::new(width, height, Pixels::Bytes((0..3 * width * height).map(at).collect())).unwrap()
}

pub(crate) fn test_images() -> Vec<RgbImage> {
    IMAGE_SIZES.map(test_image).to_vec()
}

pub(crate) fn texts(folder: &Path) -> Vec<String> {
    serde_json::from_slice(&std::fs::read(folder.join("texts.json")).unwrap()).unwrap()
}

pub(crate) struct Expected(Vec<u8>);

impl Expected {
    pub(crate) fn open(folder: &Path) -> Self {
        Self(std::fs::read(folder.join("expected.safetensors")).unwrap())
    }

    fn bytes(&self, name: &str) -> (Vec<usize>, Vec<u8>) {
        let tensors = SafeTensors::deserialize(&self.0).unwrap();
        let tensor = tensors.tensor(name).unwrap();
        (tensor.shape().to_vec(), tensor.data().to_vec())
    }

    pub(crate) fn rows(&self, name: &str) -> Vec<Vec<f32>> {
        let (shape, bytes) = self.bytes(name);
        let values: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|four| f32::from_le_bytes(*four)).collect();
        values.chunks(shape[1..].iter().product()).map(<[f32]>::to_vec).collect()
    }

    fn ids(&self) -> Vec<Vec<u32>> {
        let (shape, bytes) = self.bytes("ids");
        let values: Vec<u32> = bytes.as_chunks::<4>().0.iter().map(|four| u32::from_le_bytes(*four)).collect();
        values.chunks(shape[1]).map(<[u32]>::to_vec).collect()
    }
}

/// Compares raw outputs, and the cosines of all pairs.
pub(crate) fn assert_near(name: &str, found: &[Embedding], expected: &[Vec<f32>]) {
    assert_eq!(found.len(), expected.len(), "{name}");
    let published: Vec<Embedding> = expected.iter().map(|raw| Embedding::new(raw).unwrap()).collect();
    for (at, (embedding, raw)) in found.iter().zip(expected).enumerate() {
        for (value, expected) in embedding.raw().iter().zip(raw) {
            assert!((value - expected).abs() <= BOUND, "{name} {at}: {value} in place of {expected}");
        }
        for (other, published_other) in found.iter().zip(&published) {
            let (cosine, expected) = (embedding.cosine(other).unwrap(), published[at].cosine(published_other).unwrap());
            assert!((cosine - expected).abs() <= BOUND, "{name} {at}: cosine {cosine} in place of {expected}");
        }
    }
}

#[test]
fn images_and_texts_have_the_published_embeddings() {
    for (name, layout) in MODELS {
        let folder = fixtures().join(name);
        let model = ImageTextModel::open(&folder, Precision::F32).unwrap();
        assert_eq!(model.layout(), layout);
        let expected = Expected::open(&folder);
        let images = model.encode_images(&test_images()).unwrap();
        assert_near(name, &images, &expected.rows("images"));
        let texts = texts(&folder);
        let texts = model.encode_texts(&texts.iter().map(String::as_str).collect::<Vec<_>>()).unwrap();
        assert_near(name, &texts, &expected.rows("texts"));
        if layout == Layout::OpenClip {
            continue;
        }
        for (image, logits) in images.iter().zip(expected.rows("logits")) {
            for (text, expected) in texts.iter().zip(logits) {
                let logit = model.logit(image.cosine(text).unwrap());
                // The scale of the fixtures is about 8.
                assert!((logit - expected).abs() <= 10.0 * BOUND, "{name}: logit {logit} in place of {expected}");
            }
        }
    }
}

#[test]
fn images_are_prepared_as_published() {
    // The other CLIP prepares images in the same way.
    for (name, layout) in MODELS.into_iter().filter(|(name, _)| *name != "clip-gelu") {
        let folder = fixtures().join(name);
        let config = match layout {
            Layout::OpenClip => open_clip::read_image_text(&folder),
            _ => hugging_face::read_image_text(&folder),
        };
        let preprocess = config.unwrap().preprocess;
        let expected = Expected::open(&folder);
        let (shape, levels) = expected.bytes("levels");
        assert_eq!(shape[0], IMAGE_SIZES.len(), "{name}");
        let side = shape[3];
        for (at, (image, first_row)) in test_images().iter().zip(expected.rows("pixels")).enumerate() {
            let values = preprocess.values(image);
            for (place, value) in values.iter().enumerate() {
                let (channel, pixel) = (place % 3, place / 3);
                let level = ((value * preprocess.deviation[channel] + preprocess.mean[channel]) * 255.0).round();
                let expected = levels[(at * 3 + channel) * side * side + pixel];
                assert!((level - f32::from(expected)).abs() < 0.5, "{name} {at}: {level} in place of {expected}");
                if pixel < side {
                    assert!((value - first_row[channel * side + pixel]).abs() <= BOUND, "{name} {at}");
                }
            }
        }
    }
}

#[test]
fn texts_have_the_published_tokens() {
    for name in MODELS.map(|(name, _)| name).into_iter().chain(["bert"]) {
        let folder = fixtures().join(name);
        let tokens = TextTokens::open(&folder.join("tokenizer.json"), 16, 1000).unwrap();
        let texts = texts(&folder);
        let found = tokens.encode(&texts.iter().map(String::as_str).collect::<Vec<_>>()).unwrap();
        let expected = Expected::open(&folder).ids();
        for (found, expected) in found.iter().zip(&expected) {
            assert_eq!(found[..], expected[..found.len()], "{name}");
            // What fills up is one token.
            assert!(expected[found.len()..].windows(2).all(|pair| pair[0] == pair[1]), "{name}");
        }
        // The longest text is cut and keeps the mark of its end.
        assert!(found.iter().any(|ids| ids.len() == 16) && found.iter().all(|ids| ids.last() == found[0].last()));
    }
}

#[test]
fn sentences_have_the_published_embeddings() {
    let folder = fixtures().join("bert");
    let encoder = SentenceEncoder::open(&folder, Precision::F32).unwrap();
    let texts = texts(&folder);
    let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
    assert_near("bert", &encoder.encode_texts(&texts).unwrap(), &Expected::open(&folder).rows("texts"));
}

#[test]
fn a_batch_gives_what_single_inputs_give() {
    let images = test_images();
    for (name, _) in MODELS {
        let folder = fixtures().join(name);
        let model = ImageTextModel::open(&folder, Precision::F32).unwrap();
        let together = model.encode_images(&images).unwrap();
        for (image, expected) in images.iter().zip(&together) {
            let alone = model.encode_images(std::slice::from_ref(image)).unwrap();
            assert!(alone[0].cosine(expected).unwrap() > 1.0 - 1e-6, "{name}");
        }
        assert!(model.encode_images(&[]).unwrap().is_empty() && model.encode_texts(&[]).unwrap().is_empty());
        // More than one pass, in an order that is not that of their lengths.
        let texts = texts(&folder);
        let many: Vec<&str> = texts.iter().map(String::as_str).cycle().take(83).collect();
        let together = model.encode_texts(&many).unwrap();
        for (at, text) in many.iter().enumerate() {
            let alone = model.encode_texts(&[text]).unwrap();
            assert!(alone[0].cosine(&together[at]).unwrap() > 1.0 - 1e-6, "{name} {at}");
        }
    }
}

#[test]
fn fewer_bits_move_embeddings_little() {
    for (name, _) in MODELS {
        let folder = fixtures().join(name);
        let exact = ImageTextModel::open(&folder, Precision::F32).unwrap();
        let images = exact.encode_images(&test_images()).unwrap();
        let texts = exact.encode_texts(&["bone, 3 mm", "the sac"]).unwrap();
        for (precision, bound) in [(Precision::F16, 1e-5), (Precision::Int8, 5e-3)] {
            let model = ImageTextModel::open(&folder, precision).unwrap();
            let pairs = images.iter().zip(model.encode_images(&test_images()).unwrap());
            let pairs = pairs.chain(texts.iter().zip(model.encode_texts(&["bone, 3 mm", "the sac"]).unwrap()));
            for (exact, rounded) in pairs {
                let error = 1.0 - exact.cosine(&rounded).unwrap();
                assert!(error <= bound, "{name} {precision:?}: {error}");
            }
        }
    }
}

#[derive(serde::Deserialize)]
struct MiniLm {
    sentences: Vec<String>,
    first: Vec<Vec<f32>>,
    cosines: Vec<Vec<f32>>,
}

/// The folder of all-MiniLM-L6-v2 that `ops/models.sh` makes. Without it the test skips, after a message. With
/// `SUPERGAUSSIAN_REQUIRE_TOOLS=1`, that is a failure.
pub(crate) fn mini_lm() -> Option<PathBuf> {
    let cache = directories::ProjectDirs::from("", "", "supergaussian").unwrap().cache_dir().to_owned();
    let folder = cache.join("models/all-MiniLM-L6-v2");
    let found = folder.join("model.safetensors").is_file();
    let required = std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1");
    assert!(found || !required, "no all-MiniLM-L6-v2, and SUPERGAUSSIAN_REQUIRE_TOOLS=1; run ops/models.sh");
    found.then_some(folder)
}

#[test]
#[allow(clippy::print_stderr, reason = "a skipped test says so")]
fn a_real_sentence_encoder_gives_its_published_numbers() {
    let Some(folder) = mini_lm() else {
        eprintln!("SKIPPED: no all-MiniLM-L6-v2, run ops/models.sh");
        return;
    };
    let published: MiniLm = serde_json::from_slice(&std::fs::read(fixtures().join("minilm.json")).unwrap()).unwrap();
    let sentences: Vec<&str> = published.sentences.iter().map(String::as_str).collect();
    for (precision, bound) in [(Precision::F32, BOUND), (Precision::F16, 1e-3), (Precision::Int8, 2e-2)] {
        let encoder = SentenceEncoder::open(&folder, precision).unwrap();
        let found = encoder.encode_texts(&sentences).unwrap();
        for (at, embedding) in found.iter().enumerate() {
            for (value, expected) in embedding.unit().iter().zip(&published.first[at]) {
                assert!((value - expected).abs() <= bound, "{precision:?} {at}: {value} in place of {expected}");
            }
            for (other, expected) in found.iter().zip(&published.cosines[at]) {
                let cosine = embedding.cosine(other).unwrap();
                assert!((cosine - expected).abs() <= bound, "{precision:?} {at}: {cosine} in place of {expected}");
            }
        }
        // What the encoder is for: these pairs of `make.py` share no word.
        let between = |a: usize, b: usize| found[a].cosine(&found[b]).unwrap();
        assert!(between(2, 3) > between(2, 1) && between(2, 3) > between(2, 4), "brain tissue is grey matter");
    }
}
