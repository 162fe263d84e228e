//! What one would write first: all Gaussians projected on one core by the rules of 3DGS, sorted from back to front, uploaded,
//! and blended as instanced quads.

use bytemuck::{Pod, Zeroable};
use wgpu::TextureFormat;
use wgpu_3dgs_viewer::core::glam::{Mat2, Mat3, Quat, Vec2, Vec3, Vec3Swizzles};
use wgpu_3dgs_viewer::core::{PlyGaussianPod, PlyGaussians};

use crate::Renderer;
use crate::device::{Gpu, Target, bits};
use crate::harmonics;
use crate::turn::{Ball, Camera};

/// A projected Gaussian as the shader takes it, in clip coordinates.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Splat {
    center: [f32; 2],
    axes: [f32; 4],
    color: [f32; 4],
}

/// The renderer with its scene.
#[derive(Debug)]
pub(crate) struct Naive {
    scene: Vec<PlyGaussianPod>,
    ball: Ball,
    pipeline: wgpu::RenderPipeline,
    /// Room for all Gaussians.
    splats: wgpu::Buffer,
    format: TextureFormat,
}

impl Naive {
    /// Draws into pictures of `format`.
    pub(crate) fn new(gpu: &Gpu, scene: PlyGaussians, format: TextureFormat) -> Self {
        let module = gpu.device.create_shader_module(wgpu::include_wgsl!("naive.wgsl"));
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("naive"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("corner"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[Some(wgpu::VertexBufferLayout {
                    array_stride: size_of::<Splat>() as u64,
                    step_mode: wgpu::VertexStepMode::Instance,
                    attributes: &wgpu::vertex_attr_array![0 => Float32x2, 1 => Float32x4, 2 => Float32x4],
                })],
            },
            primitive: wgpu::PrimitiveState {
                topology: wgpu::PrimitiveTopology::TriangleStrip,
                ..wgpu::PrimitiveState::default()
            },
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("blend"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(wgpu::ColorTargetState {
                    format,
                    blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                    write_mask: wgpu::ColorWrites::ALL,
                })],
            }),
            multiview_mask: None,
            cache: None,
        });
        let splats = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("splats"),
            size: (size_of::<Splat>() * scene.0.len().max(1)) as u64,
            usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Self { ball: Ball::around(&scene.0), scene: scene.0, pipeline, splats, format }
    }
}

impl Renderer for Naive {
    fn name(&self) -> String {
        format!("naive: sort on one core, quads ({})", bits(self.format))
    }

    fn draw(&mut self, gpu: &Gpu, camera: &Camera, target: &Target) {
        let (near, _) = self.ball.depths(camera);
        let eye = camera.eye();
        let mut seen: Vec<(f32, Splat)> = self.scene.iter().filter_map(|g| project(g, camera, eye, near)).collect();
        seen.sort_by(|a, b| b.0.total_cmp(&a.0));
        let splats: Vec<Splat> = seen.into_iter().map(|(_, splat)| splat).collect();
        gpu.queue.write_buffer(&self.splats, 0, bytemuck::cast_slice(&splats));
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut pass = target.pass(&mut encoder);
        pass.set_pipeline(&self.pipeline);
        pass.set_vertex_buffer(0, self.splats.slice(..));
        pass.draw(0..4, 0..u32::try_from(splats.len()).unwrap_or(u32::MAX));
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
    }
}

/// Depth and splat of a Gaussian by the rules of 3DGS; nothing where it cannot be seen.
fn project(g: &PlyGaussianPod, camera: &Camera, eye: Vec3, near: f32) -> Option<(f32, Splat)> {
    let view = camera.view();
    let at = Vec3::from_array(g.pos);
    let t = view.transform_point3(at);
    let opacity = 1.0 / (1.0 + (-g.alpha).exp());
    if t.z < near || opacity < 1.0 / 255.0 {
        return None;
    }
    let (focal, size) = (Vec2::new(camera.fx, camera.fy), Vec2::new(camera.width as f32, camera.height as f32));
    let [w, x, y, z] = g.rot;
    let turned = Mat3::from_mat4(view) * Mat3::from_quat(Quat::from_xyzw(x, y, z, w).normalize());
    let m = turned * Mat3::from_diagonal(Vec3::from_array(g.scale).exp());
    // 3DGS linearises no further out than 1.3 times the field of view.
    let limit = 1.3 * 0.5 * size / focal;
    let slope = (t.xy() / t.z).clamp(-limit, limit);
    let row = |k: usize| (m.transpose() * (Vec3::AXES[k] - slope[k] * Vec3::Z)) * (focal[k] / t.z);
    let (j, k) = (row(0), row(1));
    let (a, b, c) = (j.dot(j) + 0.3, j.dot(k), k.dot(k) + 0.3);
    let (mid, spread) = (0.5 * (a + c), Vec2::new(0.5 * (a - c), b).length());
    let (most, least) = (mid + spread, (mid - spread).max(0.0));
    // Of the two forms of the first axis the one that does not cancel.
    let first = if a > c { Vec2::new(most - c, b) } else { Vec2::new(b, most - a) };
    let direction = first.try_normalize().unwrap_or(Vec2::X);
    let axes = Mat2::from_cols(most.sqrt() * direction, least.sqrt() * direction.perp());
    let center = focal * t.xy() / t.z + Vec2::new(camera.cx, camera.cy);
    let reach = 3.0 * most.sqrt();
    let seen = (center + reach).cmpge(Vec2::ZERO).all() && (center - reach).cmple(size).all();
    if !seen {
        return None;
    }
    let clip = Vec2::new(2.0, -2.0) / size;
    let (major, minor) = (axes.x_axis * clip, axes.y_axis * clip);
    let splat = Splat {
        center: (center * clip + Vec2::new(-1.0, 1.0)).to_array(),
        axes: [major.x, major.y, minor.x, minor.y],
        color: harmonics::color(g, (at - eye).normalize()).extend(opacity).to_array(),
    };
    Some((t.z, splat))
}
