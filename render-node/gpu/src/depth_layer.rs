//! Converts scene depths to the depth image of a headset.

use crate::device::Gpu;
use crate::kept_bindings::KeptBindings;
use crate::pipeline::{BoundDraw, DrawPipeline, DrawTargets, depth_state};
use crate::recorded;
use crate::resources::Resources;
use crate::shader::Shader;
use crate::shader_layout::DepthRange;

/// Near plane in metres along the viewing axis, stored as 0. Nearer depths are stored as 0 too.
pub const DEPTH_NEAR: f32 = 0.05;

/// Far plane in metres, stored as 1. Pixels without depth are stored as 1 too.
pub const DEPTH_FAR: f32 = 1000.0;

/// Writes depths of pictures to depth images of one format.
///
/// A depth of z metres is stored as f/(f − n) · (1 − n/z) with n = [`DEPTH_NEAR`] and f = [`DEPTH_FAR`]: a
/// perspective projection. An image of another size takes the nearest pixel.
#[derive(Debug)]
pub struct DepthLayer {
    gpu: Gpu,
    pipeline: DrawPipeline,
    range: wgpu::Buffer,
    bindings: KeptBindings<1, BoundDraw>,
}

impl DepthLayer {
    /// A pass for images of `format`, a depth format.
    #[must_use]
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let parts = [include_str!("shaders/full_screen.wgsl"), include_str!("shaders/depth_layer.wgsl")];
        let shader = Shader::new(gpu, "depth layer", &parts);
        let depth = Some(depth_state(format, true, wgpu::CompareFunction::Always));
        let targets = DrawTargets { depth, ..DrawTargets::default() };
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let pipeline = DrawPipeline::new(gpu, (&shader, ["cover", "store"]), &[], triangles, targets);
        let range = gpu.uniform("depth range", &DepthRange::default());
        Self { gpu: gpu.clone(), pipeline, range, bindings: KeptBindings::default() }
    }

    /// Writes the upper left part of `depths` (f32, such as one of [`crate::Renderer::depths`]) to the upper left part of
    /// `target`, each with its width and height in pixels. The rest is far away. `scale` is metres for each unit of depth.
    /// One submission has one scale.
    pub fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (depths, part): (&wgpu::Texture, [u32; 2]),
        (target, [width, height]): (&wgpu::TextureView, [u32; 2]),
        scale: f64,
    ) {
        let range = DepthRange { scale: scale as f32, nearest: DEPTH_NEAR, farthest: DEPTH_FAR };
        self.gpu.write_uniform(&self.range, &range);
        let draw = self.bindings.get([depths], |[view]| {
            let resources = Resources::of([("range", &self.range)]);
            self.pipeline.bind(&self.gpu, &resources.and(&Resources::of_texture("depths", &view)))
        });
        recorded::open_pass();
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("depth layer"),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: target,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(1.0), store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            ..wgpu::RenderPassDescriptor::default()
        });
        draw.draw_part(&mut pass, (depths, part), [0, 0, width, height]);
    }
}
