//! Weights by name and shape: of files, or random ones for timing.

use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::error::ModelError;
use crate::safetensors::SafetensorsReader;
use crate::tensor::{Kind, TensorReader};

/// Where weights come from.
pub struct Weights(Source);

enum Source {
    Reader(Box<dyn TensorReader>),
    Random(Box<ChaCha8Rng>),
}

impl Weights {
    /// Weights of a safetensors file.
    ///
    /// # Errors
    /// [`ModelError`] where the file is not there or not whole.
    pub fn open(path: &Path) -> Result<Self, ModelError> {
        SafetensorsReader::open(path).map(|reader| Self::of(Box::new(reader)))
    }

    /// Weights of a file in another format.
    #[must_use]
    pub fn of(reader: Box<dyn TensorReader>) -> Self {
        Self(Source::Reader(reader))
    }

    /// Weights of the size that training leaves, the same for a seed.
    #[must_use]
    pub fn random(seed: u64) -> Self {
        Self(Source::Random(Box::new(ChaCha8Rng::seed_from_u64(seed))))
    }

    /// A tensor's values in f32, row by row.
    ///
    /// # Errors
    /// As [`TensorReader::values`].
    pub fn values(&mut self, name: &str, shape: &[usize], kind: Kind) -> Result<Vec<f32>, ModelError> {
        match &mut self.0 {
            Source::Reader(reader) => reader.values(name, shape),
            Source::Random(generator) => Ok(random_values(generator, shape, kind)),
        }
    }

    /// Whether the weights have a tensor of this name. Random ones have any.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        match &self.0 {
            Source::Reader(reader) => reader.has(name),
            Source::Random(_) => true,
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
