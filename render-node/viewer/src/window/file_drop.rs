//! Files dropped on a window, or chosen in its file menu.

use std::path::Path;

use glam::{DMat3, DVec3};
use sg_formats::Format;
use sg_input::unreadable;
use sg_scene::camera::Camera;
use sg_scene::view::View;
use sg_volume::{ENDINGS, is_volume};

/// Ending of a project's file.
pub(super) const PROJECT: &str = ".sgproj";

/// Kinds of dropped files.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum DroppedFile {
    /// A camera, and the view that it has.
    View(View),
    /// Another scene, a project or a volume, as far as its name says.
    Other,
}

/// Looks at a dropped file. A camera looks at the place on its axis that is nearest to `target`.
///
/// # Errors
/// A message for a person: the supported files, or the fault of this one.
pub(super) fn read(path: &Path, target: DVec3) -> Result<DroppedFile, String> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    if name.ends_with(".json") {
        let camera = Camera::read(path).map_err(|e| e.to_string())?;
        camera.check(&path.display().to_string()).map_err(|e| e.to_string())?;
        return Ok(DroppedFile::View(seen_by(&camera, target)));
    }
    if name.ends_with(PROJECT) {
        return Ok(DroppedFile::Other);
    }
    let is_volume = is_volume(path);
    let is_scene = Format::is_scene_path(path);
    // A folder without a scene file may hold the slices of another format.
    let is_certain = is_volume || is_scene && (!path.is_dir() || path.join("scene.toml").exists());
    if !is_certain && let Some(found) = unreadable::recognise(path) {
        return Err(format!("{}: {found}", path.display()));
    }
    if is_scene || is_volume {
        return Ok(DroppedFile::Other);
    }
    Err(format!(
        "{}: give a scene ({}, or a folder of iVR-GS), a project ({PROJECT}), a volume ({}, or a folder of DICOM slices) or a camera (.json)",
        path.display(),
        Format::all_extensions().join(", "),
        ENDINGS.join(", ")
    ))
}

/// The view of a camera. Its target is the point on its axis nearest to `target`, if that lies ahead.
fn seen_by(camera: &Camera, target: DVec3) -> View {
    let turn = DMat3::from_mat4(camera.view()).transpose();
    let (up, forward, eye) = (-turn.y_axis, turn.z_axis, camera.eye());
    let ahead = (target - eye).dot(forward);
    let distance = if ahead > 0.0 { ahead } else { (target - eye).length().max(1.0) };
    let fov_y_degrees = 2.0 * (0.5 * f64::from(camera.height) / camera.fy).atan().to_degrees();
    View { eye, target: eye + distance * forward, up, fov_y_degrees }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_camera_of_a_view_gives_the_view_back() {
        let view = View {
            eye: DVec3::new(3.0, -4.0, 2.0),
            target: DVec3::new(0.5, 0.25, -1.0),
            up: DVec3::Z,
            fov_y_degrees: 40.0,
        };
        let back = seen_by(&view.camera(640, 480), view.target);
        assert!(back.eye.distance(view.eye) < 1e-9 && back.target.distance(view.target) < 1e-9);
        assert!((back.fov_y_degrees - 40.0).abs() < 1e-9);
        let (a, b) = (back.camera(640, 480), view.camera(640, 480));
        assert!(a.world_to_camera.iter().zip(&b.world_to_camera).all(|(a, b)| (a - b).abs() < 1e-9));
    }

    #[test]
    fn what_can_be_opened_is_told_from_what_cannot() {
        for name in [
            "a.compressed.PLY",
            "skull/scene.toml",
            "a.splat",
            "heart-copy.sgproj",
            "skull.nrrd",
            "brain.nii.gz",
            "tooth_103x94x161_uint8.raw.zst",
            ".",
        ] {
            assert_eq!(read(Path::new(name), DVec3::ZERO), Ok(DroppedFile::Other), "{name}");
        }
        let folder = tempfile::tempdir().unwrap();
        let slice = folder.path().join("IM0001");
        std::fs::write(&slice, [vec![0; 128], b"DICM".to_vec()].concat()).unwrap();
        for path in [&slice, folder.path(), Path::new("slice.dcm")] {
            assert_eq!(read(path, DVec3::ZERO), Ok(DroppedFile::Other), "{}", path.display());
        }
        let said = read(Path::new("cells.h5"), DVec3::ZERO).unwrap_err();
        assert!(said.contains("HDF5 cannot be read; "), "{said}");
        for name in ["notes.pdf", "nrrd", "no-such-folder"] {
            let said = read(Path::new(name), DVec3::ZERO).unwrap_err();
            assert!(
                said.starts_with(name) && [".ply", ".toml", ".nrrd", ".json"].iter().all(|e| said.contains(e)),
                "{said}"
            );
        }
        assert!(read(Path::new("no-such.json"), DVec3::ZERO).unwrap_err().contains("no-such.json"));
    }
}
