//! The chain of passes of one frame.
//!
//! | pass | module | reads | writes |
//! | --- | --- | --- | --- |
//! | mark | `splats` | `centers`, `shapes`, `units`, `edits`, `masks`, `clip_sides` | `marked`, `block_counts` |
//! | list | `splats` | `marked`, `parts` | `listed`, `part_ranges`, `totals`, `dispatches`, `part_dispatches` |
//! | project | `splats` | `listed`, columns of the scene, appearance, `clip_sides` | `ellipses`, `levels`, `tints`, `rays`, `depth_keys` |
//! | sort | `radix_sort` | `depth_keys` | `depth_order` |
//! | blend by tiles | `tiles`, `ray_tiles` | splats, `depth_order`, `shown_before` | pictures, depth textures, `longest_list` |
//! | or quadrilaterals | `quads`, `early_out`, `visibility_mask` | splats, `depth_order` | `blended` |
//! | compose quadrilaterals | `compose` | `blended` | pictures |
//! | their depth (optional) | `depth` | splats, `depth_order` | depth textures |
//!
//! Tiles write each pixel once, over the background. Only lists that one dispatch does not blend go through `pixels`.
//!
//! The names are those of the shaders' variables. A pass finds its resources by these names: see [`Resources`].

use std::collections::HashMap;

use crate::appearance_buffers::AppearanceBuffers;
use crate::buffers::{RenderTargets, WorkBuffers};
use crate::compose::ComposePass;
use crate::depth::{DepthBindings, QuadDepthPasses};
use crate::device::Gpu;
use crate::error::GpuError;
use crate::quads::{QuadBindings, QuadPasses};
use crate::radix_sort::SortBindings;
use crate::resources::Resources;
use crate::scene_buffers::SceneBuffers;
use crate::settings::Rasterizer;
use crate::splats::{PipelineKey, SplatBindings, SplatPasses};
use crate::stats::StatsReadback;
use crate::textures::PicturePrecision;
use crate::tiles::{ListSizes, TileBindings, TileMode, TilePasses};
use crate::visibility_mask::VisibilityMask;

/// Most edits whose bind groups are kept: twice those of one light.
const MOST_KEYS: usize = 64;

/// Pipelines of all passes.
pub(super) struct Passes {
    splats: SplatPasses,
    tiles: TilePasses,
    /// `None` on a device that cannot blend f32.
    quads: Option<QuadPasses>,
    compose: ComposePass,
    /// Made at the first depths of quadrilaterals.
    quad_depths: Option<QuadDepthPasses>,
}

/// Bind groups of the last frames. Missing ones are bound when a frame needs them.
#[derive(Default)]
pub(super) struct BindGroups {
    splats: Option<SplatGroups>,
    quads: Option<QuadBindings>,
    pub(super) tiles: Option<TileBindings>,
    depths: Option<DepthBindings>,
}

/// Bind groups up to the depth order.
struct SplatGroups {
    /// Generation of the appearance buffers that they belong to.
    generation: u64,
    sort: SortBindings,
    /// Those of the edits so far.
    keyed: HashMap<PipelineKey, SplatBindings>,
}

impl BindGroups {
    /// Drops the bind groups that depend on the size of the pictures.
    pub(super) fn drop_sized(&mut self) {
        self.quads = None;
        self.tiles = None;
        self.depths = None;
    }
}

/// Buffers that the passes of a frame are bound to.
pub(super) struct FrameResources<'a> {
    pub(super) gpu: &'a Gpu,
    pub(super) frame: &'a wgpu::Buffer,
    pub(super) scene: &'a SceneBuffers,
    pub(super) appearance: &'a AppearanceBuffers,
    pub(super) work: &'a WorkBuffers,
    pub(super) targets: &'a RenderTargets,
    /// The visibility mask, if one is set.
    pub(super) mask: Option<&'a VisibilityMask>,
}

/// Choice of the passes of a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct FramePlan {
    /// Width and height of the pictures.
    pub(super) size: [u32; 2],
    /// Whether short lists of tiles may be replaced by longer ones.
    pub(super) may_grow: bool,
    pub(super) rasterizer: Rasterizer,
    pub(super) mode: TileMode,
    pub(super) lists: ListSizes,
    /// Bits of the depth order.
    pub(super) order_bits: u32,
}

/// The bound passes of a frame.
pub(super) struct FramePasses<'a> {
    splats: &'a SplatBindings,
    sort: &'a SortBindings,
    blend: BlendPasses<'a>,
    depths: Option<&'a DepthBindings>,
    /// Capacity of the list of pairs; 0 without one.
    pub(super) pair_capacity: u32,
    order_bits: u32,
}

/// The bound passes of a rasterizer.
enum BlendPasses<'a> {
    Tiles(&'a TileBindings),
    Quads { bindings: &'a QuadBindings, in_bands: bool },
}

impl Passes {
    pub(super) fn new(
        gpu: &Gpu,
        scene: &SceneBuffers,
        [multiview, staged]: [bool; 2],
        pictures: PicturePrecision,
    ) -> Self {
        let multiview = multiview && gpu.has(wgpu::Features::MULTIVIEW);
        Self {
            splats: SplatPasses::new(gpu, scene),
            tiles: TilePasses::new(gpu, pictures, staged),
            quads: gpu.has(wgpu::Features::FLOAT32_BLENDABLE).then(|| QuadPasses::new(gpu, multiview)),
            compose: ComposePass::new(gpu, pictures.format()),
            quad_depths: None,
        }
    }

    /// Whether the device blends quadrilaterals.
    pub(super) fn blends_quads(&self) -> bool {
        self.quads.is_some()
    }

    /// Whether the kernels of a key are compiled.
    pub(super) fn is_compiled(&self, key: PipelineKey) -> bool {
        self.splats.is_compiled(key)
    }

    /// Compiles and binds the kernels of a key. Returns whether it was new.
    pub(super) fn prepare(
        &mut self,
        groups: &mut BindGroups,
        resources: &FrameResources<'_>,
        key: PipelineKey,
    ) -> bool {
        self.bind_key(&mut groups.splats, resources, key).2
    }

    /// Binds the passes up to the depth order for the edits of a key; keeps those of other keys. Returns them, and whether the key
    /// was new.
    fn bind_key<'b>(
        &mut self,
        groups: &'b mut Option<SplatGroups>,
        resources: &FrameResources<'_>,
        key: PipelineKey,
    ) -> (&'b SplatBindings, &'b SortBindings, bool) {
        let &FrameResources { gpu, scene, appearance, work, .. } = resources;
        let generation = appearance.generation;
        let kept = match groups.take().filter(|of| of.generation == generation) {
            Some(fitting) => fitting,
            None => SplatGroups { generation, sort: self.splats.bind_sort(gpu, work), keyed: HashMap::new() },
        };
        let SplatGroups { sort, keyed, .. } = groups.insert(kept);
        if keyed.len() == MOST_KEYS && !keyed.contains_key(&key) {
            keyed.clear();
        }
        let mut is_new = false;
        let splats = keyed.entry(key).or_insert_with(|| {
            is_new = true;
            self.splats.bind(gpu, &of_frame(resources), scene, key)
        });
        (splats, sort, is_new)
    }

    /// Binds the passes of a frame; reuses the bind groups that still fit.
    ///
    /// # Errors
    /// [`GpuError::Views`] for quadrilaterals on a device that cannot blend them.
    pub(super) fn bind<'b>(
        &mut self,
        groups: &'b mut BindGroups,
        resources: &FrameResources<'_>,
        plan: FramePlan,
    ) -> Result<FramePasses<'b>, GpuError> {
        let &FrameResources { gpu, scene, appearance, work, targets, mask, .. } = resources;
        let FramePlan { size, may_grow, rasterizer, mode, lists, order_bits } = plan;
        let BindGroups { splats, quads, tiles, depths } = groups;
        let key = PipelineKey::of(scene, &appearance.state, mode.window.is_some());
        let (splats, sort, _) = self.bind_key(splats, resources, key);
        // Gathered only where something is bound.
        let resources = || of_frame(resources).with([("depth_order", &work.depth_keys.values[sort.result()])]);
        let (blend, pair_capacity) = match rasterizer {
            Rasterizer::Tiles => {
                // Unfitting bind groups are freed here: both at once may exceed the memory.
                let fits = |t: &TileBindings| t.fit(mode, lists) || (!may_grow && t.is_of(mode));
                let mut bindings = match tiles.take().filter(fits) {
                    Some(fitting) => fitting,
                    None => self.tiles.bind(gpu, &resources(), work, targets, (lists, mode)),
                };
                bindings.set_size(size);
                if let Some(mask) = mask {
                    bindings.show_outside(gpu, mask, size);
                }
                let bindings = &*tiles.insert(bindings);
                (BlendPasses::Tiles(bindings), bindings.capacity as u32)
            }
            Rasterizer::Quads | Rasterizer::Bands => {
                let passes = self.quads.as_mut().ok_or_else(|| cannot_blend_quads(gpu))?;
                let in_bands = rasterizer == Rasterizer::Bands;
                let reject = mask.is_some() || in_bands;
                let capacity = targets.capacity;
                let bindings = match quads.take().filter(|q| q.rejects() == reject) {
                    Some(fitting) => fitting,
                    None => passes.bind(gpu, &resources(), &self.compose, (capacity, work.views, reject)),
                };
                let pair_capacity = tiles.as_ref().map_or(0, |t| t.capacity as u32);
                (BlendPasses::Quads { bindings: quads.insert(bindings), in_bands }, pair_capacity)
            }
        };
        // Tiles store their depths where they blend.
        let depths = (mode.depths && rasterizer != Rasterizer::Tiles).then(|| {
            &*depths.get_or_insert_with(|| {
                let passes = self.quad_depths.get_or_insert_with(|| QuadDepthPasses::new(gpu));
                passes.bind(gpu, &resources(), targets.capacity, work.views)
            })
        });
        Ok(FramePasses { splats, sort, blend, depths, pair_capacity, order_bits })
    }
}

/// The resources of all passes of a frame.
fn of_frame<'a>(resources: &FrameResources<'a>) -> Resources<'a> {
    let &FrameResources { frame, scene, appearance, work, .. } = resources;
    let frame = Resources::of([("frame", frame), ("parts", &scene.part_table)]);
    frame.and(&work.resources()).and(&appearance.resources())
}

/// The error of a device without blending in f32.
pub(super) fn cannot_blend_quads(gpu: &Gpu) -> GpuError {
    GpuError::Views(format!("{} cannot blend in f32; draw with tiles", gpu.name()))
}

/// Textures that a frame writes.
#[derive(Clone, Copy)]
pub(super) struct FrameOutput<'a> {
    /// Eye of the first view: 0 left, 1 right.
    pub(super) first_eye: usize,
    /// Width and height of the pictures.
    pub(super) size: [u32; 2],
    pub(super) pictures: &'a [wgpu::Texture],
    /// Empty without depths.
    pub(super) depths: &'a [wgpu::Texture],
}

impl FramePasses<'_> {
    /// Encodes the chain: splats in depth order, blended colors, pictures, depths.
    pub(super) fn encode(
        &self,
        (gpu, mask): (&Gpu, Option<&VisibilityMask>),
        encoder: &mut wgpu::CommandEncoder,
        stats: &mut StatsReadback,
        work: &WorkBuffers,
        output: FrameOutput<'_>,
    ) {
        let dispatches = &work.dispatches;
        self.splats.encode(encoder, stats, work, (self.sort, self.order_bits));
        match self.blend {
            BlendPasses::Tiles(tiles) => tiles.encode(encoder, stats, dispatches, output.first_eye),
            BlendPasses::Quads { bindings, in_bands } => {
                bindings.encode((gpu, mask), encoder, stats, dispatches, (output.first_eye, in_bands));
                bindings.compose.encode(encoder, stats, output.pictures);
            }
        }
        if let Some(depths) = self.depths {
            depths.encode(encoder, dispatches, (output.depths, output.size));
        }
    }
}
