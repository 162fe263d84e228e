//! What shaders are told of a picture: the layouts of frame.wgsl, word for word.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DMat4, DVec3, Vec4};
use sg_scene::camera::Camera;

#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct ViewUniform {
    right: Vec4,
    down: Vec4,
    forward: Vec4,
    eye: Vec4,
    lens: Vec4,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct FrameUniform {
    pub(super) views: [ViewUniform; 2],
    pub(super) shading_eye: Vec4,
    pub(super) light: Vec4,
    pub(super) overlay: Vec4,
    pub(super) background: Vec4,
    pub(super) limits: Vec4,
    pub(super) size: [u32; 2],
    pub(super) tiles: [u32; 2],
    pub(super) view_count: u32,
    pub(super) capacity: u32,
    pub(super) pair_capacity: u32,
    pub(super) edits: u32,
    pub(super) mask_words: u32,
    pub(super) clips: u32,
    pub(super) spare: [u32; 2],
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Part {
    pub(super) first: u32,
    pub(super) count: u32,
    pub(super) index: u32,
    pub(super) block: u32,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Unit {
    pub(super) linear: [Vec4; 3],
    pub(super) inverse: [Vec4; 3],
    pub(super) palette: Vec4,
    pub(super) multipliers: Vec4,
    pub(super) kind: [u32; 4],
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Edit {
    pub(super) color: Vec4,
    pub(super) kind: [u32; 4],
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Side {
    pub(super) plane: Vec4,
    pub(super) kind: [u32; 4],
}

impl ViewUniform {
    /// A camera against the origin that centres are stored relative to. The difference is taken in f64.
    pub(super) fn of(camera: &Camera, origin: DVec3) -> Self {
        let turn = DMat3::from_mat4(camera.view()).transpose();
        let exact = camera.eye() - origin;
        let eye = exact.as_vec3();
        let left = (exact - eye.as_dvec3()).as_vec3();
        Self {
            right: turn.x_axis.as_vec3().extend(left.x),
            down: turn.y_axis.as_vec3().extend(left.y),
            forward: turn.z_axis.as_vec3().extend(left.z),
            eye: eye.extend(0.0),
            lens: Vec4::new(camera.fx as f32, camera.fy as f32, camera.cx as f32, camera.cy as f32),
        }
    }
}

impl Unit {
    /// The columns of an affine transform's linear part, its greatest stretch, and the inverse (the identity where there is
    /// none, as the CPU renderer takes it).
    pub(super) fn of_transform(transform: DMat4) -> Self {
        let linear = DMat3::from_mat4(transform);
        let determinant = linear.determinant();
        let inverse = if determinant != 0.0 && determinant.is_finite() { linear.inverse() } else { DMat3::IDENTITY };
        let columns = |m: DMat3| [m.x_axis, m.y_axis, m.z_axis].map(|c| c.as_vec3().extend(0.0));
        let mut columns_of_linear = columns(linear);
        // At least the greatest singular value: the Frobenius norm.
        let stretch =
            (linear.x_axis.length_squared() + linear.y_axis.length_squared() + linear.z_axis.length_squared()).sqrt();
        columns_of_linear[0].w = if linear == DMat3::IDENTITY { 1.0 } else { stretch as f32 };
        Self { linear: columns_of_linear, inverse: columns(inverse), ..Self::default() }
    }
}
