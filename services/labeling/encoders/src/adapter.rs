//! A linear adapter of picture embeddings, fitted on the pairs of pictures and names that a session has.
//!
//! Pictures of scientific scenes are unlike those that a model was trained on, and their embeddings lie in one corner of its
//! space. A linear map W takes them towards the embeddings of their names. It is a ridge regression with the identity as prior mean:
//! W = argmin Σ|W xᵢ − yᵢ|² + λ|W − 1|² (Hoerl and Kennard 1970). This is the residual form of CLIP-Adapter (Gao et al. 2021) in
//! closed form. With pairs of a few units the dual form is small: W x = x + (Y − X)ᵀ (X Xᵀ + λ1)⁻¹ X x.

use crate::embedding::{Embedding, EmbeddingError};

/// Usual λ, for unit vectors.
pub const RIDGE: f64 = 0.1;

/// The picture embeddings, each by the map that is fitted on all *other* pairs. So a unit's own name does not decide where its
/// pictures lie. A single pair stays as it is.
///
/// The prediction without pair i needs no fit of its own: it is yᵢ − αᵢ/Cᵢᵢ, where C = (X Xᵀ + λ1)⁻¹ and α = C (Y − X)
/// (Allen 1974).
///
/// # Errors
/// [`EmbeddingError::Dimensions`] for embeddings of different models or lists of different lengths, and
/// [`EmbeddingError::NoDirection`] where an adapted embedding vanishes.
pub fn adapted(pictures: &[&Embedding], names: &[&Embedding], ridge: f64) -> Result<Vec<Embedding>, EmbeddingError> {
    let count = pictures.len();
    if names.len() != count {
        return Err(EmbeddingError::Dimensions(count, names.len()));
    }
    let Some(first) = pictures.first() else { return Ok(Vec::new()) };
    for other in pictures.iter().chain(names) {
        first.check_dimension(other)?;
    }
    // Products of unit vectors are exact enough in f64; similar pictures make the matrix nearly singular without the ridge.
    let unit = |embedding: &Embedding| embedding.unit().iter().map(|x| f64::from(*x)).collect::<Vec<f64>>();
    let (x, y): (Vec<Vec<f64>>, Vec<Vec<f64>>) =
        (pictures.iter().map(|e| unit(e)).collect(), names.iter().map(|e| unit(e)).collect());
    let mut kernel: Vec<Vec<f64>> = x.iter().map(|a| x.iter().map(|b| dot(a, b)).collect()).collect();
    for (at, row) in kernel.iter_mut().enumerate() {
        row[at] += ridge.max(f64::MIN_POSITIVE);
    }
    let inverse = inverse(kernel).ok_or(EmbeddingError::NoDirection)?;
    let shift = |at: usize| y[at].iter().zip(&x[at]).map(|(y, x)| y - x);
    let shifts: Vec<Vec<f64>> = (0..count).map(|at| shift(at).collect()).collect();
    let adapt = |at: usize| {
        let row = &inverse[at];
        let mut own = y[at].clone();
        for (weight, shift) in row.iter().zip(&shifts) {
            for (own, shift) in own.iter_mut().zip(shift) {
                *own -= weight * shift / row[at];
            }
        }
        let length = f64::from(pictures[at].norm());
        Embedding::new(&own.iter().map(|value| (value * length) as f32).collect::<Vec<_>>())
    };
    (0..count).map(adapt).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The inverse of a symmetric positive definite matrix, by Gauss and Jordan: its pivots need no exchange. `None` if it is not
/// positive definite.
fn inverse(mut matrix: Vec<Vec<f64>>) -> Option<Vec<Vec<f64>>> {
    let count = matrix.len();
    for pivot in 0..count {
        let value = matrix[pivot][pivot];
        if !value.is_normal() || value < 0.0 {
            return None;
        }
        matrix[pivot][pivot] = 1.0;
        matrix[pivot].iter_mut().for_each(|entry| *entry /= value);
        let row = matrix[pivot].clone();
        let others = matrix.iter_mut().enumerate().filter(|(at, _)| *at != pivot);
        for other in others.map(|(_, other)| other) {
            let factor = std::mem::take(&mut other[pivot]);
            for (entry, own) in other.iter_mut().zip(&row) {
                *entry -= factor * own;
            }
        }
    }
    Some(matrix)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// The map that is fitted on pairs, applied to another picture: the printed formula, without the identity of Allen.
    fn refitted(pairs: &[(&Embedding, &Embedding)], picture: &Embedding, ridge: f64) -> Vec<f64> {
        let unit = |e: &Embedding| e.unit().iter().map(|x| f64::from(*x)).collect::<Vec<f64>>();
        let (x, y): (Vec<_>, Vec<_>) = pairs.iter().map(|(p, n)| (unit(p), unit(n))).unzip();
        let mut kernel: Vec<Vec<f64>> = x.iter().map(|a| x.iter().map(|b| dot(a, b)).collect()).collect();
        kernel.iter_mut().enumerate().for_each(|(at, row)| row[at] += ridge);
        let inverse = inverse(kernel).unwrap();
        let own = unit(picture);
        let near: Vec<f64> = x.iter().map(|other| dot(other, &own)).collect();
        let mut adapted = own;
        for (i, row) in inverse.iter().enumerate() {
            let weight = dot(row, &near);
            for (value, (y, x)) in adapted.iter_mut().zip(y[i].iter().zip(&x[i])) {
                *value += weight * (y - x);
            }
        }
        adapted
    }

    fn embeddings(seed: u64, count: usize) -> Vec<Embedding> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut raw = || (0..12).map(|_| random.random_range(-1.0_f32..1.0)).collect::<Vec<_>>();
        (0..count).map(|_| Embedding::new(&raw()).unwrap()).collect()
    }

    #[test]
    fn a_pair_alone_and_no_pair_change_nothing() {
        assert_eq!(adapted(&[], &[], RIDGE), Ok(vec![]));
        let pair = embeddings(1, 2);
        let alone = adapted(&[&pair[0]], &[&pair[1]], RIDGE).unwrap();
        assert!(alone[0].cosine(&pair[0]).unwrap() > 1.0 - 1e-6);
        assert_eq!(adapted(&[&pair[0]], &[], RIDGE), Err(EmbeddingError::Dimensions(1, 0)));
        let short = Embedding::new(&[1.0]).unwrap();
        assert_eq!(adapted(&[&pair[0]], &[&short], RIDGE), Err(EmbeddingError::Dimensions(12, 1)));
    }

    #[test]
    fn a_common_shift_is_learned() {
        // All pictures lie in one corner, and names differ from them by the same rotation in a plane.
        let name = |angle: f32| Embedding::new(&[angle.cos(), angle.sin(), 0.0]).unwrap();
        let picture = |angle: f32| Embedding::new(&[(angle + 0.9).cos(), (angle + 0.9).sin(), 0.0]).unwrap();
        let angles: Vec<f32> = (0..12).map(|i| 0.5 * i as f32).collect();
        let (pictures, names): (Vec<_>, Vec<_>) = angles.iter().map(|a| (picture(*a), name(*a))).unzip();
        let found = adapted(&pictures.iter().collect::<Vec<_>>(), &names.iter().collect::<Vec<_>>(), RIDGE).unwrap();
        for ((found, name), picture) in found.iter().zip(&names).zip(&pictures) {
            assert!(found.cosine(name).unwrap() > 0.99 && picture.cosine(name).unwrap() < 0.63);
        }
    }

    proptest! {
        #[test]
        fn each_is_adapted_by_a_fit_on_the_others(seed in 0_u64..1000, count in 2_usize..9, ridge in 0.01_f64..2.0) {
            let all = embeddings(seed, 2 * count);
            let (pictures, names): (Vec<&Embedding>, Vec<&Embedding>) =
                (all[..count].iter().collect(), all[count..].iter().collect());
            let found = adapted(&pictures, &names, ridge).unwrap();
            for at in 0..count {
                let others: Vec<(&Embedding, &Embedding)> = (0..count).filter(|i| *i != at).map(|i| (pictures[i], names[i])).collect();
                let expected = refitted(&others, pictures[at], ridge);
                let length = f64::from(pictures[at].norm());
                for (found, expected) in found[at].raw().iter().zip(expected) {
                    prop_assert!((f64::from(*found) - expected * length).abs() < 1e-5 * length.max(1.0));
                }
            }
        }
    }
}
