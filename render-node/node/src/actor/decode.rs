//! Converts a picture request into the renderer's types.

use glam::DVec3;
use sg_proto::bus::Code;
use sg_proto::{limits, render as proto};
use sg_raster::attributes::{Attribute, Legend};
use sg_raster::render::Projection;
use sg_runtime::blobs::MAX_FILE_BYTES;
use sg_runtime::fault::Fault;
use sg_scene::appearance::{Clip, HalfSpace};
use sg_scene::camera::Camera;
use sg_scene::view::View;
use sg_viewer::display::DisplayMode;

/// Most clips of a request, and most sides of each.
const MAX_CLIPS: usize = 64;

/// Decodes the projection of Gaussians.
pub(super) fn projection(asked: proto::Projection) -> Projection {
    match asked {
        proto::Projection::Unspecified | proto::Projection::Affine => Projection::Affine,
        proto::Projection::PerRay => Projection::PerRay,
    }
}

/// The requested display mode.
pub(super) fn display_mode(request: &proto::CaptureRequest) -> DisplayMode {
    match request.display_mode() {
        proto::DisplayMode::Unspecified | proto::DisplayMode::Scene => DisplayMode::Scene,
        proto::DisplayMode::Clusters => DisplayMode::Clusters,
        proto::DisplayMode::FirstComponent => DisplayMode::FirstComponent,
        proto::DisplayMode::Outlines => DisplayMode::Outlines,
        proto::DisplayMode::Scale => DisplayMode::Attribute(Attribute::Scale),
        proto::DisplayMode::Anisotropy => DisplayMode::Attribute(Attribute::Anisotropy),
        proto::DisplayMode::Opacity => DisplayMode::Attribute(Attribute::Opacity),
        proto::DisplayMode::OffsetColor => DisplayMode::Attribute(Attribute::OffsetColor),
        proto::DisplayMode::Normal => DisplayMode::Attribute(Attribute::Normal),
        proto::DisplayMode::PrincipalAxis => DisplayMode::Attribute(Attribute::PrincipalAxis),
    }
}

/// The legend of a picture.
pub(super) fn legend(display_mode: DisplayMode, legend: &Legend) -> proto::Legend {
    let attribute = if let DisplayMode::Attribute(attribute) = display_mode { attribute.name() } else { "" };
    let Legend { low, high, logarithmic, .. } = *legend;
    proto::Legend { attribute: attribute.to_owned(), low, high, logarithmic }
}

/// Refuses a picture that could not be fetched after it was stored.
pub(super) fn check_stored(width: u32, height: u32) -> Result<(), Fault> {
    // Four numbers a pixel, and a header.
    let bytes = 16 * u64::from(width) * u64::from(height) + 1024;
    if bytes <= MAX_FILE_BYTES {
        return Ok(());
    }
    let text = format!(
        "a picture of {width} x {height} pixels takes {bytes} bytes as .npy; at most {MAX_FILE_BYTES} are stored, so ask for fewer pixels"
    );
    Err(Fault::new(Code::OutOfRange, text))
}

/// A camera of a picture of this size; that of `view` where none is given. Gaussians fade within `near`, and within less where
/// the view's target is near.
pub(super) fn camera(
    asked: Option<&proto::Camera>,
    (view, near): (View, f64),
    [width, height]: [u32; 2],
) -> Result<Camera, Fault> {
    let side = 1..=limits::MAX_PICTURE_PIXELS;
    if !side.contains(&width) || !side.contains(&height) {
        return Err(Fault::new(
            Code::OutOfRange,
            format!("a picture of {width} x {height} pixels was asked for; 1 to {} are drawn each way", side.end()),
        ));
    }
    let otherwise = view.camera(width, height);
    let Some(asked) = asked else { return Ok(Camera { near: view.near_distance(near), ..otherwise }) };
    let world_to_camera = asked.world_to_camera.as_slice().try_into().map_err(|_| {
        Fault::invalid(format!("a camera takes 16 numbers, row major, not {}", asked.world_to_camera.len()))
    })?;
    let proto::Camera { fx, fy, cx, cy, .. } = *asked;
    let camera = Camera { fx, fy, cx, cy, world_to_camera, near, ..otherwise };
    camera.check("camera").map_err(|e| Fault::invalid(e.to_string()))?;
    Ok(camera)
}

/// The clips of a request; whether their numbers make sense is the renderer's to say.
pub(super) fn clips(clips: &[proto::Clip]) -> Result<Vec<Clip>, Fault> {
    if clips.len() > MAX_CLIPS || clips.iter().any(|clip| clip.sides.len() > MAX_CLIPS) {
        return Err(Fault::invalid(format!("at most {MAX_CLIPS} clips of at most {MAX_CLIPS} sides each")));
    }
    let side = |side: &proto::HalfSpace| match side.normal.as_slice() {
        &[x, y, z] => Ok(HalfSpace { normal: DVec3::new(x, y, z), offset: side.offset }),
        other => Err(Fault::invalid(format!("a clip's normal takes three numbers, not {}", other.len()))),
    };
    let clip = |clip: &proto::Clip| {
        let sides = clip.sides.iter().map(side).collect::<Result<_, _>>()?;
        Ok(Clip { sides, keep_inside: !clip.hide_inside })
    };
    clips.iter().map(clip).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_has_a_near_distance_and_less_of_it_close_to_its_target() {
        let view = |distance: f64| View {
            eye: DVec3::new(0.0, -distance, 0.0),
            target: DVec3::ZERO,
            up: DVec3::Z,
            fov_y_degrees: 40.0,
        };
        let near = |asked: Option<&proto::Camera>, distance| camera(asked, (view(distance), 0.5), [4, 3]).unwrap().near;
        assert_eq!((near(None, 20.0), near(None, 1.0)), (0.5, 0.1));
        let Camera { fx, fy, cx, cy, world_to_camera, .. } = view(1.0).camera(4, 3);
        let asked = proto::Camera { fx, fy, cx, cy, world_to_camera: world_to_camera.to_vec() };
        assert_eq!(near(Some(&asked), 1.0), 0.5);
        assert!(camera(None, (view(1.0), 0.5), [0, 3]).is_err());
    }

    #[test]
    fn a_picture_is_small_enough_to_be_stored_beside_its_png() {
        assert!(check_stored(4096, 4096).is_ok() && check_stored(8192, 4095).is_ok());
        let fault = check_stored(limits::MAX_PICTURE_PIXELS, limits::MAX_PICTURE_PIXELS).unwrap_err();
        assert!(fault.code == Code::OutOfRange && fault.message.contains("fewer pixels"), "{fault:?}");
    }
}
