//! `open_clip_config.json` of OpenCLIP.

use std::path::Path;

use serde::Deserialize;
use serde_json::{Map, Value};
use sg_layers::{Activation, MAX_CONTEXT, MAX_VOCABULARY, MAX_WIDTH, read_json, within};

use crate::config::{ImageTextConfig, MAX_IMAGE, TextConfig, TextPooling, TransformerKeys, VisionConfig};
use crate::error::EncoderError;
use crate::layout::Layout;
use crate::preprocess::{CropRounding, Preprocess, Resize};
use crate::resample::Filter;
use crate::transformer::TransformerConfig;

#[derive(Deserialize)]
struct Config {
    model_cfg: Model,
    #[serde(default)]
    preprocess_cfg: Preprocessor,
}

#[derive(Deserialize)]
struct Model {
    embed_dim: usize,
    #[serde(default)]
    quick_gelu: bool,
    vision_cfg: Vision,
    text_cfg: Text,
    #[serde(flatten)]
    others: Map<String, Value>,
}

#[derive(Deserialize)]
struct Vision {
    image_size: usize,
    layers: usize,
    width: usize,
    patch_size: usize,
    head_width: Option<usize>,
    mlp_ratio: Option<f64>,
    #[serde(flatten)]
    others: Map<String, Value>,
}

#[derive(Deserialize)]
struct Text {
    context_length: usize,
    vocab_size: usize,
    width: usize,
    heads: usize,
    layers: usize,
    mlp_ratio: Option<f64>,
    pool_type: Option<String>,
    eos_id: Option<u32>,
    #[serde(flatten)]
    others: Map<String, Value>,
}

#[derive(Default, Deserialize)]
struct Preprocessor {
    mean: Option<[f32; 3]>,
    std: Option<[f32; 3]>,
    interpolation: Option<String>,
    resize_mode: Option<String>,
}

/// Keys that change nothing in what a trained model computes.
const WITHOUT_EFFECT: [&str; 6] =
    ["patch_dropout", "output_tokens", "hf_tokenizer_name", "tokenizer_kwargs", "init_logit_scale", "custom_text"];
/// Mean and standard deviation of OpenAI's images, for configurations without.
const MEAN: [f32; 3] = [0.481_454_66, 0.457_827_5, 0.408_210_73];
const DEVIATION: [f32; 3] = [0.268_629_55, 0.261_302_6, 0.275_777_1];
const DEFAULT_END: u32 = 2;

const KEYS: TransformerKeys =
    TransformerKeys { width: "width", inner: "mlp_ratio", layers: "layers", heads: "heads", epsilon: "norm_kwargs" };

/// Refuses switches of other kinds of towers, which would compute something else with the same weights.
fn refuse(path: &Path, part: &str, others: &Map<String, Value>) -> Result<(), EncoderError> {
    let is_off = |value: &Value| match value {
        Value::Null => true,
        Value::Bool(on) => !on,
        Value::Object(object) => object.is_empty(),
        _ => false,
    };
    let other = others.iter().find(|(key, value)| !WITHOUT_EFFECT.contains(&key.as_str()) && !is_off(value));
    match other {
        None => Ok(()),
        Some((key, _)) => {
            let problem = "not supported; take a model of OpenCLIP's plain vision and text transformers";
            Err(EncoderError::config(path, &format!("{part}{key}"), problem))
        }
    }
}

/// The model that a folder's `open_clip_config.json` describes.
pub(crate) fn read_image_text(folder: &Path) -> Result<ImageTextConfig, EncoderError> {
    let path = &folder.join("open_clip_config.json");
    let Config { model_cfg: model, preprocess_cfg } = read_json(path)?;
    let (vision, text) = (&model.vision_cfg, &model.text_cfg);
    refuse(path, "model_cfg.", &model.others)?;
    refuse(path, "model_cfg.vision_cfg.", &vision.others)?;
    refuse(path, "model_cfg.text_cfg.", &text.others)?;
    let activation = if model.quick_gelu { Activation::QuickGelu } else { Activation::Gelu };
    let inner = |width: usize, ratio: Option<f64>| (width as f64 * ratio.unwrap_or(4.0)) as usize;
    let head_width = vision.head_width.unwrap_or(64).max(1);
    let vision_tower = TransformerConfig {
        width: vision.width,
        layers: vision.layers,
        heads: vision.width / head_width,
        inner: inner(vision.width, vision.mlp_ratio),
        activation,
        epsilon: 1e-5,
    };
    let text_tower = TransformerConfig {
        width: text.width,
        layers: text.layers,
        heads: text.heads,
        inner: inner(text.width, text.mlp_ratio),
        activation,
        epsilon: 1e-5,
    };
    let image_size = within(path, "model_cfg.vision_cfg.image_size", vision.image_size, MAX_IMAGE)?;
    let patch_size = within(path, "model_cfg.vision_cfg.patch_size", vision.patch_size, image_size)?;
    let vocabulary = within(path, "model_cfg.text_cfg.vocab_size", text.vocab_size, MAX_VOCABULARY)?;
    let pooling = match text.pool_type.as_deref() {
        None | Some("argmax") => TextPooling::Highest,
        Some("eos") => TextPooling::First(text.eos_id.unwrap_or(DEFAULT_END)),
        Some(other) => {
            let problem = format!("`{other}`; a text is pooled by `argmax` or `eos`");
            return Err(EncoderError::config(path, "model_cfg.text_cfg.pool_type", problem));
        }
    };
    Ok(ImageTextConfig {
        layout: Layout::OpenClip,
        vision: VisionConfig {
            transformer: vision_tower.checked(path, "model_cfg.vision_cfg.", &KEYS)?,
            image_size,
            patch_size,
        },
        text: TextConfig {
            transformer: text_tower.checked(path, "model_cfg.text_cfg.", &KEYS)?,
            vocabulary,
            context: within(path, "model_cfg.text_cfg.context_length", text.context_length, MAX_CONTEXT)?,
            pooling,
        },
        dimension: within(path, "model_cfg.embed_dim", model.embed_dim, MAX_WIDTH)?,
        preprocess: preprocess(path, &preprocess_cfg, image_size)?,
    })
}

fn preprocess(path: &Path, config: &Preprocessor, side: usize) -> Result<Preprocess, EncoderError> {
    let wrong = |key: &str, problem: String| EncoderError::config(path, &format!("preprocess_cfg.{key}"), problem);
    let filter = match config.interpolation.as_deref() {
        None | Some("bicubic") => Filter::Bicubic,
        Some("bilinear") => Filter::Bilinear,
        Some(other) => return Err(wrong("interpolation", format!("`{other}`; it can be `bicubic` or `bilinear`"))),
    };
    let resize = match config.resize_mode.as_deref() {
        None | Some("shortest") => Resize::ShortestEdge(side),
        Some("squash") => Resize::Exact { width: side, height: side },
        Some(other) => return Err(wrong("resize_mode", format!("`{other}`; it can be `shortest` or `squash`"))),
    };
    let (mean, deviation) = (config.mean.unwrap_or(MEAN), config.std.unwrap_or(DEVIATION));
    let rounding = CropRounding::HalfToEven;
    let preprocess = Preprocess { side, resize, filter, rounding, factor: 1.0 / 255.0, mean, deviation };
    preprocess.checked(true).map_err(|(key, problem)| wrong(key.trim_start_matches("image_"), problem))
}
