//! A vignette over an eye's picture while the scene moves.

use bytemuck::{Pod, Zeroable};
use sg_scene::camera::Camera;

use crate::device::Gpu;
use crate::pipeline::render_pipeline;

/// Tangents of the inner and outer angle of the vignette from straight ahead: 20° and 40°.
const ANGLES: [f32; 2] = [0.364, 0.839];

#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
struct Uniform {
    middle: [f32; 2],
    focal: [f32; 2],
    begins: f32,
    whole: f32,
    strength: f32,
    spare: f32,
}

/// Darkens the edges of two eyes' pictures on targets of one format.
#[derive(Debug)]
pub struct Vignette {
    gpu: Gpu,
    pipeline: wgpu::RenderPipeline,
    eyes: [(wgpu::Buffer, wgpu::BindGroup); 2],
}

impl Vignette {
    /// A vignette for targets of `format`, a blendable format.
    #[must_use]
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("vignette"),
            source: wgpu::ShaderSource::Wgsl(include_str!("shaders/vignette.wgsl").into()),
        });
        let blend = Some(wgpu::BlendState::ALPHA_BLENDING);
        // The target stays opaque.
        let target = wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::COLOR };
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let pipeline = render_pipeline(gpu, (&module, ["cover", "darken"]), &[], triangles, target, Default::default());
        let eyes = [0, 1].map(|_| {
            let buffer = gpu.buffer("vignette", size_of::<Uniform>() as u64, wgpu::BufferUsages::UNIFORM);
            let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("vignette"),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
            });
            (buffer, group)
        });
        Self { gpu: gpu.clone(), pipeline, eyes }
    }

    /// Darkens the edges of `target`, a full picture of `camera`, by `strength` from 0 to 1, between 20° and 40°
    /// from straight ahead. Does nothing at 0. `right` selects the eye. Encode each eye once for each submission.
    pub fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        camera: &Camera,
        right: bool,
        strength: f64,
    ) {
        if strength <= 0.0 || strength.is_nan() {
            return;
        }
        let (buffer, group) = &self.eyes[usize::from(right)];
        let uniform = Uniform {
            middle: [camera.cx as f32, camera.cy as f32],
            focal: [camera.fx as f32, camera.fy as f32],
            begins: ANGLES[0],
            whole: ANGLES[1],
            strength: strength.min(1.0) as f32,
            spare: 0.0,
        };
        self.gpu.queue.write_buffer(buffer, 0, bytemuck::bytes_of(&uniform));
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("vignette"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
            })],
            ..wgpu::RenderPassDescriptor::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.draw(0..3, 0..1);
    }
}
