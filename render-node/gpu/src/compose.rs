//! Composes the blended colors over the background.

use crate::device::Gpu;
use crate::pipeline::{BoundDraw, DrawPipeline};
use crate::resources::Resources;
use crate::shader::Shader;
use crate::stats::{Attachments, Stage, StatsReadback};
use crate::textures::{PICTURE_FORMAT, layer_view};

/// Pipelines of the compose pass, one for each view.
pub(super) struct ComposePasses {
    from_tiles: [DrawPipeline; 2],
    from_quads: [DrawPipeline; 2],
}

impl ComposePasses {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let shader = Shader::new(gpu, "compose", &[include_str!("shaders/compose.wgsl")]);
        let target = wgpu::ColorTargetState { format: PICTURE_FORMAT, blend: None, write_mask: wgpu::ColorWrites::ALL };
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let pipelines = |entry| {
            let entries = (&shader, ["cover", entry]);
            [0.0, 1.0].map(|view| DrawPipeline::new(gpu, entries, &[("VIEW", view)], triangles, target.clone().into()))
        };
        Self { from_tiles: pipelines("from_tiles"), from_quads: pipelines("from_quads") }
    }

    /// Binds the pixels of the tile passes.
    pub(super) fn bind_tiles(&self, gpu: &Gpu, resources: &Resources<'_>, views: u32) -> ComposeBindings {
        let pipelines = self.from_tiles.iter().take(views as usize);
        ComposeBindings(pipelines.map(|pipeline| pipeline.bind(gpu, resources)).collect())
    }

    /// Binds the layers of the quadrilaterals' target.
    pub(super) fn bind_quads(
        &self,
        gpu: &Gpu,
        resources: &Resources<'_>,
        blended: &wgpu::Texture,
        views: u32,
    ) -> ComposeBindings {
        let draws = (0..views).zip(&self.from_quads).map(|(k, pipeline)| {
            let view = layer_view(blended, k);
            pipeline.bind(gpu, &resources.and(&Resources::of_texture("blended", &view)))
        });
        ComposeBindings(draws.collect())
    }
}

/// The bound compose pass of each view.
pub(super) struct ComposeBindings(Vec<BoundDraw>);

impl ComposeBindings {
    /// Encodes one pass onto each picture.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        stats: &mut StatsReadback,
        pictures: &[wgpu::Texture],
    ) {
        for (draw, picture) in self.0.iter().zip(pictures) {
            let target = picture.create_view(&wgpu::TextureViewDescriptor::default());
            let attachments = Attachments { color: Some(&target), depth: None, keep: false };
            draw.draw_full_screen(&mut stats.render_pass(encoder, Stage::Compose, attachments, None));
        }
    }
}
