//! Strokes of the generic script, through the densest point of the first base unit.

use std::path::Path;

use serde_json::{Value, json};

use crate::densest::{positions, stroke};
use crate::subcommands::json_of;
use crate::terminal::Failure;

/// Radius of the stroke, as a fraction of the longest edge of the scene's box.
const RADIUS: f64 = 0.015;

/// Writes the strokes of a scene.
pub(crate) fn write(scene: &Path, out: &Path, strokes: &Path) -> Result<(), Failure> {
    let info = json_of("scene", &["info".as_ref(), scene.as_os_str(), "--json".as_ref()])?;
    let corner = |name: &str| -> Option<[f64; 3]> {
        let numbers = info.get("bounds")?.get(name)?.as_array()?;
        let numbers: Option<Vec<f64>> = numbers.iter().map(Value::as_f64).collect();
        numbers?.try_into().ok()
    };
    // The first base unit with Gaussians comes first in the file's order.
    let units = info.get("units").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let count = units.iter().filter_map(|u| u.get("gaussians")?.as_u64()).find(|n| *n > 0);
    let (Some(min), Some(max), Some(count)) = (corner("min"), corner("max"), count) else {
        return Err(Failure::Input(format!("{}: no base unit holds a Gaussian", scene.display())));
    };
    // One file of plain Gaussians in the same order, for any kind of scene.
    let plain = out.join("script").join("positions.ply");
    json_of(
        "scene",
        &[
            "convert".as_ref(),
            scene.as_os_str(),
            plain.as_os_str(),
            "--format".as_ref(),
            "3dgs".as_ref(),
            "--json".as_ref(),
        ],
    )?;
    let fail = |problem: String| Failure::Work(format!("{}: {problem}", plain.display()));
    let bytes = sg_input::file::read(&plain, sg_input::limits::DATA_BYTES).map_err(|e| fail(e.to_string()))?;
    std::fs::remove_file(&plain).map_err(|e| fail(e.to_string()))?;
    let points = positions(&bytes, usize::try_from(count).unwrap_or(usize::MAX)).map_err(|e| fail(e.to_string()))?;
    let Some(points) = stroke(&points, min, max) else {
        return Err(Failure::Input(format!("{}: no Gaussian has a finite position", scene.display())));
    };
    let text = json!({"strokes": [{"mode": "walk", "kind": "foreground", "radius": RADIUS, "points": points}]});
    std::fs::write(strokes, format!("{text:#}\n")).map_err(|e| Failure::Work(format!("{}: {e}", strokes.display())))
}
