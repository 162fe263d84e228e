//! Cameras as the bench writes them (services/scene/src/camera.rs).

use serde::Deserialize;
use wgpu_3dgs_viewer::core::PlyGaussianPod;
use wgpu_3dgs_viewer::core::glam::{Mat4, Vec3};

/// Steps, each with a camera for each eye.
pub(crate) type Turn = Vec<Vec<Camera>>;

/// A pinhole camera: axes x right, y down, z forward; the first pixel's centre at (0.5, 0.5). Its background is taken for black.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Camera {
    /// Picture width in pixels.
    pub(crate) width: u32,
    /// Picture height in pixels.
    pub(crate) height: u32,
    /// Focal length along x in pixels.
    pub(crate) fx: f32,
    /// Focal length along y in pixels.
    pub(crate) fy: f32,
    /// Principal point, x, in pixels.
    pub(crate) cx: f32,
    /// Principal point, y, in pixels.
    pub(crate) cy: f32,
    /// Scene to camera, rigid, row major.
    pub(crate) world_to_camera: [f32; 16],
}

impl Camera {
    /// Scene to camera.
    pub(crate) fn view(&self) -> Mat4 {
        Mat4::from_cols_array(&self.world_to_camera).transpose()
    }

    /// Where the eye is, in the scene frame.
    pub(crate) fn eye(&self) -> Vec3 {
        self.view().inverse().transform_point3(Vec3::ZERO)
    }
}

/// A ball around the centres of Gaussians, in the scene frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ball {
    middle: Vec3,
    radius: f32,
}

impl Ball {
    pub(crate) fn around(gaussians: &[PlyGaussianPod]) -> Self {
        let positions = || gaussians.iter().map(|g| Vec3::from_array(g.pos)).filter(|p| p.is_finite());
        let low = positions().reduce(Vec3::min).unwrap_or(Vec3::ZERO);
        let high = positions().reduce(Vec3::max).unwrap_or(Vec3::ZERO);
        Self { middle: 0.5 * (low + high), radius: 0.5 * low.distance(high) }
    }

    /// Least and most depth along the view, near enough to make good use of a depth key; the least at a thousandth of the most.
    pub(crate) fn depths(self, camera: &Camera) -> (f32, f32) {
        let z = camera.view().transform_point3(self.middle).z;
        let far = (z + 1.05 * self.radius).max(f32::MIN_POSITIVE);
        ((z - 1.05 * self.radius).max(1e-3 * far), far)
    }
}
