//! Poses of OpenXR in f64, and back.

use glam::{DQuat, DVec3};
use openxr as xr;

use crate::hands::{Eye, Fov, Pose};

/// View configuration with one view per eye.
pub(super) const STEREO: xr::ViewConfigurationType = xr::ViewConfigurationType::PRIMARY_STEREO;

/// A pose as the runtime gives it.
fn of(pose: xr::Posef) -> Option<Pose> {
    let xr::Posef { orientation: q, position: p } = pose;
    Pose {
        position: DVec3::new(p.x.into(), p.y.into(), p.z.into()),
        orientation: DQuat::from_xyzw(q.x.into(), q.y.into(), q.z.into(), q.w.into()),
    }
    .checked()
}

/// Pose of a space, if the runtime knows both position and direction.
pub(super) fn pose(location: &xr::SpaceLocation) -> Option<Pose> {
    let known = xr::SpaceLocationFlags::POSITION_VALID | xr::SpaceLocationFlags::ORIENTATION_VALID;
    if !location.location_flags.contains(known) {
        return None;
    }
    of(location.pose)
}

/// An eye, if it is one.
pub(super) fn eye(view: &xr::View) -> Option<Eye> {
    let fov = Fov {
        left: view.fov.angle_left.into(),
        right: view.fov.angle_right.into(),
        up: view.fov.angle_up.into(),
        down: view.fov.angle_down.into(),
    };
    let opens = |low: f64, high: f64| high - low > 1e-3 && low > -1.57 && high < 1.57;
    let eye = Eye { pose: of(view.pose)?, fov };
    (opens(fov.left, fov.right) && opens(fov.down, fov.up)).then_some(eye)
}

/// A pose for the runtime.
pub(super) fn raw(pose: &Pose) -> xr::Posef {
    let (p, q) = (pose.position.as_vec3(), pose.orientation.as_quat());
    xr::Posef {
        position: xr::Vector3f { x: p.x, y: p.y, z: p.z },
        orientation: xr::Quaternionf { x: q.x, y: q.y, z: q.z, w: q.w },
    }
}

/// Poses of both eyes and of the head, and the views as the runtime gave them.
#[derive(Clone, Copy)]
pub(super) struct Views {
    pub(super) eyes: [Eye; 2],
    pub(super) head: Pose,
    pub(super) raw: [(xr::Posef, xr::Fovf); 2],
}
