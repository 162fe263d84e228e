//! Whisper's encoder: two convolutions and a transformer over frames of 20 ms.

use candle_core::{Device, Tensor};
use rayon::prelude::*;
use sg_layers::{Activation, Batch, LayerNorm, Linear, ModelError, Perceptron, SelfAttention};

use crate::config::ModelSize;
use crate::layout::{LayerReader, Part};
use crate::spectrogram::Spectrogram;

struct Block {
    attention_norm: LayerNorm,
    attention: SelfAttention,
    perceptron_norm: LayerNorm,
    perceptron: Perceptron,
}

pub(crate) struct Encoder {
    convolutions: [Linear; 2],
    /// Frames × width, for 30 s.
    positions: Tensor,
    blocks: Vec<Block>,
    last_norm: LayerNorm,
}

impl Encoder {
    pub(crate) fn read(reader: &mut LayerReader, size: &ModelSize) -> Result<Self, ModelError> {
        let first = reader.convolution("conv1", size.bands)?;
        let second = reader.convolution("conv2", size.width)?;
        let positions = reader.positions(Part::Encoder, size.frames)?;
        let mut blocks = Vec::with_capacity(size.encoder.layers);
        for at in 0..size.encoder.layers {
            let attention_norm = reader.self_attention_norm(Part::Encoder, at)?;
            let attention = reader.self_attention(at, size.encoder)?;
            let (perceptron_norm, perceptron) = reader.perceptron(Part::Encoder, at, size.encoder)?;
            blocks.push(Block { attention_norm, attention, perceptron_norm, perceptron });
        }
        Ok(Self {
            convolutions: [first, second],
            positions: Tensor::from_vec(positions, (size.frames, size.width), &Device::Cpu)?,
            blocks,
            last_norm: reader.last_norm(Part::Encoder)?,
        })
    }

    /// Half as many frames (× width) as the spectrogram has. They are at most those that the model has places for.
    pub(crate) fn apply(&self, spectrogram: &Spectrogram) -> Result<Tensor, ModelError> {
        let rows = neighbours(&spectrogram.values, spectrogram.bands, 1)?;
        let rows = self.convolutions[0].apply(&rows, Some(Activation::Gelu))?;
        let width = rows.dim(1)?;
        let rows = neighbours(&rows.flatten_all()?.to_vec1::<f32>()?, width, 2)?;
        let rows = self.convolutions[1].apply(&rows, Some(Activation::Gelu))?;
        let length = rows.dim(0)?;
        let mut rows = (rows + self.positions.narrow(0, 0, length)?)?;
        for block in &self.blocks {
            let batch = Batch { sequences: 1, length };
            rows = (&rows + block.attention.apply(&block.attention_norm.apply(&rows)?, batch, None)?)?;
            rows = (&rows + block.perceptron.apply(&block.perceptron_norm.apply(&rows)?)?)?;
        }
        self.last_norm.apply(&rows)
    }
}

/// The values of each `stride`th row and of both its neighbours, with zeros beyond the ends.
fn neighbours(values: &[f32], width: usize, stride: usize) -> Result<Tensor, ModelError> {
    let rows = (values.len() / width).div_ceil(stride);
    let mut all = vec![0.0; rows * 3 * width];
    all.par_chunks_mut(3 * width).enumerate().for_each(|(at, row)| {
        // The row before the first one is missing.
        let from = (at * stride * width).checked_sub(width);
        let (skipped, from) = from.map_or((width, 0), |from| (0, from));
        let until = values.len().min(from + 3 * width - skipped);
        row[skipped..][..until - from].copy_from_slice(&values[from..until]);
    });
    Ok(Tensor::from_vec(all, (rows, 3 * width), &Device::Cpu)?)
}
