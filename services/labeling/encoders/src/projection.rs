//! Projections to the space of embeddings.

use sg_layers::{Kind, Linear, Matrix, Precision, Weights};

use crate::error::EncoderError;

/// A projection to the space of embeddings, as a file keeps it.
pub(crate) enum ProjectionName {
    /// A matrix of outputs × inputs.
    OutputRows(&'static str),
    /// A matrix of inputs × outputs.
    InputRows(&'static str),
    /// A layer with a bias.
    Layer(&'static str),
}

impl ProjectionName {
    /// The layer of this name.
    pub(crate) fn read(
        &self,
        weights: &mut Weights,
        [outputs, inputs]: [usize; 2],
        precision: Precision,
    ) -> Result<Linear, EncoderError> {
        let values = match self {
            Self::Layer(name) => return Ok(Linear::read(weights, name, [outputs, inputs], precision)?),
            Self::OutputRows(name) => weights.values(name, &[outputs, inputs], Kind::Projection)?,
            Self::InputRows(name) => {
                let values = weights.values(name, &[inputs, outputs], Kind::Projection)?;
                (0..outputs * inputs).map(|at| values[at % inputs * outputs + at / inputs]).collect()
            }
        };
        Ok(Linear::new(Matrix::of_layer(values, outputs, inputs, precision)?, None))
    }
}
