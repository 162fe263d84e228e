//! Parameters of the service in the launch file.

use std::path::PathBuf;
use std::sync::Arc;

use serde::{Deserialize, Deserializer, de};
use sg_encoders::{EncoderError, OnnxImageTextModel, Precision};

use crate::label_encoder::{EncoderChoice, LabelEncoder};
use crate::picture_encoder::{ImageEncoderChoice, PictureEncoder, PictureError};
use crate::unit_embeddings::{FusionChoice, UnitEmbeddings};

/// Most pictures of a unit.
const MAX_VIEWS: usize = 12;

/// Parameters of the service in the launch file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Params {
    /// Sentence encoder beside the words: `auto`, `none`, or a model's folder.
    pub(crate) text_encoder: EncoderChoice,
    /// Model of images and texts: `none`, or a model's folder.
    pub(crate) image_encoder: ImageEncoderChoice,
    /// Precision of its weights: `f32`, `f16` or `int8`.
    #[serde(deserialize_with = "precision")]
    pub(crate) image_precision: Precision,
    /// Library of ONNX Runtime, which then runs both encoders where their folders have graphs.
    pub(crate) onnxruntime: Option<PathBuf>,
    /// Pictures of a unit, 1 to 12.
    #[serde(deserialize_with = "views")]
    pub(crate) views: usize,
    /// How pictures and name become one embedding.
    pub(crate) fusion: FusionChoice,
    /// Whether an adapter is fitted on the session's own labels.
    pub(crate) adapter: bool,
    /// Folder of stored embeddings; by default `embeddings` in the folder of the session.
    pub(crate) cache: Option<PathBuf>,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            text_encoder: EncoderChoice::default(),
            image_encoder: ImageEncoderChoice::None,
            image_precision: Precision::F32,
            onnxruntime: None,
            views: 5,
            fusion: FusionChoice::default(),
            adapter: false,
            cache: None,
        }
    }
}

/// The precision of weights by its name.
pub(crate) fn precision_of(text: &str) -> Result<Precision, String> {
    match text {
        "f32" => Ok(Precision::F32),
        "f16" => Ok(Precision::F16),
        "int8" => Ok(Precision::Int8),
        other => Err(format!("`{other}` is no precision; it must be f32, f16 or int8")),
    }
}

/// A number of pictures of a unit.
pub(crate) fn views_of(text: &str) -> Result<usize, String> {
    let views = text.parse::<usize>().ok().filter(|views| (1..=MAX_VIEWS).contains(views));
    views.ok_or_else(|| format!("it must be a number from 1 to {MAX_VIEWS}"))
}

fn precision<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Precision, D::Error> {
    let text = String::deserialize(deserializer)?;
    precision_of(&text).map_err(|problem| de::Error::custom(format!("`image_precision`: {problem}")))
}

fn views<'de, D: Deserializer<'de>>(deserializer: D) -> Result<usize, D::Error> {
    let views = usize::deserialize(deserializer)?;
    if (1..=MAX_VIEWS).contains(&views) {
        return Ok(views);
    }
    Err(de::Error::custom(format!("`views` is {views}; it must be 1 to {MAX_VIEWS}")))
}

impl Params {
    /// The sentence encoder that the parameters ask for. `None` without one.
    ///
    /// # Errors
    /// [`EncoderError`] for a folder that has no readable model, or a file that is not ONNX Runtime.
    pub(crate) fn label_encoder(&self) -> Result<Option<Arc<LabelEncoder>>, EncoderError> {
        LabelEncoder::run_by(&self.text_encoder, self.onnxruntime.as_deref())
    }

    /// The embeddings that the parameters ask for, none yet. `None` without a model.
    ///
    /// # Errors
    /// [`PictureError`] for a folder that has no readable model, a file that is not ONNX Runtime, or another precision than f32
    /// with it.
    pub(crate) fn embeddings(&self) -> Result<Option<Arc<UnitEmbeddings>>, PictureError> {
        let ImageEncoderChoice::Folder(folder) = &self.image_encoder else { return Ok(None) };
        let encoder = match &self.onnxruntime {
            Some(_) if self.image_precision != Precision::F32 => return Err(PictureError::Precision),
            Some(library) if OnnxImageTextModel::is_in(folder) => {
                PictureEncoder::open_graphs(folder, library, self.views)?
            }
            _ => PictureEncoder::open(folder, self.image_precision, self.views)?,
        };
        Ok(Some(Arc::new(UnitEmbeddings::new(encoder, self.fusion, self.adapter)?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_checked() {
        let of = |value: serde_json::Value| serde_json::from_value::<Params>(value).map_err(|e| e.to_string());
        let usual = of(serde_json::json!({})).unwrap();
        assert_eq!((usual.views, usual.fusion, usual.cache), (5, FusionChoice::Normalized, None));
        assert!(usual.image_encoder == ImageEncoderChoice::None);
        let own = of(serde_json::json!({
            "image_encoder": "/models/clip", "image_precision": "int8", "views": 3, "fusion": "pictures", "cache": "/c", "adapter": true,
        }));
        let own = own.unwrap();
        assert_eq!(own.image_encoder, ImageEncoderChoice::Folder("/models/clip".into()));
        assert_eq!((own.image_precision, own.views, own.fusion), (Precision::Int8, 3, FusionChoice::Pictures));
        assert!(own.adapter && !usual.adapter);
        let of_graphs = of(serde_json::json!({
            "image_encoder": "/models/clip", "image_precision": "f16", "onnxruntime": "/lib/libonnxruntime.so",
        }));
        let error = of_graphs.unwrap().embeddings().err().unwrap().to_string();
        assert!(error.contains("`image_precision` is not f32"), "{error}");
        for (params, problem) in [
            (serde_json::json!({"views": 0}), "`views` is 0; it must be 1 to 12"),
            (serde_json::json!({"image_precision": "f64"}), "it must be f32, f16 or int8"),
            (serde_json::json!({"fusion": "sum"}), "unknown variant `sum`"),
            (serde_json::json!({"image_encodr": "none"}), "unknown field `image_encodr`"),
        ] {
            let error = of(params).unwrap_err();
            assert!(error.contains(problem), "{error}");
        }
        assert_eq!((views_of("12"), precision_of("f16")), (Ok(12), Ok(Precision::F16)));
        assert!([views_of("13"), views_of("0"), views_of("-1"), views_of("")].iter().all(Result::is_err));
        assert!(precision_of("F32").is_err());
    }
}
