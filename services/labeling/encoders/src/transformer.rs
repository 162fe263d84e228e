//! The transformer that all encoders share: blocks of attention and a perceptron, with norms before or after them.

use candle_core::Tensor;
use sg_layers::{
    Activation, Batch, Hidden, Kind, LayerNorm, Linear, Matrix, Perceptron, Precision, SelfAttention, Weights,
};

use crate::error::EncoderError;

/// Size and kind of a transformer.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TransformerConfig {
    /// Components of a token.
    pub(crate) width: usize,
    pub(crate) layers: usize,
    pub(crate) heads: usize,
    /// Width between the perceptron's two layers.
    pub(crate) inner: usize,
    pub(crate) activation: Activation,
    /// ε of the norms.
    pub(crate) epsilon: f32,
}

/// Where a block's norms stand.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum NormOrder {
    /// x + f(norm(x)), of CLIP.
    Before,
    /// norm(x + f(x)), of BERT.
    After,
}

/// Names of a block's tensors, without the block's own prefix.
pub(crate) struct BlockNames {
    pub(crate) attention_norm: &'static str,
    pub(crate) query_key_value: QueryKeyValue,
    pub(crate) attention_output: &'static str,
    pub(crate) perceptron_norm: &'static str,
    pub(crate) perceptron: [&'static str; 2],
}

/// How a file keeps the projections to queries, keys and values.
pub(crate) enum QueryKeyValue {
    /// As three layers.
    Separate([&'static str; 3]),
    /// As one matrix and one bias, one below the other.
    Stacked { weight: &'static str, bias: &'static str },
}

impl QueryKeyValue {
    /// Weights (3 width × width) and biases, queries first.
    pub(crate) fn values(
        &self,
        weights: &mut Weights,
        prefix: &str,
        width: usize,
    ) -> Result<(Vec<f32>, Vec<f32>), EncoderError> {
        match self {
            Self::Stacked { weight, bias } => Ok((
                weights.values(&format!("{prefix}{weight}"), &[3 * width, width], Kind::Projection)?,
                weights.values(&format!("{prefix}{bias}"), &[3 * width], Kind::Shift)?,
            )),
            Self::Separate(names) => {
                let (mut matrix, mut biases) = (Vec::new(), Vec::new());
                for name in names {
                    let weight = format!("{prefix}{name}.weight");
                    matrix.extend(weights.values(&weight, &[width, width], Kind::Projection)?);
                    biases.extend(weights.values(&format!("{prefix}{name}.bias"), &[width], Kind::Shift)?);
                }
                Ok((matrix, biases))
            }
        }
    }
}

/// A perceptron from the names of its two layers.
pub(crate) fn read_perceptron(
    weights: &mut Weights,
    names: [&str; 2],
    config: &TransformerConfig,
    precision: Precision,
) -> Result<Perceptron, EncoderError> {
    let (width, inner) = (config.width, config.inner);
    let up = Linear::read(weights, names[0], [inner, width], precision)?;
    let down = Linear::read(weights, names[1], [width, inner], precision)?;
    Ok(Perceptron::new(up, down, config.activation))
}

struct Block {
    attention_norm: LayerNorm,
    attention: SelfAttention,
    perceptron_norm: LayerNorm,
    perceptron: Perceptron,
}

impl Block {
    fn read(
        weights: &mut Weights,
        prefix: &str,
        names: &BlockNames,
        config: &TransformerConfig,
        precision: Precision,
    ) -> Result<Self, EncoderError> {
        let width = config.width;
        let name = |part: &str| format!("{prefix}{part}");
        let (matrix, biases) = names.query_key_value.values(weights, prefix, width)?;
        let stacked = Linear::new(Matrix::of_layer(matrix, 3 * width, width, precision)?, Some(biases));
        let output = Linear::read(weights, &name(names.attention_output), [width, width], precision)?;
        let [up, down] = names.perceptron.map(name);
        Ok(Self {
            attention_norm: LayerNorm::read(weights, &name(names.attention_norm), width, config.epsilon)?,
            attention: SelfAttention::new(stacked, output, config.heads),
            perceptron_norm: LayerNorm::read(weights, &name(names.perceptron_norm), width, config.epsilon)?,
            perceptron: read_perceptron(weights, [&up, &down], config, precision)?,
        })
    }

    fn apply(
        &self,
        rows: &Tensor,
        batch: Batch,
        mask: Option<&Tensor>,
        order: NormOrder,
    ) -> Result<Tensor, EncoderError> {
        match order {
            NormOrder::Before => {
                let rows = (rows + self.attention.apply(&self.attention_norm.apply(rows)?, batch, mask)?)?;
                Ok((&rows + self.perceptron.apply(&self.perceptron_norm.apply(&rows)?)?)?)
            }
            NormOrder::After => {
                let rows = self.attention_norm.apply(&(rows + self.attention.apply(rows, batch, mask)?)?)?;
                Ok(self.perceptron_norm.apply(&(&rows + self.perceptron.apply(&rows)?)?)?)
            }
        }
    }
}

/// Blocks, one behind the other.
pub(crate) struct Transformer {
    blocks: Vec<Block>,
    order: NormOrder,
}

impl Transformer {
    /// Reads the blocks `PREFIX0.`, `PREFIX1.` and so on.
    pub(crate) fn read(
        weights: &mut Weights,
        prefix: &str,
        names: &BlockNames,
        order: NormOrder,
        config: &TransformerConfig,
        precision: Precision,
    ) -> Result<Self, EncoderError> {
        let block = |at| Block::read(weights, &format!("{prefix}{at}."), names, config, precision);
        Ok(Self { blocks: (0..config.layers).map(block).collect::<Result<_, _>>()?, order })
    }

    /// Rows (sequences · length × width) for rows.
    pub(crate) fn apply(&self, rows: Tensor, batch: Batch, hidden: Hidden<'_>) -> Result<Tensor, EncoderError> {
        let mask = hidden.mask(batch)?;
        self.blocks.iter().try_fold(rows, |rows, block| block.apply(&rows, batch, mask.as_ref(), self.order))
    }
}
