//! A model's own score of an image and a text, by their cosine.

use std::path::Path;

use serde::Deserialize;
use sg_input::file;
use sg_layers::{Kind, Weights, read_json};

use crate::error::EncoderError;
use crate::layout::Layout;

/// ln 100: the scale of OpenAI's CLIP, and the bound of its training (Radford et al. 2021, section 2.5).
const CLIP_SCALE: f32 = 4.605_170_2;

/// Factor of a cosine, and what is added.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Logit {
    scale: f32,
    bias: f32,
}

/// What a configuration may say in place of weights: the values of the tensors with these names.
#[derive(Deserialize)]
struct Stated {
    logit_scale: Option<f32>,
    logit_bias: Option<f32>,
}

impl Logit {
    /// Factor and bias of a file of weights.
    pub(crate) fn read(weights: &mut Weights, layout: Layout) -> Result<Self, EncoderError> {
        let mut scalar = |name: &str, shape: &[usize]| {
            weights.values(name, shape, Kind::Shift).map(|values| values.first().copied().unwrap_or_default())
        };
        let (scale, bias) = match layout {
            Layout::SigLip => (scalar("logit_scale", &[1])?, scalar("logit_bias", &[1])?),
            Layout::Clip | Layout::OpenClip => (scalar("logit_scale", &[])?, 0.0),
        };
        Ok(Self { scale: scale.exp(), bias })
    }

    /// Factor and bias of a folder whose towers are graphs, which have neither. They come from the weights if those are there, else
    /// from the keys `logit_scale` (a logarithm, as the tensor) and `logit_bias` of the configuration. Else the factor is CLIP's
    /// usual 100.
    /// `logit_scale_init_value` is where a training began, so it says nothing.
    pub(crate) fn beside_graphs(folder: &Path, layout: Layout) -> Result<Self, EncoderError> {
        let weights = folder.join(layout.weights_file());
        let is_absent = |error: std::io::Error| error.kind() == std::io::ErrorKind::NotFound;
        if !file::open(&weights).is_err_and(is_absent) {
            return Self::read(&mut Weights::open(&weights)?, layout);
        }
        let path = &folder.join(layout.config_file());
        let stated: Stated = read_json(path)?;
        let (scale, bias) = match (layout, stated.logit_scale, stated.logit_bias) {
            (Layout::SigLip, Some(scale), Some(bias)) => (scale, bias),
            (Layout::SigLip, ..) => {
                let name = layout.weights_file();
                let problem = format!("it has no `logit_scale` and `logit_bias`; add them, or put {name} beside it");
                return Err(EncoderError::file(path, problem));
            }
            (Layout::Clip | Layout::OpenClip, scale, _) => (scale.unwrap_or(CLIP_SCALE), 0.0),
        };
        if !(scale.exp().is_normal() && bias.is_finite()) {
            let problem = format!("{scale}; it is the logarithm of the factor, such as {CLIP_SCALE}");
            return Err(EncoderError::config(path, "logit_scale", problem));
        }
        Ok(Self { scale: scale.exp(), bias })
    }

    pub(crate) fn of(self, cosine: f32) -> f32 {
        self.scale * cosine + self.bias
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn graphs_without_weights_have_the_stated_factor_or_the_usual_one() {
        let folder = tempfile::tempdir().unwrap();
        let of = |config: &str, layout| {
            std::fs::write(folder.path().join("config.json"), config).unwrap();
            Logit::beside_graphs(folder.path(), layout)
        };
        let usual = of(r#"{"logit_scale_init_value": 2.6592}"#, Layout::Clip).unwrap();
        assert!((usual.of(0.5) - 50.0).abs() < 1e-3);
        let stated = of(r#"{"logit_scale": 2.0, "logit_bias": -3.0}"#, Layout::SigLip).unwrap();
        assert!((stated.of(0.5) - (0.5 * 2f32.exp() - 3.0)).abs() < 1e-5);
        let error = of(r#"{"logit_scale": 2.0}"#, Layout::SigLip).unwrap_err().to_string();
        assert!(error.contains("config.json") && error.contains("`logit_bias`; add them"), "{error}");
        let error = of(r#"{"logit_scale": 1000}"#, Layout::Clip).unwrap_err().to_string();
        assert!(error.contains("`logit_scale`: 1000; it is the logarithm"), "{error}");
        // Weights that are there decide, so damaged ones are an error.
        std::fs::write(folder.path().join("model.safetensors"), b"none").unwrap();
        let error = of("{}", Layout::Clip).unwrap_err().to_string();
        assert!(error.contains("model.safetensors") && error.contains("safetensors file"), "{error}");
    }
}
