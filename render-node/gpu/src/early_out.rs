//! Marks saturated pixels in depth between bands of quadrilaterals, so that the depth test rejects later splats early.
//!
//! A full-screen triangle writes the nearest depth wherever the transmittance is below the limit of the tile rasterizer.

use crate::device::Gpu;
use crate::pipeline::{BoundDraw, DepthMode, DrawPipeline, DrawTargets};
use crate::resources::Resources;
use crate::shader::Shader;

/// The pass that marks saturated pixels.
pub(super) struct EarlyOut(DrawPipeline);

impl EarlyOut {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let shader = Shader::new(gpu, "early out", &[include_str!("shaders/early_out.wgsl")]);
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let targets = DrawTargets { depth: DepthMode::Write.state(), ..DrawTargets::default() };
        Self(DrawPipeline::new(gpu, (&shader, ["cover", "close"]), &[], triangles, targets))
    }

    /// Binds the blended target of one view.
    pub(super) fn bind(&self, gpu: &Gpu, resources: &Resources<'_>, blended: &wgpu::TextureView) -> BoundDraw {
        self.0.bind(gpu, &resources.and(&Resources::of_texture("blended", blended)))
    }
}
