//! Evaluation of a transfer function on the values of one volume.

use glam::Vec3;

use crate::scalars::ValueRange;
use crate::transfer::{Problem, Scale, TransferFunction, Units};

impl TransferFunction {
    /// Binds the function to the values of one volume. Normalized units refer to the finite range `values`.
    ///
    /// # Errors
    /// [`Problem`], as [`TransferFunction::check`].
    pub fn classifier(&self, values: ValueRange) -> Result<Classifier, Problem> {
        self.check()?;
        let (shift, factor) = match self.units {
            Units::Raw => (0.0, 1.0),
            // A constant volume has one normalized value: 0.
            Units::Normalized if values.high > values.low => (values.low, 1.0 / (values.high - values.low)),
            Units::Normalized => (values.low, 0.0),
        };
        // Those of a constant volume are not finite: all its values are one.
        let mut bends: Vec<f64> = (self.points.iter().map(|p| p.value))
            .chain(self.domain)
            .chain(self.base_units.iter().flat_map(|unit| unit.range))
            .map(|x| x / factor + shift)
            .filter(|x| x.is_finite())
            .collect();
        bends.sort_by(f64::total_cmp);
        bends.dedup();
        Ok(Classifier {
            bends,
            shift,
            factor,
            domain: self.domain,
            scale: self.scale,
            knots: self.points.iter().map(|p| self.scale.apply(p.value)).collect(),
            samples: self.points.iter().map(|p| (Vec3::from_array(p.color), p.opacity)).collect(),
            units: self.base_units.iter().map(|u| u.range.map(|x| self.scale.apply(self.clamp(x)))).collect(),
            factors: Vec::new(),
        })
    }

    fn clamp(&self, x: f64) -> f64 {
        x.clamp(self.domain[0], self.domain[1])
    }
}

/// A transfer function bound to a volume's value range, for evaluation.
#[derive(Debug, Clone)]
pub struct Classifier {
    shift: f64,
    factor: f64,
    domain: [f64; 2],
    scale: Scale,
    /// Scaled values of the control points, increasing; as many as `samples`, at least one.
    knots: Vec<f64>,
    samples: Vec<(Vec3, f32)>,
    /// Raw values at which colour or opacity may bend or jump, increasing.
    bends: Vec<f64>,
    units: Vec<[f64; 2]>,
    /// Factors on the opacity of each base unit; those that are missing are 1.
    factors: Vec<f32>,
}

/// The base unit of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BaseUnitMatch {
    /// Index into the transfer function's base units; 0 for a function without base units.
    pub unit: usize,
    /// Whether the value lies in the range of that unit. If not, the unit is the nearest one.
    pub inside: bool,
}

impl Classifier {
    /// The same function with opacity 0 for all values of other base units.
    #[must_use]
    pub fn only(&self, unit: usize) -> Self {
        self.with_opacities((0..self.unit_count()).map(|k| if k == unit { 1.0 } else { 0.0 }).collect())
    }

    /// The same function with these factors, 0 to 1, on the opacities of its base units, in order. Those that are missing are 1.
    #[must_use]
    pub fn with_opacities(&self, factors: Vec<f32>) -> Self {
        Self { factors, ..self.clone() }
    }

    /// Whether some value between two raw values has an opacity above 0. It never misses one, but it may say so of values of
    /// hidden base units.
    #[must_use]
    pub fn is_visible_between(&self, low: f64, high: f64) -> bool {
        // Between control points the opacity is linear, so it is 0 if it is 0 at all ends.
        let ends = [self.scaled(low), self.scaled(high)];
        let within =
            self.knots.iter().zip(&self.samples).any(|(k, (_, o))| *o > 0.0 && (ends[0]..=ends[1]).contains(k));
        within || ends.into_iter().any(|x| self.at(x).1 > 0.0)
    }

    /// Colour and opacity (per reference length) of a raw value; transparent black for NaN.
    #[must_use]
    pub fn evaluate(&self, raw: f64) -> (Vec3, f32) {
        if raw.is_nan() {
            return (Vec3::ZERO, 0.0);
        }
        self.evaluate_scaled(self.scaled(raw))
    }

    /// As [`Self::evaluate`], of a value that [`Self::scaled`] gave.
    pub(crate) fn evaluate_scaled(&self, x: f64) -> (Vec3, f32) {
        let (color, opacity) = self.at(x);
        if opacity == 0.0 || self.factors.is_empty() {
            return (color, opacity);
        }
        let factor = self.factors.get(self.unit_of_scaled(x).unit).copied().unwrap_or(1.0);
        (color, factor * opacity)
    }

    /// For a linear scale: the scaled value is (raw − the first)·the second, within the domain.
    pub(crate) fn linear(&self) -> Option<(f64, f64)> {
        matches!(self.scale, Scale::Linear).then_some((self.shift, self.factor))
    }

    /// Scaled values of the control points, increasing, and their colours and opacities; at least one.
    pub(crate) fn control_points(&self) -> (&[f64], &[(Vec3, f32)]) {
        (&self.knots, &self.samples)
    }

    /// Raw values at which colour or opacity may bend or jump, increasing: between two of them, both follow the scale of the
    /// function without a bend.
    pub(crate) fn bends(&self) -> &[f64] {
        &self.bends
    }

    /// Least and greatest scaled value.
    pub(crate) fn scaled_domain(&self) -> [f64; 2] {
        self.domain.map(|x| self.scale.apply(x))
    }

    /// The domain in raw values.
    pub(crate) fn raw_domain(&self) -> [f64; 2] {
        // A factor of 0 takes every value of a constant volume to the same one.
        if self.factor == 0.0 {
            return [f64::NEG_INFINITY, f64::INFINITY];
        }
        self.domain.map(|x| x / self.factor + self.shift)
    }

    /// Colour and opacity at a scaled value.
    pub(crate) fn at(&self, x: f64) -> (Vec3, f32) {
        let after = self.knots.partition_point(|&k| k <= x);
        match (after.checked_sub(1).and_then(|i| self.samples.get(i)), self.samples.get(after)) {
            (None, Some(&first)) => first,
            (Some(&last), None) => last,
            (Some(&(c0, o0)), Some(&(c1, o1))) => {
                let (k0, k1) = (self.knots[after - 1], self.knots[after]);
                let t = ((x - k0) / (k1 - k0)) as f32;
                (c0.lerp(c1, t), o0 + t * (o1 - o0))
            }
            (None, None) => (Vec3::ZERO, 0.0),
        }
    }

    /// Opacity (per reference length) of a raw value.
    #[must_use]
    pub fn opacity(&self, raw: f64) -> f32 {
        self.evaluate(raw).1
    }

    /// Number of base units, at least 1.
    #[must_use]
    pub fn unit_count(&self) -> usize {
        self.units.len().max(1)
    }

    /// The base unit of a raw value: the first one in the file with the value in its range, else the nearest one in scaled
    /// values. A border of two units belongs to the unit that begins there. NaN gives the first unit, outside its range.
    #[must_use]
    pub fn unit(&self, raw: f64) -> BaseUnitMatch {
        if raw.is_nan() {
            return BaseUnitMatch { unit: 0, inside: false };
        }
        self.unit_of_scaled(self.scaled(raw))
    }

    fn unit_of_scaled(&self, x: f64) -> BaseUnitMatch {
        if self.units.is_empty() {
            return BaseUnitMatch { unit: 0, inside: true };
        }
        let mut best = (0, f64::INFINITY);
        for (i, &[low, high]) in self.units.iter().enumerate() {
            let distance = (low - x).max(x - high).max(0.0);
            // A shared border belongs to the unit that begins there.
            let begins_here = distance == 0.0 && low == x && best.1 == 0.0 && self.units[best.0][1] == x;
            if distance < best.1 || begins_here {
                best = (i, distance);
            }
        }
        BaseUnitMatch { unit: best.0, inside: best.1 == 0.0 }
    }

    /// The value on the scale of the control points, within the domain.
    pub(crate) fn scaled(&self, raw: f64) -> f64 {
        self.scale.apply(self.within_domain(raw))
    }

    /// The derivative of the scaled value by the raw one. Values beyond the domain have that of its end.
    pub(crate) fn slope(&self, raw: f64) -> f64 {
        self.factor * self.scale.slope(self.within_domain(raw))
    }

    fn within_domain(&self, raw: f64) -> f64 {
        let x = (raw - self.shift) * self.factor;
        // An infinite value times a factor of 0 is NaN; clamp would pass it on.
        let x = if x.is_nan() { self.domain[0] } else { x };
        x.clamp(self.domain[0], self.domain[1])
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::transfer::{BaseUnitRange, ControlPoint};

    fn range(low: f64, high: f64) -> ValueRange {
        ValueRange { low, high, non_finite: 0 }
    }

    fn point(value: f64, gray: f32, opacity: f32) -> ControlPoint {
        ControlPoint { value, color: [gray; 3], opacity }
    }

    fn function(points: Vec<ControlPoint>) -> TransferFunction {
        TransferFunction {
            domain: [0.0, 100.0],
            units: Units::Raw,
            scale: Scale::Linear,
            variable: None,
            points,
            base_units: Vec::new(),
        }
    }

    #[test]
    fn jumps_ends_and_nan() {
        let f = function(vec![point(10.0, 0.0, 0.0), point(20.0, 1.0, 0.5), point(20.0, 0.5, 1.0)]);
        let c = f.classifier(range(0.0, 255.0)).unwrap();
        assert_eq!(c.evaluate(-1e9), (Vec3::ZERO, 0.0));
        assert_eq!(c.evaluate(15.0), (Vec3::splat(0.5), 0.25));
        assert_eq!(c.evaluate(20.0), (Vec3::splat(0.5), 1.0));
        assert_eq!(c.evaluate(f64::INFINITY), (Vec3::splat(0.5), 1.0));
        assert_eq!(c.evaluate(f64::NAN).1, 0.0);
        assert_eq!(c.unit(f64::NAN), BaseUnitMatch { unit: 0, inside: false });
    }

    #[test]
    fn normalized_units_follow_the_volume() {
        let mut f = function(vec![point(0.0, 0.0, 0.0), point(1.0, 1.0, 1.0)]);
        (f.domain, f.units) = ([0.0, 1.0], Units::Normalized);
        let c = f.classifier(range(-1000.0, 3000.0)).unwrap();
        assert_eq!(c.opacity(-1000.0), 0.0);
        assert_eq!(c.opacity(0.0), 0.25);
        assert_eq!(c.opacity(3000.0), 1.0);
        let constant = f.classifier(range(7.0, 7.0)).unwrap();
        assert_eq!(constant.opacity(7.0), 0.0);
    }

    #[test]
    fn scales_space_the_values() {
        let mut f = function(vec![point(1.0, 0.0, 0.0), point(100.0, 1.0, 1.0)]);
        (f.domain, f.scale) = ([1.0, 100.0], Scale::Log10);
        assert!((f.classifier(range(0.0, 100.0)).unwrap().opacity(10.0) - 0.5).abs() < 1e-6);
        let mut f = function(vec![point(-99.0, 0.0, 0.0), point(99.0, 1.0, 1.0)]);
        (f.domain, f.scale) = ([-99.0, 99.0], Scale::Symlog);
        let c = f.classifier(range(-99.0, 99.0)).unwrap();
        assert!((c.opacity(0.0) - 0.5).abs() < 1e-6);
        assert!((c.opacity(9.0) - 0.75).abs() < 1e-6);
        assert!((c.opacity(-9.0) - 0.25).abs() < 1e-6);
    }

    #[test]
    fn units_share_borders_and_take_values_between_them() {
        let mut f = function(vec![point(0.0, 0.0, 1.0)]);
        let unit = |name: &str, low, high| BaseUnitRange { name: name.into(), range: [low, high] };
        f.base_units = vec![unit("a", 10.0, 20.0), unit("b", 20.0, 30.0), unit("c", 50.0, 60.0)];
        let c = f.classifier(range(0.0, 100.0)).unwrap();
        let of = |x| {
            let u = c.unit(x);
            (u.unit, u.inside)
        };
        assert_eq!([of(10.0), of(19.9), of(20.0), of(30.0)], [(0, true), (0, true), (1, true), (1, true)]);
        assert_eq!([of(0.0), of(39.0), of(41.0), of(99.0)], [(0, false), (1, false), (2, false), (2, false)]);
        assert_eq!(c.unit_count(), 3);
    }

    proptest! {
        #[test]
        fn evaluation_stays_within_the_points(
            mut values in prop::collection::vec(-50.0..150.0_f64, 1..8),
            tints in prop::collection::vec(0.0..=1.0_f32, 8),
            opacities in prop::collection::vec(0.0..=1.0_f32, 8),
            x in -1e3..1e3_f64,
        ) {
            values.sort_by(f64::total_cmp);
            let points = values.iter().zip(&tints).zip(&opacities).map(|((&v, &g), &o)| point(v, g, o)).collect();
            let f = function(points);
            let c = f.classifier(range(0.0, 1.0)).unwrap();
            let (color, opacity) = c.evaluate(x);
            let n = values.len();
            let (low, high) = opacities[..n].iter().fold((1.0_f32, 0.0_f32), |(l, h), &o| (l.min(o), h.max(o)));
            prop_assert!(opacity >= low - 1e-6 && opacity <= high + 1e-6);
            prop_assert!(color.cmpge(Vec3::splat(-1e-6)).all() && color.cmple(Vec3::splat(1.0 + 1e-6)).all());
        }
    }
}
