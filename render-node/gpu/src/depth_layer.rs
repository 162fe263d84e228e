//! Converts scene depths to the depth image of a headset.

use bytemuck::{Pod, Zeroable};

use crate::device::Gpu;

/// Near plane in metres along the viewing axis, stored as 0. Nearer depths are stored as 0 too.
pub const DEPTH_NEAR: f32 = 0.05;

/// Far plane in metres, stored as 1. Pixels without depth are stored as 1 too.
pub const DEPTH_FAR: f32 = 1000.0;

#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Range {
    scale: f32,
    nearest: f32,
    farthest: f32,
    spare: f32,
}

/// Writes depths of pictures to depth images of one format.
///
/// A depth of z metres is stored as f/(f − n) · (1 − n/z) with n = [`DEPTH_NEAR`] and f = [`DEPTH_FAR`]: a
/// perspective projection. An image of another size takes the nearest pixel.
#[derive(Debug)]
pub struct DepthLayer {
    gpu: Gpu,
    pipeline: wgpu::RenderPipeline,
    range: wgpu::Buffer,
}

impl DepthLayer {
    /// A pass for images of `format`, a depth format.
    #[must_use]
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("depth layer"),
            source: wgpu::ShaderSource::Wgsl(
                concat!(include_str!("shaders/full_screen.wgsl"), include_str!("shaders/depth_layer.wgsl")).into(),
            ),
        });
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("depth layer"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("cover"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Always),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("store"),
                compilation_options: Default::default(),
                targets: &[],
            }),
            multiview_mask: None,
            cache: None,
        });
        let range = gpu.buffer("depth range", size_of::<Range>() as u64, wgpu::BufferUsages::UNIFORM);
        Self { gpu: gpu.clone(), pipeline, range }
    }

    /// Writes `depths` (f32, such as one of [`crate::Renderer::depths`]) to the whole of `target`. `scale` is
    /// metres for each unit of depth. One submission has one scale.
    pub fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        depths: &wgpu::Texture,
        target: &wgpu::TextureView,
        scale: f64,
    ) {
        let range = Range { scale: scale as f32, nearest: DEPTH_NEAR, farthest: DEPTH_FAR, spare: 0.0 };
        self.gpu.queue.write_buffer(&self.range, 0, bytemuck::bytes_of(&range));
        let view = depths.create_view(&wgpu::TextureViewDescriptor::default());
        let group = self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("depth layer"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: self.range.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&view) },
            ],
        });
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("depth layer"),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: target,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(1.0), store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            ..wgpu::RenderPassDescriptor::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
    }
}
