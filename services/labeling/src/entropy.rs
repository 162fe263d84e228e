//! Entropy of the opacity of a picture: how much of a region a view shows, and how evenly.

/// Excess over 1 that rounding may give an opacity.
const ROUNDING: f32 = 1e-4;

/// The opacity of each pixel of a picture, 0 to 1, row by row.
#[derive(Debug, Clone, Copy)]
pub struct AlphaPicture<'a> {
    alpha: &'a [f32],
}

/// Pixels that are no picture of opacity.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum AlphaError {
    /// The number of pixels is not width times height, or is 0.
    #[error("{found} opacities came for a picture of {width} x {height} pixels; give one for each pixel, at least one")]
    Size {
        /// Number of opacities.
        found: usize,
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
    /// An opacity is NaN, negative or above 1.
    #[error("the opacity of pixel {index} is {found}; it must be 0 to 1")]
    Opacity {
        /// Index of the pixel, row by row.
        index: usize,
        /// Its opacity.
        found: f32,
    },
}

/// The two definitions of a view's entropy.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum EntropyForm {
    /// −Σ p log₂ p / log₂(width·height) with p = α/Σα, as in NLI4VolVis (2025). From 0 for one pixel to 1 for a uniform picture.
    #[default]
    Normalized,
    /// −Σ α log₂ α over the raw opacities, as the paper writes it. In bits; fully opaque pixels add nothing.
    Literal,
}

impl<'a> AlphaPicture<'a> {
    /// A picture of width × height opacities. Those above 1 by rounding count as 1.
    ///
    /// # Errors
    /// [`AlphaError`] if the number of pixels is wrong, or if one is NaN, negative or above 1.
    pub fn new(alpha: &'a [f32], width: u32, height: u32) -> Result<Self, AlphaError> {
        let pixels = u64::from(width) * u64::from(height);
        if alpha.is_empty() || alpha.len() as u64 != pixels {
            return Err(AlphaError::Size { found: alpha.len(), width, height });
        }
        match alpha.iter().position(|a| !(0.0..=1.0 + ROUNDING).contains(a)) {
            Some(index) => Err(AlphaError::Opacity { index, found: alpha[index] }),
            None => Ok(Self { alpha }),
        }
    }

    fn opacities(&self) -> impl Iterator<Item = f64> {
        self.alpha.iter().map(|a| f64::from(a.min(1.0)))
    }

    /// The entropy of the picture, with 0·log 0 = 0. A picture without opacity has entropy 0, in both forms. So has one pixel alone
    /// in the normalized form, where its definition is 0/0.
    #[must_use]
    pub fn entropy(&self, form: EntropyForm) -> f64 {
        match form {
            EntropyForm::Normalized => self.normalized(),
            EntropyForm::Literal => self.opacities().map(surprise).sum(),
        }
    }

    fn normalized(&self) -> f64 {
        let total: f64 = self.opacities().sum();
        if self.alpha.len() < 2 || total <= 0.0 {
            return 0.0;
        }
        // The sum of a uniform picture is rounded; its entropy is 1 by definition.
        let first = self.alpha[0].min(1.0);
        if self.alpha.iter().all(|a| a.min(1.0) == first) {
            return 1.0;
        }
        let bits: f64 = self.opacities().map(|a| surprise(a / total)).sum();
        (bits / (self.alpha.len() as f64).log2()).clamp(0.0, 1.0)
    }

    /// Share of the picture that the region covers: the mean opacity, 0 to 1. A simple measure to compare entropy with.
    #[must_use]
    pub fn visible_area(&self) -> f64 {
        self.opacities().sum::<f64>() / self.alpha.len() as f64
    }
}

/// −p log₂ p in bits, 0 at 0.
fn surprise(p: f64) -> f64 {
    if p > 0.0 { -p * p.log2() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn entropy(alpha: &[f32], form: EntropyForm) -> f64 {
        AlphaPicture::new(alpha, alpha.len() as u32, 1).unwrap().entropy(form)
    }

    #[test]
    fn hard_pictures() {
        use EntropyForm::{Literal, Normalized};
        for n in [2, 3, 7, 10, 1000, 224 * 224] {
            for level in [1e-30_f32, 0.1, 0.3, 1.0] {
                assert_eq!(entropy(&vec![level; n], Normalized), 1.0, "{n} {level}");
            }
            assert_eq!(entropy(&vec![0.0; n], Normalized), 0.0);
            assert_eq!(entropy(&vec![0.0; n], Literal), 0.0);
            assert_eq!(entropy(&vec![1.0; n], Literal), 0.0, "opaque pixels say nothing in the literal form");
            let mut one = vec![0.0; n];
            one[n / 2] = 0.7;
            assert_eq!(entropy(&one, Normalized), 0.0, "one pixel");
        }
        assert_eq!(entropy(&[0.4], Normalized), 0.0, "a picture of one pixel");
        assert!((entropy(&[0.5; 10], Literal) - 5.0).abs() < 1e-12);
        // Half of four pixels: log 2 / log 4.
        assert!((entropy(&[0.3, 0.3, 0.0, 0.0], Normalized) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn what_is_no_opacity_is_refused() {
        let refused = |alpha: &[f32]| AlphaPicture::new(alpha, 2, 1).err();
        assert!(matches!(refused(&[0.0, f32::NAN]), Some(AlphaError::Opacity { index: 1, .. })));
        assert!(matches!(refused(&[-0.1, 0.0]), Some(AlphaError::Opacity { index: 0, .. })));
        assert!(matches!(refused(&[0.0, 1.1]), Some(AlphaError::Opacity { .. })));
        assert!(matches!(refused(&[0.0, f32::INFINITY]), Some(AlphaError::Opacity { .. })));
        assert!(matches!(refused(&[0.0]), Some(AlphaError::Size { found: 1, .. })));
        assert!(AlphaPicture::new(&[], 0, 5).is_err());
        assert!(refused(&[1.000_01, 0.0]).is_none(), "rounding");
    }

    proptest! {
        #[test]
        fn bounds_and_invariances(
            alpha in prop::collection::vec(prop_oneof![Just(0.0_f32), 0.0_f32..=1.0], 2..200),
            factor in 0.01_f32..1.0,
            turn in 0_usize..200,
        ) {
            use EntropyForm::{Literal, Normalized};
            let h = entropy(&alpha, Normalized);
            prop_assert!((0.0..=1.0).contains(&h));
            let covered = alpha.iter().filter(|a| **a > 0.0).count().max(1) as f64;
            prop_assert!(h <= covered.log2() / (alpha.len() as f64).log2() + 1e-12, "no more than its area allows");
            let mut moved = alpha.clone();
            moved.rotate_left(turn % alpha.len());
            prop_assert!((entropy(&moved, Normalized) - h).abs() < 1e-12, "pixels may change places");
            prop_assert!((entropy(&moved, Literal) - entropy(&alpha, Literal)).abs() < 1e-9);
            let fainter: Vec<f32> = alpha.iter().map(|a| a * factor).collect();
            prop_assert!((entropy(&fainter, Normalized) - h).abs() < 1e-5, "the brightness does not matter");
            // Literal: at most log₂(e)/e bits a pixel.
            let most = alpha.len() as f64 * std::f64::consts::LOG2_E / std::f64::consts::E;
            prop_assert!((0.0..=most + 1e-9).contains(&entropy(&alpha, Literal)));
        }
    }
}
