//! Image towers: vision transformers (Dosovitskiy et al. 2021) with a class token or with attention pooling.

use candle_core::{Device, Tensor};
use sg_layers::{Batch, Hidden, Kind, LayerNorm, Linear, Matrix, Perceptron, Precision, Weights, attend, split_heads};

use crate::config::VisionConfig;
use crate::error::EncoderError;
use crate::layout::{Layout, VisionHead};
use crate::transformer::{NormOrder, QueryKeyValue, Transformer, TransformerConfig, read_perceptron};

pub(crate) struct VisionTower {
    patches: Linear,
    /// Tokens × width; the class token's position is the first.
    positions: Tensor,
    transformer: Transformer,
    norm_after: LayerNorm,
    head: Head,
    width: usize,
}

enum Head {
    Class { token: Tensor, norm_before: LayerNorm, projection: Linear },
    Pooling(Box<AttentionPooling>),
}

impl VisionTower {
    pub(crate) fn read(
        weights: &mut Weights,
        layout: Layout,
        config: &VisionConfig,
        dimension: usize,
        precision: Precision,
    ) -> Result<Self, EncoderError> {
        let (names, transformer) = (layout.vision(), &config.transformer);
        let (width, epsilon, side) = (transformer.width, transformer.epsilon, config.patch_size);
        let kernel = weights.values(names.patches, &[width, 3, side, side], Kind::Projection)?;
        let bias = names.patch_bias.map(|name| weights.values(name, &[width], Kind::Shift)).transpose()?;
        let head = match &names.head {
            VisionHead::Class { token, norm_before, projection } => Head::Class {
                token: Tensor::from_vec(weights.values(token, &[width], Kind::Shift)?, (1, 1, width), &Device::Cpu)?,
                norm_before: LayerNorm::read(weights, norm_before, width, epsilon)?,
                projection: projection.read(weights, [dimension, width], precision)?,
            },
            VisionHead::AttentionPooling(prefix) => {
                Head::Pooling(Box::new(AttentionPooling::read(weights, prefix, transformer, precision)?))
            }
        };
        let tokens = config.patches() + usize::from(matches!(head, Head::Class { .. }));
        let positions = weights.values(names.positions, &[tokens, width], Kind::Table)?;
        let blocks =
            Transformer::read(weights, names.blocks, layout.block(), NormOrder::Before, transformer, precision)?;
        Ok(Self {
            patches: Linear::new(Matrix::of_layer(kernel, width, 3 * side * side, precision)?, bias),
            positions: Tensor::from_vec(positions, (tokens, width), &Device::Cpu)?,
            transformer: blocks,
            norm_after: LayerNorm::read(weights, names.norm_after, width, epsilon)?,
            head,
            width,
        })
    }

    /// Embeddings (images × dimension) of patches (images · patches × values of a patch).
    pub(crate) fn apply(&self, patches: &Tensor, images: usize) -> Result<Tensor, EncoderError> {
        let tokens = self.patches.apply(patches, None)?.reshape((images, (), self.width))?;
        let tokens = match &self.head {
            Head::Class { token, .. } => {
                Tensor::cat(&[&token.broadcast_as((images, 1, self.width))?.contiguous()?, &tokens], 1)?
            }
            Head::Pooling(_) => tokens,
        };
        let batch = Batch { sequences: images, length: tokens.dim(1)? };
        let rows = tokens.broadcast_add(&self.positions)?.reshape(((), self.width))?;
        match &self.head {
            Head::Class { norm_before, projection, .. } => {
                let rows = self.transformer.apply(norm_before.apply(&rows)?, batch, Hidden::Nothing)?;
                let class = rows.reshape((images, (), self.width))?.narrow(1, 0, 1)?.squeeze(1)?;
                Ok(projection.apply(&self.norm_after.apply(&class)?, None)?)
            }
            Head::Pooling(pooling) => {
                let rows = self.transformer.apply(rows, batch, Hidden::Nothing)?;
                pooling.apply(&self.norm_after.apply(&rows)?, batch)
            }
        }
    }
}

/// `SigLIP`'s head: one learnt query attends to all tokens, and a perceptron follows.
struct AttentionPooling {
    /// The query of each head, 1 × heads × 1 × width of a head. It is the same for all images.
    query: Tensor,
    key_value: Linear,
    output: Linear,
    norm: LayerNorm,
    perceptron: Perceptron,
    heads: usize,
}

impl AttentionPooling {
    fn read(
        weights: &mut Weights,
        prefix: &str,
        config: &TransformerConfig,
        precision: Precision,
    ) -> Result<Self, EncoderError> {
        let (width, heads) = (config.width, config.heads);
        let name = |part: &str| format!("{prefix}{part}");
        let probe = weights.values(&name("probe"), &[1, 1, width], Kind::Table)?;
        let names = QueryKeyValue::Stacked { weight: "attention.in_proj_weight", bias: "attention.in_proj_bias" };
        let (mut matrix, mut biases) = names.values(weights, prefix, width)?;
        let (of_keys, keys_biases) = (matrix.split_off(width * width), biases.split_off(width));
        let projection = Linear::new(Matrix::of_layer(matrix, width, width, Precision::F32)?, Some(biases));
        let query = projection.apply(&Tensor::from_vec(probe, (1, width), &Device::Cpu)?, None)?;
        Ok(Self {
            query: split_heads(&query, Batch { sequences: 1, length: 1 }, heads)?,
            key_value: Linear::new(Matrix::of_layer(of_keys, 2 * width, width, precision)?, Some(keys_biases)),
            output: Linear::read(weights, &name("attention.out_proj"), [width, width], precision)?,
            norm: LayerNorm::read(weights, &name("layernorm"), width, config.epsilon)?,
            perceptron: read_perceptron(weights, [&name("mlp.fc1"), &name("mlp.fc2")], config, precision)?,
            heads,
        })
    }

    fn apply(&self, rows: &Tensor, batch: Batch) -> Result<Tensor, EncoderError> {
        let width = rows.dim(1)?;
        let both = self.key_value.apply(rows, None)?;
        let keys = split_heads(&both.narrow(1, 0, width)?, batch, self.heads)?;
        let values = split_heads(&both.narrow(1, width, width)?, batch, self.heads)?;
        let (_, heads, _, of_head) = self.query.dims4()?;
        let query = self.query.broadcast_as((batch.sequences, heads, 1, of_head))?.contiguous()?;
        let pooled = self.output.apply(&attend(&query, &keys, &values, None)?, None)?;
        Ok((&pooled + self.perceptron.apply(&self.norm.apply(&pooled)?)?)?)
    }
}
