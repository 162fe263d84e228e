//! The buffers that pictures are made in, and how the passes are bound to them.

use super::columns::{Columns, PartColumns};
use super::device::Gpu;
use super::hidden;
use super::kernel::Kernel;
use super::look::Look;
use super::passes::{BANDS, Needs, PICTURE, Passes};
use super::rays::{EDGE, TINT, Waiting};
use super::sort::{Pairs, Sorting};
use super::uniform::Part;
use sg_raster::TILE;

/// Bytes of each of the three vectors of a splat.
const VECTOR: u64 = 16;

/// Word of the dispatches at which the draw of all quadrilaterals stands.
pub(super) const ALL_DRAWN: u64 = 6;

/// Words of the dispatches before those of the bands, four each, and of the parts, three each.
pub(super) const BAND_DRAWS: u64 = 10;
pub(super) const PART_DISPATCHES: u64 = BAND_DRAWS + 4 * BANDS;

/// Buffers whose size the scene decides.
pub(super) struct Work {
    /// Gaussians that can be listed at once.
    pub(super) capacity: u64,
    pub(super) views: u32,
    /// Whether splats say what rays meet.
    per_ray: bool,
    bits: wgpu::Buffer,
    blocks: wgpu::Buffer,
    stretches: wgpu::Buffer,
    pub(super) totals: wgpu::Buffer,
    /// Splats of the longest list of a tile.
    pub(super) longest: wgpu::Buffer,
    pub(super) dispatches: wgpu::Buffer,
    listed: wgpu::Buffer,
    /// Ellipses, levels, tints.
    splats: [wgpu::Buffer; 3],
    depths: Pairs,
}

impl Work {
    /// For as many views; the capacity is the whole scene's unless a binding's limit is in the way.
    pub(super) fn new(gpu: &Gpu, columns: &Columns, views: u32, per_ray: bool) -> Self {
        let tint = if per_ray { TINT } else { 1 };
        let capacity = (columns.len as u64).min(gpu.largest_binding() / (tint * VECTOR * u64::from(views))).max(1);
        let blocks = u64::from(columns.blocks);
        let parts = columns.parts.len() as u64;
        Self {
            capacity,
            views,
            per_ray,
            bits: gpu.storage("bits", 128 * blocks),
            blocks: gpu.storage("blocks", 4 * blocks),
            stretches: gpu.storage("stretches", 8 * parts),
            totals: gpu.storage("totals", 16),
            longest: gpu.storage("longest list", 4),
            dispatches: gpu.buffer(
                "dispatches",
                4 * (PART_DISPATCHES + 3 * parts),
                wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::STORAGE,
            ),
            listed: gpu.storage("listed", 4 * capacity),
            splats: [("ellipses", 1), ("levels", 1), ("tints", tint)]
                .map(|(label, vectors)| gpu.storage(label, vectors * VECTOR * capacity * u64::from(views))),
            depths: Pairs::new(gpu, "depths", capacity),
        }
    }

    /// What quadrilaterals are drawn from.
    pub(super) fn of_quads<'a>(
        &'a self,
        frame: &'a wgpu::Buffer,
        order: &Sorting,
    ) -> [(u32, wgpu::BindingResource<'a>); 5] {
        let [ellipses, levels, tints] = &self.splats;
        let values = &self.depths.values[order.result()];
        [(0, frame), (1, ellipses), (2, values), (3, levels), (4, tints)].map(|(at, b)| (at, b.as_entire_binding()))
    }

    pub(super) fn serves(&self, views: u32, per_ray: bool) -> bool {
        (self.views, self.per_ray) == (views, per_ray)
    }
}

/// What the pictures' size decides.
pub(super) struct Canvas {
    pub(super) size: [u32; 2],
    pub(super) pictures: Vec<wgpu::Texture>,
    /// Depths of them, where they are asked for.
    pub(super) depths: Vec<wgpu::Texture>,
}

impl Canvas {
    pub(super) fn new(gpu: &Gpu, size: [u32; 2], views: usize) -> Self {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC;
        Self { size, pictures: (0..views).map(|_| texture(gpu, size, 1, usage)).collect(), depths: Vec::new() }
    }
}

pub(super) fn texture(gpu: &Gpu, size: [u32; 2], layers: u32, usage: wgpu::TextureUsages) -> wgpu::Texture {
    gpu.texture("picture", (size, layers), PICTURE, usage)
}

/// Passes up to the depth order, bound.
pub(super) struct Ordering {
    pub(super) mark: Vec<wgpu::BindGroup>,
    pub(super) sum_blocks: wgpu::BindGroup,
    pub(super) list: Vec<wgpu::BindGroup>,
    pub(super) project: Vec<wgpu::BindGroup>,
    pub(super) depths: Sorting,
}

impl Ordering {
    pub(super) fn bind(
        gpu: &Gpu,
        frame: &wgpu::Buffer,
        (columns, look, work): (&Columns, &Look, &Work),
        passes: &mut Passes,
        needs: Needs,
    ) -> Self {
        let depths = passes.depth_sort.bind(gpu, &work.totals, &work.depths, u32::BITS);
        let sum_blocks = passes.sum_blocks.bind(
            gpu,
            &[
                (0, frame),
                (3, &work.blocks),
                (4, &work.stretches),
                (5, &work.totals),
                (6, &work.dispatches),
                (8, &columns.part_table),
            ],
        );
        let list = columns.parts.iter().map(|p| {
            let buffers = [(0, frame), (1, &p.uniform), (2, &work.bits), (3, &work.blocks), (7, &work.listed)];
            passes.list.bind(gpu, &buffers)
        });
        let list = list.collect();
        let kernels = passes.specialised(gpu, needs);
        // What scene.wgsl names, and what a pass names beside it.
        let of_scene = |kernel: &Kernel, p: &PartColumns, own: &[(u32, &wgpu::Buffer)]| {
            let scene = [
                (0, frame),
                (1, &p.uniform),
                (2, &p.centers),
                (3, &p.shapes),
                (4, &look.units),
                (5, &look.edits),
                (6, &look.masks),
            ];
            kernel.bind(gpu, &[&scene, own].concat())
        };
        let mark = columns
            .parts
            .iter()
            .map(|p| of_scene(&kernels.mark, p, &[(7, &look.sides), (8, &work.bits), (9, &work.blocks)]));
        let [ellipses, levels, tints] = &work.splats;
        let project = columns.parts.iter().map(|p| {
            let own = [
                (7, &p.surfaces),
                (8, &p.harmonics),
                (9, &look.colors),
                (10, &work.stretches),
                (11, &work.listed),
                (12, ellipses),
                (13, levels),
                (14, tints),
                (15, &work.depths.keys[0]),
                (16, &work.depths.values[0]),
            ];
            of_scene(&kernels.project, p, &own)
        });
        Self { mark: mark.collect(), sum_blocks, list, project: project.collect(), depths }
    }
}

/// Quadrilaterals, bound.
pub(super) struct Quads {
    /// A layer for each view.
    blended: wgpu::Texture,
    /// The same of what hides, where pixels may be hidden or closed.
    depths: Option<wgpu::Texture>,
    /// One for each view, or one for both.
    pub(super) draw: Vec<wgpu::BindGroup>,
    /// One for each view, where pixels may be closed.
    pub(super) close: Vec<wgpu::BindGroup>,
    pub(super) compose: Vec<wgpu::BindGroup>,
}

impl Quads {
    pub(super) fn bind(
        gpu: &Gpu,
        frame: &wgpu::Buffer,
        (work, order): (&Work, &Sorting),
        passes: &Passes,
        (size, tested): ([u32; 2], bool),
    ) -> Self {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
        let blended = texture(gpu, size, work.views, usage);
        let pipelines = passes.quads_of(work.views, tested).0;
        let draw = pipelines.iter().map(|pipeline| group(gpu, pipeline, &work.of_quads(frame, order)));
        let compose = (0..work.views).zip(&passes.compose_quads).map(|(k, pipeline)| {
            let view = layer(&blended, k);
            group(gpu, pipeline, &[(0, frame.as_entire_binding()), (2, wgpu::BindingResource::TextureView(&view))])
        });
        let closing = passes.tested().filter(|_| tested).map(|t| &t.closing);
        let close = closing.into_iter().flat_map(|c| (0..work.views).map(|k| c.bind(gpu, frame, &layer(&blended, k))));
        let (draw, close, compose) = (draw.collect(), close.collect(), compose.collect());
        let depths = tested.then(|| hidden::depths(gpu, size, work.views));
        Self { blended, depths, draw, close, compose }
    }

    /// What one view is blended in, or both are where they are drawn together.
    pub(super) fn target(&self, view: u32, together: bool) -> wgpu::TextureView {
        Self::part(&self.blended, view, together)
    }

    /// As [`Self::target`], of what hides.
    pub(super) fn depths(&self, view: u32, together: bool) -> Option<wgpu::TextureView> {
        self.depths.as_ref().map(|depths| Self::part(depths, view, together))
    }

    /// Whether pixels may be hidden or closed.
    pub(super) fn is_tested(&self) -> bool {
        self.depths.is_some()
    }

    fn part(texture: &wgpu::Texture, view: u32, together: bool) -> wgpu::TextureView {
        if !together {
            return layer(texture, view);
        }
        texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..wgpu::TextureViewDescriptor::default()
        })
    }
}

pub(super) fn layer(texture: &wgpu::Texture, at: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2),
        base_array_layer: at,
        array_layer_count: Some(1),
        ..wgpu::TextureViewDescriptor::default()
    })
}

pub(super) fn group(
    gpu: &Gpu,
    pipeline: &wgpu::RenderPipeline,
    resources: &[(u32, wgpu::BindingResource<'_>)],
) -> wgpu::BindGroup {
    let entries: Vec<wgpu::BindGroupEntry> = resources
        .iter()
        .map(|(binding, resource)| wgpu::BindGroupEntry { binding: *binding, resource: resource.clone() })
        .collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries,
    })
}

/// What passes over tiles are specialised on: how layers of a ray wait in the view-consistent mode, and whether depths are noted.
pub(super) type Mode = (Option<Waiting>, bool);

/// Tiles, bound.
pub(super) struct Tiles {
    pub(super) capacity: u64,
    pub(super) touch: wgpu::BindGroup,
    pub(super) sum_touched: wgpu::BindGroup,
    pub(super) windows: Vec<Window>,
    pub(super) clear_lists: wgpu::BindGroup,
    pub(super) find_ends: wgpu::BindGroup,
    pub(super) longest: wgpu::BindGroup,
    pub(super) sorting: Sorting,
    /// Before the sort by tile, in the view-consistent mode.
    pub(super) by_depth: Option<ByDepth>,
    /// How layers of a ray wait there, and whether depths are noted.
    pub(super) mode: Mode,
    /// Depth of each pixel's front, view after view, where depths are noted.
    pub(super) fronts: wgpu::Buffer,
    /// Dispatches of the pairs' sort and of their ends.
    pub(super) dispatches: wgpu::Buffer,
    pub(super) compose: Vec<wgpu::BindGroup>,
    pub(super) clear_groups: u32,
}

/// Pairs in the order of their depths, bound.
pub(super) struct ByDepth {
    pub(super) measure: wgpu::BindGroup,
    pub(super) sorting: Sorting,
    /// Takes that order up.
    pub(super) order: wgpu::BindGroup,
}

/// One window of pairs.
pub(super) struct Window {
    pub(super) open: wgpu::BindGroup,
    pub(super) list: wgpu::BindGroup,
    /// Stretches of the lists, one after another.
    pub(super) blend: Vec<wgpu::BindGroup>,
}

/// Splats of one tile that are blended by one dispatch: STRETCH of tiles.wgsl.
pub(super) const STRETCH: u32 = 32_768;

impl Tiles {
    /// Whether so many windows of so many pairs fit.
    pub(super) fn holds(&self, capacity: u64, windows: u32) -> bool {
        self.capacity >= capacity && self.windows.len() >= windows as usize
    }

    /// Whether a list of so many splats is blended to its end.
    pub(super) fn blends(&self, longest: u32) -> bool {
        let stretches = self.windows.first().map_or(0, |w| w.blend.len() as u64);
        u64::from(longest) <= stretches * u64::from(STRETCH)
    }

    pub(super) fn bind(
        gpu: &Gpu,
        frame: &wgpu::Buffer,
        (work, order): (&Work, &Sorting),
        passes: &Passes,
        [width, height]: [u32; 2],
        (capacity, windows, stretches): (u64, u32, u32),
        mode: Mode,
    ) -> Self {
        let (waiting, depths_noted) = mode;
        let views = work.views;
        let items = work.capacity * u64::from(views);
        let tiles = views * tile_count([width, height], work.per_ray).iter().product::<u32>();
        let pixels = u64::from(views) * u64::from(width) * u64::from(height);
        let touched = gpu.storage("touched", 4 * items);
        let sums = gpu.storage("touched, summed", 4 * items.div_ceil(256));
        let pairs = Pairs::new(gpu, "pairs", capacity);
        let dispatches = gpu.buffer("pair dispatches", 24, wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::STORAGE);
        let lists = gpu.storage("lists", 8 * u64::from(tiles));
        let fronts = gpu.storage("fronts", if depths_noted { 4 * pixels } else { 0 });
        let pixels = gpu.storage("pixels", 16 * pixels);
        let values = &work.depths.values[order.result()];
        let [ellipses, levels, tints] = &work.splats;
        // The last key is the number of tiles less one.
        let bits = u32::BITS - tiles.saturating_sub(1).leading_zeros();
        let sorting = passes.pair_sort.bind(gpu, &work.totals, &pairs, bits.max(1));
        let (keys, splats) = (&pairs.keys[sorting.result()], &pairs.values[sorting.result()]);
        let rays = passes.rays(waiting, depths_noted);
        let depths = rays.map(|_| Pairs::new(gpu, "pairs by depth", capacity));
        // What the sort by tile begins with is the other list in the order of depths.
        let listed = usize::from(rays.is_some());
        let by_depth = rays.zip(depths.as_ref()).map(|(rays, depths)| {
            let sorting = passes.pair_sort.bind(gpu, &work.totals, depths, u32::BITS);
            let buffers = [
                (4, &work.totals),
                (7, &pairs.keys[1]),
                (8, &pairs.values[1]),
                (16, &depths.values[sorting.result()]),
                (17, &pairs.keys[0]),
                (18, &pairs.values[0]),
            ];
            let order = rays.order.bind(gpu, &buffers);
            let buffers = [
                (0, frame),
                (2, ellipses),
                (4, &work.totals),
                (7, &pairs.keys[1]),
                (8, &pairs.values[1]),
                (12, levels),
                (13, tints),
                (15, &depths.keys[0]),
                (16, &depths.values[0]),
            ];
            ByDepth { measure: rays.measure.bind(gpu, &buffers), sorting, order }
        });
        let blend = |window: u32, stretch: u32| {
            let part = gpu.buffer("stretch", 16, wgpu::BufferUsages::UNIFORM);
            // What was blended before is gone on with from the second on.
            let index = window + stretch;
            let told = Part { index, block: stretch * STRETCH, ..Part::default() };
            gpu.queue.write_buffer(&part, 0, bytemuck::bytes_of(&told));
            let buffers = [
                (0, frame),
                (1, &part),
                (2, ellipses),
                (8, splats),
                (10, &lists),
                (11, &pixels),
                (12, levels),
                (13, tints),
                (19, &fronts),
            ];
            rays.map_or(passes.blend_of(depths_noted), |r| &r.blend).bind(gpu, &buffers)
        };
        let windows = (0..windows).map(|index| {
            let first = (capacity * u64::from(index)) as u32;
            let part = gpu.buffer("window", 16, wgpu::BufferUsages::UNIFORM);
            gpu.queue.write_buffer(&part, 0, bytemuck::bytes_of(&Part { first, index, ..Part::default() }));
            Window {
                open: passes
                    .open_window
                    .bind(gpu, &[(0, frame), (1, &part), (4, &work.totals), (9, &dispatches), (14, &work.longest)]),
                list: rays.map_or(&passes.list_pairs, |r| &r.list).bind(
                    gpu,
                    &[
                        (0, frame),
                        (1, &part),
                        (2, ellipses),
                        (3, values),
                        (4, &work.totals),
                        (5, &touched),
                        (6, &sums),
                        (7, &pairs.keys[listed]),
                        (8, &pairs.values[listed]),
                        (12, levels),
                    ],
                ),
                blend: (0..stretches).map(|stretch| blend(index, stretch)).collect(),
            }
        });
        let compose =
            passes.compose_tiles.iter().take(views as usize).map(|pipeline| {
                group(gpu, pipeline, &[(0, frame.as_entire_binding()), (1, pixels.as_entire_binding())])
            });
        Self {
            capacity,
            touch: rays.map_or(&passes.touch, |r| &r.touch).bind(
                gpu,
                &[(0, frame), (2, ellipses), (3, values), (4, &work.totals), (5, &touched), (6, &sums), (12, levels)],
            ),
            sum_touched: passes.sum_touched.bind(gpu, &[(0, frame), (4, &work.totals), (6, &sums)]),
            windows: windows.collect(),
            clear_lists: passes.clear_lists.bind(gpu, &[(0, frame), (10, &lists)]),
            longest: passes.longest.bind(gpu, &[(0, frame), (10, &lists), (14, &work.longest)]),
            find_ends: passes.find_ends.bind(gpu, &[(4, &work.totals), (7, keys), (10, &lists)]),
            sorting,
            by_depth,
            mode,
            fronts,
            dispatches,
            compose: compose.collect(),
            clear_groups: tiles.div_ceil(256),
        }
    }
}

/// Tiles across and down.
pub(super) fn tile_count([width, height]: [u32; 2], per_ray: bool) -> [u32; 2] {
    let edge = if per_ray { EDGE } else { TILE as u32 };
    [width.div_ceil(edge), height.div_ceil(edge)]
}
