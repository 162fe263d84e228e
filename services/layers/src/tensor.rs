//! Tensors of a file: what they do, how their values are stored, and how they are read.

use half::slice::HalfFloatSliceExt;
use half::{bf16, f16};

use crate::error::ModelError;

/// What a tensor does, which is what random weights go by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Multiplies inputs, of which each output sums the last dimension.
    Projection,
    /// Rows that are taken.
    Table,
    /// Factors near one.
    Scale,
    /// Terms near zero.
    Shift,
}

/// A file with tensors that have names and shapes.
pub trait TensorReader {
    /// A tensor's values in f32, row by row.
    ///
    /// # Errors
    /// [`ModelError`] where there is none of this name and shape, before memory is taken for it.
    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError>;

    /// Whether there is a tensor of this name.
    fn has(&self, name: &str) -> bool;
}

/// Type of a stored value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoredType {
    /// IEEE single precision.
    F32,
    /// IEEE half precision.
    F16,
    /// The upper half of a single precision.
    Bf16,
}

/// Little-endian values.
#[must_use]
pub fn to_f32(bytes: &[u8], stored: StoredType) -> Vec<f32> {
    let pairs = || bytes.as_chunks::<2>().0.iter().map(|pair| u16::from_le_bytes(*pair));
    match stored {
        StoredType::F16 => {
            let halves: Vec<f16> = pairs().map(f16::from_bits).collect();
            let mut values = vec![0.0; halves.len()];
            halves.convert_to_f32_slice(&mut values);
            values
        }
        StoredType::Bf16 => pairs().map(|bits| bf16::from_bits(bits).to_f32()).collect(),
        StoredType::F32 => bytes.as_chunks::<4>().0.iter().map(|four| f32::from_le_bytes(*four)).collect(),
    }
}
