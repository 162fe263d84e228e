//! Composes the blended colors of quadrilaterals over the background. Tiles do so where they blend.

use crate::device::Gpu;
use crate::pipeline::{BoundDraw, DrawPipeline};
use crate::resources::Resources;
use crate::shader::Shader;
use crate::stats::{Attachments, Stage, StatsReadback};
use crate::textures::layer_view;

/// Text of the function that puts a color over the background.
pub(super) const OVER: &str = include_str!("shaders/over.wgsl");

/// The pipeline of the compose pass.
pub(super) struct ComposePass(DrawPipeline);

impl ComposePass {
    /// A pass onto pictures of `format`.
    pub(super) fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let shader = Shader::new(gpu, "compose", &[OVER, include_str!("shaders/compose.wgsl")]);
        let target = wgpu::ColorTargetState::from(format);
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        Self(DrawPipeline::new(gpu, (&shader, ["cover", "from_quads"]), &[], triangles, target.into()))
    }

    /// Binds the layers of the quadrilaterals' target.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        resources: &Resources<'_>,
        blended: &wgpu::Texture,
        views: u32,
    ) -> ComposeBindings {
        let draws = (0..views).map(|k| {
            let view = layer_view(blended, k);
            self.0.bind(gpu, &resources.and(&Resources::of_texture("blended", &view)))
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
