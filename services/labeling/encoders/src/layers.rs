//! Linear layers and layer norms, made from weights by name.

use candle_core::{Device, Tensor};

use crate::activation::{Activation, Epilogue};
use crate::error::EncoderError;
use crate::matrix::{Matrix, Precision};
use crate::weights::{Kind, Weights};

/// A projection to the space of embeddings, as a file keeps it.
pub(crate) enum ProjectionName {
    /// A matrix of outputs × inputs.
    OutputRows(&'static str),
    /// A matrix of inputs × outputs.
    InputRows(&'static str),
    /// A layer with a bias.
    Layer(&'static str),
}

/// y = x Wᵀ + b.
pub(crate) struct Linear {
    matrix: Matrix,
    bias: Option<Vec<f32>>,
}

impl Linear {
    pub(crate) fn new(matrix: Matrix, bias: Option<Vec<f32>>) -> Self {
        Self { matrix, bias }
    }

    /// A layer with its bias, from `NAME.weight` and `NAME.bias`.
    pub(crate) fn read(
        weights: &mut Weights,
        name: &str,
        [outputs, inputs]: [usize; 2],
        precision: Precision,
    ) -> Result<Self, EncoderError> {
        let values = weights.values(&format!("{name}.weight"), &[outputs, inputs], Kind::Projection)?;
        let bias = weights.values(&format!("{name}.bias"), &[outputs], Kind::Shift)?;
        Ok(Self::new(Matrix::of_layer(values, outputs, inputs, precision)?, Some(bias)))
    }

    /// A projection to the space of embeddings.
    pub(crate) fn read_projection(
        weights: &mut Weights,
        name: &ProjectionName,
        [outputs, inputs]: [usize; 2],
        precision: Precision,
    ) -> Result<Self, EncoderError> {
        let values = match name {
            ProjectionName::Layer(name) => return Self::read(weights, name, [outputs, inputs], precision),
            ProjectionName::OutputRows(name) => weights.values(name, &[outputs, inputs], Kind::Projection)?,
            ProjectionName::InputRows(name) => {
                let values = weights.values(name, &[inputs, outputs], Kind::Projection)?;
                (0..outputs * inputs).map(|at| values[at % inputs * outputs + at / inputs]).collect()
            }
        };
        Ok(Self::new(Matrix::of_layer(values, outputs, inputs, precision)?, None))
    }

    /// Rows of outputs for rows of inputs.
    pub(crate) fn apply(&self, inputs: &Tensor, activation: Option<Activation>) -> Result<Tensor, EncoderError> {
        let outputs = self.matrix.apply(inputs)?;
        let bias = self.bias.as_deref();
        if bias.is_some() || activation.is_some() {
            outputs.inplace_op1(&Epilogue { bias, activation, width: self.matrix.rows() })?;
        }
        Ok(outputs)
    }
}

/// (x − mean)/√(variance + ε), scaled and shifted.
pub(crate) struct LayerNorm {
    scale: Tensor,
    shift: Tensor,
    epsilon: f32,
}

impl LayerNorm {
    /// From `NAME.weight` and `NAME.bias`.
    pub(crate) fn read(weights: &mut Weights, name: &str, width: usize, epsilon: f32) -> Result<Self, EncoderError> {
        let scale = weights.values(&format!("{name}.weight"), &[width], Kind::Scale)?;
        let shift = weights.values(&format!("{name}.bias"), &[width], Kind::Shift)?;
        let tensor = |values| Tensor::from_vec(values, width, &Device::Cpu);
        Ok(Self { scale: tensor(scale)?, shift: tensor(shift)?, epsilon })
    }

    pub(crate) fn apply(&self, inputs: &Tensor) -> Result<Tensor, EncoderError> {
        Ok(candle_nn::ops::layer_norm(&inputs.contiguous()?, &self.scale, &self.shift, self.epsilon)?)
    }
}
