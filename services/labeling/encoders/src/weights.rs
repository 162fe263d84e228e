//! Weights by name and shape: of safetensors files, or random ones for timing.
//!
//! A file is read tensor by tensor. So memory never holds more of it than one tensor beside those that the model keeps, and a
//! shape is compared with the configuration before its memory is taken.

use std::collections::HashMap;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use half::slice::HalfFloatSliceExt;
use half::{bf16, f16};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use safetensors::Dtype;
use safetensors::tensor::{Metadata, TensorInfo};
use sg_input::file::{self, RegularFile};

use crate::error::EncoderError;

/// Most bytes of a file's header. Real ones have up to 200 kB.
const MAX_HEADER_BYTES: u64 = 8 << 20;

/// What a tensor does, which is what random weights go by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Multiplies inputs, of which each output sums the last dimension.
    Projection,
    /// Rows that are taken.
    Table,
    /// Factors near one.
    Scale,
    /// Terms near zero.
    Shift,
}

/// Where weights come from.
pub(crate) enum Weights {
    File(SafetensorsReader),
    Random(Box<ChaCha8Rng>),
}

/// An open file of weights with its header.
pub(crate) struct SafetensorsReader {
    path: PathBuf,
    file: RegularFile,
    tensors: HashMap<String, TensorInfo>,
    /// Where the tensors' bytes begin.
    data: u64,
}

impl Weights {
    pub(crate) fn open(path: &Path) -> Result<Self, EncoderError> {
        SafetensorsReader::open(path).map(Self::File)
    }

    /// Weights of the size that training leaves, the same for a seed.
    pub(crate) fn random(seed: u64) -> Self {
        Self::Random(Box::new(ChaCha8Rng::seed_from_u64(seed)))
    }

    /// A tensor's values in f32, row by row.
    pub(crate) fn values(&mut self, name: &str, shape: &[usize], kind: Kind) -> Result<Vec<f32>, EncoderError> {
        match self {
            Self::File(file) => file.values(name, shape),
            Self::Random(generator) => Ok(random_values(generator, shape, kind)),
        }
    }

    /// Whether the weights have a tensor of this name.
    pub(crate) fn has(&self, name: &str) -> bool {
        match self {
            Self::File(file) => file.tensors.contains_key(name),
            Self::Random(_) => true,
        }
    }
}

fn random_values(generator: &mut ChaCha8Rng, shape: &[usize], kind: Kind) -> Vec<f32> {
    let (center, deviation) = match kind {
        Kind::Projection => (0.0, 1.0 / (shape.last().copied().unwrap_or(1) as f32).sqrt()),
        Kind::Table => (0.0, 0.3),
        Kind::Scale => (1.0, 0.1),
        Kind::Shift => (0.0, 0.1),
    };
    // Uniform with this deviation.
    let half_width = deviation * 3f32.sqrt();
    (0..shape.iter().product()).map(|_| center + generator.random_range(-half_width..half_width)).collect()
}

impl SafetensorsReader {
    fn open(path: &Path) -> Result<Self, EncoderError> {
        let wrong = |problem: String| EncoderError::file(path, problem);
        let file = file::open(path).map_err(|error| wrong(error.to_string()))?;
        let mut start = [0; 8];
        file.file.read_exact_at(&mut start, 0).map_err(|_| wrong(damaged("it has less than 8 bytes")))?;
        let header = u64::from_le_bytes(start);
        if header > MAX_HEADER_BYTES {
            return Err(wrong(damaged(&format!("its header would have {header} bytes, more than {MAX_HEADER_BYTES}"))));
        }
        let data = 8 + header;
        let mut text = vec![0; usize::try_from(header).unwrap_or_default()];
        let read = file.file.read_exact_at(&mut text, 8);
        read.map_err(|_| wrong(damaged(&format!("it ends within its header of {header} bytes"))))?;
        let metadata: Metadata =
            serde_json::from_slice(&text).map_err(|error| wrong(damaged(&format!("in its header, {error}"))))?;
        let expected = data.saturating_add(metadata.data_len() as u64);
        if file.length != expected {
            let found = file.length;
            return Err(wrong(damaged(&format!("it has {found} bytes, but its header speaks of {expected}"))));
        }
        let tensors = metadata.tensors().into_iter().map(|(name, info)| (name, info.clone())).collect();
        Ok(Self { path: path.to_owned(), file, tensors, data })
    }

    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, EncoderError> {
        let Some(info) = self.tensors.get(name) else {
            return Err(EncoderError::NoTensor {
                path: self.path.clone(),
                tensor: name.to_owned(),
                expected: shape.to_vec(),
            });
        };
        if info.shape != shape {
            return Err(EncoderError::Shape {
                path: self.path.clone(),
                tensor: name.to_owned(),
                expected: shape.to_vec(),
                found: info.shape.clone(),
            });
        }
        let wrong = |problem: String| EncoderError::file(&self.path, format!("tensor `{name}`: {problem}"));
        if !matches!(info.dtype, Dtype::F32 | Dtype::F16 | Dtype::BF16) {
            return Err(wrong(format!("its values are {:?}; convert the weights to F32, F16 or BF16", info.dtype)));
        }
        let (from, to) = info.data_offsets;
        // The header's offsets fit its shapes and the file's length.
        let mut bytes = vec![0; to - from];
        let read = self.file.file.read_exact_at(&mut bytes, self.data + from as u64);
        read.map_err(|error| wrong(error.to_string()))?;
        Ok(to_f32(&bytes, info.dtype))
    }
}

fn damaged(what: &str) -> String {
    format!("not a whole safetensors file: {what}; get it again")
}

/// Little-endian values of a type that [`SafetensorsReader::values`] lets through.
fn to_f32(bytes: &[u8], dtype: Dtype) -> Vec<f32> {
    let pairs = || bytes.as_chunks::<2>().0.iter().map(|pair| u16::from_le_bytes(*pair));
    match dtype {
        Dtype::F16 => {
            let halves: Vec<f16> = pairs().map(f16::from_bits).collect();
            let mut values = vec![0.0; halves.len()];
            halves.convert_to_f32_slice(&mut values);
            values
        }
        Dtype::BF16 => pairs().map(|bits| bf16::from_bits(bits).to_f32()).collect(),
        _ => bytes.as_chunks::<4>().0.iter().map(|four| f32::from_le_bytes(*four)).collect(),
    }
}
