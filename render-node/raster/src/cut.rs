//! Gaussians across the planes of clips: each becomes the Gaussian of the part that is kept.
//!
//! A half-space at t standard deviations from the centre of a Gaussian keeps the share Φ(t) of its mass. The mean of the kept
//! part lies m = φ(t)/Φ(t) standard deviations further in, along the conjugate direction of the plane. Its variance across
//! the plane is 1 − m(m + t) of the former one. These are the moments of a truncated normal distribution (Johnson, Kotz and
//! Balakrishnan 1994, section 13.10). The Gaussian with these three moments is drawn. Its optical depth follows from the mass
//! and the area that the eye sees. A cut through a solid is therefore flat, where whole Gaussians would leave it rough.
//!
//! Several planes cut one after the other. What a clip leaves of the outside of its region is cut by that side of the region
//! which the Gaussian is nearest to leaving, or farthest outside of.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use glam::{DMat3, DVec3};
use sg_scene::appearance::{Appearance, Clip, HalfSpace};

/// Standard deviations beyond which the plane of a clip leaves a Gaussian whole, or nothing of it: 0.13 % of the mass.
pub const REACH: f64 = 3.0;

/// The clips of a picture in view axes, with unit normals, relative to the eye.
#[derive(Debug, Clone)]
pub(crate) struct Cutter {
    clips: Vec<Clip>,
}

/// A Gaussian: its centre relative to the eye and the rows of the root A of its covariance A·Aᵀ, both in view axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shape {
    pub(crate) center: DVec3,
    pub(crate) rows: [DVec3; 3],
}

/// One plane through one Gaussian.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub(crate) normal: DVec3,
    /// The Gaussian before.
    pub(crate) before: Shape,
    /// Its standard deviation across the plane, above 0.
    pub(crate) deviation: f64,
    /// Unit vector Aᵀn/|Aᵀn|.
    pub(crate) axis: DVec3,
    pub(crate) kept: Kept,
}

/// The kept part of a Gaussian.
#[derive(Debug, Clone)]
pub(crate) struct Cut {
    pub(crate) shape: Shape,
    pub(crate) steps: Vec<Step>,
    /// Share of the mass.
    pub(crate) mass: f64,
}

/// Moments of a standard normal distribution above −t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Kept {
    /// Distance t.
    pub(crate) at: f64,
    /// Share Φ(t) of the mass.
    pub(crate) mass: f64,
    /// Mean.
    pub(crate) mean: f64,
    /// Variance, above 0.
    pub(crate) variance: f64,
}

impl Kept {
    fn above(at: f64) -> Self {
        let mass = 0.5 * libm::erfc(-at * FRAC_1_SQRT_2);
        let mean = (-0.5 * at * at).exp() / TAU.sqrt() / mass;
        Self { at, mass, mean, variance: 1.0 - mean * (mean + at) }
    }
}

impl Cutter {
    pub(crate) fn of(appearance: &Appearance, scene_to_view: DMat3, eye: DVec3) -> Self {
        let clip = |clip: &Clip| {
            // Relative to the eye before it is turned: far from the origin nothing cancels later.
            let turned = |side: HalfSpace| HalfSpace { normal: scene_to_view * side.normal, ..side };
            let sides = clip.sides.iter().map(|side| turned(side.relative_to(eye))).collect();
            Clip { sides, keep_inside: clip.keep_inside }
        };
        Self { clips: appearance.clips.iter().map(clip).collect() }
    }

    /// The kept part; `None` if nothing is kept.
    pub(crate) fn cut(&self, shape: Shape) -> Option<Cut> {
        let mut cut = Cut { shape, steps: Vec::new(), mass: 1.0 };
        for clip in &self.clips {
            if clip.keep_inside {
                for side in &clip.sides {
                    cut.by(side)?;
                }
            } else {
                // Nearest to the outside, or farthest out there.
                let distance = |side: &&HalfSpace| cut.shape.distance(side).0;
                let side = clip.sides.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
                cut.by(&HalfSpace { normal: -side.normal, offset: -side.offset })?;
            }
        }
        Some(cut)
    }
}

impl Cut {
    /// The opacity of the kept part towards the eye, of a Gaussian of this opacity. Mass is optical depth times area.
    pub(crate) fn opacity(&self, opacity: f64) -> f64 {
        if self.steps.is_empty() {
            return opacity;
        }
        -(self.depth_factor() * (-opacity).ln_1p()).exp_m1()
    }

    /// The optical depth of the kept part towards the eye, over that of the whole. Both count as seen towards the centre of the
    /// whole.
    pub(crate) fn depth_factor(&self) -> f64 {
        let whole = self.steps.first().map_or(&self.shape, |first| &first.before);
        let [area, kept_area] = [whole, &self.shape].map(|shape| shape.seen_area(whole.center).length());
        // A Gaussian without area is a needle or a point; its part is as wide.
        self.mass * if kept_area > 0.0 { area / kept_area } else { 1.0 }
    }

    fn by(&mut self, side: &HalfSpace) -> Option<()> {
        let (at, deviation, axis) = self.shape.distance(side);
        if at <= -REACH {
            return None;
        }
        // And what is not a number: the projection refuses it.
        if at.is_nan() || at >= REACH {
            return Some(());
        }
        let kept = Kept::above(at);
        let before = self.shape;
        let narrowed = 1.0 - kept.variance.sqrt();
        for (k, row) in before.rows.into_iter().enumerate() {
            let along = row.dot(axis);
            self.shape.center[k] += kept.mean * along;
            self.shape.rows[k] = row - narrowed * along * axis;
        }
        self.mass *= kept.mass;
        self.steps.push(Step { normal: side.normal, before, deviation, axis, kept });
        Some(())
    }
}

impl Shape {
    /// The distance of the centre from a plane in standard deviations, positive on the kept side; the standard deviation across it;
    /// and its axis Aᵀn/|Aᵀn|. A point is at an infinite distance.
    fn distance(&self, &HalfSpace { normal, offset }: &HalfSpace) -> (f64, f64, DVec3) {
        let [x, y, z] = self.rows;
        let across = normal.x * x + normal.y * y + normal.z * z;
        let deviation = across.length();
        let distance = normal.dot(self.center) - offset;
        if deviation > 0.0 {
            (distance / deviation, deviation, across / deviation)
        } else {
            (if distance >= 0.0 { f64::INFINITY } else { f64::NEG_INFINITY }, 0.0, DVec3::ZERO)
        }
    }

    /// adj(A)·v for the view direction v: its length is that of v times the area of the Gaussian that is seen along v, up to a
    /// constant.
    pub(crate) fn seen_area(&self, direction: DVec3) -> DVec3 {
        let [x, y, z] = self.rows;
        direction.x * y.cross(z) + direction.y * z.cross(x) + direction.z * x.cross(y)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn cutter(clips: Vec<Clip>) -> Cutter {
        let scene = sg_scene::synthetic::test_scene(&[("one", 1)]);
        Cutter::of(&Appearance { clips, ..Appearance::of(&scene) }, DMat3::IDENTITY, DVec3::ZERO)
    }

    proptest! {
        #[test]
        fn moments_are_those_of_the_kept_part(at in -REACH..REACH) {
            let kept = Kept::above(at);
            let (mut mass, mut first, mut second) = (0.0, 0.0, 0.0);
            let step = 1e-4;
            for i in 0..120_000 {
                let x = -at + (f64::from(i) + 0.5) * step;
                let density = (-0.5 * x * x).exp() / TAU.sqrt() * step;
                mass += density;
                first += x * density;
                second += x * x * density;
            }
            let mean = first / mass;
            prop_assert!((kept.mass - mass).abs() < 1e-7);
            prop_assert!((kept.mean - mean).abs() < 1e-5);
            prop_assert!((kept.variance - (second / mass - mean * mean)).abs() < 1e-4, "{kept:?}");
        }

        #[test]
        fn a_cut_gaussian_has_the_moments_of_its_samples(
            m in proptest::array::uniform9(-1.0..1.0_f64), n in proptest::array::uniform3(-1.0..1.0_f64), at in -1.5..1.5_f64,
        ) {
            let normal = DVec3::from_array(n);
            prop_assume!(normal.length() > 0.2);
            let rows = [0, 3, 6].map(|k| DVec3::from_slice(&m[k..k + 3]));
            let shape = Shape { center: DVec3::new(0.3, -0.2, 5.0), rows };
            let across = normal.x * rows[0] + normal.y * rows[1] + normal.z * rows[2];
            prop_assume!(across.length() > 0.05);
            let clip = Clip::plane(shape.center - normal * (at * across.length() / normal.length_squared()), normal);
            let cut = cutter(vec![clip.clone()]).cut(shape).unwrap();
            // Places of a regular grid stand for samples.
            let (mut all, mut kept, mut sum) = (0.0, 0.0, DVec3::ZERO);
            let mut places = Vec::new();
            let axis = |k: i32| (f64::from(k) + 0.5) / 5.0;
            for (i, j, k) in (-22..22).flat_map(|i| (-22..22).flat_map(move |j| (-22..22).map(move |k| (i, j, k)))) {
                let x = DVec3::new(axis(i), axis(j), axis(k));
                let weight = (-0.5 * x.length_squared()).exp();
                let p = shape.center + DVec3::new(rows[0].dot(x), rows[1].dot(x), rows[2].dot(x));
                all += weight;
                if clip.keeps(p) {
                    kept += weight;
                    sum += weight * p;
                    places.push((weight, p));
                }
            }
            let mean = sum / kept;
            prop_assert!((cut.mass - kept / all).abs() < 0.03, "{} {}", cut.mass, kept / all);
            prop_assert!((cut.shape.center - mean).length() < 0.06, "{} {mean}", cut.shape.center);
            for (k, l) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)] {
                let found: f64 = places.iter().map(|(w, p)| w * (p - mean)[k] * (p - mean)[l]).sum::<f64>() / kept;
                let got = cut.shape.rows[k].dot(cut.shape.rows[l]);
                prop_assert!((got - found).abs() < 0.06, "{k} {l}: {got} {found}");
            }
        }
    }

    #[test]
    fn mass_is_optical_depth_times_area() {
        let shape = Shape { center: DVec3::new(0.0, 0.0, 9.0), rows: [DVec3::X, DVec3::Y, DVec3::Z] };
        // A plane that the eye looks onto takes depth; one that it looks along takes area.
        for (normal, taken) in [(DVec3::Z, 0.5), (DVec3::X, 0.5 / (1.0 - 2.0 / std::f64::consts::PI).sqrt())] {
            let cut = cutter(vec![Clip::plane(shape.center, normal)]).cut(shape).unwrap();
            let depth = |opacity: f64| -(-opacity).ln_1p();
            for opacity in [1e-6, 0.3, 0.99] {
                let found = depth(cut.opacity(opacity)) / depth(opacity);
                assert!((found - taken).abs() < 1e-9, "{normal} {opacity}: {found} {taken}");
            }
            assert_eq!(cut.opacity(1.0), 1.0);
        }
    }

    #[test]
    fn boxes_keep_their_inside_or_their_outside() {
        let at =
            |x: f64| Shape { center: DVec3::new(x, 0.0, 9.0), rows: [0.1 * DVec3::X, 0.1 * DVec3::Y, 0.1 * DVec3::Z] };
        let (min, max) = (DVec3::new(-1.0, -1.0, 8.0), DVec3::new(1.0, 1.0, 10.0));
        let [inside, outside] = [true, false].map(|keep| cutter(vec![Clip::between(min, max, keep)]));
        let mass = |cutter: &Cutter, x: f64| cutter.cut(at(x)).map_or(0.0, |cut| cut.mass);
        for (x, share) in
            [(0.0, 1.0), (0.95, Kept::above(0.5).mass), (1.0, 0.5), (1.05, Kept::above(-0.5).mass), (2.0, 0.0)]
        {
            assert!((mass(&inside, x) - share).abs() < 1e-12, "{x}: {}", mass(&inside, x));
            assert!((mass(&outside, x) - (1.0 - share)).abs() < 1e-12, "{x}: {}", mass(&outside, x));
        }
        // Two planes through one place keep a quarter.
        let quarter = cutter(vec![Clip::plane(DVec3::ZERO, DVec3::X), Clip::plane(DVec3::ZERO, DVec3::Y)]);
        assert!((mass(&quarter, 0.0) - 0.25).abs() < 1e-12);
    }

    #[test]
    fn points_and_needles_are_kept_or_gone() {
        let cutter = cutter(vec![Clip::plane(DVec3::ZERO, DVec3::X)]);
        let at = |x: f64, rows: [DVec3; 3]| cutter.cut(Shape { center: DVec3::new(x, 0.0, 3.0), rows });
        assert!(at(0.0, [DVec3::ZERO; 3]).is_some() && at(-1e-9, [DVec3::ZERO; 3]).is_none());
        let needle = at(0.0, [DVec3::X, DVec3::ZERO, DVec3::ZERO]).unwrap();
        assert!((needle.opacity(0.5) - 1.0 + 0.5_f64.sqrt()).abs() < 1e-12, "{}", needle.opacity(0.5));
    }
}
