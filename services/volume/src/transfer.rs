//! Transfer functions: from a voxel's value to a colour and an opacity, and to the base unit it belongs to.

use std::io;
use std::path::{Path, PathBuf};

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::scalars::ValueRange;

/// Opacities at and above this count as this when they are turned into an extinction, which would be infinite at 1.
pub const MAX_OPACITY: f32 = 0.999_999;

/// A one-dimensional transfer function as it stands in its JSON file.
///
/// All numbers but colours and opacities are in the file's `units`. Between points the colour and the opacity are linear
/// in the *scaled* value; values outside the domain count as its ends, values outside the points as the first or last one.
/// Two points of one value make a jump: the value itself takes the later point. NaN is transparent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TransferFunction {
    /// Least and greatest value that is told apart.
    pub domain: [f64; 2],
    /// What the numbers are in.
    #[serde(default)]
    pub units: Units,
    /// How values are spaced between points.
    #[serde(default)]
    pub scale: Scale,
    /// Name of the quantity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variable: Option<String>,
    /// Control points by increasing value.
    pub points: Vec<ControlPoint>,
    /// The editable base units; without any the whole volume is one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub base_units: Vec<BaseUnitRange>,
}

/// What a transfer function's numbers are in.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Units {
    /// The volume's own values.
    #[default]
    Raw,
    /// 0 at the volume's least finite value, 1 at its greatest.
    Normalized,
}

/// How values are spaced between control points.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// As they are.
    #[default]
    Linear,
    /// By log₁₀ x; the domain lies above 0.
    Log10,
    /// By sign(x)·log₁₀(1 + |x|): linear around 0, logarithmic far from it, for both signs.
    Symlog,
}

impl Scale {
    /// The scaled value.
    #[must_use]
    pub fn apply(self, x: f64) -> f64 {
        match self {
            Self::Linear => x,
            Self::Log10 => x.log10(),
            Self::Symlog => x.signum() * x.abs().ln_1p() / std::f64::consts::LN_10,
        }
    }
}

/// Colour and opacity at one value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ControlPoint {
    /// The value, in the file's units.
    pub value: f64,
    /// RGB, 0 to 1.
    pub color: [f32; 3],
    /// Opacity of one reference length (1/256 of the volume's diagonal), 0 to 1.
    pub opacity: f32,
}

/// The values that make one editable base unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BaseUnitRange {
    /// Its name, unique in the file.
    pub name: String,
    /// Least and greatest value. The least one is inside; the greatest one too unless the next unit begins there.
    pub range: [f64; 2],
}

/// Why a transfer function is refused.
#[derive(Debug, thiserror::Error)]
pub enum TransferError {
    /// The file can't be read.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file is not the JSON of a transfer function.
    #[error("{}: {source}", .path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What and where (line and column).
        source: serde_json::Error,
    },
    /// A number makes no sense.
    #[error("{}: {problem}", .path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// What is wrong, where and what to do.
        problem: Problem,
    },
}

/// What is wrong with the numbers of a transfer function.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{place}: {what}; {remedy}")]
pub struct Problem {
    /// The field.
    pub place: String,
    /// What is wrong with it.
    pub what: String,
    /// What to do.
    pub remedy: &'static str,
}

/// A transfer function that was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// The function, checked.
    pub function: TransferFunction,
    /// Keys at the top of the file that mean nothing here: perhaps a misspelling worth a word.
    pub ignored_keys: Vec<String>,
}

const KEYS: [&str; 6] = ["domain", "units", "scale", "variable", "points", "base_units"];
/// Longest file.
const MAX_BYTES: u64 = 16 << 20;

impl TransferFunction {
    /// Reads and checks a JSON file.
    ///
    /// # Errors
    /// [`TransferError`]: one line with the file, the line and column or the field, and what to do.
    pub fn load(path: &Path) -> Result<Loaded, TransferError> {
        let io = |source| TransferError::Io { path: path.to_owned(), source };
        let json = |source| TransferError::Json { path: path.to_owned(), source };
        let size = std::fs::metadata(path).map_err(io)?.len();
        if size > MAX_BYTES {
            let what = format!("{size} bytes are more than the {MAX_BYTES} a transfer function may have");
            return Err(io(io::Error::new(io::ErrorKind::InvalidData, what)));
        }
        let text = std::fs::read_to_string(path).map_err(io)?;
        let function: Self = serde_json::from_str(&text).map_err(json)?;
        function.check().map_err(|problem| TransferError::Value { path: path.to_owned(), problem })?;
        let keys: serde_json::Map<String, serde_json::Value> = serde_json::from_str(&text).map_err(json)?;
        let ignored_keys = keys.into_iter().map(|(k, _)| k).filter(|k| !KEYS.contains(&k.as_str())).collect();
        Ok(Loaded { function, ignored_keys })
    }

    /// The JSON text, with a final newline. Numbers round-trip exactly.
    ///
    /// # Errors
    /// Where a number is not finite: JSON has no word for it.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }

    /// Checks every number.
    ///
    /// # Errors
    /// The first [`Problem`].
    pub fn check(&self) -> Result<(), Problem> {
        let problem = |place: String, what: String, remedy| Err(Problem { place, what, remedy });
        let [low, high] = self.domain;
        if !(low.is_finite() && high.is_finite() && low < high) {
            return problem("domain".into(), format!("[{low}, {high}]"), "give two finite numbers, the least first");
        }
        let positive = |x: f64| self.scale != Scale::Log10 || x > 0.0;
        if !positive(low) {
            return problem(
                "domain".into(),
                format!("{low} has no logarithm"),
                "start above 0 or use scale \"symlog\"",
            );
        }
        if self.points.is_empty() {
            return problem("points".into(), "no control point".into(), "give at least one");
        }
        for (i, p) in self.points.iter().enumerate() {
            let place = || format!("points[{i}]");
            if !p.value.is_finite() || !positive(p.value) {
                return problem(place(), format!("value {}", p.value), "give a finite value (above 0 for log10)");
            }
            let unit = |x: &f32| (0.0..=1.0).contains(x);
            if !p.color.iter().all(unit) {
                return problem(place(), format!("color {:?}", p.color), "give red, green and blue from 0 to 1");
            }
            if !unit(&p.opacity) {
                return problem(place(), format!("opacity {}", p.opacity), "give an opacity from 0 to 1");
            }
            if i > 0 && self.points[i - 1].value > p.value {
                let what = format!("value {} after {}", p.value, self.points[i - 1].value);
                return problem(place(), what, "order the points by value");
            }
        }
        for (i, unit) in self.base_units.iter().enumerate() {
            let place = || format!("base_units[{i}]");
            if unit.name.trim().is_empty() {
                return problem(place(), "no name".into(), "give each base unit a name");
            }
            if self.base_units[..i].iter().any(|u| u.name == unit.name) {
                return problem(
                    place(),
                    format!("name \"{}\" is taken", unit.name),
                    "give each base unit its own name",
                );
            }
            let [low, high] = unit.range;
            if !(low.is_finite() && high.is_finite() && low <= high) {
                return problem(place(), format!("range [{low}, {high}]"), "give two finite numbers, the least first");
            }
        }
        Ok(())
    }

    /// Makes the function ready for the values of one volume, whose finite range normalized units refer to.
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
        Ok(Classifier {
            shift,
            factor,
            domain: self.domain,
            scale: self.scale,
            knots: self.points.iter().map(|p| self.scale.apply(p.value)).collect(),
            samples: self.points.iter().map(|p| (Vec3::from_array(p.color), p.opacity)).collect(),
            units: self.base_units.iter().map(|u| u.range.map(|x| self.scale.apply(self.clamp(x)))).collect(),
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
    units: Vec<[f64; 2]>,
}

/// Which base unit a value belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnitOf {
    /// Index into the transfer function's base units (0 where it names none).
    pub unit: usize,
    /// Whether the value lies in that unit's range; else the unit is the nearest one.
    pub inside: bool,
}

impl Classifier {
    /// Colour and opacity (per reference length) of a raw value; transparent black for NaN.
    #[must_use]
    pub fn evaluate(&self, raw: f64) -> (Vec3, f32) {
        if raw.is_nan() {
            return (Vec3::ZERO, 0.0);
        }
        let x = self.scaled(raw);
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

    /// The base unit of a raw value: the first one in the file whose range holds it (a border shared by two belongs to the
    /// one that begins there), else the nearest one in scaled values. NaN counts as the first unit's, outside.
    #[must_use]
    pub fn unit(&self, raw: f64) -> UnitOf {
        if self.units.is_empty() {
            return UnitOf { unit: 0, inside: !raw.is_nan() };
        }
        if raw.is_nan() {
            return UnitOf { unit: 0, inside: false };
        }
        let x = self.scaled(raw);
        let mut best = (0, f64::INFINITY);
        for (i, &[low, high]) in self.units.iter().enumerate() {
            let distance = (low - x).max(x - high).max(0.0);
            // A shared border belongs to the unit that begins there.
            let begins_here = distance == 0.0 && low == x && best.1 == 0.0 && self.units[best.0][1] == x;
            if distance < best.1 || begins_here {
                best = (i, distance);
            }
        }
        UnitOf { unit: best.0, inside: best.1 == 0.0 }
    }

    fn scaled(&self, raw: f64) -> f64 {
        let x = (raw - self.shift) * self.factor;
        // An infinite value times a factor of 0 is NaN; clamp would pass it on.
        let x = if x.is_nan() { self.domain[0] } else { x };
        self.scale.apply(x.clamp(self.domain[0], self.domain[1]))
    }
}

/// Opacity over `step` of a medium with `opacity` over `reference`: 1 − (1 − a)^(step/reference).
///
/// Computed through logarithms in f64: the direct form loses every digit of an opacity below 1e-8.
#[must_use]
pub fn correct_opacity(opacity: f64, step: f64, reference: f64) -> f64 {
    let ratio = step / reference;
    if !(opacity > 0.0 && ratio > 0.0) {
        return 0.0;
    }
    -((-opacity.min(1.0)).ln_1p() * ratio).exp_m1()
}

/// Extinction per length of a medium with `opacity` over `reference`, finite also at opacity 1 (see [`MAX_OPACITY`]).
#[must_use]
pub fn extinction(opacity: f32, reference: f64) -> f32 {
    (-f64::from(-opacity.clamp(0.0, MAX_OPACITY)).ln_1p() / reference) as f32
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

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
        assert_eq!(c.unit(f64::NAN), UnitOf { unit: 0, inside: false });
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
    fn units_share_borders_and_take_what_lies_between() {
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

    #[test]
    fn every_bad_number_is_named() {
        let good = function(vec![point(10.0, 0.0, 0.0), point(20.0, 1.0, 0.5)]);
        assert!(good.check().is_ok());
        type Change = fn(&mut TransferFunction);
        let cases: [(&str, Change); 10] = [
            ("domain", |f| f.domain = [5.0, 5.0]),
            ("domain", |f| f.scale = Scale::Log10),
            ("points", |f| f.points.clear()),
            ("points[0]", |f| f.points[0].value = f64::NAN),
            ("points[1]", |f| f.points[1].value = 9.0),
            ("points[1]", |f| f.points[1].opacity = 1.5),
            ("points[0]", |f| f.points[0].color[2] = -0.1),
            ("base_units[0]", |f| f.base_units = vec![BaseUnitRange { name: " ".into(), range: [0.0, 1.0] }]),
            ("base_units[0]", |f| f.base_units = vec![BaseUnitRange { name: "a".into(), range: [2.0, 1.0] }]),
            ("base_units[1]", |f| f.base_units = vec![BaseUnitRange { name: "a".into(), range: [0.0, 1.0] }; 2]),
        ];
        for (place, change) in cases {
            let mut f = good.clone();
            change(&mut f);
            assert_eq!(f.check().unwrap_err().place, place, "{f:?}");
        }
    }

    #[test]
    fn a_file_round_trips_and_strangers_are_told() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("tf.json");
        let mut f = function(vec![point(0.1 + 0.2, 0.1, 1.0 / 3.0)]);
        f.base_units = vec![BaseUnitRange { name: "bone".into(), range: [0.1, 1e-30] }];
        f.base_units[0].range = [1e-30, 0.1];
        std::fs::write(&path, f.to_json().unwrap()).unwrap();
        assert_eq!(TransferFunction::load(&path).unwrap(), Loaded { function: f, ignored_keys: vec![] });

        std::fs::write(&path, r#"{"domain":[0,1],"base_unit":[],"points":[{"value":0,"color":[0,0,0],"opacity":1}]}"#)
            .unwrap();
        assert_eq!(TransferFunction::load(&path).unwrap().ignored_keys, ["base_unit"]);

        std::fs::write(&path, "{\"domain\":[0,1],\n\"points\":[{\"value\":0,\"color\":[0,0],\"opacity\":1}]}").unwrap();
        let message = TransferFunction::load(&path).unwrap_err().to_string();
        assert!(message.contains("tf.json") && message.contains("line 2"), "{message}");
        std::fs::write(&path, r#"{"domain":[1,0],"points":[]}"#).unwrap();
        assert!(TransferFunction::load(&path).unwrap_err().to_string().contains("domain: [1, 0]"));
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

        #[test]
        fn two_steps_compose_to_their_sum(a in 0.0..=1.0_f64, s in 0.0..3.0_f64, t in 0.0..3.0_f64) {
            let transmit = |step| 1.0 - correct_opacity(a, step, 1.5);
            prop_assert!((transmit(s) * transmit(t) - transmit(s + t)).abs() < 1e-12);
            prop_assert!((0.0..=1.0).contains(&correct_opacity(a, s, 1.5)));
            prop_assert!((correct_opacity(a, 1.5, 1.5) - a).abs() < 1e-12);
        }

        #[test]
        fn tiny_opacities_keep_their_digits(exponent in -15.0..-9.0_f64) {
            let a = 10.0_f64.powf(exponent);
            let exact = a / 2.0 + a * a / 8.0;
            let direct = 1.0 - (1.0 - a).powf(0.5);
            prop_assert!((correct_opacity(a, 0.5, 1.0) / exact - 1.0).abs() < 1e-12);
            // The direct form rounds 1 − a to 2⁻⁵³ and keeps almost nothing at 1e-15.
            prop_assert!(exponent > -14.0 || (direct / exact - 1.0).abs() > 1e-6);
        }

        #[test]
        fn extinction_and_correction_agree(a in 0.0..0.99_f32, step in 0.01..3.0_f64) {
            let through = 1.0 - (-f64::from(extinction(a, 1.7)) * step).exp();
            prop_assert!((through - correct_opacity(f64::from(a), step, 1.7)).abs() < 1e-5);
        }
    }
}
