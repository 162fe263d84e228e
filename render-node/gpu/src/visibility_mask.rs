//! The headset's visibility mask: pixels that the lenses hide are not blended.
//!
//! The triangles of the mask write the nearest depth before the quadrilaterals are drawn. The depth test then rejects all
//! fragments of hidden pixels. Tiles list no splats where the mask hides a whole tile (`hidden_tiles`). Visible pixels stay the
//! same to the last bit.

use glam::Vec2;

use crate::device::Gpu;
use crate::pipeline::{DepthMode, DrawPipeline, DrawTargets, ViewPipelines};
use crate::resources::Resources;
use crate::shader::Shader;
use crate::shader_layout::MaskCorner;
use crate::textures::{BLEND_FORMAT, BOTH_VIEWS, REJECT_DEPTH_FORMAT};

/// Limit of the number of triangle corners for one eye.
const MAX_CORNERS: usize = 3 << 16;

/// Pipelines that write the mask's triangles into depth; `multiview` adds one for both eyes in one pass.
pub(super) fn mask_pipelines(gpu: &Gpu, multiview: bool) -> ViewPipelines {
    let write_mask = wgpu::ColorWrites::empty();
    let color = Some(wgpu::ColorTargetState { format: BLEND_FORMAT, blend: None, write_mask });
    let targets = DrawTargets { color, depth: DepthMode::Write.state(), multiview: None };
    let text = include_str!("shaders/visibility_mask.wgsl");
    let shader = Shader::new(gpu, "visibility mask", &[text]);
    let triangles = wgpu::PrimitiveTopology::TriangleList;
    let each = [0.0, 1.0].map(|view| {
        let view = [("VIEW", view)];
        DrawPipeline::new(gpu, (&shader, ["hide", "leave"]), &view, triangles, targets.clone())
    });
    let multiview = multiview.then(|| {
        let parts = [text, include_str!("shaders/visibility_mask_multiview.wgsl")];
        let shader = Shader::new(gpu, "visibility mask, both eyes", &parts);
        let targets = DrawTargets { multiview: BOTH_VIEWS, ..targets };
        DrawPipeline::new(gpu, (&shader, ["hide_together", "leave"]), &[], triangles, targets)
    });
    ViewPipelines { each, multiview }
}

/// The mask's triangles of two eyes, also on the device.
pub(super) struct VisibilityMask {
    /// Triangles of each eye, shares of the picture's width and height from the upper left.
    pub(super) triangles: [Vec<[Vec2; 3]>; 2],
    /// Number of the mask, different for each.
    pub(super) number: u64,
    /// Buffer and number of corners: left eye, right eye, both eyes.
    corners: [(wgpu::Buffer, u32); 3],
}

impl VisibilityMask {
    /// Uploads triangles, their corners as shares of the picture's width and height from the upper left; `None` for an empty
    /// mask. Triangles with corners that are not finite are left out.
    pub(super) fn upload(gpu: &Gpu, eyes: [&[[Vec2; 3]]; 2], number: u64) -> Option<Self> {
        let finite = |triangles: &[[Vec2; 3]]| {
            let finite = triangles.iter().filter(|t| t.iter().all(|c| c.is_finite()));
            finite.take(MAX_CORNERS / 3).copied().collect::<Vec<_>>()
        };
        let triangles = eyes.map(finite);
        let corners = |eye: usize, view: u32| {
            triangles.get(eye).into_iter().flatten().flatten().map(move |at| MaskCorner { at: *at, view })
        };
        let [left, right] = [0, 1].map(|eye| corners(eye, 0).collect::<Vec<_>>());
        if left.is_empty() && right.is_empty() {
            return None;
        }
        let both = corners(0, 0).chain(corners(1, 1)).collect::<Vec<_>>();
        let corners = [left, right, both].map(|all| (gpu.table("visibility mask", &all), all.len() as u32));
        Some(Self { triangles, number, corners })
    }

    /// Draws the triangles into a pass of `pipeline`, one of [`mask_pipelines`]. The frame shows `views` views, from the eye
    /// `first_eye` on.
    pub(super) fn encode(
        &self,
        gpu: &Gpu,
        pipeline: &DrawPipeline,
        pass: &mut wgpu::RenderPass<'_>,
        (first_eye, views): (usize, u32),
    ) {
        let (buffer, count) = &self.corners[if views == 2 { 2 } else { first_eye.min(1) }];
        pipeline.bind(gpu, &Resources::of([("mask_corners", buffer)])).draw(pass, *count);
    }
}

/// A depth texture for the mask and the early out, a layer for each view.
pub(super) fn depth_texture(gpu: &Gpu, size: [u32; 2], layers: u32) -> wgpu::Texture {
    gpu.texture("visibility mask", (size, layers), REJECT_DEPTH_FORMAT, wgpu::TextureUsages::RENDER_ATTACHMENT)
}
