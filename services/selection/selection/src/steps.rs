//! The steps a selection is made in, and their JSON file.

use std::path::Path;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value};
use sg_scene::mask::Mask;

use crate::operations::Operation;
use crate::strokes::{MOST_STROKES, Stroke, StrokeError};
use crate::tuning::Tuning;

/// One step.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// A stroke of the brush.
    Stroke(Stroke),
    /// An operation on what is selected.
    Operation(Operation),
    /// What was selected otherwise, such as by name; added. Not in files.
    Given(Mask),
    /// What the walk is done with instead of what it was done with before.
    Tuning(Tuning),
}

impl From<Stroke> for Step {
    fn from(stroke: Stroke) -> Self {
        Self::Stroke(stroke)
    }
}

impl From<Operation> for Step {
    fn from(operation: Operation) -> Self {
        Self::Operation(operation)
    }
}

impl From<Tuning> for Step {
    fn from(tuning: Tuning) -> Self {
        Self::Tuning(tuning)
    }
}

impl Step {
    /// Checks that the step can be taken.
    ///
    /// # Errors
    /// What is wrong and what would be right, in words.
    pub fn check(&self) -> Result<(), String> {
        match self {
            Self::Stroke(stroke) => stroke.check(),
            Self::Operation(operation) => operation.check(),
            Self::Given(_) => Ok(()),
            Self::Tuning(tuning) => tuning.check(),
        }
    }

    /// The stroke that it is, if it is one.
    #[must_use]
    pub fn stroke(&self) -> Option<&Stroke> {
        if let Self::Stroke(stroke) = self { Some(stroke) } else { None }
    }
}

impl<'de> Deserialize<'de> for Step {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let map = Map::deserialize(deserializer)?;
        let has = |key| map.contains_key(key);
        let (is_operation, is_tuning) = (has("operation"), has("leak"));
        let map = Value::Object(map);
        let step = match (is_operation, is_tuning) {
            (true, _) => serde_json::from_value(map).map(Self::Operation),
            (_, true) => serde_json::from_value(map).map(Self::Tuning),
            _ => serde_json::from_value(map).map(Self::Stroke),
        };
        step.map_err(D::Error::custom)
    }
}

impl Serialize for Step {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Stroke(stroke) => stroke.serialize(serializer),
            Self::Operation(operation) => operation.serialize(serializer),
            Self::Tuning(tuning) => tuning.serialize(serializer),
            Self::Given(_) => Err(serde::ser::Error::custom("a mask has no place in a file of strokes")),
        }
    }
}

/// A file of steps: `{"strokes": [ … ]}`, each entry a stroke, with `operation` an operation, or with `leak` a tuning.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Steps {
    /// In the order they were taken.
    pub strokes: Vec<Step>,
}

impl Steps {
    /// Reads and checks a file of steps.
    ///
    /// # Errors
    /// [`StrokeError`] names the file and the place in it.
    pub fn read(path: &Path) -> Result<Self, StrokeError> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|source| StrokeError::Read { path: name.clone(), source })?;
        Self::parse(&text, &name)
    }

    /// Parses and checks steps; `path` names the source in errors.
    ///
    /// # Errors
    /// [`StrokeError`].
    pub fn parse(text: &str, path: &str) -> Result<Self, StrokeError> {
        let path = path.to_owned();
        let steps: Self =
            serde_json::from_str(text).map_err(|source| StrokeError::Parse { path: path.clone(), source })?;
        if steps.strokes.len() > MOST_STROKES {
            return Err(StrokeError::TooMany { path, found: steps.strokes.len() });
        }
        for (number, step) in steps.strokes.iter().enumerate() {
            step.check().map_err(|reason| StrokeError::Stroke { path: path.clone(), number, reason })?;
        }
        Ok(steps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strokes_and_operations_stand_in_one_list() {
        let text = r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":0.02,"points":[[0.1,0.2,0.3]]},
            {"operation":"grow","distance":0.01},
            {"mode":"point","kind":"background","radius":0.02,"points":[[0.1,0.2,0.3]]},
            {"leak":0.1,"threshold":-0.25}]}"#;
        let steps = Steps::parse(text, "s.json").unwrap();
        assert_eq!(steps.strokes.iter().map(|s| s.stroke().is_some()).collect::<Vec<_>>(), [true, false, true, false]);
        assert_eq!(steps.strokes[3], Step::Tuning(Tuning { leak: 0.1, threshold: -0.25 }));
        let again = serde_json::to_string(&steps).unwrap();
        assert_eq!(Steps::parse(&again, "s.json").unwrap(), steps);
    }

    #[test]
    fn a_file_is_read_as_it_is_written() {
        use crate::strokes::{Kind, Mode};
        let text = r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":0.02,"points":[[0.1,0.2,0.3],[0.5,-0.5,1.5]]},
            {"mode":"cluster","kind":"toggle","radius":0,"points":[[0,0,0]]},
            {"mode":"point","kind":"background","radius":0.1,"points":[[0,0,0],[1,0,0]],"pressure":[0,2.5]}]}"#;
        let steps = Steps::parse(text, "s.json").unwrap();
        let strokes: Vec<_> = steps.strokes.iter().filter_map(Step::stroke).collect();
        assert_eq!((strokes[0].mode, strokes[1].kind), (Mode::Walk, Kind::Toggle));
        assert_eq!((&strokes[0].pressure[..], &strokes[2].pressure[..]), (&[][..], &[0.0, 2.5][..]));
        let again = serde_json::to_string(&steps).unwrap();
        assert_eq!(again.matches("pressure").count(), 1, "a stroke without is written as before");
        assert_eq!(Steps::parse(&again, "s.json").unwrap(), steps);
    }

    #[test]
    fn bad_strokes_are_named() {
        let bad = [
            (r#"{"strokes":[{"mode":"walk","kind":"toggle","radius":0.1,"points":[[0,0,0]]}]}"#, "toggle"),
            (r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":-1,"points":[[0,0,0]]}]}"#, "radius is -1"),
            (r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":0.1,"points":[]}]}"#, "0 points"),
            (r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":0.1,"points":[[0,0]]}]}"#, "line 1"),
            (
                r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":0.1,"points":[[0,0,0]],"pressure":[1,1]}]}"#,
                "2 entries of `pressure` for 1 points",
            ),
            (
                r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":0.1,"points":[[0,0,0]],"pressure":[-1]}]}"#,
                "pressure at point 0 is -1",
            ),
            (r#"{"strokes":[{"mode":"wander","kind":"foreground","radius":0.1,"points":[[0,0,0]]}]}"#, "wander"),
            (r#"{"stroke":[]}"#, "stroke"),
            ("{\n \"strokes\": [\n", "line 3"),
        ];
        for (text, part) in bad {
            let message = Steps::parse(text, "s.json").unwrap_err().to_string();
            assert!(message.starts_with("s.json: ") && message.contains(part), "{message}");
        }
    }

    #[test]
    fn a_bad_step_is_named() {
        for (text, part) in [
            (
                "{\"strokes\":[\n{\"operation\":\"grow\",\n\"distance\":-1}]}",
                "stroke 0 (counted from 0): the distance is -1",
            ),
            ("{\"strokes\":[\n{\"operation\":\"grwo\"}]}", "line 2"),
            ("{\"strokes\":[\n{\"leak\":-0.5,\"threshold\":0}]}", "the leak is -0.5"),
            ("{\"strokes\":[\n{\"leak\":0.5,\"threshold\":1}]}", "the threshold is 1"),
            ("{\"strokes\":[\n{\"leak\":0.5}]}", "threshold"),
            ("{\"strokes\":[\n{\"mode\":\"wander\"}]}", "unknown variant `wander`"),
        ] {
            let message = Steps::parse(text, "s.json").unwrap_err().to_string();
            assert!(message.starts_with("s.json: ") && message.contains(part), "{message}");
        }
        let given = Steps { strokes: vec![Step::Given(Mask::empty(3))] };
        assert!(serde_json::to_string(&given).is_err());
    }
}
