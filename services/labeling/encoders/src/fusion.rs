//! One embedding of a region from an image and a text of it.

use crate::embedding::{Embedding, EmbeddingError};

/// How an image embedding `e_I` and a text embedding `e_T` become one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fusion {
    /// The bisector: (`ê_I` + `ê_T`)/2 of the unit vectors, renormalised. Both parts count alike.
    #[default]
    Normalised,
    /// (`e_I` + `e_T`)/2 of the model's outputs, as printed in the paper and in NLI4VolVis. The longer output counts more.
    Unnormalised,
}

/// Fuses two embeddings of one model. The norm of the result is the length of the mean before it is renormalised.
///
/// # Errors
/// [`EmbeddingError::Dimensions`] for embeddings of different models, [`EmbeddingError::NoDirection`] for opposite ones.
pub fn fuse(image: &Embedding, text: &Embedding, fusion: Fusion) -> Result<Embedding, EmbeddingError> {
    image.check_dimension(text)?;
    let (of_image, of_text) = match fusion {
        Fusion::Normalised => (1.0, 1.0),
        Fusion::Unnormalised => (f64::from(image.norm()), f64::from(text.norm())),
    };
    let pairs = image.unit().iter().zip(text.unit());
    let mean: Vec<f32> =
        pairs.map(|(i, t)| (0.5 * (of_image * f64::from(*i) + of_text * f64::from(*t))) as f32).collect();
    Embedding::new(&mean)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn fusion_is_the_printed_formula() {
        let image = Embedding::new(&[8.0, 0.0]).unwrap();
        let text = Embedding::new(&[0.0, 2.0]).unwrap();
        let normalised = fuse(&image, &text, Fusion::Normalised).unwrap();
        let half = std::f32::consts::FRAC_1_SQRT_2;
        assert!((normalised.unit()[0] - half).abs() < 1e-7 && (normalised.unit()[1] - half).abs() < 1e-7);
        assert!((normalised.norm() - half).abs() < 1e-7);
        let unnormalised = fuse(&image, &text, Fusion::Unnormalised).unwrap().raw();
        assert!((unnormalised[0] - 4.0).abs() < 1e-6 && (unnormalised[1] - 1.0).abs() < 1e-6, "{unnormalised:?}");
    }

    #[test]
    fn opposite_embeddings_have_no_mean() {
        let [a, b] = [[1.0, 0.0], [-1.0, 0.0]].map(|raw| Embedding::new(&raw).unwrap());
        assert_eq!(fuse(&a, &b, Fusion::Normalised), Err(EmbeddingError::NoDirection));
        let three = Embedding::new(&[1.0, 0.0, 0.0]).unwrap();
        assert_eq!(fuse(&a, &three, Fusion::Normalised), Err(EmbeddingError::Dimensions(2, 3)));
    }

    proptest! {
        #[test]
        fn the_bisector_is_as_near_to_both(
            a in proptest::collection::vec(-1f32..1.0, 8), b in proptest::collection::vec(-1f32..1.0, 8), scale in 0.1f32..10.0,
        ) {
            let (Ok(image), Ok(text)) = (Embedding::new(&a), Embedding::new(&b)) else { return Ok(()) };
            prop_assume!(image.cosine(&text).unwrap() > -0.99);
            let fused = fuse(&image, &text, Fusion::Normalised).unwrap();
            let (to_image, to_text) = (fused.cosine(&image).unwrap(), fused.cosine(&text).unwrap());
            prop_assert!((to_image - to_text).abs() < 1e-4);
            // The length of a model's output changes nothing.
            let longer = Embedding::new(&a.iter().map(|v| v * scale).collect::<Vec<_>>()).unwrap();
            prop_assert!(fuse(&longer, &text, Fusion::Normalised).unwrap().cosine(&fused).unwrap() > 1.0 - 1e-5);
        }
    }
}
