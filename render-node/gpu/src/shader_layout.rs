//! Layouts shared with shaders: structures of frame.wgsl, words of the dispatch and total buffers, numbers of
//! enumerations.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DMat4, DVec3, Vec4};
use sg_scene::appearance::ShadingTerm;
use sg_scene::camera::Camera;
use sg_scene::model::ShadingModel;

/// Number of bands of quadrilaterals, near to far. Each band except the first is as long as all bands before it.
pub(super) const BANDS: u64 = 5;

/// Words of the dispatch buffer.
pub(super) mod dispatch {
    /// Workgroups of the sort by depth: three words.
    pub(crate) const DEPTH_SORT: u64 = 0;
    /// Workgroups of the passes that list pairs: three words.
    pub(crate) const TILE_LISTS: u64 = 3;
    /// Draw of all quadrilaterals: four words.
    pub(crate) const ALL_QUADS: u64 = 6;
    /// Draws of the bands: four words each.
    pub(crate) const BAND_QUADS: u64 = 10;
    /// Workgroups of the projection of each part: three words each.
    pub(crate) const PARTS: u64 = BAND_QUADS + 4 * super::BANDS;
}

/// Words of the dispatch buffer of a window of pairs.
pub(super) mod pair_dispatch {
    /// Workgroups of the sort by tile: three words.
    pub(crate) const SORT: u64 = 0;
    /// Workgroups of the passes over all pairs: three words.
    pub(crate) const PAIRS: u64 = 3;
}

/// Words of the totals buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Total {
    /// Number of Gaussians in the list.
    Listed = 0,
    /// Number of Gaussians that may be visible, listed or not.
    #[cfg(test)]
    Marked = 1,
    /// Number of pairs of a Gaussian and a tile in the current window.
    WindowPairs = 2,
}

/// Number of a shading model in the shaders.
pub(super) fn shading_model_number(model: ShadingModel) -> u32 {
    match model {
        ShadingModel::Paper => 0,
        ShadingModel::IvrgsTrain => 1,
        ShadingModel::IvrgsViewer => 2,
    }
}

/// Number of a shading term in the shaders.
pub(super) fn shading_term_number(term: ShadingTerm) -> u32 {
    match term {
        ShadingTerm::Full => 0,
        ShadingTerm::Normal => 1,
        ShadingTerm::Ambient => 2,
        ShadingTerm::Diffuse => 3,
        ShadingTerm::Specular => 4,
    }
}

/// Source of a base unit's colors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ColorSource {
    /// The palette color.
    Palette = 0,
    /// Shading columns.
    Lit = 1,
    /// Spherical harmonics.
    Harmonics = 2,
}

/// One camera.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct ViewUniform {
    right: Vec4,
    down: Vec4,
    forward: Vec4,
    eye: Vec4,
    lens: Vec4,
}

/// All numbers of a frame.
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

/// A range of Gaussians of one buffer set, or of pairs of one window.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Part {
    pub(super) first: u32,
    pub(super) count: u32,
    pub(super) index: u32,
    pub(super) block: u32,
}

/// A base unit.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Unit {
    pub(super) linear: [Vec4; 3],
    pub(super) inverse: [Vec4; 3],
    pub(super) palette: Vec4,
    pub(super) multipliers: Vec4,
    pub(super) kind: [u32; 4],
}

/// An editable unit.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Edit {
    pub(super) color: Vec4,
    pub(super) kind: [u32; 4],
}

/// A half-space of a clip.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Side {
    pub(super) plane: Vec4,
    pub(super) kind: [u32; 4],
}

impl ViewUniform {
    /// The camera relative to `origin`, the origin of the stored centers. The difference is taken in f64.
    pub(super) fn of(camera: &Camera, origin: DVec3) -> Self {
        let rotation = DMat3::from_mat4(camera.view()).transpose();
        let exact = camera.eye() - origin;
        let eye = exact.as_vec3();
        let rest = (exact - eye.as_dvec3()).as_vec3();
        Self {
            right: rotation.x_axis.as_vec3().extend(rest.x),
            down: rotation.y_axis.as_vec3().extend(rest.y),
            forward: rotation.z_axis.as_vec3().extend(rest.z),
            eye: eye.extend(0.0),
            lens: Vec4::new(camera.fx as f32, camera.fy as f32, camera.cx as f32, camera.cy as f32),
        }
    }
}

impl Unit {
    /// The linear part of an affine transform, its greatest stretch, and its inverse. As in the CPU renderer, a singular
    /// transform has the identity as its inverse.
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
