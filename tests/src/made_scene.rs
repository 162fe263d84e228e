//! A scene as large as one likes, made from the made volume.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{command, said};

/// Fits the made volume of 128³ voxels directly with about so many Gaussians: the path of its `scene.toml` below a folder.
///
/// # Errors
/// A line that names the missing part or the failure.
pub fn write(folder: &Path, gaussians: u32) -> Result<PathBuf, String> {
    let run = |arguments: &[&str]| -> Result<Value, String> {
        let mut fit = command(&folder.join("run")).map_err(|e| e.to_string())?;
        let output = fit.arg("fit").args(arguments).output().map_err(|e| e.to_string())?;
        if !output.status.success() {
            return Err(said(&output));
        }
        serde_json::from_slice(&output.stdout).map_err(|e| e.to_string())
    };
    let (volume, scene) = (folder.join("volume"), folder.join("scene"));
    let made = run(&["phantom", "--size", "128", "--json", "--out", &volume.to_string_lossy()])?;
    let file = |key: &str| volume.join(made[key].as_str().unwrap_or_default()).to_string_lossy().into_owned();
    run(&[
        &file("volume"),
        "--transfer-function",
        &file("transfer_function"),
        "--initial-only",
        "--gaussians",
        &gaussians.to_string(),
        "--json",
        "--out",
        &scene.to_string_lossy(),
    ])?;
    Ok(scene.join("scene.toml"))
}
