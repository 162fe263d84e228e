//! Multi-head attention.

use candle_core::{Device, Tensor};

use crate::error::ModelError;
use crate::layers::Linear;

/// Which keys a query does not see.
#[derive(Clone, Copy)]
pub enum Hidden<'a> {
    /// None.
    Nothing,
    /// Those behind the query.
    Later,
    /// Of each sequence, those from its length on.
    Padding(&'a [usize]),
}

/// Rows of a batch: `sequences` × `length`, sequence by sequence.
#[derive(Clone, Copy)]
pub struct Batch {
    /// Number of sequences.
    pub sequences: usize,
    /// Tokens of each.
    pub length: usize,
}

impl Hidden<'_> {
    /// What is added to the scores (sequences × heads × queries × keys), if anything.
    ///
    /// # Errors
    /// [`ModelError::Computation`] where there are not as many lengths as sequences.
    pub fn mask(self, batch: Batch) -> Result<Option<Tensor>, ModelError> {
        let of = |hidden: bool| if hidden { f32::NEG_INFINITY } else { 0.0 };
        let length = batch.length;
        match self {
            Self::Nothing => Ok(None),
            Self::Later => {
                let mask: Vec<f32> = (0..length * length).map(|at| of(at % length > at / length)).collect();
                Ok(Some(Tensor::from_vec(mask, (1, 1, length, length), &Device::Cpu)?))
            }
            Self::Padding(lengths) if lengths.iter().all(|own| *own == length) => Ok(None),
            Self::Padding(lengths) => {
                let mask: Vec<f32> =
                    lengths.iter().flat_map(|own| (0..length).map(move |key| of(key >= *own))).collect();
                Ok(Some(Tensor::from_vec(mask, (lengths.len(), 1, 1, length), &Device::Cpu)?))
            }
        }
    }
}

/// Attention of a sequence to itself.
pub struct SelfAttention {
    /// Queries, keys and values of all heads, in this order, by one multiplication.
    query_key_value: Linear,
    output: Linear,
    heads: usize,
}

impl SelfAttention {
    /// From the layer that gives queries, keys and values one behind the other, and the layer behind the attention.
    #[must_use]
    pub fn new(query_key_value: Linear, output: Linear, heads: usize) -> Self {
        Self { query_key_value, output, heads }
    }

    /// Rows (sequences · length × width) for rows.
    ///
    /// # Errors
    /// [`ModelError::Computation`] where shapes don't fit.
    pub fn apply(&self, rows: &Tensor, batch: Batch, mask: Option<&Tensor>) -> Result<Tensor, ModelError> {
        let width = rows.dim(1)?;
        let all = self.query_key_value.apply(rows, None)?;
        let [queries, keys, values] = [0, 1, 2].map(|part| {
            let rows = all.narrow(1, part * width, width)?;
            split_heads(&rows, batch, self.heads)
        });
        let attended = attend(&queries?, &keys?, &values?, mask)?;
        self.output.apply(&attended, None)
    }
}

/// Rows (sequences · length × width) as sequences × heads × length × width of a head.
///
/// # Errors
/// [`ModelError::Computation`] where shapes don't fit.
pub fn split_heads(rows: &Tensor, batch: Batch, heads: usize) -> Result<Tensor, ModelError> {
    let shape = (batch.sequences, batch.length, heads, rows.dim(1)? / heads);
    Ok(rows.reshape(shape)?.transpose(1, 2)?.contiguous()?)
}

/// Most scores that are kept at once, unless a single query has more: they stay in the processor's cache.
const SCORES: usize = 1 << 20;

/// softmax(Q Kᵀ/√d + mask) V of each head, as rows (sequences · queries × width).
///
/// # Errors
/// [`ModelError::Computation`] where shapes don't fit.
pub fn attend(queries: &Tensor, keys: &Tensor, values: &Tensor, mask: Option<&Tensor>) -> Result<Tensor, ModelError> {
    let (sequences, heads, length, width) = queries.dims4()?;
    let queries = (queries * (width as f64).sqrt().recip())?;
    let keys = keys.t()?;
    let of_query = sequences * heads * keys.dim(3)?;
    let step = (SCORES / of_query.max(1)).clamp(1, length.max(1));
    let part = |from: usize| -> Result<Tensor, ModelError> {
        let count = step.min(length - from);
        let scores = queries.narrow(2, from, count)?.matmul(&keys)?;
        let scores = match mask {
            // A mask that is the same for all queries has one row.
            Some(mask) if mask.dim(2)? == length => scores.broadcast_add(&mask.narrow(2, from, count)?)?,
            Some(mask) => scores.broadcast_add(mask)?,
            None => scores,
        };
        Ok(candle_nn::ops::softmax_last_dim(&scores)?.matmul(values)?)
    };
    let parts: Vec<Tensor> = (0..length).step_by(step).map(part).collect::<Result<_, _>>()?;
    let attended = if parts.len() == 1 { parts[0].clone() } else { Tensor::cat(&parts, 2)? };
    Ok(attended.transpose(1, 2)?.reshape((sequences * length, heads * width))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attention_in_parts_is_attention_at_once() {
        // Three parts of 2¹⁰ queries and a rest.
        let (length, keys) = (3 * 1024 + 5, 1024);
        let tensor = |rows: usize, shift: usize| {
            let values: Vec<f32> = (0..rows * 4).map(|at| ((at * 37 + shift) % 101) as f32 / 50.0 - 1.0).collect();
            Tensor::from_vec(values, (1, 1, rows, 4), &Device::Cpu).unwrap()
        };
        let (queries, keys, values) = (tensor(length, 1), tensor(keys, 2), tensor(keys, 3));
        let all = attend(&queries, &keys, &values, None).unwrap().to_vec2::<f32>().unwrap();
        assert_eq!(all.len(), length);
        for at in [0, 1023, 1024, 2047, 3071, 3072, length - 1] {
            let alone = attend(&queries.narrow(2, at, 1).unwrap(), &keys, &values, None).unwrap();
            let pairs = alone.to_vec2::<f32>().unwrap().remove(0);
            assert!(pairs.iter().zip(&all[at]).all(|(a, b)| (a - b).abs() < 1e-6), "{at}");
        }
        let mask: Vec<f32> = (0..length * 1024).map(|at| ((at * 13) % 7) as f32).collect();
        let mask = Tensor::from_vec(mask, (1, 1, length, 1024), &Device::Cpu).unwrap();
        let all = attend(&queries, &keys, &values, Some(&mask)).unwrap().to_vec2::<f32>().unwrap();
        for at in [0, 2048, length - 1] {
            let own = mask.narrow(2, at, 1).unwrap();
            let alone = attend(&queries.narrow(2, at, 1).unwrap(), &keys, &values, Some(&own)).unwrap();
            let pairs = alone.to_vec2::<f32>().unwrap().remove(0);
            assert!(pairs.iter().zip(&all[at]).all(|(a, b)| (a - b).abs() < 1e-6), "{at}");
        }
    }
}
