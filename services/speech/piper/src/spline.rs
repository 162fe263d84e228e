//! Monotonic rational-quadratic splines (Durkan et al. 2019, section 3.1), the identity outside of an interval.

/// The spline maps [−BOUND, BOUND] to itself.
pub(crate) const BOUND: f32 = 5.0;
/// Least share of a bin in the interval, and least derivative at its ends.
const LEAST: f32 = 1e-3;

/// Parameters of a spline, as a network gives them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unnormalized<'a> {
    pub(crate) widths: &'a [f32],
    pub(crate) heights: &'a [f32],
    /// Between the bins: one fewer than bins.
    pub(crate) derivatives: &'a [f32],
}

/// The spline. Knots are one more than bins.
#[derive(Clone, Debug)]
pub(crate) struct Spline {
    x: Vec<f32>,
    y: Vec<f32>,
    derivatives: Vec<f32>,
}

/// Numbers of one bin.
struct Bin {
    x: f32,
    width: f32,
    y: f32,
    height: f32,
    /// Mean slope, and the derivatives at both ends.
    slope: f32,
    left: f32,
    right: f32,
}

impl Spline {
    /// Softmax gives the shares of bins, and softplus the derivatives. The outermost derivatives are 1, those of the identity.
    pub(crate) fn new(parameters: Unnormalized) -> Self {
        let derivative = |value: f32| LEAST + softplus(value);
        let inner = parameters.derivatives.iter().map(|value| derivative(*value));
        let derivatives = std::iter::once(1.0).chain(inner).chain(std::iter::once(1.0)).collect();
        Self { x: knots(parameters.widths), y: knots(parameters.heights), derivatives }
    }

    /// The bin between whose knots `value` is.
    fn bin(&self, value: f32, knots: &[f32]) -> Bin {
        let at = knots.partition_point(|knot| *knot <= value).clamp(1, knots.len() - 1) - 1;
        let (x, y) = (self.x[at], self.y[at]);
        let (width, height) = (self.x[at + 1] - x, self.y[at + 1] - y);
        let [left, right] = [self.derivatives[at], self.derivatives[at + 1]];
        Bin { x, width, y, height, slope: height / width, left, right }
    }

    /// The spline's value (equation 4).
    #[cfg(test)]
    pub(crate) fn forward(&self, x: f32) -> f32 {
        if !(-BOUND..=BOUND).contains(&x) {
            return x;
        }
        let Bin { x: from, width, y, height, slope, left, right } = self.bin(x, &self.x);
        let part = (x - from) / width;
        let both = part * (1.0 - part);
        y + height * (slope * part * part + left * both) / (slope + (right + left - 2.0 * slope) * both)
    }

    /// Where the spline has the value `y` (appendix A.1): the root of a quadratic, written so that nothing cancels.
    pub(crate) fn inverse(&self, y: f32) -> f32 {
        if !(-BOUND..=BOUND).contains(&y) {
            return y;
        }
        let bin = self.bin(y, &self.y);
        let above = y - bin.y;
        let bend = above * (bin.right + bin.left - 2.0 * bin.slope);
        let a = bin.height * (bin.slope - bin.left) + bend;
        let b = bin.height * bin.left - bend;
        let c = -bin.slope * above;
        let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
        let part = 2.0 * c / (-b - root);
        // With all weights 0 in a bin's lower end, both are 0.
        if part.is_finite() { part * bin.width + bin.x } else { bin.x }
    }
}

/// Knots from −BOUND to BOUND by the shares of bins.
fn knots(unnormalized: &[f32]) -> Vec<f32> {
    let most = unnormalized.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let shares: Vec<f32> = unnormalized.iter().map(|value| (value - most).exp()).collect();
    let sum: f32 = shares.iter().sum();
    let free = 1.0 - LEAST * shares.len() as f32;
    let mut end = 0.0;
    let inner = shares.iter().take(shares.len() - 1).map(|share| {
        end += LEAST + free * share / sum;
        2.0 * BOUND * end - BOUND
    });
    std::iter::once(-BOUND).chain(inner).chain(std::iter::once(BOUND)).collect()
}

/// log(1 + eˣ).
fn softplus(x: f32) -> f32 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_inverse_undoes_the_spline(
            widths in prop::collection::vec(-2.0_f32..2.0, 10),
            heights in prop::collection::vec(-2.0_f32..2.0, 10),
            derivatives in prop::collection::vec(-2.0_f32..2.0, 9),
            x in -7.0_f32..7.0,
        ) {
            let spline = Spline::new(Unnormalized { widths: &widths, heights: &heights, derivatives: &derivatives });
            let y = spline.forward(x);
            prop_assert!((spline.inverse(y) - x).abs() < 2e-3, "{x} {y} {}", spline.inverse(y));
            prop_assert!((spline.forward(spline.inverse(x)) - x).abs() < 2e-3);
            // It rises, and it meets the identity at both ends.
            prop_assert!(spline.forward(x + 0.01) > y);
            prop_assert!((spline.forward(BOUND) - BOUND).abs() < 1e-5 && (spline.inverse(-BOUND) + BOUND).abs() < 1e-5);
        }
    }

    #[test]
    fn equal_bins_are_the_identity() {
        // softplus⁻¹(1 − 0.001).
        let one = (0.999_f32.exp() - 1.0).ln();
        let spline = Spline::new(Unnormalized { widths: &[0.3; 4], heights: &[0.3; 4], derivatives: &[one; 3] });
        for x in [-9.0, -5.0, -1.3, 0.0, 2.5, 4.99, 8.0] {
            assert!((spline.forward(x) - x).abs() < 1e-5 && (spline.inverse(x) - x).abs() < 1e-5, "{x}");
        }
    }
}
