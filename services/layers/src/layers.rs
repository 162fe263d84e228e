//! Linear layers, layer norms and perceptrons, made from weights by name.

use candle_core::{Device, Tensor};

use crate::activation::{Activation, Epilogue};
use crate::error::ModelError;
use crate::matrix::{Matrix, Precision};
use crate::tensor::Kind;
use crate::weights::Weights;

/// y = x Wᵀ + b.
pub struct Linear {
    matrix: Matrix,
    bias: Option<Vec<f32>>,
}

impl Linear {
    /// A layer of outputs × inputs, with a bias for each output if any.
    #[must_use]
    pub fn new(matrix: Matrix, bias: Option<Vec<f32>>) -> Self {
        Self { matrix, bias }
    }

    /// A layer with its bias, from `NAME.weight` and `NAME.bias`.
    ///
    /// # Errors
    /// As [`Weights::values`].
    pub fn read(
        weights: &mut Weights,
        name: &str,
        [outputs, inputs]: [usize; 2],
        precision: Precision,
    ) -> Result<Self, ModelError> {
        let values = weights.values(&format!("{name}.weight"), &[outputs, inputs], Kind::Projection)?;
        let bias = weights.values(&format!("{name}.bias"), &[outputs], Kind::Shift)?;
        Ok(Self::new(Matrix::of_layer(values, outputs, inputs, precision)?, Some(bias)))
    }

    /// Rows of outputs for rows of inputs, through an activation if any.
    ///
    /// # Errors
    /// [`ModelError::Computation`] where `inputs` has another width.
    pub fn apply(&self, inputs: &Tensor, activation: Option<Activation>) -> Result<Tensor, ModelError> {
        let outputs = self.matrix.apply(inputs)?;
        let bias = self.bias.as_deref();
        if bias.is_some() || activation.is_some() {
            outputs.inplace_op1(&Epilogue { bias, activation, width: self.matrix.rows() })?;
        }
        Ok(outputs)
    }
}

/// (x − mean)/√(variance + ε), scaled and shifted.
pub struct LayerNorm {
    scale: Tensor,
    shift: Tensor,
    epsilon: f32,
}

impl LayerNorm {
    /// From `NAME.weight` and `NAME.bias`.
    ///
    /// # Errors
    /// As [`Weights::values`].
    pub fn read(weights: &mut Weights, name: &str, width: usize, epsilon: f32) -> Result<Self, ModelError> {
        let scale = weights.values(&format!("{name}.weight"), &[width], Kind::Scale)?;
        let shift = weights.values(&format!("{name}.bias"), &[width], Kind::Shift)?;
        Self::new(scale, shift, epsilon)
    }

    /// From a factor and a term for each component.
    ///
    /// # Errors
    /// [`ModelError::Computation`] where the tensor library refuses them.
    pub fn new(scale: Vec<f32>, shift: Vec<f32>, epsilon: f32) -> Result<Self, ModelError> {
        let tensor = |values: Vec<f32>| {
            let width = values.len();
            Tensor::from_vec(values, width, &Device::Cpu)
        };
        Ok(Self { scale: tensor(scale)?, shift: tensor(shift)?, epsilon })
    }

    /// Normalised rows.
    ///
    /// # Errors
    /// [`ModelError::Computation`] where `inputs` has another width.
    pub fn apply(&self, inputs: &Tensor) -> Result<Tensor, ModelError> {
        Ok(candle_nn::ops::layer_norm(&inputs.contiguous()?, &self.scale, &self.shift, self.epsilon)?)
    }
}

/// Two layers with an activation between.
pub struct Perceptron {
    up: Linear,
    down: Linear,
    activation: Activation,
}

impl Perceptron {
    /// The layer to the inner width, and the one from it.
    #[must_use]
    pub fn new(up: Linear, down: Linear, activation: Activation) -> Self {
        Self { up, down, activation }
    }

    /// Rows for rows.
    ///
    /// # Errors
    /// [`ModelError::Computation`] where `rows` has another width.
    pub fn apply(&self, rows: &Tensor) -> Result<Tensor, ModelError> {
        self.down.apply(&self.up.apply(rows, Some(self.activation))?, None)
    }
}
