//! Activation functions, and the pass that adds a layer's bias and applies one.

use std::f32::consts::{FRAC_1_SQRT_2, PI};

use candle_core::{CpuStorage, InplaceOp1, Layout, Result};
use rayon::prelude::*;

/// An activation function by its name in Hugging Face's configurations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
pub enum Activation {
    /// x·σ(1.702 x), of OpenAI's models.
    #[serde(rename = "quick_gelu")]
    QuickGelu,
    /// x·Φ(x), by the error function.
    #[serde(rename = "gelu")]
    Gelu,
    /// x·Φ(x) with Φ approximated by a hyperbolic tangent.
    #[serde(rename = "gelu_pytorch_tanh", alias = "gelu_new")]
    GeluTanh,
}

impl Activation {
    /// The function at x.
    #[must_use]
    pub fn apply(self, x: f32) -> f32 {
        match self {
            Self::QuickGelu => x / (1.0 + (-1.702 * x).exp()),
            Self::Gelu => 0.5 * x * (1.0 + erf(x * FRAC_1_SQRT_2)),
            Self::GeluTanh => 0.5 * x * (1.0 + ((2.0 / PI).sqrt() * (x + 0.044_715 * x * x * x)).tanh()),
        }
    }
}

/// The error function as a quotient of polynomials, within 1e-6. Compilers make vectors of it, as of no call of a library.
fn erf(x: f32) -> f32 {
    const ODD: [f32; 7] = [
        -2.726_142_3e-10,
        2.770_681_5e-8,
        -2.101_024e-6,
        -5.692_506_5e-5,
        -7.349_906_3e-4,
        -2.954_6e-3,
        -1.609_603_3e-2,
    ];
    const EVEN: [f32; 5] = [-1.456_607_2e-5, -2.133_740_6e-4, -1.682_827e-3, -7.373_329_3e-3, -1.426_473_9e-2];
    // Beyond, it is ±1.
    let x = x.clamp(-4.0, 4.0);
    let square = x * x;
    let polynomial = |coefficients: &[f32]| coefficients.iter().fold(0.0, |sum, c| sum * square + c);
    x * polynomial(&ODD) / polynomial(&EVEN)
}

/// Adds a bias to each row and applies an activation, in one pass over the output of a multiplication.
pub(crate) struct Epilogue<'a> {
    pub(crate) bias: Option<&'a [f32]>,
    pub(crate) activation: Option<Activation>,
    /// Length of a row.
    pub(crate) width: usize,
}

/// Rows that one task takes.
const ROWS: usize = 8;

impl InplaceOp1 for Epilogue<'_> {
    fn name(&self) -> &'static str {
        "bias and activation"
    }

    fn cpu_fwd(&self, storage: &mut CpuStorage, layout: &Layout) -> Result<()> {
        let (CpuStorage::F32(values), Some((start, end))) = (storage, layout.contiguous_offsets()) else {
            candle_core::bail!("{} takes contiguous f32", self.name());
        };
        values[start..end].par_chunks_mut(ROWS * self.width).for_each(|rows| {
            for row in rows.chunks_exact_mut(self.width) {
                if let Some(bias) = self.bias {
                    row.iter_mut().zip(bias).for_each(|(value, bias)| *value += bias);
                }
                // The choice stands outside the loop, so that the loop becomes vectors.
                match self.activation {
                    Some(Activation::Gelu) => row.iter_mut().for_each(|value| *value = Activation::Gelu.apply(*value)),
                    Some(other) => row.iter_mut().for_each(|value| *value = other.apply(*value)),
                    None => {}
                }
            }
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn activations_agree_with_f64(x in -12f32..12.0) {
            let wide = f64::from(x);
            let quick = wide / (1.0 + (-1.702 * wide).exp());
            let gelu = 0.5 * wide * libm::erfc(-wide * std::f64::consts::FRAC_1_SQRT_2);
            let inner = (2.0 / std::f64::consts::PI).sqrt() * (wide + 0.044_715 * wide.powi(3));
            for (activation, exact) in [
                (Activation::QuickGelu, quick),
                (Activation::Gelu, gelu),
                (Activation::GeluTanh, 0.5 * wide * (1.0 + inner.tanh())),
            ] {
                let error = (f64::from(activation.apply(x)) - exact).abs();
                prop_assert!(error < 2e-6, "{activation:?}({x}) is off by {error}");
            }
            // The approximation is one of the exact function.
            prop_assert!((Activation::GeluTanh.apply(x) - Activation::Gelu.apply(x)).abs() < 1e-3);
        }
    }
}
