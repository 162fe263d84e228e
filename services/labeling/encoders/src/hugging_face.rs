//! `config.json` and `preprocessor_config.json` of Hugging Face's transformers: CLIP, `SigLIP`.

use std::path::Path;

use serde::Deserialize;
use sg_layers::{Activation, MAX_CONTEXT, MAX_VOCABULARY, MAX_WIDTH, read_json, within};

use crate::config::{HUGGING_FACE_KEYS, ImageTextConfig, MAX_IMAGE, TextConfig, TextPooling, VisionConfig};
use crate::error::EncoderError;
use crate::layout::Layout;
use crate::preprocess::{CropRounding, Preprocess, Resize};
use crate::resample::Filter;
use crate::transformer::TransformerConfig;

/// The numbers that both towers have. Absent ones are the published class's defaults, which differ between towers.
#[derive(Default, Deserialize)]
struct Tower {
    hidden_size: Option<usize>,
    intermediate_size: Option<usize>,
    num_hidden_layers: Option<usize>,
    num_attention_heads: Option<usize>,
    hidden_act: Option<Activation>,
    layer_norm_eps: Option<f32>,
}

#[derive(Default, Deserialize)]
struct Vision {
    #[serde(flatten)]
    tower: Tower,
    image_size: Option<usize>,
    patch_size: Option<usize>,
    num_channels: Option<usize>,
    vision_use_head: Option<bool>,
}

#[derive(Default, Deserialize)]
struct Text {
    #[serde(flatten)]
    tower: Tower,
    vocab_size: Option<usize>,
    max_position_embeddings: Option<usize>,
    eos_token_id: Option<TokenId>,
    pad_token_id: Option<u32>,
    projection_size: Option<usize>,
}

#[derive(Clone, Deserialize)]
#[serde(untagged)]
enum TokenId {
    One(u32),
    Many(Vec<u32>),
}

#[derive(Deserialize)]
struct Config {
    model_type: Option<String>,
    #[serde(default)]
    vision_config: Vision,
    #[serde(default)]
    text_config: Text,
    projection_dim: Option<usize>,
}

/// Width, inner width, blocks and heads.
type Sizes = [usize; 4];

impl Tower {
    fn checked(
        &self,
        path: &Path,
        part: &str,
        default: Sizes,
        activation: Activation,
        epsilon: f32,
    ) -> Result<TransformerConfig, EncoderError> {
        let config = TransformerConfig {
            width: self.hidden_size.unwrap_or(default[0]),
            inner: self.intermediate_size.unwrap_or(default[1]),
            layers: self.num_hidden_layers.unwrap_or(default[2]),
            heads: self.num_attention_heads.unwrap_or(default[3]),
            activation: self.hidden_act.unwrap_or(activation),
            epsilon: self.layer_norm_eps.unwrap_or(epsilon),
        };
        config.checked(path, part, &HUGGING_FACE_KEYS)
    }
}

/// Id of the end of text in configurations of before transformers 4.31, where it was wrong.
const WRONG_END: u32 = 2;
const CLIP_END: u32 = 49_407;
const SIGLIP_PADDING: u32 = 1;

/// The model that a folder's `config.json` and `preprocessor_config.json` describe.
pub(crate) fn read_image_text(folder: &Path) -> Result<ImageTextConfig, EncoderError> {
    let path = &folder.join("config.json");
    let config: Config = read_json(path)?;
    let (vision, text) = (&config.vision_config, &config.text_config);
    let (layout, activation, epsilon) = match config.model_type.as_deref() {
        Some("clip") => (Layout::Clip, Activation::QuickGelu, 1e-5),
        Some("siglip") => (Layout::SigLip, Activation::GeluTanh, 1e-6),
        other => {
            let problem = format!("{}; models with images and texts are `clip` and `siglip`", named(other));
            return Err(EncoderError::config(path, "model_type", problem));
        }
    };
    let (text_sizes, patch, vocabulary, context) = match layout {
        Layout::SigLip => ([768, 3072, 12, 12], 16, 32_000, 64),
        _ => ([512, 2048, 12, 8], 32, 49_408, 77),
    };
    let tower = vision.tower.checked(path, "vision_config.", [768, 3072, 12, 12], activation, epsilon)?;
    let image_size = within(path, "vision_config.image_size", vision.image_size.unwrap_or(224), MAX_IMAGE)?;
    let patch_size = within(path, "vision_config.patch_size", vision.patch_size.unwrap_or(patch), image_size)?;
    if vision.num_channels.is_some_and(|channels| channels != 3) {
        return Err(EncoderError::config(path, "vision_config.num_channels", "images are RGB; it can only be 3"));
    }
    if vision.vision_use_head == Some(false) {
        let problem = "a model without this head gives no embedding of an image; take another one";
        return Err(EncoderError::config(path, "vision_config.vision_use_head", problem));
    }
    let dimension = match layout {
        Layout::SigLip => {
            let width = tower.width;
            let size = text.projection_size.unwrap_or(text.tower.hidden_size.unwrap_or(text_sizes[0]));
            if size != width {
                let problem = format!("texts have {size} components, but images have {width}; they must be equal");
                return Err(EncoderError::config(path, "text_config.projection_size", problem));
            }
            width
        }
        _ => within(path, "projection_dim", config.projection_dim.unwrap_or(512), MAX_WIDTH)?,
    };
    let vocabulary = within(path, "text_config.vocab_size", text.vocab_size.unwrap_or(vocabulary), MAX_VOCABULARY)?;
    let end = match &text.eos_token_id {
        None => CLIP_END,
        Some(TokenId::One(id)) => *id,
        Some(TokenId::Many(ids)) => ids.first().copied().unwrap_or(CLIP_END),
    };
    let pooling = match layout {
        Layout::SigLip => TextPooling::Last { padding: text.pad_token_id.unwrap_or(SIGLIP_PADDING) },
        _ if end == WRONG_END => TextPooling::Highest,
        _ => TextPooling::First(end),
    };
    let of_pooling = match pooling {
        TextPooling::Last { padding } => Some(("text_config.pad_token_id", padding)),
        TextPooling::First(end) => Some(("text_config.eos_token_id", end)),
        TextPooling::Highest => None,
    };
    if let Some((key, id)) = of_pooling.filter(|(_, id)| *id as usize >= vocabulary) {
        return Err(EncoderError::config(path, key, format!("{id}, but there are only {vocabulary} tokens")));
    }
    let text_tower = text.tower.checked(path, "text_config.", text_sizes, activation, epsilon)?;
    let key = "text_config.max_position_embeddings";
    let context = within(path, key, text.max_position_embeddings.unwrap_or(context), MAX_CONTEXT)?;
    Ok(ImageTextConfig {
        layout,
        vision: VisionConfig { transformer: tower, image_size, patch_size },
        text: TextConfig { transformer: text_tower, vocabulary, context, pooling },
        dimension,
        preprocess: read_preprocessor(&folder.join("preprocessor_config.json"), image_size, layout)?,
    })
}

/// A value that a file states, or that it states none.
pub(crate) fn named(value: Option<&str>) -> String {
    value.map_or_else(|| "there is none".to_owned(), |value| format!("it is `{value}`"))
}

#[derive(Deserialize)]
struct Preprocessor {
    size: Size,
    crop_size: Option<Size>,
    do_center_crop: Option<bool>,
    do_resize: Option<bool>,
    do_rescale: Option<bool>,
    do_normalize: Option<bool>,
    resample: Option<u32>,
    rescale_factor: Option<f32>,
    image_mean: [f32; 3],
    image_std: [f32; 3],
}

#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
enum Size {
    Side(usize),
    ShortestEdge { shortest_edge: usize },
    Rectangle { height: usize, width: usize },
}

fn read_preprocessor(path: &Path, side: usize, layout: Layout) -> Result<Preprocess, EncoderError> {
    let config: Preprocessor = read_json(path)?;
    let steps =
        [("do_resize", config.do_resize), ("do_rescale", config.do_rescale), ("do_normalize", config.do_normalize)];
    if let Some((key, _)) = steps.iter().find(|(_, step)| *step == Some(false)) {
        return Err(EncoderError::config(path, key, "images are always resized and normalised; it can only be true"));
    }
    let filter = match config.resample {
        None | Some(3) => Filter::Bicubic,
        Some(2) => Filter::Bilinear,
        Some(other) => {
            let problem = format!("{other}; filters are 2 (bilinear) and 3 (bicubic)");
            return Err(EncoderError::config(path, "resample", problem));
        }
    };
    let resize = match config.size {
        Size::ShortestEdge { shortest_edge } => Resize::ShortestEdge(shortest_edge),
        // Configurations of before transformers 4.20 state a number, which CLIP takes for the shortest edge.
        Size::Side(size) if layout == Layout::Clip => Resize::ShortestEdge(size),
        Size::Side(size) => Resize::Exact { width: size, height: size },
        Size::Rectangle { height, width } => Resize::Exact { width, height },
    };
    let crops = config.do_center_crop.unwrap_or(layout == Layout::Clip);
    if crops {
        let crop = match config.crop_size {
            None => [side; 2],
            Some(Size::Side(size) | Size::ShortestEdge { shortest_edge: size }) => [size; 2],
            Some(Size::Rectangle { height, width }) => [width, height],
        };
        if crop != [side; 2] {
            let problem = format!("{} × {}, but the model takes images of {side} × {side}", crop[0], crop[1]);
            return Err(EncoderError::config(path, "crop_size", problem));
        }
    }
    let factor = config.rescale_factor.unwrap_or(1.0 / 255.0);
    let preprocess = Preprocess {
        side,
        resize,
        filter,
        rounding: CropRounding::Down,
        factor,
        mean: config.image_mean,
        deviation: config.image_std,
    };
    preprocess.checked(crops).map_err(|(key, problem)| EncoderError::config(path, key, problem))
}
