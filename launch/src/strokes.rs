//! Files of brush strokes (JSON).

use std::path::{Path, PathBuf};

use serde::Deserialize;
use sg_proto::limits::{MAX_STROKE_POINTS, MAX_STROKES};
use sg_proto::scene::{Stroke, StrokeKind, StrokeMode};

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
    strokes: Vec<StrokeEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StrokeEntry {
    mode: Mode,
    kind: Kind,
    radius: f64,
    points: Vec<[f64; 3]>,
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
/// [`StrokesError`] with line and column, or the number of the stroke, counted from 1.
pub fn parse(file: &Path, text: &str) -> Result<Vec<Stroke>, StrokesError> {
    let fail = |problem: String| StrokesError { file: file.to_owned(), problem };
    let read: StrokesFile = serde_json::from_str(text).map_err(|e| fail(e.to_string()))?;
    if read.strokes.is_empty() || read.strokes.len() > MAX_STROKES {
        return Err(fail(format!("{} strokes; there must be 1 to {MAX_STROKES}", read.strokes.len())));
    }
    read.strokes
        .into_iter()
        .enumerate()
        .map(|(i, stroke)| message(stroke).map_err(|problem| fail(format!("stroke {}: {problem}", i + 1))))
        .collect()
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
    let points: Vec<f64> = stroke.points.into_iter().flatten().collect();
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
    Ok(Stroke { mode: mode.into(), kind: kind.into(), radius: stroke.radius, points })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strokes_are_read() {
        let text = r#"{"strokes": [
            {"mode": "walk", "kind": "foreground", "radius": 0.02, "points": [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]},
            {"mode": "cluster", "kind": "toggle", "radius": 0.01, "points": [[1, 0, 0]]}]}"#;
        let strokes = parse(Path::new("a.json"), text).unwrap();
        assert_eq!(strokes.len(), 2);
        assert_eq!(strokes[0].points, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]);
        assert_eq!((strokes[0].mode(), strokes[0].kind()), (StrokeMode::Walk, StrokeKind::Foreground));
        assert_eq!((strokes[1].mode(), strokes[1].kind()), (StrokeMode::Cluster, StrokeKind::Toggle));
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
        ] {
            assert_eq!(parse(Path::new("a.json"), &text).unwrap_err().to_string(), expected);
        }
        let said = parse(Path::new("a.json"), "{\"strokes\": [{\"mode\": \"wlak\"}]}").unwrap_err().to_string();
        assert!(said.starts_with("a.json: unknown variant `wlak`") && said.contains("line 1 column"), "{said}");
    }
}
