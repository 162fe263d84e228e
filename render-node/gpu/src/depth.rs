//! Optional per-pixel depth output: the depth of the front of each pixel.
//!
//! Tiles visit the layers of a pixel from near to far and store the depth of the layer that reaches the opacity of a surface,
//! in the same pass.
//! Quadrilaterals do not know the layers before them. They give the weighted mean depth of all layers, at a lower resolution.

use std::mem::offset_of;

use crate::device::Gpu;
use crate::pipeline::{BoundDraw, DrawPipeline};
use crate::recorded;
use crate::resources::Resources;
use crate::settings::Rasterizer;
use crate::shader::Shader;
use crate::shader_layout::{COARSE, Dispatches};
use crate::textures::{blend_texture, front_to_back_target, layer_view};

/// Format of a depth texture.
pub(super) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;

/// Pipelines that blend and write the depths of quadrilaterals.
pub(super) struct QuadDepthPasses {
    /// One for each view.
    blend: [DrawPipeline; 2],
    compose: DrawPipeline,
}

impl QuadDepthPasses {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let parts = [include_str!("shaders/quads.wgsl"), include_str!("shaders/depth_quads.wgsl")];
        let shader = Shader::new(gpu, "depths of quads", &parts);
        let blend = [0.0, 1.0].map(|view| {
            let strip = wgpu::PrimitiveTopology::TriangleStrip;
            let entries = (&shader, ["corner_depth", "blend_depth"]);
            DrawPipeline::new(gpu, entries, &[("VIEW", view)], strip, front_to_back_target().into())
        });
        let shader = Shader::new(gpu, "depths", &[include_str!("shaders/depth.wgsl")]);
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let target = wgpu::ColorTargetState::from(DEPTH_FORMAT);
        let compose = DrawPipeline::new(gpu, (&shader, ["cover", "depth_from_quads"]), &[], triangles, target.into());
        Self { blend, compose }
    }

    /// Binds the splats for a picture of `size` pixels.
    pub(super) fn bind(&self, gpu: &Gpu, resources: &Resources<'_>, size: [u32; 2], views: u32) -> DepthBindings {
        let blended = blend_texture(gpu, depth_size(size, Rasterizer::Quads), views);
        let coarse =
            (0..views).zip(&self.blend).map(|(k, pipeline)| (layer_view(&blended, k), pipeline.bind(gpu, resources)));
        let compose =
            (0..views).map(|k| self.compose.bind(gpu, &Resources::of_texture("blended", &layer_view(&blended, k))));
        DepthBindings { coarse: coarse.collect(), compose: compose.collect() }
    }
}

/// The bound depth passes of quadrilaterals, one for each view.
pub(super) struct DepthBindings {
    /// Target and blending.
    coarse: Vec<(wgpu::TextureView, BoundDraw)>,
    compose: Vec<BoundDraw>,
}

impl DepthBindings {
    /// Encodes the depths of the drawn views into `pictures`, for pictures of `size` pixels.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        dispatches: &wgpu::Buffer,
        (pictures, size): (&[wgpu::Texture], [u32; 2]),
    ) {
        let size = depth_size(size, Rasterizer::Quads);
        for (view, blend) in &self.coarse {
            blend.draw_indirect(&mut depth_pass(encoder, view, size), dispatches, offset_of!(Dispatches, all_quads));
        }
        for (compose, picture) in self.compose.iter().zip(pictures) {
            let view = picture.create_view(&wgpu::TextureViewDescriptor::default());
            compose.draw_full_screen(&mut depth_pass(encoder, &view, size));
        }
    }
}

fn depth_pass<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    view: &wgpu::TextureView,
    [width, height]: [u32; 2],
) -> wgpu::RenderPass<'e> {
    recorded::open_pass();
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("depths"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store: wgpu::StoreOp::Store },
        })],
        ..wgpu::RenderPassDescriptor::default()
    });
    pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
    pass
}

/// Width and height of the depths of a picture.
pub(super) fn depth_size(picture: [u32; 2], rasterizer: Rasterizer) -> [u32; 2] {
    match rasterizer {
        Rasterizer::Tiles => picture,
        Rasterizer::Quads | Rasterizer::Bands => picture.map(|pixels| pixels.div_ceil(COARSE)),
    }
}

/// Replaces `textures` by `views` depth textures of a picture of `size` pixels, unless they fit already. Returns whether it did.
pub(super) fn prepare_textures(
    gpu: &Gpu,
    textures: &mut Vec<wgpu::Texture>,
    (size, views): ([u32; 2], usize),
    rasterizer: Rasterizer,
) -> bool {
    let size = depth_size(size, rasterizer);
    if textures.len() == views && textures.iter().all(|t| [t.width(), t.height()] == size) {
        return false;
    }
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
        | wgpu::TextureUsages::STORAGE_BINDING
        | wgpu::TextureUsages::TEXTURE_BINDING
        | wgpu::TextureUsages::COPY_SRC;
    *textures = (0..views).map(|_| gpu.texture("depths", (size, 1), DEPTH_FORMAT, usage)).collect();
    true
}
