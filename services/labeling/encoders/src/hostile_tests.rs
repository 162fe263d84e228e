//! Folders of models that are damaged, huge or mixed up: each gives one line with the file, the place in it and the remedy.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::{EncoderError, ImageTextModel, Precision, SentenceEncoder};

/// A copy of a fixture to damage.
pub(crate) struct Copy(TempDir);

impl Copy {
    pub(crate) fn of(name: &str) -> Self {
        let copy = Self(tempfile::tempdir().unwrap());
        let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name);
        fs::create_dir(copy.0.path().join("onnx")).unwrap();
        for folder in ["", "onnx"] {
            for file in fs::read_dir(from.join(folder)).into_iter().flatten().map(Result::unwrap) {
                if file.path().is_file() {
                    fs::copy(file.path(), copy.0.path().join(folder).join(file.file_name())).unwrap();
                }
            }
        }
        copy
    }

    pub(crate) fn bytes(&self, file: &str) -> Vec<u8> {
        fs::read(self.0.path().join(file)).unwrap()
    }

    pub(crate) fn write(&self, file: &str, bytes: &[u8]) {
        fs::write(self.0.path().join(file), bytes).unwrap();
    }

    pub(crate) fn remove(&self, file: &str) {
        fs::remove_file(self.0.path().join(file)).unwrap();
    }

    /// Sets a value by its JSON pointer.
    pub(crate) fn set(&self, file: &str, pointer: &str, value: Value) {
        let mut all: Value = serde_json::from_slice(&self.bytes(file)).unwrap();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        all.pointer_mut(parent).unwrap()[key] = value;
        self.write(file, all.to_string().as_bytes());
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    fn open(&self) -> Result<ImageTextModel, EncoderError> {
        ImageTextModel::open(self.0.path(), Precision::F32)
    }

    /// The error of opening the model, which comes at once, is one line and names a file of it.
    fn error(&self) -> String {
        one_line(|| self.open().err())
    }

    fn sentence_error(&self) -> String {
        one_line(|| SentenceEncoder::open(self.0.path(), Precision::F32).err())
    }
}

pub(crate) fn one_line(open: impl Fn() -> Option<EncoderError>) -> String {
    let began = Instant::now();
    let error = open().unwrap().to_string();
    assert!(began.elapsed() < Duration::from_secs(2), "{error}");
    assert!(!error.contains('\n') && error.starts_with('/'), "{error}");
    error
}

pub(crate) fn assert_names(error: &str, parts: &[&str]) {
    assert!(parts.iter().all(|part| error.contains(part)), "{error} lacks one of {parts:?}");
}

#[test]
fn a_configuration_out_of_bounds_is_refused_before_memory_is_taken() {
    let huge = 1_u64 << 40;
    for (pointer, value, parts) in [
        ("/vision_config/hidden_size", json!(huge), &["vision_config.hidden_size", "8192"][..]),
        ("/vision_config/num_hidden_layers", json!(huge), &["num_hidden_layers", "128"]),
        ("/vision_config/num_attention_heads", json!(3), &["num_attention_heads", "do not divide"]),
        ("/vision_config/num_attention_heads", json!(0), &["num_attention_heads", "0; it can be 1"]),
        ("/vision_config/image_size", json!(huge), &["image_size", "2048"]),
        ("/vision_config/patch_size", json!(33), &["patch_size", "1 to 32"]),
        ("/vision_config/num_channels", json!(4), &["num_channels"]),
        ("/vision_config/layer_norm_eps", json!(-1), &["vision_config.layer_norm_eps"]),
        ("/text_config/intermediate_size", json!(huge), &["text_config.intermediate_size", "65536"]),
        ("/text_config/vocab_size", json!(huge), &["text_config.vocab_size", "1048576"]),
        ("/text_config/max_position_embeddings", json!(huge), &["max_position_embeddings", "4096"]),
        ("/text_config/eos_token_id", json!(5000), &["eos_token_id", "there are only 148 tokens"]),
        ("/text_config/hidden_act", json!("swish"), &["swish", "quick_gelu"]),
        ("/text_config/hidden_size", json!(-4), &["-4"]),
        ("/projection_dim", json!(0), &["projection_dim"]),
        ("/model_type", json!("blip"), &["model_type", "`blip`", "`clip`"]),
    ] {
        let copy = Copy::of("clip-gelu");
        copy.set("config.json", pointer, value);
        let error = copy.error();
        assert_names(&error, parts);
        assert_names(&error, &["config.json"]);
    }
}

#[test]
fn weights_that_do_not_match_are_named_with_both_shapes() {
    // Within all bounds, and no memory is taken for it, as the file's shape differs.
    let copy = Copy::of("clip-gelu");
    copy.set("config.json", "/vision_config/hidden_size", json!(8192));
    assert_names(
        &copy.error(),
        &["model.safetensors", "patch_embedding.weight", "[8192, 3, 8, 8]", "[16, 3, 8, 8]", "same model"],
    );
    let copy = Copy::of("open-clip");
    copy.set("open_clip_config.json", "/model_cfg/text_cfg/layers", json!(3));
    assert_names(
        &copy.error(),
        &["open_clip_model.safetensors", "no tensor `transformer.resblocks.2.attn.in_proj_weight`", "[48, 16]"],
    );
    let copy = Copy::of("siglip");
    copy.set("config.json", "/text_config/max_position_embeddings", json!(20));
    assert_names(&copy.error(), &["text_model.embeddings.position_embedding.weight", "[20, 16]", "[16, 16]"]);
}

#[test]
fn a_damaged_file_of_weights_is_refused() {
    let whole = Copy::of("clip-quick-gelu");
    let bytes = whole.bytes("model.safetensors");
    let header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let with = |bytes: &[u8], parts: &[&str]| {
        whole.write("model.safetensors", bytes);
        assert_names(&whole.error(), &["model.safetensors", "not a whole safetensors file", "get it again"]);
        assert_names(&whole.error(), parts);
    };
    with(&[], &["less than 8 bytes"]);
    with(&bytes[..7], &["less than 8 bytes"]);
    with(&bytes[..header / 2], &["ends within its header"]);
    with(&bytes[..bytes.len() - 1], &["bytes, but its header speaks of"]);
    with(&[&bytes[..], b"more"].concat(), &["bytes, but its header speaks of"]);
    with(&[&u64::MAX.to_le_bytes(), &bytes[8..]].concat(), &["its header would have"]);
    let of_header = |text: &str| [&(text.len() as u64).to_le_bytes(), text.as_bytes()].concat();
    with(&of_header("not JSON"), &["in its header"]);
    // More bytes than there are, and a shape whose product overflows.
    with(
        &of_header(r#"{"a":{"dtype":"F32","shape":[1099511627776],"data_offsets":[0,4398046511104]}}"#),
        &["speaks of"],
    );
    with(
        &of_header(r#"{"a":{"dtype":"F32","shape":[4611686018427387904,4611686018427387904],"data_offsets":[0,4]}}"#),
        &["in its header"],
    );
    whole.write("model.safetensors", &bytes);
    assert!(whole.open().is_ok());
    whole.remove("model.safetensors");
    assert_names(&whole.error(), &["model.safetensors", "No such file"]);
}

#[test]
fn integers_are_no_weights() {
    let copy = Copy::of("bert");
    let mut bytes = copy.bytes("model.safetensors");
    // The same number of bytes: a header stays as long.
    let at = bytes.windows(5).position(|part| part == b"\"F32\"").unwrap();
    bytes[at..at + 5].copy_from_slice(b"\"I32\"");
    copy.write("model.safetensors", &bytes);
    assert_names(&copy.sentence_error(), &["model.safetensors", "tensor `", "I32", "convert the weights"]);
}

#[test]
fn every_truncation_and_changed_byte_of_a_header_is_an_error_or_a_model() {
    let copy = Copy::of("bert");
    let bytes = copy.bytes("model.safetensors");
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    for at in (0..header).step_by(37) {
        copy.write("model.safetensors", &bytes[..at]);
        copy.sentence_error();
        let mut changed = bytes.clone();
        changed[at] ^= 0x15;
        copy.write("model.safetensors", &changed);
        // A changed name or offset is noticed; a changed remark is not.
        let _ = SentenceEncoder::open(copy.0.path(), Precision::F32);
    }
}

#[test]
fn a_folder_says_what_it_lacks() {
    let copy = Copy::of("clip-gelu");
    copy.remove("preprocessor_config.json");
    assert_names(&copy.error(), &["preprocessor_config.json", "No such file"]);
    copy.remove("config.json");
    assert_names(&copy.error(), &["neither config.json nor open_clip_config.json", "name the folder of a model"]);
    let copy = Copy::of("clip-gelu");
    copy.remove("tokenizer.json");
    assert_names(&copy.error(), &["tokenizer.json", "No such file"]);
    copy.write("tokenizer.json", b"{\"version\":\"1.0\"}");
    assert_names(&copy.error(), &["tokenizer.json", "not a tokenizer"]);
    assert_names(&copy.sentence_error(), &["config.json", "model_type", "`clip`", "`bert`"]);
}

#[test]
fn a_tokenizer_of_another_model_is_refused() {
    // Its marks alone are as many as the model takes.
    let copy = Copy::of("clip-gelu");
    copy.set("config.json", "/text_config/max_position_embeddings", json!(2));
    assert_names(&copy.error(), &["tokenizer.json", "2 marks", "2 tokens in all"]);
    let copy = Copy::of("siglip");
    copy.set("config.json", "/text_config/vocab_size", json!(100));
    assert_names(&copy.error(), &["pad_token_id", "147, but there are only 100 tokens"]);
}

#[test]
fn a_text_that_is_none_is_refused_with_its_place() {
    use crate::TextEncoder;
    let model = Copy::of("clip-gelu").open().unwrap();
    let long = "bone ".repeat(20_000);
    let error = model.encode_texts(&["bone", &long]).unwrap_err().to_string();
    assert_names(&error, &["text 1", "100000 bytes", "65536"]);
}

#[test]
fn preparations_that_would_give_other_images_are_refused() {
    for (pointer, value, parts) in [
        ("/size", json!({"shortest_edge": 16}), &["`size`", "32 × 32"][..]),
        ("/size", json!({"longest_edge": 16}), &["preprocessor_config.json"]),
        ("/crop_size", json!({"height": 16, "width": 32}), &["crop_size", "32 × 16"]),
        ("/do_resize", json!(false), &["do_resize"]),
        ("/resample", json!(1), &["resample", "bicubic"]),
        ("/image_std", json!([0.5, 0.0, 0.5]), &["image_std", "positive"]),
        ("/image_mean", json!([0.5]), &["preprocessor_config.json"]),
        ("/rescale_factor", json!(0.0), &["rescale_factor"]),
    ] {
        let copy = Copy::of("clip-gelu");
        copy.set("preprocessor_config.json", pointer, value);
        let error = copy.error();
        assert_names(&error, parts);
        assert_names(&error, &["preprocessor_config.json"]);
    }
}

#[test]
fn other_towers_of_open_clip_are_refused() {
    for (pointer, value, key) in [
        ("/model_cfg/vision_cfg/timm_model_name", json!("resnet50"), "vision_cfg.timm_model_name"),
        ("/model_cfg/vision_cfg/attentional_pool", json!(true), "vision_cfg.attentional_pool"),
        ("/model_cfg/text_cfg/hf_model_name", json!("roberta-base"), "text_cfg.hf_model_name"),
        ("/model_cfg/text_cfg/no_causal_mask", json!(true), "text_cfg.no_causal_mask"),
        ("/model_cfg/text_cfg/pool_type", json!("last"), "text_cfg.pool_type"),
        ("/model_cfg/multimodal_cfg", json!({"width": 512}), "model_cfg.multimodal_cfg"),
        ("/model_cfg/vision_cfg/mlp_ratio", json!(1e30), "vision_cfg.mlp_ratio"),
        ("/preprocess_cfg/resize_mode", json!("longest"), "preprocess_cfg.resize_mode"),
    ] {
        let copy = Copy::of("open-clip");
        copy.set("open_clip_config.json", pointer, value);
        assert_names(&copy.error(), &["open_clip_config.json", key]);
    }
    let copy = Copy::of("open-clip");
    copy.set("open_clip_config.json", "/model_cfg/vision_cfg/attentional_pool", json!(false));
    assert!(copy.open().is_ok());
}

#[test]
fn weights_that_are_not_finite_give_no_embedding() {
    use crate::TextEncoder;
    let copy = Copy::of("bert");
    let mut bytes = copy.bytes("model.safetensors");
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    for four in bytes[header..].as_chunks_mut::<4>().0 {
        *four = f32::NAN.to_le_bytes();
    }
    copy.write("model.safetensors", &bytes);
    let encoder = SentenceEncoder::open(copy.0.path(), Precision::F32).unwrap();
    let error = encoder.encode_texts(&["bone"]).unwrap_err().to_string();
    assert_names(&error, &["component 0", "not finite", "damaged"]);
}
