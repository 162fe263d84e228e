//! Blends splats as quadrilaterals, near to far, in one draw or in bands.

use std::mem::offset_of;
use std::num::NonZeroU32;

use crate::compose::{ComposeBindings, ComposePass};
use crate::device::Gpu;
use crate::early_out::EarlyOut;
use crate::pipeline::{BoundDraw, DepthMode, DrawPipeline, DrawTargets, ViewPipelines};
use crate::resources::Resources;
use crate::shader::Shader;
use crate::shader_layout::{BANDS, Dispatches, DrawArguments};
use crate::stats::{Attachments, Stage, StatsReadback};
use crate::textures::{BOTH_VIEWS, blend_texture, front_to_back_target, layer_view, pass_view};
use crate::visibility_mask::{VisibilityMask, depth_texture, mask_pipelines};

/// Pipelines of the quadrilaterals. They need blending in f32: in half precision a thousand faint layers lose a fifth of
/// their coverage.
pub(super) struct QuadPasses {
    blend: ViewPipelines,
    /// Pipelines with a depth buffer, made at the first visibility mask or band.
    rejecting: Option<RejectingPasses>,
}

/// Pipelines that reject fragments of masked and saturated pixels.
struct RejectingPasses {
    blend: ViewPipelines,
    mask: ViewPipelines,
    early_out: EarlyOut,
}

impl QuadPasses {
    /// `multiview` adds pipelines for both eyes in one pass.
    pub(super) fn new(gpu: &Gpu, multiview: bool) -> Self {
        Self { blend: blend_pipelines(gpu, multiview, DepthMode::Ignore), rejecting: None }
    }

    /// Binds the passes for `views` pictures of `size` pixels; `reject` adds the depth buffer.
    pub(super) fn bind(
        &mut self,
        gpu: &Gpu,
        resources: &Resources<'_>,
        compose: &ComposePass,
        (size, views, reject): ([u32; 2], u32, bool),
    ) -> QuadBindings {
        let multiview = self.blend.multiview.is_some();
        let rejecting = reject.then(|| {
            &*self.rejecting.get_or_insert_with(|| RejectingPasses {
                blend: blend_pipelines(gpu, multiview, DepthMode::Test),
                mask: mask_pipelines(gpu, multiview),
                early_out: EarlyOut::new(gpu),
            })
        });
        let blended = blend_texture(gpu, size, views);
        let (pipelines, multiview) = rejecting.map_or(&self.blend, |r| &r.blend).passes(views);
        let blend = pipelines.iter().map(|pipeline| pipeline.bind(gpu, resources)).collect();
        let rejection = rejecting.map(|passes| Rejection {
            early_out: (0..views).map(|k| passes.early_out.bind(gpu, resources, &layer_view(&blended, k))).collect(),
            depth: depth_texture(gpu, size, views),
            mask: passes.mask.passes(views).0.to_vec(),
        });
        let compose = compose.bind(gpu, resources, &blended, views);
        QuadBindings { blended, rejection, blend, multiview, compose, views }
    }
}

fn blend_pipelines(gpu: &Gpu, multiview: bool, depth: DepthMode) -> ViewPipelines {
    let targets = DrawTargets { depth: depth.state(), ..front_to_back_target().into() };
    let strip = wgpu::PrimitiveTopology::TriangleStrip;
    let text = include_str!("shaders/quads.wgsl");
    let shader = Shader::new(gpu, "quads", &[text]);
    let each = [0.0, 1.0].map(|view| {
        let view = [("VIEW", view)];
        DrawPipeline::new(gpu, (&shader, ["corner", "blend"]), &view, strip, targets.clone())
    });
    let multiview = multiview.then(|| {
        let parts = [text, include_str!("shaders/quads_multiview.wgsl")];
        let shader = Shader::new(gpu, "quads, both eyes", &parts);
        let targets = DrawTargets { multiview: BOTH_VIEWS, ..targets };
        DrawPipeline::new(gpu, (&shader, ["corner_together", "blend"]), &[], strip, targets)
    });
    ViewPipelines { each, multiview }
}

/// The bound passes of the quadrilaterals.
pub(super) struct QuadBindings {
    /// Blended colors, a layer for each view.
    blended: wgpu::Texture,
    rejection: Option<Rejection>,
    /// One for each view, or one for both.
    blend: Vec<BoundDraw>,
    /// Mask of the layers that one pass draws to.
    multiview: Option<NonZeroU32>,
    pub(super) compose: ComposeBindings,
    views: u32,
}

/// The depth buffer that rejects masked and saturated pixels.
struct Rejection {
    /// A layer for each view.
    depth: wgpu::Texture,
    /// Pipelines of the visibility mask, one for each pass of the quadrilaterals.
    mask: Vec<DrawPipeline>,
    /// One for each view.
    early_out: Vec<BoundDraw>,
}

impl QuadBindings {
    /// Whether the passes have a depth buffer.
    pub(super) fn rejects(&self) -> bool {
        self.rejection.is_some()
    }

    /// Encodes all quadrilaterals, in bands or in one draw. The views are those of the eyes from `first_eye` on.
    pub(super) fn encode(
        &self,
        (gpu, mask): (&Gpu, Option<&VisibilityMask>),
        encoder: &mut wgpu::CommandEncoder,
        stats: &mut StatsReadback,
        dispatches: &wgpu::Buffer,
        (first_eye, in_bands): (usize, bool),
    ) {
        let bands = if in_bands { BANDS as usize } else { 1 };
        for band in 0..bands {
            let draw = match in_bands {
                true => offset_of!(Dispatches, bands) + band * size_of::<DrawArguments>(),
                false => offset_of!(Dispatches, all_quads),
            };
            let keep = band > 0;
            if let (true, Some(rejection)) = (keep, &self.rejection) {
                for (k, early_out) in (0..).zip(&rejection.early_out) {
                    let depth = layer_view(&rejection.depth, k);
                    let attachments = Attachments { color: None, depth: Some(&depth), keep };
                    early_out.draw_full_screen(&mut stats.render_pass(encoder, Stage::Blend, attachments, None));
                }
            }
            let masks = self.rejection.iter().flat_map(|r| &r.mask).map(Some).chain(std::iter::repeat(None));
            for (k, (blend, mask_pipeline)) in (0..).zip(self.blend.iter().zip(masks)) {
                let view = |texture| pass_view(texture, k, self.multiview.is_some());
                let (target, depth) = (view(&self.blended), self.rejection.as_ref().map(|r| view(&r.depth)));
                let attachments = Attachments { color: Some(&target), depth: depth.as_ref(), keep };
                let mut pass = stats.render_pass(encoder, Stage::Blend, attachments, self.multiview);
                if let (false, Some(mask), Some(pipeline)) = (keep, mask, mask_pipeline) {
                    mask.encode(gpu, pipeline, &mut pass, (first_eye, self.views));
                }
                blend.draw_indirect(&mut pass, dispatches, draw);
            }
        }
    }
}
