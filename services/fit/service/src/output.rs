//! Files that the command writes.

use std::path::{Path, PathBuf};

use sg_formats::{npy, staged_file};
use sg_input::print::status as print_line;
use sg_input::{file, limits};
use sg_scene::model::Scene;
use sg_volume::TransferFunction;

use crate::failure::{Failure, input, work};

/// Writes the labels of the Gaussians, or where they have a value.
pub(crate) fn write_truth(file: &Path, labels: &[i32], value: Option<i32>) -> Result<(), Failure> {
    match value {
        None => npy::write_array(file, &[labels.len()], labels),
        Some(value) => {
            let mask: Vec<u8> = labels.iter().map(|&l| u8::from(l == value)).collect();
            npy::write_array(file, &[mask.len()], &mask)
        }
    }
    .map_err(work)
}

/// Replaces a file with these bytes, whole or not at all.
pub(crate) fn write(target: &Path, bytes: &[u8]) -> Result<(), Failure> {
    staged_file::replace(target, bytes).map_err(|e| work(format!("{}: {e}; nothing was written", target.display())))
}

/// Creates a folder and those above it.
pub(crate) fn make_folder(out: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(out).map_err(|e| work(format!("{}: {e}; give a writable folder", out.display())))
}

/// The place of the transfer function beside the scene.
pub(crate) fn function_file(out: &Path, given: Option<&Path>) -> PathBuf {
    out.join(given.and_then(Path::file_name).unwrap_or_else(|| "automatic.tf.json".as_ref()))
}

/// Writes the transfer function and then the scene with its name. A scene without values of a volume has no function.
pub(crate) fn write_scene(
    out: &Path,
    scene: &mut Scene,
    given: Option<&Path>,
    function: Option<&TransferFunction>,
) -> Result<Vec<PathBuf>, Failure> {
    make_folder(out)?;
    let target = function.map(|_| function_file(out, given));
    let name = target.as_deref().and_then(Path::file_name).map(PathBuf::from);
    match (&target, function, given) {
        // The unchanged file, with unknown keys.
        (Some(target), _, Some(given)) => write(
            target,
            &file::read(given, limits::TEXT_BYTES).map_err(|e| input(format!("{}: {e}", given.display())))?,
        )?,
        (Some(target), Some(function), None) => write(target, function.to_json().map_err(work)?.as_bytes())?,
        _ => {}
    }
    for unit in &mut scene.units {
        unit.transfer_function.clone_from(&name);
    }
    let saved = sg_formats::save(&out.join("scene.toml"), scene, &sg_formats::SaveOptions::default()).map_err(work)?;
    for warning in &saved.warnings {
        print_line(&format!("note: {}", warning.message));
    }
    Ok(saved.files.into_iter().chain(target).collect())
}
