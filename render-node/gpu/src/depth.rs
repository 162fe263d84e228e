//! How far away what a picture shows is, for whoever asks: the depth of the front of each pixel.
//!
//! Tiles and rays come by all layers of a pixel from near to far and note the depth of the one that brings it to the opacity of
//! a surface. Quadrilaterals do not know what was blended before them: they tell the mean depth of all that a pixel shows, each
//! layer by its share, and do so in a smaller picture of its own.

use super::device::Gpu;
use super::kernel::{Kernel, drawing, module};
use super::passes::{blended_under, surface, tiles_of};
use super::renderer::Rasterizer;
use super::sort::Sorting;
use super::work::{ALL_DRAWN, Tiles, Work, group, layer, texture};
use sg_raster::TILE;

/// Edge in pixels of what one pixel of the depths by quadrilaterals stands for.
const COARSE: u32 = 4;

/// One number for each pixel.
const DEPTHS: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;

/// Passes that are made when depths are first asked for.
pub(super) struct DepthPasses {
    /// Blends tiles and notes depths.
    pub(super) blend: Kernel,
    /// Blends depths by quadrilaterals, each view by itself; nothing on a device that cannot blend f32.
    quads: Option<[wgpu::RenderPipeline; 2]>,
    from_tiles: [wgpu::RenderPipeline; 2],
    from_quads: [wgpu::RenderPipeline; 2],
}

impl DepthPasses {
    /// `quads` says whether the device blends quadrilaterals.
    pub(super) fn new(gpu: &Gpu, quads: bool) -> Self {
        let tiles = module(gpu, "tiles, with depths", &tiles_of(TILE as u32));
        let text = format!(
            "const COARSE: u32 = {COARSE}u;\n{}\n{}",
            include_str!("shaders/quads.wgsl"),
            include_str!("shaders/depth_quads.wgsl")
        );
        let quads = quads.then(|| {
            let shader = module(gpu, "depths of quads", &text);
            [0.0, 1.0].map(|view| {
                let strip = wgpu::PrimitiveTopology::TriangleStrip;
                let entries = ["corner_depth", "blend_depth"];
                drawing(gpu, (&shader, entries), &[("VIEW", view)], strip, blended_under(), Default::default())
            })
        });
        let compose = module(gpu, "depths", &[&surface(), include_str!("shaders/depth.wgsl")].concat());
        let composing = |entry| {
            let triangles = wgpu::PrimitiveTopology::TriangleList;
            let entries = (&compose, ["cover", entry]);
            [0.0, 1.0]
                .map(|view| drawing(gpu, entries, &[("VIEW", view)], triangles, DEPTHS.into(), Default::default()))
        };
        Self {
            blend: Kernel::new(gpu, &tiles, "blend", &[("DEPTHS", 1.0)]),
            quads,
            from_tiles: composing("depth_from_tiles"),
            from_quads: composing("depth_from_quads"),
        }
    }
}

/// The passes of one rasterizer, bound; one of each for each view.
pub(super) struct Depths {
    /// What quadrilaterals are blended in, and what blends them there.
    coarse: Vec<(wgpu::TextureView, wgpu::BindGroup)>,
    compose: Vec<wgpu::BindGroup>,
}

impl Depths {
    /// Of what tiles noted.
    pub(super) fn of_tiles(
        gpu: &Gpu,
        frame: &wgpu::Buffer,
        (passes, tiles, views): (&DepthPasses, &Tiles, u32),
    ) -> Self {
        let compose = passes.from_tiles.iter().take(views as usize).map(|pipeline| {
            group(gpu, pipeline, &[(0, frame.as_entire_binding()), (1, tiles.fronts.as_entire_binding())])
        });
        Self { coarse: Vec::new(), compose: compose.collect() }
    }

    /// Of quadrilaterals.
    pub(super) fn of_quads(
        gpu: &Gpu,
        frame: &wgpu::Buffer,
        (work, order): (&Work, &Sorting),
        passes: &DepthPasses,
        picture: [u32; 2],
    ) -> Self {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
        let blended = texture(gpu, size_of(picture, Rasterizer::Quads), work.views, usage);
        let pipelines = passes.quads.iter().flatten();
        let coarse = (0..work.views)
            .zip(pipelines)
            .map(|(k, pipeline)| (layer(&blended, k), group(gpu, pipeline, &work.of_quads(frame, order))));
        let compose = (0..work.views).zip(&passes.from_quads).map(|(k, pipeline)| {
            let view = layer(&blended, k);
            group(gpu, pipeline, &[(2, wgpu::BindingResource::TextureView(&view))])
        });
        Self { coarse: coarse.collect(), compose: compose.collect() }
    }

    /// Puts the depths of the views that were drawn into `pictures`.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        passes: &DepthPasses,
        dispatches: &wgpu::Buffer,
        pictures: &[wgpu::Texture],
    ) {
        let mut draw = |view: &wgpu::TextureView, pipeline: &wgpu::RenderPipeline, group: &wgpu::BindGroup, strips| {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("depths"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..wgpu::RenderPassDescriptor::default()
            });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[]);
            match strips {
                true => pass.draw_indirect(dispatches, 4 * ALL_DRAWN),
                false => pass.draw(0..3, 0..1),
            }
        };
        for ((view, group), pipeline) in self.coarse.iter().zip(passes.quads.iter().flatten()) {
            draw(view, pipeline, group, true);
        }
        let pipelines = if self.coarse.is_empty() { &passes.from_tiles } else { &passes.from_quads };
        for ((group, pipeline), picture) in self.compose.iter().zip(pipelines).zip(pictures) {
            draw(&picture.create_view(&wgpu::TextureViewDescriptor::default()), pipeline, group, false);
        }
    }
}

/// Width and height of the depths of a picture.
fn size_of(picture: [u32; 2], rasterizer: Rasterizer) -> [u32; 2] {
    match rasterizer {
        Rasterizer::Tiles => picture,
        Rasterizer::Quads | Rasterizer::Bands => picture.map(|pixels| pixels.div_ceil(COARSE)),
    }
}

/// Textures for the depths of so many pictures, unless there are such already.
pub(super) fn prepare(
    gpu: &Gpu,
    there: &mut Vec<wgpu::Texture>,
    (picture, views): ([u32; 2], usize),
    rasterizer: Rasterizer,
) {
    let size = size_of(picture, rasterizer);
    if there.len() == views && there.iter().all(|t| [t.width(), t.height()] == size) {
        return;
    }
    let usage =
        wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC;
    *there = (0..views).map(|_| gpu.texture("depths", (size, 1), DEPTHS, usage)).collect();
}
