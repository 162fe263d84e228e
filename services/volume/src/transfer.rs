//! Transfer functions and their JSON file.

use std::collections::{BTreeMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};

use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use sg_input::{file, limits};

/// A one-dimensional transfer function: colour and opacity by voxel value.
///
/// All numbers except colours and opacities are in `units`. Between points, colour and opacity are linear in the *scaled*
/// value. Values are clamped to the domain, and then to the range of the points. Two points of one value make a jump:
/// the value itself takes the later point. NaN is transparent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TransferFunction {
    /// Least and greatest value; values outside are clamped.
    pub domain: [f64; 2],
    /// Unit of the values.
    #[serde(default)]
    pub units: Units,
    /// Spacing of values between points.
    #[serde(default)]
    pub scale: Scale,
    /// Name of the quantity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variable: Option<String>,
    /// Control points by increasing value.
    pub points: Vec<ControlPoint>,
    /// The editable base units. Without any, the whole volume is one base unit.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub base_units: Vec<BaseUnitRange>,
}

/// Unit of a transfer function's values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Units {
    /// The volume's own values.
    #[default]
    Raw,
    /// 0 at the volume's least finite value, 1 at its greatest.
    Normalized,
}

/// Spacing of values between control points.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// Unchanged.
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

    /// The derivative of [`Self::apply`].
    #[must_use]
    pub fn slope(self, x: f64) -> f64 {
        match self {
            Self::Linear => 1.0,
            Self::Log10 => 1.0 / (x * std::f64::consts::LN_10),
            Self::Symlog => 1.0 / ((1.0 + x.abs()) * std::f64::consts::LN_10),
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

/// The value range of one editable base unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BaseUnitRange {
    /// Name, unique in the file.
    pub name: String,
    /// Least and greatest value. The least one is inside; the greatest one too unless the next unit begins there.
    pub range: [f64; 2],
}

/// A transfer function was refused.
#[derive(Debug, thiserror::Error)]
pub enum TransferError {
    /// The file cannot be read.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The file is not the JSON of a transfer function.
    #[error("{}: {source}", .path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// The syntax error with its line and column.
        source: serde_json::Error,
    },
    /// A number is outside its range.
    #[error("{}: {problem}", .path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// The field, the error and the remedy.
        problem: Problem,
    },
}

/// A number of a transfer function is outside its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{place}: {what}; {remedy}")]
pub struct Problem {
    /// The field.
    pub place: String,
    /// The error.
    pub what: String,
    /// How to correct it.
    pub remedy: &'static str,
}

/// A transfer function from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedTransferFunction {
    /// The function, checked.
    pub function: TransferFunction,
    /// Unknown keys at the top level of the file, for a warning about misspellings.
    pub ignored_keys: Vec<String>,
}

impl LoadedTransferFunction {
    /// A line for a person for each unknown key. `path` is the file.
    pub fn notes(&self, path: &Path) -> impl Iterator<Item = String> {
        let path = path.display();
        self.ignored_keys.iter().map(move |key| format!("note: {path}: the unknown key `{key}` is ignored"))
    }
}

const KEYS: [&str; 6] = ["domain", "units", "scale", "variable", "points", "base_units"];

impl TransferFunction {
    /// Reads and checks a JSON file.
    ///
    /// # Errors
    /// [`TransferError`]: one line with the file, the line and column or the field, and a remedy.
    pub fn load(path: &Path) -> Result<LoadedTransferFunction, TransferError> {
        let io = |source| TransferError::Io { path: path.to_owned(), source };
        let json = |source| TransferError::Json { path: path.to_owned(), source };
        let text = file::read_text(path, limits::TEXT_BYTES).map_err(io)?;
        let function: Self = serde_json::from_str(&text).map_err(json)?;
        function.check().map_err(|problem| TransferError::Value { path: path.to_owned(), problem })?;
        let keys: BTreeMap<String, IgnoredAny> = serde_json::from_str(&text).map_err(json)?;
        let ignored_keys = keys.into_keys().filter(|k| !KEYS.contains(&k.as_str())).collect();
        Ok(LoadedTransferFunction { function, ignored_keys })
    }

    /// The JSON text, with a final newline. Numbers round-trip exactly.
    ///
    /// # Errors
    /// A number is not finite: JSON cannot express it.
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
        let mut names = HashSet::new();
        for (i, unit) in self.base_units.iter().enumerate() {
            let place = || format!("base_units[{i}]");
            if unit.name.trim().is_empty() {
                return problem(place(), "no name".into(), "give each base unit a name");
            }
            if !names.insert(unit.name.as_str()) {
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
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn a_file_round_trips_and_unknown_keys_are_returned() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("tf.json");
        let mut f = function(vec![point(0.1 + 0.2, 0.1, 1.0 / 3.0)]);
        f.base_units = vec![BaseUnitRange { name: "bone".into(), range: [0.1, 1e-30] }];
        f.base_units[0].range = [1e-30, 0.1];
        std::fs::write(&path, f.to_json().unwrap()).unwrap();
        assert_eq!(
            TransferFunction::load(&path).unwrap(),
            LoadedTransferFunction { function: f, ignored_keys: vec![] }
        );

        std::fs::write(&path, r#"{"domain":[0,1],"base_unit":[],"points":[{"value":0,"color":[0,0,0],"opacity":1}]}"#)
            .unwrap();
        assert_eq!(TransferFunction::load(&path).unwrap().ignored_keys, ["base_unit"]);

        std::fs::write(&path, "{\"domain\":[0,1],\n\"points\":[{\"value\":0,\"color\":[0,0],\"opacity\":1}]}").unwrap();
        let message = TransferFunction::load(&path).unwrap_err().to_string();
        assert!(message.contains("tf.json") && message.contains("line 2"), "{message}");
        std::fs::write(&path, r#"{"domain":[1,0],"points":[]}"#).unwrap();
        assert!(TransferFunction::load(&path).unwrap_err().to_string().contains("domain: [1, 0]"));
    }
}
