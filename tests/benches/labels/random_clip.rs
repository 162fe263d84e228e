//! A model of the size of ViT-B/32 with random weights, in the layout of Hugging Face.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use safetensors::{Dtype, View};

/// Files of the folder with the configuration.
const FILES: [&str; 3] = ["config.json", "preprocessor_config.json", "tokenizer.json"];
/// Width, inner width, blocks: the published sizes, which the configuration leaves out.
const VISION: [usize; 3] = [768, 3072, 12];
const TEXT: [usize; 3] = [512, 2048, 12];
/// Length of an embedding, tokens, longest text, patches of a picture and their side.
const DIMENSION: usize = 512;
const VOCABULARY: usize = 49_408;
const CONTEXT: usize = 77;
const PATCHES: usize = 49;
const PATCH: usize = 32;

/// A tensor that is written.
struct Tensor {
    name: String,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl View for &Tensor {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.bytes)
    }

    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}

/// Tensors of random values.
struct Random {
    generator: ChaCha8Rng,
    tensors: Vec<Tensor>,
}

impl Random {
    /// Values of a width about a middle.
    fn add(&mut self, name: String, shape: &[usize], middle: f32, half_width: f32) {
        let count = shape.iter().product::<usize>();
        let mut value = || middle + self.generator.random_range(-half_width..half_width);
        let bytes = (0..count).flat_map(|_| value().to_le_bytes()).collect();
        self.tensors.push(Tensor { name, shape: shape.to_vec(), bytes });
    }

    fn matrix(&mut self, name: &str, [rows, columns]: [usize; 2], has_bias: bool) {
        let half_width = (3.0 / columns as f32).sqrt();
        self.add(format!("{name}.weight"), &[rows, columns], 0.0, half_width);
        if has_bias {
            self.add(format!("{name}.bias"), &[rows], 0.0, 0.1);
        }
    }

    fn norm(&mut self, name: &str, width: usize) {
        self.add(format!("{name}.weight"), &[width], 1.0, 0.1);
        self.add(format!("{name}.bias"), &[width], 0.0, 0.1);
    }

    fn blocks(&mut self, tower: &str, [width, inner, blocks]: [usize; 3]) {
        for block in 0..blocks {
            let name = |part: &str| format!("{tower}.encoder.layers.{block}.{part}");
            self.norm(&name("layer_norm1"), width);
            self.norm(&name("layer_norm2"), width);
            for part in ["q_proj", "k_proj", "v_proj", "out_proj"] {
                self.matrix(&name(&format!("self_attn.{part}")), [width, width], true);
            }
            self.matrix(&name("mlp.fc1"), [inner, width], true);
            self.matrix(&name("mlp.fc2"), [width, inner], true);
        }
    }
}

/// Writes the model of a configuration below a folder; 600 MB.
pub(crate) fn write(configuration: &Path, below: &Path) -> PathBuf {
    let folder = below.join("vit-b-32");
    std::fs::create_dir(&folder).unwrap();
    for name in FILES {
        std::fs::copy(configuration.join(name), folder.join(name)).unwrap();
    }
    let mut random = Random { generator: ChaCha8Rng::seed_from_u64(1), tensors: Vec::new() };
    let [vision, text] = [VISION[0], TEXT[0]];
    random.add("vision_model.embeddings.class_embedding".to_owned(), &[vision], 0.0, 0.5);
    let patches = [vision, 3, PATCH, PATCH];
    random.add("vision_model.embeddings.patch_embedding.weight".to_owned(), &patches, 0.0, 0.03);
    random.matrix("vision_model.embeddings.position_embedding", [PATCHES + 1, vision], false);
    random.norm("vision_model.pre_layrnorm", vision);
    random.blocks("vision_model", VISION);
    random.norm("vision_model.post_layernorm", vision);
    random.matrix("visual_projection", [DIMENSION, vision], false);
    random.matrix("text_model.embeddings.token_embedding", [VOCABULARY, text], false);
    random.matrix("text_model.embeddings.position_embedding", [CONTEXT, text], false);
    random.blocks("text_model", TEXT);
    random.norm("text_model.final_layer_norm", text);
    random.matrix("text_projection", [DIMENSION, text], false);
    random.add("logit_scale".to_owned(), &[], 4.6, 0.1);
    let named = random.tensors.iter().map(|tensor| (tensor.name.clone(), tensor));
    safetensors::serialize_to_file(named, None, &folder.join("model.safetensors")).unwrap();
    folder
}
