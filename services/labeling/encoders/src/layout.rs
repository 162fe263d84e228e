//! Names of tensors in the three layouts of files with an image and a text tower.

use crate::projection::ProjectionName;
use crate::transformer::{BlockNames, QueryKeyValue};

/// A layout of configuration and weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// CLIP of Hugging Face's transformers: `config.json` with `model_type` `clip`, `model.safetensors`.
    Clip,
    /// OpenCLIP: `open_clip_config.json`, `open_clip_model.safetensors`.
    OpenClip,
    /// `SigLIP` of Hugging Face's transformers: `config.json` with `model_type` `siglip`, `model.safetensors`.
    SigLip,
}

/// How an image tower's tokens become one vector.
pub(crate) enum VisionHead {
    /// The class token's output, projected.
    Class { token: &'static str, norm_before: &'static str, projection: ProjectionName },
    /// Attention of a learnt query to all tokens; the prefix of its tensors.
    AttentionPooling(&'static str),
}

/// Names of an image tower's tensors outside its blocks.
pub(crate) struct VisionNames {
    pub(crate) patches: &'static str,
    pub(crate) patch_bias: Option<&'static str>,
    pub(crate) positions: &'static str,
    pub(crate) blocks: &'static str,
    pub(crate) norm_after: &'static str,
    pub(crate) head: VisionHead,
}

/// Names of a text tower's tensors outside its blocks.
pub(crate) struct TextNames {
    pub(crate) tokens: &'static str,
    pub(crate) positions: &'static str,
    pub(crate) blocks: &'static str,
    pub(crate) norm_after: &'static str,
    pub(crate) projection: ProjectionName,
}

const HUGGING_FACE_BLOCK: BlockNames = BlockNames {
    attention_norm: "layer_norm1",
    query_key_value: QueryKeyValue::Separate(["self_attn.q_proj", "self_attn.k_proj", "self_attn.v_proj"]),
    attention_output: "self_attn.out_proj",
    perceptron_norm: "layer_norm2",
    perceptron: ["mlp.fc1", "mlp.fc2"],
};

const OPEN_CLIP_BLOCK: BlockNames = BlockNames {
    attention_norm: "ln_1",
    query_key_value: QueryKeyValue::Stacked { weight: "attn.in_proj_weight", bias: "attn.in_proj_bias" },
    attention_output: "attn.out_proj",
    perceptron_norm: "ln_2",
    perceptron: ["mlp.c_fc", "mlp.c_proj"],
};

impl Layout {
    pub(crate) fn config_file(self) -> &'static str {
        match self {
            Self::Clip | Self::SigLip => "config.json",
            Self::OpenClip => "open_clip_config.json",
        }
    }

    pub(crate) fn weights_file(self) -> &'static str {
        match self {
            Self::Clip | Self::SigLip => "model.safetensors",
            Self::OpenClip => "open_clip_model.safetensors",
        }
    }

    pub(crate) fn block(self) -> &'static BlockNames {
        match self {
            Self::Clip | Self::SigLip => &HUGGING_FACE_BLOCK,
            Self::OpenClip => &OPEN_CLIP_BLOCK,
        }
    }

    pub(crate) fn vision(self) -> VisionNames {
        match self {
            Self::Clip => VisionNames {
                patches: "vision_model.embeddings.patch_embedding.weight",
                patch_bias: None,
                positions: "vision_model.embeddings.position_embedding.weight",
                blocks: "vision_model.encoder.layers.",
                norm_after: "vision_model.post_layernorm",
                head: VisionHead::Class {
                    token: "vision_model.embeddings.class_embedding",
                    // The published name has this spelling.
                    norm_before: "vision_model.pre_layrnorm",
                    projection: ProjectionName::OutputRows("visual_projection.weight"),
                },
            },
            Self::OpenClip => VisionNames {
                patches: "visual.conv1.weight",
                patch_bias: None,
                positions: "visual.positional_embedding",
                blocks: "visual.transformer.resblocks.",
                norm_after: "visual.ln_post",
                head: VisionHead::Class {
                    token: "visual.class_embedding",
                    norm_before: "visual.ln_pre",
                    projection: ProjectionName::InputRows("visual.proj"),
                },
            },
            Self::SigLip => VisionNames {
                patches: "vision_model.embeddings.patch_embedding.weight",
                patch_bias: Some("vision_model.embeddings.patch_embedding.bias"),
                positions: "vision_model.embeddings.position_embedding.weight",
                blocks: "vision_model.encoder.layers.",
                norm_after: "vision_model.post_layernorm",
                head: VisionHead::AttentionPooling("vision_model.head."),
            },
        }
    }

    pub(crate) fn text(self) -> TextNames {
        let hugging_face = |projection| TextNames {
            tokens: "text_model.embeddings.token_embedding.weight",
            positions: "text_model.embeddings.position_embedding.weight",
            blocks: "text_model.encoder.layers.",
            norm_after: "text_model.final_layer_norm",
            projection,
        };
        match self {
            Self::Clip => hugging_face(ProjectionName::OutputRows("text_projection.weight")),
            Self::SigLip => hugging_face(ProjectionName::Layer("text_model.head")),
            Self::OpenClip => TextNames {
                tokens: "token_embedding.weight",
                positions: "positional_embedding",
                blocks: "transformer.resblocks.",
                norm_after: "ln_final",
                projection: ProjectionName::InputRows("text_projection"),
            },
        }
    }
}
