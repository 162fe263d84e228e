//! Files that are dropped on a window.

use std::path::Path;

use glam::{DMat3, DVec3};
use sg_scene::camera::Camera;
use sg_scene::view::View;

/// What a dropped file asks for.
///
/// # Errors
/// What a person is told: how another scene is opened, or what is wrong with the file.
pub(super) fn view_of(path: &Path, target: DVec3) -> Result<View, String> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
    if extension != "json" {
        return Err(format!(
            "{0}: a camera (.json) can be dropped here; `supergaussian demo {0}` opens another scene or volume",
            path.display()
        ));
    }
    let camera = Camera::read(path).map_err(|e| e.to_string())?;
    camera.check(&path.display().to_string()).map_err(|e| e.to_string())?;
    Ok(seen_by(&camera, target))
}

/// The view of a camera: it looks at the place on its axis that is nearest to `target`, if that is before it.
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
    fn what_is_no_camera_is_told_what_to_do_with() {
        let said = view_of(Path::new("skull.nrrd"), DVec3::ZERO).unwrap_err();
        assert!(said.contains("supergaussian demo skull.nrrd"), "{said}");
        assert!(view_of(Path::new("no-such.json"), DVec3::ZERO).unwrap_err().contains("no-such.json"));
    }
}
