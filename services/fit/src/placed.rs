//! The Gaussians of a direct start by base unit, and their number.

use crate::report::Seconds;
use crate::shape::Splat;

/// The Gaussians of the base units, before they are a scene.
pub(crate) struct Placed {
    /// In the order of the transfer function.
    pub(crate) units: Vec<PlacedUnit>,
    /// Voxels or tetrahedra with an opacity above 0.
    pub(crate) visible: usize,
    /// Those outside the ranges of all base units.
    pub(crate) outside_ranges: usize,
    /// Length that stands for the smallest voxel in the report.
    pub(crate) edge: f64,
    pub(crate) seconds: Seconds,
}

/// The Gaussians of one base unit.
pub(crate) struct PlacedUnit {
    pub(crate) splats: Vec<Splat>,
    /// Sum of the importance of its data.
    pub(crate) importance: f64,
    /// Voxels or tetrahedra with an opacity above 0.
    pub(crate) visible: usize,
}

/// Divides `n` in proportion to the totals (largest remainders). Each total above 0 gets at least one if `n` is large enough.
pub(crate) fn apportion(totals: &[f64], n: usize) -> Vec<usize> {
    let sum: f64 = totals.iter().sum();
    let wanted = totals.iter().filter(|&&t| t > 0.0).count();
    let least = usize::from(n >= wanted);
    let spare = n - least * wanted.min(n);
    let exact: Vec<f64> = totals.iter().map(|t| t / sum * spare as f64).collect();
    let mut shares: Vec<usize> =
        exact.iter().zip(totals).map(|(e, &t)| *e as usize + if t > 0.0 { least } else { 0 }).collect();
    let mut rest: Vec<usize> = (0..totals.len()).filter(|&i| totals[i] > 0.0).collect();
    rest.sort_by(|&i, &j| exact[j].fract().total_cmp(&exact[i].fract()).then(i.cmp(&j)));
    let missing = n.saturating_sub(shares.iter().sum());
    for &i in rest.iter().cycle().take(missing) {
        shares[i] += 1;
    }
    shares
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn shares_sum_to_the_budget(totals in prop::collection::vec(prop_oneof![Just(0.0), 1e-6..1e6_f64], 1..6), n in 1..500_usize) {
            prop_assume!(totals.iter().any(|&t| t > 0.0));
            let shares = apportion(&totals, n);
            prop_assert_eq!(shares.iter().sum::<usize>(), n);
            let wanted = totals.iter().filter(|&&t| t > 0.0).count();
            for (s, t) in shares.iter().zip(&totals) {
                prop_assert!(*t > 0.0 || *s == 0);
                prop_assert!(*t == 0.0 || n < wanted || *s > 0);
            }
        }
    }
}
