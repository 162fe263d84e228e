//! Transfer functions made from others: window and level, ranges of values shown, hidden or coloured, and another scale.

use crate::transfer::{ControlPoint, Scale, TransferFunction};

/// Opacity of shown values where the whole function shows nothing.
const OPACITY: f32 = 0.5;

/// A transfer function cannot be changed as asked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AdjustError {
    /// A number is not finite, or a width is not above 0.
    #[error("{what} {value}: give a finite number{above}", above = if *.is_width { " above 0" } else { "" })]
    Number {
        /// Name of the number.
        what: &'static str,
        /// The number.
        value: f64,
        /// Whether it has to be above 0.
        is_width: bool,
    },
    /// The range has no value of the function's domain.
    #[error("no value lies {}: the transfer function goes from {least} to {greatest}", words(*.low, *.high))]
    Range {
        /// Least value asked for.
        low: f64,
        /// Greatest value asked for.
        high: f64,
        /// Least value of the domain.
        least: f64,
        /// Greatest value of the domain.
        greatest: f64,
    },
    /// Values at or below 0 have no logarithm.
    #[error("the values go down to {least}, which has no logarithm: use the scale symlog")]
    Logarithm {
        /// Least value.
        least: f64,
    },
}

/// Words for a range, of which an infinite end is no limit.
fn words(low: f64, high: f64) -> String {
    match (low.is_finite(), high.is_finite()) {
        (true, false) => format!("above {low}"),
        (false, true) => format!("below {high}"),
        _ => format!("from {low} to {high}"),
    }
}

impl TransferFunction {
    /// Level and window: the middle of the points, and the distance from the first one to the last.
    #[must_use]
    pub fn level_and_window(&self) -> (f64, f64) {
        let ends = [self.points.first(), self.points.last()].map(|point| point.map_or(0.0, |point| point.value));
        (0.5 * (ends[0] + ends[1]), ends[1] - ends[0])
    }

    /// The function with its points shifted and spread, so that it has this level and window. A function of one value, such as a
    /// single jump, has a level alone: its window stays 0.
    ///
    /// # Errors
    /// [`AdjustError::Number`], and [`AdjustError::Logarithm`] where a point would come to 0 or below it on a logarithmic scale.
    pub fn windowed(&self, level: f64, window: f64) -> Result<Self, AdjustError> {
        if !level.is_finite() {
            return Err(AdjustError::Number { what: "level", value: level, is_width: false });
        }
        if !(window.is_finite() && window >= 0.0) {
            return Err(AdjustError::Number { what: "window", value: window, is_width: true });
        }
        let (before, width) = self.level_and_window();
        let factor = if width > 0.0 { window / width } else { 1.0 };
        let moved = |point: &ControlPoint| ControlPoint { value: level + (point.value - before) * factor, ..*point };
        let function = Self { points: self.points.iter().map(moved).collect(), ..self.clone() };
        function.without_bad_logarithms()
    }

    /// The function that shows the values from `low` to just below `high` as this one does, and no others. Where this one shows none
    /// of them, they get the greatest opacity of the function (0.5 if it shows nothing at all). An infinite end is no limit.
    ///
    /// # Errors
    /// [`AdjustError::Range`] if the domain has no such value, [`AdjustError::Number`] for NaN.
    pub fn showing_only(&self, low: f64, high: f64) -> Result<Self, AdjustError> {
        let range = self.part([low, high])?;
        let mut inside = self.points_between(range);
        if inside.iter().all(|point| point.opacity == 0.0) {
            let most = self.points.iter().fold(0.0_f32, |most, point| most.max(point.opacity));
            inside.iter_mut().for_each(|point| point.opacity = if most > 0.0 { most } else { OPACITY });
        }
        let mut points = Vec::with_capacity(inside.len() + 2);
        if low > self.domain[0] {
            points.extend(inside.first().map(|point| ControlPoint { opacity: 0.0, ..*point }));
        }
        points.append(&mut inside);
        if high < self.domain[1] {
            let last = points.last().map(|point| ControlPoint { opacity: 0.0, ..*point });
            points.extend(last);
        }
        Ok(Self { points, ..self.clone() })
    }

    /// The function that hides the values from `low` to just below `high`, and shows others as this one does. An infinite end is no
    /// limit.
    ///
    /// # Errors
    /// As [`Self::showing_only`].
    pub fn hiding(&self, low: f64, high: f64) -> Result<Self, AdjustError> {
        self.replaced([low, high], |point| point.opacity = 0.0)
    }

    /// The function that gives the values from `low` to just below `high` this colour, RGB 0 to 1. An infinite end is no limit.
    ///
    /// # Errors
    /// As [`Self::showing_only`].
    pub fn colored(&self, low: f64, high: f64, color: [f32; 3]) -> Result<Self, AdjustError> {
        self.replaced([low, high], |point| point.color = color)
    }

    /// The function with another spacing of values between its points, which stay.
    ///
    /// # Errors
    /// [`AdjustError::Logarithm`] for values at or below 0.
    pub fn scaled(&self, scale: Scale) -> Result<Self, AdjustError> {
        Self { scale, ..self.clone() }.without_bad_logarithms()
    }

    fn without_bad_logarithms(self) -> Result<Self, AdjustError> {
        let least = self.points.first().map_or(self.domain[0], |point| point.value.min(self.domain[0]));
        if self.scale == Scale::Log10 && least <= 0.0 { Err(AdjustError::Logarithm { least }) } else { Ok(self) }
    }

    /// The part of a range within the domain.
    fn part(&self, [low, high]: [f64; 2]) -> Result<[f64; 2], AdjustError> {
        for (what, value) in [("least value", low), ("greatest value", high)] {
            if value.is_nan() {
                return Err(AdjustError::Number { what, value, is_width: false });
            }
        }
        let [least, greatest] = self.domain;
        let part = [low.max(least), high.min(greatest)];
        if part[0] < part[1] { Ok(part) } else { Err(AdjustError::Range { low, high, least, greatest }) }
    }

    /// The points of a range with one at each end.
    fn points_between(&self, [low, high]: [f64; 2]) -> Vec<ControlPoint> {
        let mut points = vec![self.point_at(low, Side::Above)];
        points.extend(self.points.iter().filter(|point| low < point.value && point.value < high));
        points.push(self.point_at(high, Side::Below));
        points
    }

    /// The function with changed points in a range, and jumps at its ends.
    fn replaced(&self, range: [f64; 2], change: impl Fn(&mut ControlPoint)) -> Result<Self, AdjustError> {
        let [low, high] = self.part(range)?;
        let mut points = Vec::with_capacity(self.points.len() + 4);
        if range[0] > self.domain[0] {
            points.extend(self.points.iter().filter(|point| point.value < low));
            points.push(self.point_at(low, Side::Below));
        }
        let mut inside = self.points_between([low, high]);
        inside.iter_mut().for_each(change);
        points.append(&mut inside);
        if range[1] < self.domain[1] {
            points.push(self.point_at(high, Side::Above));
            points.extend(self.points.iter().filter(|point| high < point.value));
        }
        Ok(Self { points, ..self.clone() })
    }

    /// The look on one side of a value, as a control point there.
    fn point_at(&self, value: f64, side: Side) -> ControlPoint {
        let before = match side {
            Side::Below => self.points.partition_point(|point| point.value < value),
            Side::Above => self.points.partition_point(|point| point.value <= value),
        };
        let (left, right) = (before.checked_sub(1).and_then(|i| self.points.get(i)), self.points.get(before));
        let look = match (left, right) {
            (Some(left), Some(right)) => {
                let [a, b, x] = [left.value, right.value, value].map(|x| self.scale.apply(x));
                let t = if b > a { ((x - a) / (b - a)).clamp(0.0, 1.0) as f32 } else { 0.0 };
                let mix = |a: f32, b: f32| a + (b - a) * t;
                let color = std::array::from_fn(|i| mix(left.color[i], right.color[i]));
                ControlPoint { color, opacity: mix(left.opacity, right.opacity), ..*left }
            }
            (Some(only), None) | (None, Some(only)) => *only,
            (None, None) => ControlPoint { value, color: [1.0; 3], opacity: 0.0 },
        };
        ControlPoint { value, ..look }
    }
}

/// A side of a value at which two points may make a jump.
#[derive(Debug, Clone, Copy)]
enum Side {
    Below,
    Above,
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;

    use super::*;
    use crate::scalars::ValueRange;
    use crate::transfer::Units;

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

    fn ramp() -> TransferFunction {
        function(vec![point(20.0, 0.5, 0.0), point(40.0, 0.5, 0.5), point(60.0, 0.5, 1.0)])
    }

    fn look(function: &TransferFunction, value: f64) -> (Vec3, f32) {
        let values = ValueRange { low: 0.0, high: 100.0, non_finite: 0 };
        function.classifier(values).unwrap().evaluate(value)
    }

    fn values(function: &TransferFunction) -> Vec<f64> {
        function.points.iter().map(|point| point.value).collect()
    }

    #[test]
    fn window_and_level_move_all_points() {
        assert_eq!(ramp().level_and_window(), (40.0, 40.0));
        let wide = ramp().windowed(50.0, 80.0).unwrap();
        assert_eq!(values(&wide), [10.0, 50.0, 90.0]);
        assert_eq!(wide.level_and_window(), (50.0, 80.0));
        // A jump has a level alone.
        let jump = ramp().windowed(50.0, 0.0).unwrap();
        assert_eq!(values(&jump.windowed(30.0, 10.0).unwrap()), [30.0; 3]);
        assert!(ramp().windowed(f64::NAN, 1.0).is_err());
        assert!(ramp().windowed(1.0, -1.0).is_err());
        let logarithmic = TransferFunction { domain: [1.0, 100.0], scale: Scale::Log10, ..ramp() };
        assert_eq!(logarithmic.windowed(40.0, 100.0), Err(AdjustError::Logarithm { least: -10.0 }));
    }

    #[test]
    fn only_a_range_is_shown() {
        let cut = ramp().showing_only(30.0, 50.0).unwrap();
        assert!(cut.check().is_ok());
        for (value, opacity) in
            [(10.0, 0.0), (29.9, 0.0), (30.0, 0.25), (40.0, 0.5), (49.9, 0.7475), (50.0, 0.0), (90.0, 0.0)]
        {
            assert!((look(&cut, value).1 - opacity).abs() < 2e-3, "{value}: {}", look(&cut, value).1);
        }
        // Above a value: no end.
        let above = ramp().showing_only(50.0, f64::INFINITY).unwrap();
        assert_eq!((look(&above, 49.0).1, look(&above, 90.0).1), (0.0, 1.0));
        // Values without opacity get that of the function.
        assert_eq!(look(&ramp().showing_only(5.0, 15.0).unwrap(), 10.0).1, 1.0);
        let nothing = function(vec![point(0.0, 1.0, 0.0)]);
        assert_eq!(look(&nothing.showing_only(5.0, 15.0).unwrap(), 10.0).1, OPACITY);
    }

    #[test]
    fn a_range_is_hidden_or_coloured() {
        let hidden = ramp().hiding(30.0, 50.0).unwrap();
        assert!(hidden.check().is_ok());
        for (value, opacity) in [(25.0, 0.125), (30.0, 0.0), (45.0, 0.0), (50.0, 0.75), (60.0, 1.0)] {
            assert!((look(&hidden, value).1 - opacity).abs() < 2e-3, "{value}: {}", look(&hidden, value).1);
        }
        let colored = ramp().colored(f64::NEG_INFINITY, 30.0, [1.0, 0.0, 0.0]).unwrap();
        assert!(colored.check().is_ok());
        assert_eq!(look(&colored, 25.0).0, Vec3::X);
        assert_eq!(look(&colored, 35.0).0, Vec3::splat(0.5));
        assert!((look(&colored, 25.0).1 - 0.125).abs() < 2e-3);
    }

    #[test]
    fn ranges_outside_the_domain_are_refused() {
        for (low, high) in [(200.0, f64::INFINITY), (f64::NEG_INFINITY, -1.0), (50.0, 50.0), (60.0, 40.0)] {
            assert!(matches!(ramp().showing_only(low, high), Err(AdjustError::Range { .. })), "{low} {high}");
            assert!(ramp().hiding(low, high).is_err());
        }
        let message = ramp().hiding(200.0, 300.0).unwrap_err().to_string();
        assert_eq!(message, "no value lies from 200 to 300: the transfer function goes from 0 to 100");
        let above = ramp().hiding(200.0, f64::INFINITY).unwrap_err().to_string();
        assert_eq!(above, "no value lies above 200: the transfer function goes from 0 to 100");
        assert!(ramp().hiding(f64::NAN, 3.0).is_err());
    }

    #[test]
    fn scales_keep_the_points() {
        let positive = TransferFunction { domain: [1.0, 100.0], ..ramp() };
        let logarithmic = positive.scaled(Scale::Log10).unwrap();
        assert_eq!(values(&logarithmic), values(&positive));
        assert!((look(&logarithmic, 800.0_f64.sqrt()).1 - 0.25).abs() < 2e-3);
        assert_eq!(ramp().scaled(Scale::Log10), Err(AdjustError::Logarithm { least: 0.0 }));
        assert!(ramp().scaled(Scale::Symlog).is_ok());
    }

    proptest! {
        #[test]
        fn looks_inside_and_outside_a_range_stay(
            mut at in prop::collection::vec((0.0_f64..100.0, 0.0_f32..=1.0, 0.01_f32..=1.0), 1..6),
            ends in (0.0_f64..100.0, 0.0_f64..100.0),
            value in 0.0_f64..100.0,
            symlog in any::<bool>(),
        ) {
            at.sort_by(|a, b| a.0.total_cmp(&b.0));
            let points = at.iter().map(|&(value, gray, opacity)| point(value, gray, opacity)).collect();
            let scale = if symlog { Scale::Symlog } else { Scale::Linear };
            let function = TransferFunction { scale, ..function(points) };
            let (low, high) = (ends.0.min(ends.1), ends.0.max(ends.1));
            // A step of the classifier's table from a jump may lie on either side of it.
            prop_assume!(high - low > 0.5 && (value - low).abs() > 0.1 && (value - high).abs() > 0.1);
            let inside = low < value && value < high;
            let before = look(&function, value);
            let changed = [
                (function.showing_only(low, high).unwrap(), if inside { before } else { (before.0, 0.0) }),
                (function.hiding(low, high).unwrap(), if inside { (before.0, 0.0) } else { before }),
                (function.colored(low, high, [1.0, 0.0, 0.0]).unwrap(), if inside { (Vec3::X, before.1) } else { before }),
            ];
            for (k, (after, expected)) in changed.iter().enumerate() {
                prop_assert!(after.check().is_ok());
                let found = look(after, value);
                prop_assert!((found.1 - expected.1).abs() < 2e-3, "{k}: {found:?} instead of {expected:?}");
                if expected.1 > 0.0 {
                    prop_assert!(found.0.abs_diff_eq(expected.0, 2e-3), "{k}: {found:?} instead of {expected:?}");
                }
            }
        }
    }
}
