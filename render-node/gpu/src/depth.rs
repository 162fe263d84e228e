//! Optional per-pixel depth output: the depth of the front of each pixel.
//!
//! Tiles visit the layers of a pixel from near to far and store the depth of the layer that reaches the opacity of a surface.
//! Quadrilaterals do not know the layers before them. They give the weighted mean depth of all layers, at a lower resolution.

use crate::buffers::WorkBuffers;
use crate::device::Gpu;
use crate::pipeline::{BoundDraw, render_pipeline, shader_module};
use crate::radix_sort::SortBindings;
use crate::settings::Rasterizer;
use crate::shader_layout::dispatch;
use crate::shader_source::surface_source;
use crate::textures::{front_to_back_target, layer_view, picture_texture};

/// Edge in picture pixels of one depth pixel of the quadrilaterals.
const COARSE: u32 = 4;

/// Format of a depth texture.
const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;

/// Pipelines that write the depths of tiles, one for each view.
pub(super) struct TileDepthPasses([wgpu::RenderPipeline; 2]);

/// Pipelines that blend and write the depths of quadrilaterals, one for each view.
pub(super) struct QuadDepthPasses {
    blend: [wgpu::RenderPipeline; 2],
    compose: [wgpu::RenderPipeline; 2],
}

fn compose_pipelines(gpu: &Gpu, entry: &str) -> [wgpu::RenderPipeline; 2] {
    let compose = shader_module(gpu, "depths", &[&surface_source(), include_str!("shaders/depth.wgsl")].concat());
    let triangles = wgpu::PrimitiveTopology::TriangleList;
    let entries = (&compose, ["cover", entry]);
    [0.0, 1.0].map(|view| {
        render_pipeline(gpu, entries, &[("VIEW", view)], triangles, DEPTH_FORMAT.into(), Default::default())
    })
}

impl TileDepthPasses {
    pub(super) fn new(gpu: &Gpu) -> Self {
        Self(compose_pipelines(gpu, "depth_from_tiles"))
    }

    /// Binds the fronts of the tile passes.
    pub(super) fn bind(&self, gpu: &Gpu, frame: &wgpu::Buffer, fronts: &wgpu::Buffer, views: u32) -> DepthBindings {
        let resources = [(0, frame.as_entire_binding()), (1, fronts.as_entire_binding())];
        let compose = self.0.iter().take(views as usize).map(|pipeline| BoundDraw::new(gpu, pipeline, &resources));
        DepthBindings { coarse: Vec::new(), compose: compose.collect() }
    }
}

impl QuadDepthPasses {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let text = format!(
            "const COARSE: u32 = {COARSE}u;\n{}\n{}",
            include_str!("shaders/quads.wgsl"),
            include_str!("shaders/depth_quads.wgsl")
        );
        let shader = shader_module(gpu, "depths of quads", &text);
        let blend = [0.0, 1.0].map(|view| {
            let strip = wgpu::PrimitiveTopology::TriangleStrip;
            let entries = (&shader, ["corner_depth", "blend_depth"]);
            render_pipeline(gpu, entries, &[("VIEW", view)], strip, front_to_back_target(), Default::default())
        });
        Self { blend, compose: compose_pipelines(gpu, "depth_from_quads") }
    }

    /// Binds the splats for a picture of `size` pixels.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        frame: &wgpu::Buffer,
        (work, order): (&WorkBuffers, &SortBindings),
        size: [u32; 2],
    ) -> DepthBindings {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
        let blended = picture_texture(gpu, depth_size(size, Rasterizer::Quads), work.views, usage);
        let coarse = (0..work.views).zip(&self.blend).map(|(k, pipeline)| {
            (layer_view(&blended, k), BoundDraw::new(gpu, pipeline, &work.quad_resources(frame, order)))
        });
        let compose = (0..work.views).zip(&self.compose).map(|(k, pipeline)| {
            let view = layer_view(&blended, k);
            BoundDraw::new(gpu, pipeline, &[(2, wgpu::BindingResource::TextureView(&view))])
        });
        DepthBindings { coarse: coarse.collect(), compose: compose.collect() }
    }
}

/// The bound depth passes, one for each view.
pub(super) struct DepthBindings {
    /// Target and blending of quadrilaterals; empty for tiles.
    coarse: Vec<(wgpu::TextureView, BoundDraw)>,
    compose: Vec<BoundDraw>,
}

impl DepthBindings {
    /// Encodes the depths of the drawn views into `pictures`.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        dispatches: &wgpu::Buffer,
        pictures: &[wgpu::Texture],
    ) {
        for (view, blend) in &self.coarse {
            blend.draw_indirect(&mut depth_pass(encoder, view), dispatches, dispatch::ALL_QUADS);
        }
        for (compose, picture) in self.compose.iter().zip(pictures) {
            let view = picture.create_view(&wgpu::TextureViewDescriptor::default());
            compose.draw_full_screen(&mut depth_pass(encoder, &view));
        }
    }
}

fn depth_pass<'e>(encoder: &'e mut wgpu::CommandEncoder, view: &wgpu::TextureView) -> wgpu::RenderPass<'e> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("depths"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store: wgpu::StoreOp::Store },
        })],
        ..wgpu::RenderPassDescriptor::default()
    })
}

/// Width and height of the depths of a picture.
fn depth_size(picture: [u32; 2], rasterizer: Rasterizer) -> [u32; 2] {
    match rasterizer {
        Rasterizer::Tiles => picture,
        Rasterizer::Quads | Rasterizer::Bands => picture.map(|pixels| pixels.div_ceil(COARSE)),
    }
}

/// Replaces `textures` by `views` depth textures of a picture of `size` pixels, unless they fit already.
pub(super) fn prepare_textures(
    gpu: &Gpu,
    textures: &mut Vec<wgpu::Texture>,
    (size, views): ([u32; 2], usize),
    rasterizer: Rasterizer,
) {
    let size = depth_size(size, rasterizer);
    if textures.len() == views && textures.iter().all(|t| [t.width(), t.height()] == size) {
        return;
    }
    let usage =
        wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC;
    *textures = (0..views).map(|_| gpu.texture("depths", (size, 1), DEPTH_FORMAT, usage)).collect();
}
