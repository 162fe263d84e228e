//! Geometry files of a scene on another machine.

use std::path::{Component, Path, PathBuf};
use std::time::Duration;

use sg_proto::keys;
use sg_proto::scene::FilesRequest;

use crate::blobs::{BlobError, fetch_to};
use crate::bus::Bus;
use crate::context::Context;
use crate::fault::Fault;

/// Deadline of the file list and of each part of a file. The list is slow: the scene hashes its files for it.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(30);
/// Largest file of a scene, bytes.
const MAX_FILE_BYTES: u64 = 64 << 30;
/// Most files of one scene.
const MAX_FILES: usize = 10_000;

/// Fetches the missing files of a scene into a folder named after its geometry. Returns the path to open.
///
/// # Errors
/// The fault of the scene; a name that leads out of the folder; a file that could not be fetched or stored.
pub(crate) async fn fetch(bus: &Bus, run_dir: &Path, geometry_hash: &str) -> Result<PathBuf, Fault> {
    let context = Context::root().deadline_in(REQUEST_TIMEOUT);
    let listed = bus.ask(&keys::SCENE_FILES, &FilesRequest {}, &context).await?;
    if listed.files.len() > MAX_FILES {
        return Err(Fault::exhausted(format!("the scene has {} files; {MAX_FILES} at most", listed.files.len())));
    }
    let folder = run_dir.join("scenes").join(within(geometry_hash)?);
    for file in &listed.files {
        let path = folder.join(within(&file.name)?);
        let is_there = std::fs::metadata(&path).is_ok_and(|m| m.len() == file.bytes);
        if is_there {
            continue;
        }
        let parent = path.parent().unwrap_or(&folder);
        std::fs::create_dir_all(parent).map_err(|source| BlobError { path: parent.to_owned(), source })?;
        fetch_to(bus, &keys::SCENE_CONTENT, (&file.hash, MAX_FILE_BYTES), &path, &context).await?;
        tracing::info!(file = file.name, bytes = file.bytes, "fetched from the scene's machine");
    }
    // The time of the last use. The node clears scenes that were not used for long.
    if let Err(error) = std::fs::File::open(&folder).and_then(|f| f.set_modified(std::time::SystemTime::now())) {
        tracing::debug!(%error, folder = %folder.display(), "the use of a scene cannot be noted");
    }
    Ok(if listed.open.is_empty() { folder } else { folder.join(within(&listed.open)?) })
}

/// Checks that a relative path stays inside its folder.
fn within(name: &str) -> Result<&Path, Fault> {
    let path = Path::new(name);
    let inside = !name.is_empty() && path.components().all(|c| matches!(c, Component::Normal(_)));
    if inside { Ok(path) } else { Err(Fault::invalid(format!("`{name}` leads out of the scene's folder"))) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_out_of_the_folder_are_refused() {
        assert!(within("a.ply").is_ok() && within("units/bone.ply").is_ok());
        for bad in ["", "..", "../a", "/etc/passwd", "a/../../b", "."] {
            assert!(within(bad).is_err(), "{bad}");
        }
    }
}
