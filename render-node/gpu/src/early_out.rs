//! Marks saturated pixels in depth between bands of quadrilaterals, so that the depth test rejects later splats early.
//!
//! A full-screen triangle writes the nearest depth wherever the transmittance is below the limit of the tile rasterizer.

use crate::device::Gpu;
use crate::pipeline::{BoundDraw, DepthMode, shader_module};

/// The pass that marks saturated pixels.
pub(super) struct EarlyOut {
    pipeline: wgpu::RenderPipeline,
}

impl EarlyOut {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let shader = shader_module(gpu, "early out", include_str!("shaders/early_out.wgsl"));
        let options = wgpu::PipelineCompilationOptions::default();
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("early out"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &shader,
                entry_point: Some("cover"),
                compilation_options: options.clone(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: DepthMode::Write.state(),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &shader,
                entry_point: Some("close"),
                compilation_options: options,
                targets: &[],
            }),
            multiview_mask: None,
            cache: None,
        });
        Self { pipeline }
    }

    /// Binds the blended target of one view.
    pub(super) fn bind(&self, gpu: &Gpu, frame: &wgpu::Buffer, blended: &wgpu::TextureView) -> BoundDraw {
        let blended = wgpu::BindingResource::TextureView(blended);
        BoundDraw::new(gpu, &self.pipeline, &[(0, frame.as_entire_binding()), (1, blended)])
    }
}
