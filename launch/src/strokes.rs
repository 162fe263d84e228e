//! Files of brush strokes and other steps of a selection (JSON).

use std::path::{Path, PathBuf};

use prost_reflect::{DescriptorPool, DynamicMessage};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use serde_json::{Map, Value, json};
use sg_proto::limits::{MAX_STROKE_POINTS, MAX_STROKES};
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::{SelectionOperation, SelectionStep, Stroke, StrokeDepth, StrokeKind, StrokeMode, WalkTuning};

/// A file of strokes that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {problem}", .file.display())]
pub struct StrokesError {
    /// The file.
    pub file: PathBuf,
    /// What is wrong with it and where.
    pub problem: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StrokesFile {
    strokes: Vec<Entry>,
}

/// A stroke, an operation (the entry with `operation`), or what the walk is done with (the entry with `leak`).
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

/// The message of an operation, from how people write it: the names of the contract in small letters with hyphens.
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
        // A camera file holds light and background too, which say nothing about what it sees.
        map.extend(camera.into_iter().filter(|(key, _)| !["light", "background"].contains(&key.as_str())));
    }
    if let Some(Value::Array(corners)) = map.get_mut("polygon") {
        let flat = |corner: Value| if let Value::Array(xy) = corner { xy } else { vec![corner] };
        *corners = std::mem::take(corners).into_iter().flat_map(flat).collect();
    }
    let message = json!({ kind.replace('-', "_"): map, "combine": prefixed("COMBINE_", &combine) });
    let unknown = |e: &dyn std::fmt::Display| format!("operation `{kind}`: {e}");
    let pool = DescriptorPool::decode(sg_proto::DESCRIPTORS).map_err(|e| unknown(&e))?;
    let descriptor = pool.get_message_by_name("supergaussian.scene.v1.SelectionOperation");
    let descriptor = descriptor.ok_or_else(|| unknown(&"the contract knows no operations"))?;
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
    behind: f64,
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

/// Reads the text of a file of strokes: points normalized to the scene's box, radii as fractions of its longest edge.
///
/// # Errors
/// [`StrokesError`] with line and column, or the number of the entry, counted from 1.
pub fn parse(file: &Path, text: &str) -> Result<Vec<SelectionStep>, StrokesError> {
    let fail = |problem: String| StrokesError { file: file.to_owned(), problem };
    let read: StrokesFile = serde_json::from_str(text).map_err(|e| fail(e.to_string()))?;
    if read.strokes.is_empty() || read.strokes.len() > MAX_STROKES {
        return Err(fail(format!("{} strokes; there must be 1 to {MAX_STROKES}", read.strokes.len())));
    }
    read.strokes
        .into_iter()
        .enumerate()
        .map(|(i, entry)| {
            let step = match entry {
                Entry::Stroke(stroke) => message(stroke).map(Step::Stroke),
                Entry::Operation(operation) => Ok(Step::Operation(*operation)),
                // Whether a walk can be done with these is the selection's to say.
                Entry::Tuning(TuningEntry { leak, threshold }) => Ok(Step::Tuning(WalkTuning { leak, threshold })),
            };
            let step = step.map_err(|problem| fail(format!("stroke {}: {problem}", i + 1)))?;
            Ok(SelectionStep { step: Some(step) })
        })
        .collect()
}

/// The stroke that a step is, if it is one.
#[must_use]
pub fn stroke_of(step: &SelectionStep) -> Option<&Stroke> {
    if let Some(Step::Stroke(stroke)) = &step.step { Some(stroke) } else { None }
}

fn message(stroke: StrokeEntry) -> Result<Stroke, String> {
    if stroke.points.is_empty() || stroke.points.len() > MAX_STROKE_POINTS {
        return Err(format!("{} points; there must be 1 to {MAX_STROKE_POINTS}", stroke.points.len()));
    }
    if !(stroke.radius > 0.0 && stroke.radius.is_finite()) {
        return Err(format!("radius {} must be above 0", stroke.radius));
    }
    if matches!(stroke.kind, Kind::Toggle) && !matches!(stroke.mode, Mode::Cluster) {
        return Err("only a cluster stroke can toggle".to_owned());
    }
    if !(stroke.pressure.is_empty() || stroke.pressure.len() == stroke.points.len()) {
        let (found, points) = (stroke.pressure.len(), stroke.points.len());
        return Err(format!("{found} entries of `pressure` for {points} points; there must be one a point, or none"));
    }
    if let Some(factor) = stroke.pressure.iter().find(|f| !(**f >= 0.0 && f.is_finite())) {
        return Err(format!("a pressure of {factor} must be finite and at least 0"));
    }
    let points: Vec<f64> = stroke.points.into_iter().flatten().collect();
    if stroke
        .depth
        .as_ref()
        .is_some_and(|d| !(d.behind >= 0.0 && d.behind.is_finite() && d.eye.iter().all(|x| x.is_finite())))
    {
        return Err("a `depth` has an `eye` of finite numbers and at least 0 `behind` it".to_owned());
    }
    if points.iter().any(|x| !x.is_finite()) {
        return Err("a point is not finite".to_owned());
    }
    let mode = match stroke.mode {
        Mode::Walk => StrokeMode::Walk,
        Mode::Cluster => StrokeMode::Cluster,
        Mode::Point => StrokeMode::Point,
    };
    let kind = match stroke.kind {
        Kind::Foreground => StrokeKind::Foreground,
        Kind::Background => StrokeKind::Background,
        Kind::Toggle => StrokeKind::Toggle,
    };
    let (radius, pressure) = (stroke.radius, stroke.pressure);
    let depth = stroke.depth.map(|d| StrokeDepth { eye: d.eye.to_vec(), behind: d.behind });
    Ok(Stroke { mode: mode.into(), kind: kind.into(), radius, points, pressure, depth })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strokes_are_read() {
        let text = r#"{"strokes": [
            {"mode": "walk", "kind": "foreground", "radius": 0.02, "points": [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]},
            {"mode": "cluster", "kind": "toggle", "radius": 0.01, "points": [[1, 0, 0]], "pressure": [0.5],
             "depth": {"eye": [0, -3, 0], "behind": 0.01}}]}"#;
        let steps = parse(Path::new("a.json"), text).unwrap();
        let strokes: Vec<_> = steps.iter().filter_map(stroke_of).collect();
        assert_eq!((steps.len(), strokes.len()), (2, 2));
        assert_eq!(strokes[0].points, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]);
        assert_eq!((&strokes[0].pressure[..], &strokes[1].pressure[..]), (&[][..], &[0.5][..]));
        let depth = StrokeDepth { eye: vec![0.0, -3.0, 0.0], behind: 0.01 };
        assert_eq!((&strokes[0].depth, &strokes[1].depth), (&None, &Some(depth)));
        assert_eq!((strokes[0].mode(), strokes[0].kind()), (StrokeMode::Walk, StrokeKind::Foreground));
        assert_eq!((strokes[1].mode(), strokes[1].kind()), (StrokeMode::Cluster, StrokeKind::Toggle));
    }

    #[test]
    fn operations_are_read() {
        use sg_proto::scene::selection_operation::Operation;
        let text = r#"{"strokes": [
            {"operation": "grow", "distance": 0.02},
            {"operation": "fill-holes", "most": 50},
            {"leak": 0.1, "threshold": -0.5},
            {"operation": "range", "attribute": "opacity", "min": 0.5, "max": 1, "combine": "intersect"},
            {"operation": "lasso", "polygon": [[0, 0], [9, 0], [9, 9]], "far": 3,
             "camera": {"width": 64, "height": 48, "fx": 50, "fy": 50, "cx": 32, "cy": 24,
                        "world_to_camera": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1], "background": [0, 0, 0]}}]}"#;
        let steps = parse(Path::new("a.json"), text).unwrap();
        assert_eq!(steps[2].step, Some(Step::Tuning(WalkTuning { leak: 0.1, threshold: -0.5 })));
        let operations: Vec<_> =
            steps.iter().filter_map(|s| if let Some(Step::Operation(o)) = &s.step { Some(o) } else { None }).collect();
        assert!(matches!(&operations[0].operation, Some(Operation::Grow(grow)) if grow.distance == 0.02));
        assert!(matches!(&operations[1].operation, Some(Operation::FillHoles(holes)) if holes.most == 50));
        assert_eq!(operations[2].combine(), sg_proto::scene::Combine::Intersect);
        let Some(Operation::Lasso(lasso)) = operations[3].operation.clone() else { panic!("{:?}", operations[3]) };
        assert_eq!((lasso.width, lasso.far, lasso.polygon.len(), lasso.world_to_camera.len()), (64, 3.0, 6, 16));
        for (entry, part) in [
            (r#"{"operation": "grwo", "distance": 1}"#, "operation `grwo`"),
            (r#"{"operation": "grow", "far": 1}"#, "operation `grow`"),
            (r#"{"operation": "similar", "threshold": 1, "combine": "xor"}"#, "COMBINE_XOR"),
            (r#"{"operation": 5}"#, "must be a word"),
        ] {
            let said = parse(Path::new("a.json"), &format!("{{\"strokes\": [{entry}]}}")).unwrap_err().to_string();
            assert!(said.contains(part) && said.contains("line 1"), "{said}");
        }
    }

    #[test]
    fn mistakes_name_the_file_and_the_stroke() {
        let one = |stroke: &str| format!("{{\"strokes\": [{stroke}]}}");
        for (text, expected) in [
            (one(""), "a.json: 0 strokes; there must be 1 to 1000"),
            (
                one(r#"{"mode": "walk", "kind": "foreground", "radius": 0, "points": [[0, 0, 0]]}"#),
                "a.json: stroke 1: radius 0 must be above 0",
            ),
            (
                one(r#"{"mode": "walk", "kind": "foreground", "radius": 1, "points": []}"#),
                "a.json: stroke 1: 0 points; there must be 1 to 100000",
            ),
            (
                one(r#"{"mode": "point", "kind": "toggle", "radius": 1, "points": [[0, 0, 0]]}"#),
                "a.json: stroke 1: only a cluster stroke can toggle",
            ),
            (
                one(
                    r#"{"mode": "walk", "kind": "foreground", "radius": 1, "points": [[0, 0, 0]], "pressure": [1, 2]}"#,
                ),
                "a.json: stroke 1: 2 entries of `pressure` for 1 points; there must be one a point, or none",
            ),
            (
                one(r#"{"mode": "walk", "kind": "foreground", "radius": 1, "points": [[0, 0, 0]], "pressure": [-1]}"#),
                "a.json: stroke 1: a pressure of -1 must be finite and at least 0",
            ),
        ] {
            assert_eq!(parse(Path::new("a.json"), &text).unwrap_err().to_string(), expected);
        }
        let said = parse(Path::new("a.json"), "{\"strokes\": [{\"mode\": \"wlak\"}]}").unwrap_err().to_string();
        assert!(said.starts_with("a.json: unknown variant `wlak`") && said.contains("line 1 column"), "{said}");
    }
}
