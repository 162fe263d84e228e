//! A vignette over an eye's picture while the scene moves.

use glam::Vec2;
use sg_scene::camera::Camera;

use crate::device::Gpu;
use crate::pipeline::{BoundDraw, DrawPipeline};
use crate::resources::Resources;
use crate::shader::Shader;
use crate::shader_layout::VignetteShape;

/// Tangents of the inner and outer angle of the vignette from straight ahead: 20° and 40°.
const ANGLES: [f32; 2] = [0.364, 0.839];

/// Darkens the edges of two eyes' pictures on targets of one format.
#[derive(Debug)]
pub struct Vignette {
    gpu: Gpu,
    /// The uniform of each eye, and the pass that it is bound to.
    eyes: [(wgpu::Buffer, BoundDraw); 2],
}

impl Vignette {
    /// A vignette for targets of `format`, a blendable format.
    #[must_use]
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let shader = Shader::new(gpu, "vignette", &[include_str!("shaders/vignette.wgsl")]);
        let blend = Some(wgpu::BlendState::ALPHA_BLENDING);
        // The target stays opaque.
        let target = wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::COLOR };
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let pipeline = DrawPipeline::new(gpu, (&shader, ["cover", "darken"]), &[], triangles, target.into());
        let eyes = [0, 1].map(|_| {
            let vignette = gpu.uniform("vignette", &VignetteShape::default());
            let draw = pipeline.bind(gpu, &Resources::of([("vignette", &vignette)]));
            (vignette, draw)
        });
        Self { gpu: gpu.clone(), eyes }
    }

    /// Darkens the edges of the picture of `camera` by `strength` from 0 to 1, between 20° and 40° from straight ahead. The
    /// picture is the upper left part of `target`. Does nothing at 0. `right` selects the eye. Encode each eye once for
    /// each submission.
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
        let (uniform, draw) = &self.eyes[usize::from(right)];
        let vignette = VignetteShape {
            middle: Vec2::new(camera.cx as f32, camera.cy as f32),
            focal: Vec2::new(camera.fx as f32, camera.fy as f32),
            begins: ANGLES[0],
            whole: ANGLES[1],
            strength: strength.min(1.0) as f32,
        };
        self.gpu.write_uniform(uniform, &vignette);
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
        pass.set_scissor_rect(0, 0, camera.width, camera.height);
        draw.draw_full_screen(&mut pass);
    }
}
