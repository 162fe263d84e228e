//! Averages of a transfer function over ranges of values.

use glam::{DVec3, Vec3};

use crate::classifier::Classifier;
use crate::opacity::MAX_OPACITY;

/// Colour and opacity of a set of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Average {
    /// Mean colour, each value weighted by its opacity; that of the middle value where none is visible.
    pub color: Vec3,
    /// Mean opacity of one reference length.
    pub opacity: f64,
    /// Mean optical depth of one reference length, the mean of −ln(1 − opacity).
    pub depth: f64,
}

/// Integrals of opacity, depth and weighted colour, over scaled values.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Integrals {
    opacity: f64,
    depth: f64,
    color: DVec3,
}

impl Integrals {
    /// Those of one look over a range of length 1.
    fn of((color, opacity): (Vec3, f32)) -> Self {
        let opacity = f64::from(opacity);
        Self { opacity, depth: mean_depth(opacity, opacity), color: color.as_dvec3() * opacity }
    }

    fn plus(self, other: Self) -> Self {
        Self { opacity: self.opacity + other.opacity, depth: self.depth + other.depth, color: self.color + other.color }
    }

    fn times(self, factor: f64) -> Self {
        Self { opacity: self.opacity * factor, depth: self.depth * factor, color: self.color * factor }
    }
}

/// A part of the function between two control points.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Segment {
    /// Scaled values of its ends.
    ends: [f64; 2],
    opacities: [f64; 2],
    colors: [DVec3; 2],
}

impl Segment {
    /// The place of a scaled value within the segment, 0 to 1.
    fn place(&self, x: f64) -> f64 {
        (x - self.ends[0]) / (self.ends[1] - self.ends[0])
    }

    fn opacity(&self, t: f64) -> f64 {
        self.opacities[0] + t * (self.opacities[1] - self.opacities[0])
    }

    /// Means between the relative places `from` and `to` within the segment.
    fn mean(&self, from: f64, to: f64) -> Integrals {
        let [a, b] = [from, to].map(|t| self.opacity(t));
        let [c, d] = [from, to].map(|t| self.colors[0].lerp(self.colors[1], t));
        // ∫ (a + s·Δa)(c + s·Δc) ds over 0 to 1.
        let color = c * a + (c * (b - a) + (d - c) * a) / 2.0 + (d - c) * (b - a) / 3.0;
        Integrals { opacity: 0.5 * (a + b), depth: mean_depth(a, b), color }
    }
}

/// The linear parts of a function from the begin to the end of its domain. Jumps lie between them.
fn segments(classifier: &Classifier) -> Vec<Segment> {
    let [first, last] = classifier.scaled_domain();
    let (knots, samples) = classifier.control_points();
    let mut ends = vec![first];
    ends.extend(knots.iter().copied().filter(|knot| first < *knot && *knot < last));
    ends.push(last);
    ends.dedup();
    let linear = |pair: &[f64]| {
        let &[from, to] = pair else { return None };
        let after = knots.partition_point(|knot| *knot <= 0.5 * (from + to));
        // Before the first control point and behind the last one the function is constant: both are the same point there.
        let (low, high) = (after.saturating_sub(1), after.min(knots.len() - 1));
        let place = |x: f64| if high > low { (x - knots[low]) / (knots[high] - knots[low]) } else { 0.0 };
        let between = |x: f64| {
            let ((c0, o0), (c1, o1)) = (samples[low], samples[high]);
            let (c0, c1, o0, o1) = (c0.as_dvec3(), c1.as_dvec3(), f64::from(o0), f64::from(o1));
            (c0.lerp(c1, place(x)), o0 + place(x) * (o1 - o0))
        };
        let [(c0, o0), (c1, o1)] = [between(from), between(to)];
        Some(Segment { ends: [from, to], opacities: [o0, o1], colors: [c0, c1] })
    };
    ends.windows(2).filter_map(linear).collect()
}

/// The mean of −ln(1 − a) for a from `a` to `b`: the difference of its antiderivative, x + (1 − x)·ln(1 − x), over b − a.
fn mean_depth(a: f64, b: f64) -> f64 {
    let [a, b] = [a, b].map(|x| x.min(f64::from(MAX_OPACITY)));
    let middle = -(-0.5 * (a + b)).ln_1p();
    // Simpson's rule is exact to rounding for near ends, where the difference cancels.
    if (b - a).abs() < 1e-3 * (1.0 - a.max(b)) {
        return (-(-a).ln_1p() - (-b).ln_1p() + 4.0 * middle) / 6.0;
    }
    let antiderivative = |x: f64| x + (1.0 - x) * (-x).ln_1p();
    (antiderivative(b) - antiderivative(a)) / (b - a)
}

/// Averages of a classifier over ranges of values, in closed form: between control points, colour and opacity are linear.
#[derive(Debug, Clone)]
pub struct Averages {
    classifier: Classifier,
    segments: Vec<Segment>,
    /// Integrals from the begin of the domain to that of each segment, and to the end of the last one.
    sums: Vec<Integrals>,
}

impl Averages {
    /// The averages of a function without factors on its base units.
    #[must_use]
    pub fn new(classifier: &Classifier) -> Self {
        let segments = segments(classifier);
        let mut sums = vec![Integrals::default()];
        for segment in &segments {
            let width = segment.ends[1] - segment.ends[0];
            let sum = sums.last().copied().unwrap_or_default();
            sums.push(sum.plus(segment.mean(0.0, 1.0).times(width)));
        }
        Self { classifier: classifier.with_opacities(Vec::new()), segments, sums }
    }

    /// The average over raw values that are spread evenly from `low` to `high`. Values beyond the ends of the domain have
    /// the look of that end. Between them the spread is even on the scale of the function. NaN is transparent.
    #[must_use]
    pub fn over(&self, low: f64, high: f64) -> Average {
        if low.is_nan() || high.is_nan() {
            return Average { color: Vec3::ZERO, opacity: 0.0, depth: 0.0 };
        }
        let (low, high) = (low.min(high), low.max(high));
        let [first, last] = self.classifier.raw_domain();
        let width = high - low;
        let middle = 0.5 * (low + high);
        if !(width > 0.0 && width.is_finite() && low < last && high > first) {
            return self.average(self.point(middle), middle);
        }
        let (below, above) = ((first - low).max(0.0) / width, (high - last).max(0.0) / width);
        let inside = 1.0 - below - above;
        let [from, to] = [low.max(first), high.min(last)].map(|raw| self.classifier.scaled(raw));
        let mut sum = self.mean_between(from, to).times(inside);
        for (share, end) in [(below, first), (above, last)] {
            if share > 0.0 {
                sum = sum.plus(self.point(end).times(share));
            }
        }
        self.average(sum, middle)
    }

    fn point(&self, raw: f64) -> Integrals {
        Integrals::of(self.classifier.evaluate(raw))
    }

    fn average(&self, sum: Integrals, middle: f64) -> Average {
        let color =
            if sum.opacity > 0.0 { (sum.color / sum.opacity).as_vec3() } else { self.classifier.evaluate(middle).0 };
        Average { color, opacity: sum.opacity, depth: sum.depth }
    }

    /// The mean between two scaled values.
    fn mean_between(&self, from: f64, to: f64) -> Integrals {
        let width = to - from;
        let extent =
            self.segments.last().map_or(0.0, |last| last.ends[1]) - self.segments.first().map_or(0.0, |s| s.ends[0]);
        // A very short range has the look of its middle: differences of integrals would be rounding errors.
        if width <= 1e-9 * extent {
            return self.point_of_scaled(0.5 * (from + to));
        }
        let (i, j) = (self.segment_at(from), self.segment_at(to));
        if i == j
            && let Some(segment) = self.segments.get(i)
        {
            return segment.mean(segment.place(from), segment.place(to));
        }
        self.integral_to(to).plus(self.integral_to(from).times(-1.0)).times(1.0 / width)
    }

    /// The segment of a scaled value; the number of segments at the end of the domain.
    fn segment_at(&self, x: f64) -> usize {
        self.segments.partition_point(|segment| segment.ends[1] <= x)
    }

    /// The integral from the begin of the domain to a scaled value within it.
    fn integral_to(&self, x: f64) -> Integrals {
        let at = self.segment_at(x);
        let sum = self.sums.get(at).copied().unwrap_or_default();
        match self.segments.get(at) {
            Some(segment) => sum.plus(segment.mean(0.0, segment.place(x)).times(x - segment.ends[0])),
            None => sum,
        }
    }

    fn point_of_scaled(&self, x: f64) -> Integrals {
        Integrals::of(self.classifier.at(x))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::scalars::ValueRange;
    use crate::transfer::{ControlPoint, Scale, TransferFunction, Units};

    fn function(points: Vec<(f64, f32, f32)>, domain: [f64; 2], scale: Scale) -> TransferFunction {
        let point = |(value, gray, opacity)| ControlPoint { value, color: [gray, 1.0 - gray, 0.5], opacity };
        let points = points.into_iter().map(point).collect();
        TransferFunction { domain, units: Units::Raw, scale, variable: None, points, base_units: Vec::new() }
    }

    fn bound(function: &TransferFunction) -> Classifier {
        function.classifier(ValueRange { low: 0.0, high: 1.0, non_finite: 0 }).unwrap()
    }

    /// The definition: many values.
    fn by_values(classifier: &Classifier, low: f64, high: f64) -> Average {
        let n = 20_000;
        let (mut color, mut opacity, mut depth) = (DVec3::ZERO, 0.0, 0.0);
        for k in 0..n {
            let raw = low + (high - low) * (f64::from(k) + 0.5) / f64::from(n);
            let (c, o) = classifier.evaluate(raw);
            let o = f64::from(o);
            color += c.as_dvec3() * o;
            opacity += o;
            depth -= (-o.min(f64::from(MAX_OPACITY))).ln_1p();
        }
        let n = f64::from(n);
        Average { color: (color / opacity).as_vec3(), opacity: opacity / n, depth: depth / n }
    }

    #[test]
    fn jumps_single_points_and_the_ends_of_the_domain() {
        let jump = bound(&function(vec![(5.0, 0.0, 0.0), (5.0, 1.0, 0.5)], [0.0, 10.0], Scale::Linear));
        let of = Averages::new(&jump);
        let half = of.over(0.0, 10.0);
        assert!((half.opacity - 0.25).abs() < 1e-12 && (half.depth - 0.5 * 2.0_f64.ln()).abs() < 1e-9, "{half:?}");
        assert_eq!((of.over(5.0, 5.0).opacity, of.over(4.9, 4.9).opacity), (0.5, 0.0));
        assert_eq!(of.over(6.0, 6.0).color, Vec3::new(1.0, 0.0, 0.5));
        // Half of the values lie beyond the end, which all have its look.
        assert!((of.over(5.0, 15.0).opacity - 0.5).abs() < 1e-12);
        assert_eq!((of.over(20.0, 30.0).opacity, of.over(f64::NAN, 1.0).opacity), (0.5, 0.0));
        assert_eq!(of.over(f64::NEG_INFINITY, 1.0).opacity, 0.0);
        let flat = Averages::new(&bound(&function(vec![(5.0, 1.0, 0.3)], [0.0, 10.0], Scale::Linear)));
        assert!((flat.over(1.0, 9.0).opacity - f64::from(0.3_f32)).abs() < 1e-12);
    }

    #[test]
    fn opacity_one_has_a_finite_depth() {
        let solid = Averages::new(&bound(&function(vec![(0.0, 0.0, 0.0), (1.0, 0.0, 1.0)], [0.0, 1.0], Scale::Linear)));
        // −∫ ln(1 − a) over 0 to 1 is 1.
        let whole = solid.over(0.0, 1.0);
        assert!((whole.depth - 1.0).abs() < 1e-4, "{whole:?}");
        assert!(solid.over(1.0, 1.0).depth < 14.0);
    }

    #[test]
    fn short_ranges_do_not_cancel() {
        let steep = bound(&function(vec![(0.0, 0.0, 0.2), (1e6, 1.0, 0.9)], [0.0, 1e6], Scale::Linear));
        let of = Averages::new(&steep);
        for width in [1.0, 1e-2, 1e-4, 1e-6, 1e-8] {
            let (found, exact) = (of.over(5e5 - width, 5e5 + width), of.over(5e5, 5e5));
            assert!(
                (found.opacity - exact.opacity).abs() < 1e-6 && (found.depth - exact.depth).abs() < 1e-6,
                "{width}"
            );
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn averages_are_those_of_many_values(
            mut values in prop::collection::vec(0.0..100.0_f64, 1..7),
            looks in prop::collection::vec((0.0..=1.0_f32, 0.0..=0.95_f32), 7),
            ends in (-40.0..140.0_f64, -40.0..140.0_f64),
        ) {
            prop_assume!((ends.0 - ends.1).abs() > 0.5);
            values.sort_by(f64::total_cmp);
            let points = values.iter().zip(&looks).map(|(v, (gray, opacity))| (*v, *gray, *opacity)).collect();
            let classifier = bound(&function(points, [0.0, 100.0], Scale::Linear));
            let (low, high) = (ends.0.min(ends.1), ends.0.max(ends.1));
            let (fast, slow) = (Averages::new(&classifier).over(low, high), by_values(&classifier, low, high));
            prop_assert!((fast.opacity - slow.opacity).abs() < 2e-3, "{fast:?} {slow:?}");
            prop_assert!((fast.depth - slow.depth).abs() < 1e-2, "{fast:?} {slow:?}");
            if slow.opacity > 0.01 {
                prop_assert!((fast.color - slow.color).length() < 2e-2, "{fast:?} {slow:?}");
            }
        }

        #[test]
        fn a_logarithmic_scale_spreads_values_on_it(a in 0.0..3.0_f64, b in 0.0..3.0_f64) {
            prop_assume!((a - b).abs() > 1e-3);
            let points = vec![(1.0, 0.0, 0.0), (1000.0, 1.0, 0.9)];
            let of = Averages::new(&bound(&function(points, [1.0, 1000.0], Scale::Log10)));
            let found = of.over(10.0_f64.powf(a), 10.0_f64.powf(b)).opacity;
            prop_assert!((found - 0.9 * (a + b) / 6.0).abs() < 1e-6, "{found}");
        }
    }
}
