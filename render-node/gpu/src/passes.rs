//! The kernels of a picture, specialised on what a scene and its look have.

use std::collections::HashMap;
use std::num::NonZeroU32;

use super::closing::Closing;
use super::columns::Columns;
use super::depth::DepthPasses;
use super::device::Gpu;
use super::hidden::Hiding;
use super::kernel::{Behind, Kernel, drawing, module};
use super::look::Now;
use super::rays::{RayPasses, Waiting};
use super::sort::Sort;
use sg_raster::TILE;
use sg_raster::pick::SURFACE;

/// What projecting and shading is specialised on: a scene without highlights, masks or harmonics runs no line of theirs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Needs {
    lit: bool,
    highlights: bool,
    degree: i32,
    half: bool,
    term: u32,
    directional: bool,
    masks: bool,
    overlay: bool,
    colors: bool,
    clips: bool,
    per_ray: bool,
}

impl Needs {
    pub(super) fn of(columns: &Columns, now: &Now, per_ray: bool) -> Self {
        let Columns { lit, highlights, degree, half, .. } = *columns;
        let &Now { edits, sides, overlay, colors, directional, term, .. } = now;
        Self {
            lit,
            highlights,
            degree,
            half,
            term,
            directional,
            masks: edits > 0,
            overlay,
            colors,
            clips: sides > 0,
            per_ray,
        }
    }
}

/// Marking and projecting for one set of needs.
pub(super) struct Specialised {
    pub(super) mark: Kernel,
    pub(super) project: Kernel,
}

/// What blends quadrilaterals: each view by itself, and both in one pass where the device can and is to.
pub(super) struct Blending {
    pub(super) each: [wgpu::RenderPipeline; 2],
    pub(super) together: Option<wgpu::RenderPipeline>,
}

impl Blending {
    /// For so many views: a pipeline for each, or one for both.
    pub(super) fn of(&self, views: u32) -> (&[wgpu::RenderPipeline], Option<NonZeroU32>) {
        match &self.together {
            Some(both) if views == 2 => (std::slice::from_ref(both), BOTH),
            _ => (self.each.get(..views as usize).unwrap_or(&self.each), None),
        }
    }

    fn quads(gpu: &Gpu, both: bool, behind: Behind) -> Self {
        let target = blended_under();
        let strip = wgpu::PrimitiveTopology::TriangleStrip;
        let text = include_str!("shaders/quads.wgsl");
        let quads = module(gpu, "quads", text);
        let each = [0.0, 1.0].map(|view| {
            let view = [("VIEW", view)];
            drawing(gpu, (&quads, ["corner", "blend"]), &view, strip, target.clone(), (None, behind))
        });
        let together = both.then(|| {
            let text = format!("{text}\n{}", include_str!("shaders/quads_together.wgsl"));
            let shader = module(gpu, "quads, both eyes", &text);
            drawing(gpu, (&shader, ["corner_together", "blend"]), &[], strip, target.clone(), (BOTH, behind))
        });
        Self { each, together }
    }
}

/// Blending that leaves pixels out, and what does that to them.
pub(super) struct Tested {
    blending: Blending,
    pub(super) hiding: Hiding,
    pub(super) closing: Closing,
}

/// All that draws.
pub(super) struct Passes {
    cull: wgpu::ShaderModule,
    projection: wgpu::ShaderModule,
    specialised: HashMap<Needs, Specialised>,
    pub(super) sum_blocks: Kernel,
    pub(super) list: Kernel,
    pub(super) depth_sort: Sort,
    pub(super) pair_sort: Sort,
    pub(super) touch: Kernel,
    pub(super) sum_touched: Kernel,
    pub(super) open_window: Kernel,
    pub(super) list_pairs: Kernel,
    pub(super) clear_lists: Kernel,
    pub(super) find_ends: Kernel,
    pub(super) longest: Kernel,
    blend: Kernel,
    /// Nothing on a device that cannot blend f32: in half precision a thousand faint layers lose a fifth of their coverage.
    pub(super) quads: Option<Blending>,
    /// The same where pixels may be hidden or closed; made when they first may be.
    tested: Option<Tested>,
    pub(super) compose_tiles: [wgpu::RenderPipeline; 2],
    pub(super) compose_quads: [wgpu::RenderPipeline; 2],
    /// Made when they are first needed, with depths and without.
    rays: HashMap<(Waiting, bool), RayPasses>,
    /// Made when depths are first asked for.
    depths: Option<DepthPasses>,
}

/// Bands that quadrilaterals are drawn in, near to far. Each but the first is as long as all before it.
pub(super) const BANDS: u64 = 5;

/// What quadrilaterals are blended in and finished pictures are kept in.
pub(super) const PICTURE: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// The passes over tiles of so many pixels each way.
pub(super) fn tiles_of(edge: u32) -> String {
    format!("const TILE: u32 = {edge}u;\n{}{}", surface(), include_str!("shaders/tiles.wgsl"))
}

/// The opacity of a surface, for shaders that look for one.
pub(super) fn surface() -> String {
    format!("const SURFACE: f32 = {SURFACE:?};\n")
}

/// A target in which what is drawn first keeps its share.
pub(super) fn blended_under() -> wgpu::ColorTargetState {
    let under = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::OneMinusDstAlpha,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    let blend = Some(wgpu::BlendState { color: under, alpha: under });
    wgpu::ColorTargetState { format: PICTURE, blend, write_mask: wgpu::ColorWrites::ALL }
}

/// Both layers of a texture at once.
pub(super) const BOTH: Option<NonZeroU32> = NonZeroU32::new(0b11);

impl Passes {
    pub(super) fn new(gpu: &Gpu, columns: &Columns, multiview: bool) -> Self {
        let list = module(gpu, "list", &format!("const BANDS: u32 = {BANDS}u;\n{}", include_str!("shaders/list.wgsl")));
        let tiles = module(gpu, "tiles", &tiles_of(TILE as u32));
        let compose = module(gpu, "compose", include_str!("shaders/compose.wgsl"));
        let counts = [("BLOCKS", f64::from(columns.blocks)), ("PARTS", columns.parts.len() as f64)];
        let onto = wgpu::ColorTargetState { format: PICTURE, blend: None, write_mask: wgpu::ColorWrites::ALL };
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let composing = |entry| {
            let entries = (&compose, ["cover", entry]);
            [0.0, 1.0].map(|view| drawing(gpu, entries, &[("VIEW", view)], triangles, onto.clone(), Default::default()))
        };
        let tile = |entry| Kernel::new(gpu, &tiles, entry, &[]);
        let blends = gpu.has(wgpu::Features::FLOAT32_BLENDABLE);
        let both = multiview && gpu.has(wgpu::Features::MULTIVIEW);
        Self {
            cull: module(gpu, "cull", concat!(include_str!("shaders/scene.wgsl"), include_str!("shaders/cull.wgsl"))),
            projection: module(
                gpu,
                "project",
                concat!(
                    include_str!("shaders/scene.wgsl"),
                    include_str!("shaders/ray.wgsl"),
                    include_str!("shaders/project.wgsl")
                ),
            ),
            specialised: HashMap::new(),
            sum_blocks: Kernel::new(gpu, &list, "sum_blocks", &counts),
            list: Kernel::new(gpu, &list, "list", &[]),
            depth_sort: Sort::new(gpu, 0),
            pair_sort: Sort::new(gpu, 2),
            touch: tile("touch"),
            sum_touched: tile("sum_touched"),
            open_window: tile("open_window"),
            list_pairs: tile("list_pairs"),
            clear_lists: tile("clear_lists"),
            find_ends: tile("find_ends"),
            longest: tile("longest"),
            blend: tile("blend"),
            quads: blends.then(|| Blending::quads(gpu, both, Behind::All)),
            tested: None,
            compose_tiles: composing("from_tiles"),
            compose_quads: composing("from_quads"),
            rays: HashMap::new(),
            depths: None,
        }
    }

    /// What depths need, once [`Self::prepare_depths`] was called.
    pub(super) fn depths(&self) -> Option<&DepthPasses> {
        self.depths.as_ref()
    }

    /// Makes what depths need where it is not there yet.
    pub(super) fn prepare_depths(&mut self, gpu: &Gpu) {
        let quads = self.quads.is_some();
        self.depths.get_or_insert_with(|| DepthPasses::new(gpu, quads));
    }

    /// What blends tiles in the affine mode.
    pub(super) fn blend_of(&self, depths: bool) -> &Kernel {
        self.depths.as_ref().filter(|_| depths).map_or(&self.blend, |d| &d.blend)
    }

    /// What blends quadrilaterals of so many views, where pixels may be hidden or closed or not: a pipeline for each, or one for
    /// both. None on a device that cannot.
    pub(super) fn quads_of(&self, views: u32, tested: bool) -> (&[wgpu::RenderPipeline], Option<NonZeroU32>) {
        let seen = self.tested.as_ref().map(|t| &t.blending);
        let blending = if tested { seen } else { self.quads.as_ref() };
        blending.map_or((&[], None), |b| b.of(views))
    }

    /// What hides and closes pixels, once [`Self::test`] was called.
    pub(super) fn tested(&self) -> Option<&Tested> {
        self.tested.as_ref()
    }

    /// Makes what is needed where pixels may be hidden or closed.
    pub(super) fn test(&mut self, gpu: &Gpu) {
        if let (Some(quads), None) = (&self.quads, &self.tested) {
            let both = quads.together.is_some();
            let blending = Blending::quads(gpu, both, Behind::Seen);
            self.tested = Some(Tested { blending, hiding: Hiding::new(gpu, both), closing: Closing::new(gpu) });
        }
    }

    /// The view-consistent mode's own.
    pub(super) fn rays(&self, waiting: Option<Waiting>, depths: bool) -> Option<&RayPasses> {
        self.rays.get(&(waiting?, depths))
    }

    /// Makes the view-consistent mode's own where they are not there yet.
    pub(super) fn prepare_rays(&mut self, gpu: &Gpu, waiting: Waiting, depths: bool) {
        self.rays.entry((waiting, depths)).or_insert_with(|| RayPasses::new(gpu, waiting, depths));
    }

    /// The kernels for these needs, made when they are first needed.
    pub(super) fn specialised(&mut self, gpu: &Gpu, needs: Needs) -> &Specialised {
        let (cull, projection) = (&self.cull, &self.projection);
        self.specialised.entry(needs).or_insert_with(|| {
            let flag = |on: bool| f64::from(u8::from(on));
            let per_ray = ("PER_RAY", flag(needs.per_ray));
            let mark = [("MASKS", flag(needs.masks)), ("CLIPS", flag(needs.clips)), per_ray];
            let project = [
                ("LIT", flag(needs.lit)),
                ("DEGREE", f64::from(needs.degree)),
                ("HIGHLIGHTS", flag(needs.highlights)),
                ("TERM", f64::from(needs.term)),
                ("DIRECTIONAL", flag(needs.directional)),
                ("MASKS", flag(needs.masks)),
                ("OVERLAY", flag(needs.overlay)),
                ("COLORS", flag(needs.colors)),
                ("HALF", flag(needs.half)),
                per_ray,
            ];
            Specialised {
                mark: Kernel::new(gpu, cull, "mark", &mark),
                project: Kernel::new(gpu, projection, "project", &project),
            }
        })
    }
}
