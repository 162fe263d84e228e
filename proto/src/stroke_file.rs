//! Stroke files: JSON lists of brush strokes, operations and walk parameters.
//!
//! ```json
//! {"strokes": [
//!   {"mode": "walk", "kind": "foreground", "radius": 0.02, "points": [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]},
//!   {"operation": "grow", "distance": 0.01},
//!   {"leak": 0.03, "threshold": 0.0}
//! ]}
//! ```
//!
//! Points are normalized to the scene's box, 0 to 1 on each axis. Lengths are fractions of the box's longest edge.
//!
//! ```
//! use sg_proto::scene::StrokeMode;
//! use sg_proto::stroke_file::{self, Limits};
//!
//! let text = r#"{"strokes": [{"mode": "walk", "kind": "foreground", "radius": 0.02, "points": [[0.1, 0.2, 0.3]]}]}"#;
//! let steps = stroke_file::parse(text, &Limits::BUS)?;
//! let stroke = stroke_file::stroke_of(&steps[0]).unwrap();
//! assert_eq!((stroke.mode(), stroke.radius), (StrokeMode::Walk, 0.02));
//! # Ok::<(), stroke_file::StrokeFileError>(())
//! ```

use std::ops::RangeInclusive;
use std::sync::LazyLock;

use prost_reflect::{DescriptorPool, DynamicMessage};
use serde::de::{Error as _, IgnoredAny};
use serde::{Deserialize, Deserializer};
use serde_json::{Map, Value, json};

use crate::limits::{MAX_STROKE_POINTS, MAX_STROKES};
use crate::scene::selection_step::Step;
use crate::scene::{SelectionOperation, SelectionStep, Stroke, StrokeDepth, StrokeKind, StrokeMode, WalkTuning};

/// How much a stroke file may hold.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// Number of entries.
    pub strokes: RangeInclusive<usize>,
    /// Most points of one stroke.
    pub points: usize,
}

impl Limits {
    /// The limits of one request on the bus.
    pub const BUS: Self = Self { strokes: 1..=MAX_STROKES, points: MAX_STROKE_POINTS };
}

/// A stroke file with a mistake. The text does not name the file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StrokeFileError {
    /// The text is not JSON of the right form. The message holds line and column.
    #[error("{0}")]
    Json(String),
    /// The file has too many entries, or too few.
    #[error("{found} strokes; there must be {} to {}", .allowed.start(), .allowed.end())]
    Count {
        /// Number of entries.
        found: usize,
        /// Allowed numbers.
        allowed: RangeInclusive<usize>,
    },
    /// A stroke has an impossible value.
    #[error("stroke {number}: {problem}")]
    Stroke {
        /// Position of the entry in the list, from 1.
        number: usize,
        /// The mistake.
        problem: StrokeProblem,
    },
}

/// An impossible value of a stroke. Points are counted from 1.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StrokeProblem {
    /// The stroke has no points, or too many.
    #[error("{found} points; there must be 1 to {most}")]
    Points {
        /// Number of points.
        found: usize,
        /// Largest number.
        most: usize,
    },
    /// A coordinate is infinite or not a number.
    #[error("point {point} is not finite")]
    NotFinite {
        /// Position of the point.
        point: usize,
    },
    /// The radius is negative or not finite.
    #[error("radius {0} must be finite and at least 0")]
    Radius(f64),
    /// A stroke other than a cluster stroke toggles.
    #[error("`toggle` works in cluster mode only; use foreground or background")]
    Toggle,
    /// The number of pressures differs from the number of points.
    #[error("{found} entries of `pressure` for {points} points; there must be one per point, or none")]
    PressureCount {
        /// Number of pressures.
        found: usize,
        /// Number of points.
        points: usize,
    },
    /// A pressure is negative or not finite.
    #[error("pressure {pressure} at point {point} must be finite and at least 0")]
    Pressure {
        /// Position of the point.
        point: usize,
        /// The pressure.
        pressure: f64,
    },
    /// The depth has a coordinate that is not finite, or a negative reach.
    #[error("`depth` needs an `eye` of finite numbers, and a finite `reach` of at least 0")]
    Depth,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StrokeFile {
    strokes: Vec<Entry>,
}

/// [`StrokeFile`] without the content of its entries. It takes no memory for them.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EntryCount {
    strokes: Vec<IgnoredAny>,
}

/// The contract's messages. They are decoded once, since each operation of a file needs them.
static POOL: LazyLock<Result<DescriptorPool, String>> =
    LazyLock::new(|| DescriptorPool::decode(crate::DESCRIPTORS).map_err(|e| e.to_string()));

/// An entry with `operation` is an operation, one with `leak` holds walk parameters, any other is a stroke.
enum Entry {
    Stroke(StrokeEntry),
    Operation(Box<SelectionOperation>),
    Tuning(TuningEntry),
}

impl<'de> Deserialize<'de> for Entry {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let map = Map::deserialize(deserializer)?;
        let entry = if map.contains_key("operation") {
            operation(map).map(|o| Self::Operation(Box::new(o)))
        } else if map.contains_key("leak") {
            serde_json::from_value(Value::Object(map)).map(Self::Tuning).map_err(|e| e.to_string())
        } else {
            serde_json::from_value(Value::Object(map)).map(Self::Stroke).map_err(|e| e.to_string())
        };
        entry.map_err(D::Error::custom)
    }
}

/// Reads an operation. Its names are those of the contract in lower case with hyphens.
fn operation(mut map: Map<String, Value>) -> Result<SelectionOperation, String> {
    let word = |value: Option<Value>, name: &str| match value {
        Some(Value::String(word)) => Ok(Some(word)),
        None => Ok(None),
        Some(_) => Err(format!("`{name}` must be a word")),
    };
    let prefixed = |prefix: &str, word: &str| format!("{prefix}{}", word.to_uppercase().replace('-', "_"));
    let kind = word(map.remove("operation"), "operation")?.unwrap_or_default();
    let combine = word(map.remove("combine"), "combine")?.unwrap_or_else(|| "unspecified".to_owned());
    if let Some(attribute) = word(map.remove("attribute"), "attribute")? {
        map.insert("attribute".to_owned(), prefixed("ATTRIBUTE_", &attribute).into());
    }
    if let Some(Value::Object(camera)) = map.remove("camera") {
        // A camera file also holds light and background. They do not change the visible region.
        map.extend(camera.into_iter().filter(|(key, _)| !["light", "background"].contains(&key.as_str())));
    }
    if let Some(Value::Array(corners)) = map.get_mut("polygon") {
        let flat = |corner: Value| if let Value::Array(xy) = corner { xy } else { vec![corner] };
        *corners = std::mem::take(corners).into_iter().flat_map(flat).collect();
    }
    let message = json!({ kind.replace('-', "_"): map, "combine": prefixed("COMBINE_", &combine) });
    let unknown = |e: &dyn std::fmt::Display| format!("operation `{kind}`: {e}");
    let pool = POOL.as_ref().map_err(|e| unknown(e))?;
    let descriptor = pool.get_message_by_name("supergaussian.scene.v1.SelectionOperation");
    let descriptor = descriptor.ok_or_else(|| unknown(&"the contract has no operations"))?;
    let message = DynamicMessage::deserialize(descriptor, message).map_err(|e| unknown(&e))?;
    message.transcode_to().map_err(|e| unknown(&e))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TuningEntry {
    leak: f64,
    threshold: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StrokeEntry {
    mode: Mode,
    kind: Kind,
    radius: f64,
    points: Vec<[f64; 3]>,
    #[serde(default)]
    pressure: Vec<f64>,
    depth: Option<DepthEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DepthEntry {
    eye: [f64; 3],
    reach: f64,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Mode {
    Walk,
    Cluster,
    Point,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Foreground,
    Background,
    Toggle,
}

/// Parses the text of a stroke file.
///
/// Operations and walk parameters are checked for their form only: the selection service knows their ranges.
///
/// # Errors
/// [`StrokeFileError`] with line and column, or with the number of the entry.
pub fn parse(text: &str, limits: &Limits) -> Result<Vec<SelectionStep>, StrokeFileError> {
    let json = |e: serde_json::Error| StrokeFileError::Json(e.to_string());
    // Entries are counted before any is read.
    let found = serde_json::from_str::<EntryCount>(text).map_err(json)?.strokes.len();
    if !limits.strokes.contains(&found) {
        return Err(StrokeFileError::Count { found, allowed: limits.strokes.clone() });
    }
    let file: StrokeFile = serde_json::from_str(text).map_err(json)?;
    let step = |(number, entry)| {
        let step = match entry {
            Entry::Stroke(entry) => {
                let stroke = stroke(entry, limits.points);
                Step::Stroke(stroke.map_err(|problem| StrokeFileError::Stroke { number, problem })?)
            }
            Entry::Operation(operation) => Step::Operation(*operation),
            Entry::Tuning(TuningEntry { leak, threshold }) => Step::Tuning(WalkTuning { leak, threshold }),
        };
        Ok(SelectionStep { step: Some(step) })
    };
    (1..).zip(file.strokes).map(step).collect()
}

/// The stroke of a step; `None` for operations and walk parameters.
#[must_use]
pub fn stroke_of(step: &SelectionStep) -> Option<&Stroke> {
    if let Some(Step::Stroke(stroke)) = &step.step { Some(stroke) } else { None }
}

fn stroke(entry: StrokeEntry, most: usize) -> Result<Stroke, StrokeProblem> {
    check(&entry, most)?;
    let mode = match entry.mode {
        Mode::Walk => StrokeMode::Walk,
        Mode::Cluster => StrokeMode::Cluster,
        Mode::Point => StrokeMode::Point,
    };
    let kind = match entry.kind {
        Kind::Foreground => StrokeKind::Foreground,
        Kind::Background => StrokeKind::Background,
        Kind::Toggle => StrokeKind::Toggle,
    };
    Ok(Stroke {
        mode: mode.into(),
        kind: kind.into(),
        radius: entry.radius,
        points: entry.points.into_iter().flatten().collect(),
        pressure: entry.pressure,
        depth: entry.depth.map(|d| StrokeDepth { eye: d.eye.to_vec(), reach: d.reach }),
    })
}

fn check(entry: &StrokeEntry, most: usize) -> Result<(), StrokeProblem> {
    let StrokeEntry { mode, kind, radius, points, pressure, depth } = entry;
    let at_least_0 = |x: f64| x >= 0.0 && x.is_finite();
    if matches!(kind, Kind::Toggle) && !matches!(mode, Mode::Cluster) {
        return Err(StrokeProblem::Toggle);
    }
    if !at_least_0(*radius) {
        return Err(StrokeProblem::Radius(*radius));
    }
    if points.is_empty() || points.len() > most {
        return Err(StrokeProblem::Points { found: points.len(), most });
    }
    if let Some(at) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        return Err(StrokeProblem::NotFinite { point: at + 1 });
    }
    if !(pressure.is_empty() || pressure.len() == points.len()) {
        return Err(StrokeProblem::PressureCount { found: pressure.len(), points: points.len() });
    }
    if let Some((at, pressure)) = pressure.iter().enumerate().find(|(_, f)| !at_least_0(**f)) {
        return Err(StrokeProblem::Pressure { point: at + 1, pressure: *pressure });
    }
    if depth.as_ref().is_some_and(|d| !(at_least_0(d.reach) && d.eye.iter().all(|x| x.is_finite()))) {
        return Err(StrokeProblem::Depth);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strokes_are_read() {
        let text = r#"{"strokes": [
            {"mode": "walk", "kind": "foreground", "radius": 0.02, "points": [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]},
            {"mode": "cluster", "kind": "toggle", "radius": 0.01, "points": [[1, 0, 0]], "pressure": [0.5],
             "depth": {"eye": [0, -3, 0], "reach": 0.01}}]}"#;
        let steps = parse(text, &Limits::BUS).unwrap();
        let strokes: Vec<_> = steps.iter().filter_map(stroke_of).collect();
        assert_eq!((steps.len(), strokes.len()), (2, 2));
        assert_eq!(strokes[0].points, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]);
        assert_eq!((&strokes[0].pressure[..], &strokes[1].pressure[..]), (&[][..], &[0.5][..]));
        let depth = StrokeDepth { eye: vec![0.0, -3.0, 0.0], reach: 0.01 };
        assert_eq!((&strokes[0].depth, &strokes[1].depth), (&None, &Some(depth)));
        assert_eq!((strokes[0].mode(), strokes[0].kind()), (StrokeMode::Walk, StrokeKind::Foreground));
        assert_eq!((strokes[1].mode(), strokes[1].kind()), (StrokeMode::Cluster, StrokeKind::Toggle));
    }

    #[test]
    fn operations_are_read() {
        use crate::scene::selection_operation::Operation;
        let text = r#"{"strokes": [
            {"operation": "grow", "distance": 0.02},
            {"operation": "fill-holes", "most": 50},
            {"leak": 0.1, "threshold": -0.5},
            {"operation": "range", "attribute": "opacity", "min": 0.5, "max": 1, "combine": "intersect"},
            {"operation": "lasso", "polygon": [[0, 0], [9, 0], [9, 9]], "far": 3,
             "camera": {"width": 64, "height": 48, "fx": 50, "fy": 50, "cx": 32, "cy": 24,
                        "world_to_camera": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1], "background": [0, 0, 0]}}]}"#;
        let steps = parse(text, &Limits::BUS).unwrap();
        assert_eq!(steps[2].step, Some(Step::Tuning(WalkTuning { leak: 0.1, threshold: -0.5 })));
        let operations: Vec<_> =
            steps.iter().filter_map(|s| if let Some(Step::Operation(o)) = &s.step { Some(o) } else { None }).collect();
        assert!(matches!(&operations[0].operation, Some(Operation::Grow(grow)) if grow.distance == 0.02));
        assert!(matches!(&operations[1].operation, Some(Operation::FillHoles(holes)) if holes.most == 50));
        assert_eq!(operations[2].combine(), crate::scene::Combine::Intersect);
        let Some(Operation::Lasso(lasso)) = operations[3].operation.clone() else { panic!("{:?}", operations[3]) };
        assert_eq!((lasso.width, lasso.far, lasso.polygon.len(), lasso.world_to_camera.len()), (64, 3.0, 6, 16));
        for (entry, part) in [
            (r#"{"operation": "grwo", "distance": 1}"#, "operation `grwo`"),
            (r#"{"operation": "grow", "far": 1}"#, "operation `grow`"),
            (r#"{"operation": "similar", "threshold": 1, "combine": "xor"}"#, "COMBINE_XOR"),
            (r#"{"operation": 5}"#, "must be a word"),
        ] {
            let said = parse(&format!("{{\"strokes\": [{entry}]}}"), &Limits::BUS).unwrap_err().to_string();
            assert!(said.contains(part) && said.contains("line 1"), "{said}");
        }
    }

    #[test]
    fn mistakes_name_the_stroke() {
        let one = |stroke: &str| format!("{{\"strokes\": [{stroke}]}}");
        for (text, expected) in [
            (one(""), "0 strokes; there must be 1 to 1000"),
            (
                one(r#"{"mode": "walk", "kind": "foreground", "radius": -1, "points": [[0, 0, 0]]}"#),
                "stroke 1: radius -1 must be finite and at least 0",
            ),
            (
                one(r#"{"mode": "walk", "kind": "foreground", "radius": 1, "points": []}"#),
                "stroke 1: 0 points; there must be 1 to 100000",
            ),
            (
                one(r#"{"mode": "point", "kind": "toggle", "radius": 1, "points": [[0, 0, 0]]}"#),
                "stroke 1: `toggle` works in cluster mode only; use foreground or background",
            ),
            (
                one(
                    r#"{"mode": "walk", "kind": "foreground", "radius": 1, "points": [[0, 0, 0]], "pressure": [1, 2]}"#,
                ),
                "stroke 1: 2 entries of `pressure` for 1 points; there must be one per point, or none",
            ),
            (
                one(r#"{"mode": "walk", "kind": "foreground", "radius": 1, "points": [[0, 0, 0]], "pressure": [-1]}"#),
                "stroke 1: pressure -1 at point 1 must be finite and at least 0",
            ),
        ] {
            assert_eq!(parse(&text, &Limits::BUS).unwrap_err().to_string(), expected);
        }
        let said = parse("{\"strokes\": [{\"mode\": \"wlak\"}]}", &Limits::BUS).unwrap_err().to_string();
        assert!(said.starts_with("unknown variant `wlak`") && said.contains("line 1 column"), "{said}");
    }
}
