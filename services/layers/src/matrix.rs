//! Matrices of weights in the precision that they are kept in. The arithmetic is f32 in all of them.

use candle_core::{Device, Result, Tensor};
use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

/// Precision in which weights are kept in memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// 4 bytes for each weight.
    #[default]
    F32,
    /// 2 bytes.
    F16,
    /// 1 byte in linear layers, with a scale for each row of outputs, symmetric about zero. Tables of tokens and positions
    /// keep 2 bytes.
    Int8,
}

/// A matrix of `rows` × `columns`, row by row.
pub struct Matrix {
    rows: usize,
    columns: usize,
    values: Values,
}

enum Values {
    F32(Tensor),
    F16(Vec<f16>),
    Int8 { levels: Vec<i8>, scales: Vec<f32> },
}

/// Highest level of an 8-bit weight. −128 is left out, so that the levels are symmetric.
const LEVELS: f32 = 127.0;

impl Matrix {
    /// The weights of a linear layer; `values` has `rows` × `columns` of them.
    ///
    /// # Errors
    /// Where there are more or fewer values.
    pub fn of_layer(values: Vec<f32>, rows: usize, columns: usize, precision: Precision) -> Result<Self> {
        let values = match precision {
            Precision::F32 => Values::F32(Tensor::from_vec(values, (rows, columns), &Device::Cpu)?),
            Precision::F16 => Values::F16(to_f16(&values)),
            Precision::Int8 => {
                let scales: Vec<f32> = values
                    .par_chunks(columns)
                    .map(|row| row.iter().fold(0.0, |most: f32, value| most.max(value.abs())) / LEVELS)
                    .collect();
                let mut levels = vec![0; values.len()];
                let rows = levels.par_chunks_mut(columns).zip(values.par_chunks(columns)).zip(&scales);
                rows.for_each(|((levels, row), scale)| {
                    let steps = if *scale > 0.0 { scale.recip() } else { 0.0 };
                    // A conversion to an integer saturates.
                    levels.iter_mut().zip(row).for_each(|(level, value)| *level = (value * steps).round() as i8);
                });
                Values::Int8 { levels, scales }
            }
        };
        Ok(Self { rows, columns, values })
    }

    /// A table of which rows are taken.
    ///
    /// # Errors
    /// As [`Matrix::of_layer`].
    pub fn of_table(values: Vec<f32>, rows: usize, columns: usize, precision: Precision) -> Result<Self> {
        let precision = if precision == Precision::Int8 { Precision::F16 } else { precision };
        Self::of_layer(values, rows, columns, precision)
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// `inputs` (n × columns) times this matrix transposed: n × rows.
    ///
    /// # Errors
    /// Where `inputs` has another width.
    pub fn apply(&self, inputs: &Tensor) -> Result<Tensor> {
        match &self.values {
            Values::F32(tensor) => inputs.matmul(&tensor.t()?),
            _ => inputs.matmul(&Tensor::from_vec(self.expanded(), (self.rows, self.columns), &Device::Cpu)?.t()?),
        }
    }

    /// The rows of these indices, one below the other. Each index is less than [`Self::rows`].
    ///
    /// # Errors
    /// Where an index is none of f32 rows.
    pub fn take(&self, indices: &[u32]) -> Result<Tensor> {
        let Values::F16(values) = &self.values else {
            let indices = Tensor::from_slice(indices, indices.len(), &Device::Cpu)?;
            return match &self.values {
                Values::F32(tensor) => tensor.index_select(&indices, 0),
                _ => Tensor::from_vec(self.expanded(), (self.rows, self.columns), &Device::Cpu)?
                    .index_select(&indices, 0),
            };
        };
        let mut taken = vec![0.0; indices.len() * self.columns];
        for (row, index) in taken.chunks_exact_mut(self.columns).zip(indices) {
            values[*index as usize * self.columns..][..self.columns].convert_to_f32_slice(row);
        }
        Tensor::from_vec(taken, (indices.len(), self.columns), &Device::Cpu)
    }

    /// All weights as f32.
    fn expanded(&self) -> Vec<f32> {
        let mut all = vec![0.0; self.rows * self.columns];
        let rows = all.par_chunks_mut(self.columns);
        match &self.values {
            Values::F32(_) => {}
            Values::F16(values) => {
                rows.zip(values.par_chunks(self.columns)).for_each(|(to, from)| from.convert_to_f32_slice(to));
            }
            Values::Int8 { levels, scales } => {
                rows.zip(levels.par_chunks(self.columns)).zip(scales).for_each(|((to, from), scale)| {
                    to.iter_mut().zip(from).for_each(|(to, level)| *to = f32::from(*level) * scale);
                });
            }
        }
        all
    }
}

fn to_f16(values: &[f32]) -> Vec<f16> {
    let mut halves = vec![f16::ZERO; values.len()];
    halves.convert_from_f32_slice(values);
    halves
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn product(weights: &[f32], inputs: &[f32], rows: usize, columns: usize, precision: Precision) -> Vec<f32> {
        let matrix = Matrix::of_layer(weights.to_vec(), rows, columns, precision).unwrap();
        let inputs = Tensor::from_slice(inputs, (inputs.len() / columns, columns), &Device::Cpu).unwrap();
        matrix.apply(&inputs).unwrap().flatten_all().unwrap().to_vec1().unwrap()
    }

    proptest! {
        #[test]
        fn precisions_differ_by_the_rounding_of_weights(
            weights in proptest::collection::vec(-2f32..2.0, 5 * 12), inputs in proptest::collection::vec(-1f32..1.0, 3 * 12),
        ) {
            let exact = product(&weights, &inputs, 5, 12, Precision::F32);
            for (row, value) in exact.iter().enumerate() {
                let dot: f32 = (0..12).map(|i| weights[row % 5 * 12 + i] * inputs[row / 5 * 12 + i]).sum();
                prop_assert!((dot - value).abs() < 1e-4);
            }
            // Half a unit in the last place of a value below 2, and half a level of a row below 2, for each of 12 terms.
            for (precision, bound) in [(Precision::F16, 12.0 * 2f32.powi(-11)), (Precision::Int8, 12.0 / LEVELS)] {
                for (value, exact) in product(&weights, &inputs, 5, 12, precision).iter().zip(&exact) {
                    prop_assert!((value - exact).abs() <= bound + 1e-5, "{precision:?}: {value} for {exact}");
                }
            }
        }
    }

    #[test]
    fn rows_are_taken_in_every_precision() {
        let values: Vec<f32> = (0..12u8).map(f32::from).collect();
        for precision in [Precision::F32, Precision::F16, Precision::Int8] {
            let table = Matrix::of_table(values.clone(), 4, 3, precision).unwrap();
            let taken = table.take(&[2, 0, 2]).unwrap().to_vec2::<f32>().unwrap();
            assert_eq!(taken, [[6.0, 7.0, 8.0], [0.0, 1.0, 2.0], [6.0, 7.0, 8.0]]);
        }
        let layer = Matrix::of_layer(vec![0.0, 0.0, 127.0, -64.0], 2, 2, Precision::Int8).unwrap();
        assert_eq!(layer.take(&[1, 0]).unwrap().to_vec2::<f32>().unwrap(), [[127.0, -64.0], [0.0, 0.0]]);
    }
}
