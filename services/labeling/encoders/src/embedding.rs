//! Embeddings: directions in the space that a model's images and texts share.

/// Why a vector is no embedding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EmbeddingError {
    /// Nothing has no direction.
    #[error("the vector has no components")]
    Empty,
    /// A component is infinite or not a number.
    #[error("component {0} of the vector is not finite")]
    NotFinite(usize),
    /// The zero vector has no direction.
    #[error("the vector is zero, or too short or too long for its length to be told")]
    NoDirection,
    /// Two embeddings are of different models.
    #[error("the embeddings have {0} and {1} components; compare embeddings of one model")]
    Dimensions(usize, usize),
}

/// A unit vector with the length that the model gave it. Both are finite, and the length is positive.
#[derive(Clone, Debug, PartialEq)]
pub struct Embedding {
    unit: Vec<f32>,
    norm: f32,
}

impl Embedding {
    /// The embedding of a model's raw output, of any positive length.
    ///
    /// # Errors
    /// [`EmbeddingError`] for a vector without a direction.
    pub fn new(raw: &[f32]) -> Result<Self, EmbeddingError> {
        if raw.is_empty() {
            return Err(EmbeddingError::Empty);
        }
        if let Some(at) = raw.iter().position(|value| !value.is_finite()) {
            return Err(EmbeddingError::NotFinite(at));
        }
        // In f64 no square of an f32 overflows or vanishes.
        let norm = raw.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>().sqrt();
        let length = norm as f32;
        if !length.is_normal() {
            return Err(EmbeddingError::NoDirection);
        }
        Ok(Self { unit: raw.iter().map(|value| (f64::from(*value) / norm) as f32).collect(), norm: length })
    }

    /// The components of the unit vector.
    #[must_use]
    pub fn unit(&self) -> &[f32] {
        &self.unit
    }

    /// Euclidean length of the model's output, or of the fused vector.
    #[must_use]
    pub fn norm(&self) -> f32 {
        self.norm
    }

    /// The vector with its length: the model's output up to rounding.
    #[must_use]
    pub fn raw(&self) -> Vec<f32> {
        self.unit.iter().map(|value| value * self.norm).collect()
    }

    /// Number of components.
    #[must_use]
    pub fn dimension(&self) -> usize {
        self.unit.len()
    }

    /// Cosine of the angle between two embeddings of one model, −1 to 1.
    ///
    /// # Errors
    /// [`EmbeddingError::Dimensions`] for embeddings of different models.
    pub fn cosine(&self, other: &Self) -> Result<f32, EmbeddingError> {
        self.check_dimension(other)?;
        let sum: f64 = self.unit.iter().zip(&other.unit).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
        Ok(sum.clamp(-1.0, 1.0) as f32)
    }

    pub(crate) fn check_dimension(&self, other: &Self) -> Result<(), EmbeddingError> {
        let (own, its) = (self.dimension(), other.dimension());
        if own == its { Ok(()) } else { Err(EmbeddingError::Dimensions(own, its)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_vector_without_a_direction_is_refused() {
        assert_eq!(Embedding::new(&[]), Err(EmbeddingError::Empty));
        assert_eq!(Embedding::new(&[0.0, -0.0]), Err(EmbeddingError::NoDirection));
        assert_eq!(Embedding::new(&[1.0, f32::NAN]), Err(EmbeddingError::NotFinite(1)));
        assert_eq!(Embedding::new(&[f32::NEG_INFINITY]), Err(EmbeddingError::NotFinite(0)));
        assert_eq!(Embedding::new(&[f32::MAX, f32::MAX]), Err(EmbeddingError::NoDirection));
        assert_eq!(Embedding::new(&[1e-42]), Err(EmbeddingError::NoDirection));
    }

    #[test]
    fn squares_that_overflow_leave_the_direction() {
        let large = Embedding::new(&[3e30, 4e30]).unwrap();
        assert!((large.unit()[0] - 0.6).abs() < 1e-7 && (large.norm() / 5e30 - 1.0).abs() < 1e-6);
        let small = Embedding::new(&[3e-30, -4e-30]).unwrap();
        assert!((small.unit()[0] - 0.6).abs() < 1e-7 && (small.unit()[1] + 0.8).abs() < 1e-7);
    }

    #[test]
    fn embeddings_of_two_models_are_not_compared() {
        let (a, b) = (Embedding::new(&[1.0]).unwrap(), Embedding::new(&[1.0, 0.0]).unwrap());
        assert_eq!(a.cosine(&b), Err(EmbeddingError::Dimensions(1, 2)));
    }

    proptest! {
        #[test]
        fn an_embedding_is_a_unit_vector_in_the_direction_of_its_vector(
            raw in proptest::collection::vec(-1e3f32..1e3, 1..40), scale in 1e-3f32..1e3,
        ) {
            prop_assume!(raw.iter().any(|value| value.abs() > 1e-3));
            let embedding = Embedding::new(&raw).unwrap();
            let length: f64 = embedding.unit().iter().map(|v| f64::from(*v).powi(2)).sum();
            prop_assert!((length - 1.0).abs() < 1e-6);
            for (back, value) in embedding.raw().iter().zip(&raw) {
                prop_assert!((back - value).abs() <= 1e-6 * embedding.norm());
            }
            let scaled: Vec<f32> = raw.iter().map(|value| value * scale).collect();
            let cosine = embedding.cosine(&Embedding::new(&scaled).unwrap()).unwrap();
            prop_assert!(cosine > 1.0 - 1e-6);
        }
    }
}
