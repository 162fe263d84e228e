//! How alike two units look.

use crate::attributes::Attributes;

/// Distance in Oklab at which colours count as one standard deviation apart.
const COLOR: f64 = 0.1;
/// Logarithm of the ratio of sizes that counts as one standard deviation.
const SIZE: f64 = 0.35;
/// Difference of an elongation, flatness or roundness that counts as one standard deviation.
const SHAPE: f64 = 0.2;
/// Difference of mean opacities that counts as one standard deviation.
const OPACITY: f64 = 0.3;
/// Standard deviations up to which a measure counts as shared in words.
const SHARED: f64 = 0.7;

/// How alike two units look.
#[derive(Debug, Clone, PartialEq)]
pub struct Likeness {
    /// From 0 to 1 for units that measure the same.
    pub score: f64,
    /// What they share, in words: "colour", "size", "shape", "opacity".
    pub shared: Vec<&'static str>,
}

impl Likeness {
    /// exp(−½ Σ z²) over the differences z in standard deviations: of the mean colour in Oklab (Ottosson 2020), of the logarithm of
    /// the size, of elongation, flatness and roundness, and of the mean opacity. The place does not count.
    #[must_use]
    pub fn of(a: &Attributes, b: &Attributes) -> Self {
        let [first, second] = [a, b].map(|unit| sg_color::oklab(sg_color::from_rgb(unit.color)));
        let squares = first.iter().zip(second).map(|(x, y)| f64::from(x - y).powi(2));
        let color = squares.sum::<f64>().sqrt() / COLOR;
        // Two points have the same size, and a point has none of a unit with extent.
        let size = if a.size() == b.size() { 0.0 } else { (a.size() / b.size()).ln().abs() / SIZE };
        let forms = [Attributes::elongation, Attributes::flatness, Attributes::roundness];
        let shape = forms.map(|form| (form(a) - form(b)) / SHAPE).iter().map(|z| z * z).sum::<f64>().sqrt();
        let opacity = (a.opacity - b.opacity).abs() / OPACITY;
        let measures = [("colour", color), ("size", size), ("shape", shape), ("opacity", opacity)];
        let sum: f64 = measures.iter().map(|(_, z)| z * z).sum();
        let shared = measures.iter().filter(|(_, z)| *z <= SHARED).map(|(name, _)| *name).collect();
        Self { score: (-0.5 * sum).exp(), shared }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    use super::*;

    fn unit(deviations: [f64; 3], color: [f32; 3], opacity: f64) -> Attributes {
        let covariance = DMat3::from_diagonal(DVec3::from_array(deviations.map(|d| d * d)));
        Attributes { count: 9, center: DVec3::ZERO, covariance, deviations, color, opacity }
    }

    #[test]
    fn what_is_shared_has_a_name() {
        let red_rod = unit([10.0, 1.0, 1.0], [0.8, 0.1, 0.1], 0.9);
        let same = Likeness::of(&red_rod, &Attributes { center: DVec3::splat(1e3), count: 2000, ..red_rod });
        assert_eq!((same.score, same.shared), (1.0, vec!["colour", "size", "shape", "opacity"]));
        let blue_rod = Likeness::of(&red_rod, &unit([10.0, 1.0, 1.0], [0.1, 0.1, 0.8], 0.9));
        assert_eq!(blue_rod.shared, ["size", "shape", "opacity"]);
        let red_ball = Likeness::of(&red_rod, &unit([2.15, 2.15, 2.15], [0.8, 0.1, 0.1], 0.9));
        assert_eq!(red_ball.shared, ["colour", "size", "opacity"]);
        assert!(blue_rod.score < 0.5 && red_ball.score < 0.5, "{blue_rod:?} {red_ball:?}");
        let slightly = Likeness::of(&red_rod, &unit([11.0, 1.1, 1.0], [0.75, 0.12, 0.1], 0.8));
        assert!(slightly.score > 0.8, "{slightly:?}");
        let point = unit([0.0; 3], [0.5; 3], 1.0);
        assert_eq!(Likeness::of(&point, &point).score, 1.0);
        assert_eq!(Likeness::of(&point, &red_rod).score, 0.0);
    }

    proptest! {
        #[test]
        fn likeness_is_mutual_and_between_0_and_1(
            a in (prop::array::uniform3(0.0_f64..9.0), prop::array::uniform3(0.0_f32..1.0), 0.0_f64..1.0),
            b in (prop::array::uniform3(0.0_f64..9.0), prop::array::uniform3(0.0_f32..1.0), 0.0_f64..1.0),
        ) {
            let [a, b] = [a, b].map(|(mut deviations, color, opacity)| {
                deviations.sort_by(|x, y| y.total_cmp(x));
                unit(deviations, color, opacity)
            });
            let (there, back) = (Likeness::of(&a, &b), Likeness::of(&b, &a));
            prop_assert!((0.0..=1.0).contains(&there.score) && (there.score - back.score).abs() < 1e-9);
            prop_assert_eq!(Likeness::of(&a, &a).score, 1.0);
        }
    }
}
