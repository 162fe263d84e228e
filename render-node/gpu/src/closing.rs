//! Between two bands of quadrilaterals, near to far, pixels in which no more than the promise would change are closed.
//!
//! A full-screen triangle is put nearer than everything where the transmittance is below what tiles stop at, and the depth test
//! keeps later quadrilaterals from there: they cost no shading and no blending, and a surface hides what lies behind it.

use super::device::Gpu;
use super::kernel::{Behind, module};

/// What closes pixels.
pub(super) struct Closing {
    pipeline: wgpu::RenderPipeline,
}

impl Closing {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let shader = module(gpu, "close", include_str!("shaders/close.wgsl"));
        let options = wgpu::PipelineCompilationOptions::default();
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("close"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &shader,
                entry_point: Some("cover"),
                compilation_options: options.clone(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Behind::Hides.state(),
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

    /// For what one view is blended in.
    pub(super) fn bind(&self, gpu: &Gpu, frame: &wgpu::Buffer, blended: &wgpu::TextureView) -> wgpu::BindGroup {
        let blended = wgpu::BindingResource::TextureView(blended);
        super::work::group(gpu, &self.pipeline, &[(0, frame.as_entire_binding()), (1, blended)])
    }

    pub(super) fn encode(&self, pass: &mut wgpu::RenderPass<'_>, group: &wgpu::BindGroup) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.draw(0..3, 0..1);
    }
}
