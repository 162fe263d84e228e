//! Blends splats tile by tile: lists pairs of a splat and a tile in depth order, sorts them by tile, blends each list.

use std::collections::HashMap;
use std::mem::offset_of;

use encase::ShaderSize;
use glam::Vec4;
use sg_raster::TILE;

use crate::buffers::{RenderTargets, WorkBuffers, tile_count};
use crate::depth::DEPTH_FORMAT;
use crate::device::Gpu;
use crate::hidden_tiles::shown_before;
use crate::pipeline::{BoundKernel, Kernel};
use crate::radix_sort::{RadixSort, SortBindings, SortBuffers};
use crate::ray_tiles::{RAY_TILE, RayPasses};
use crate::recorded;
use crate::resources::Resources;
use crate::shader::Shader;
use crate::shader_layout::{Dispatches, LANES, LARGE_ITEMS, PairDispatches, STRETCH, Stretch, TileList, Window};
use crate::sort_window::SortWindow;
use crate::stats::{Stage, StatsReadback};
use crate::textures::PicturePrecision;
use crate::tile_shader::source;
use crate::visibility_mask::VisibilityMask;

/// Bytes of the number of large items, before the items.
const LARGE_ITEMS_HEAD: u64 = 4;

/// Constants of the passes over tiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TileMode {
    /// The sort window of each ray in the ray-consistent mode.
    pub(super) window: Option<SortWindow>,
    /// Whether to store the depth of each pixel's front.
    pub(super) depths: bool,
}

/// Sizes of the lists of pairs.
#[derive(Debug, Clone, Copy)]
pub(super) struct ListSizes {
    /// Number of pairs in one window.
    pub(super) capacity: u64,
    /// Number of windows.
    pub(super) windows: u32,
    /// Length of the longest list of a tile.
    pub(super) longest: u32,
}

impl ListSizes {
    /// Number of dispatches that blend the longest list.
    fn stretches(&self) -> u32 {
        self.longest.div_ceil(STRETCH).max(1)
    }
}

/// Kernels of the passes over tiles.
pub(super) struct TilePasses {
    affine: Shader,
    pictures: PicturePrecision,
    /// The entry point of the affine blending.
    blend: &'static str,
    pair_sort: RadixSort,
    touch: Kernel,
    sum_touched: Kernel,
    open_window: Kernel,
    list_pairs: Kernel,
    list_large: Kernel,
    clear_lists: Kernel,
    find_ends: Kernel,
    longest: Kernel,
    /// The affine blending with depths or without, made at their first use.
    blends: HashMap<bool, Kernel>,
    /// Kernels of the ray-consistent mode with and without depths, made at their first use.
    rays: HashMap<(SortWindow, bool), RayPasses>,
    /// The blending of all dispatches but the last one, for lists that one dispatch does not blend; made at their first use.
    continued: HashMap<(Option<SortWindow>, bool), Kernel>,
    /// Bound in the place of a picture that a frame lacks, and of depths.
    spare_picture: wgpu::Texture,
    spare_depths: [wgpu::Texture; 2],
}

impl TilePasses {
    /// `staged` says whether the affine blending copies splats to workgroup memory.
    pub(super) fn new(gpu: &Gpu, pictures: PicturePrecision, staged: bool) -> Self {
        let affine = Shader::new(gpu, "tiles", &[&source(TILE as u32, pictures)]);
        let kernel = |entry| Kernel::new(gpu, &affine, entry, &[]);
        let spare = |format| gpu.texture("spare", ([1, 1], 1), format, wgpu::TextureUsages::STORAGE_BINDING);
        Self {
            pair_sort: RadixSort::new(gpu, "window_pairs"),
            touch: kernel("touch"),
            sum_touched: kernel("sum_touched"),
            open_window: kernel("open_window"),
            list_pairs: kernel("list_pairs"),
            list_large: kernel("list_large"),
            clear_lists: kernel("clear_lists"),
            find_ends: kernel("find_ends"),
            longest: kernel("longest"),
            blends: HashMap::new(),
            rays: HashMap::new(),
            continued: HashMap::new(),
            spare_picture: spare(pictures.format()),
            spare_depths: [(); 2].map(|()| spare(DEPTH_FORMAT)),
            pictures,
            affine,
            blend: if staged { "blend_staged" } else { "blend" },
        }
    }

    /// Binds the passes for pictures of at most the targets' size. Compiles the kernels of a new mode.
    pub(super) fn bind(
        &mut self,
        gpu: &Gpu,
        resources: &Resources<'_>,
        work: &WorkBuffers,
        targets: &RenderTargets,
        (lists, mode): (ListSizes, TileMode),
    ) -> TileBindings {
        let (size, pictures) = (targets.capacity, self.pictures);
        // One view can be drawn to the picture of either eye.
        let firsts = if work.views == 1 { targets.pictures.len().max(1) } else { 1 };
        let stored: Vec<_> = (0..firsts).map(|first| self.stored(targets, first)).collect();
        let Self { affine, blend, pair_sort, blends, rays, continued, .. } = self;
        let rays = mode.window.map(|window| {
            &*rays.entry((window, mode.depths)).or_insert_with(|| RayPasses::new(gpu, window, mode.depths, pictures))
        });
        let flag = |on: bool| f64::from(u8::from(on));
        let affine_blend = |is_continued: bool| {
            Kernel::new(gpu, affine, blend, &[("DEPTHS", flag(mode.depths)), ("CONTINUED", flag(is_continued))])
        };
        let ([touch, list_pairs, list_large], blend) = match rays {
            Some(rays) => ([&rays.touch, &rays.list, &rays.list_large], &rays.blend),
            None => {
                let blend = blends.entry(mode.depths).or_insert_with(|| affine_blend(false));
                ([&self.touch, &self.list_pairs, &self.list_large], &*blend)
            }
        };
        let is_continued = lists.windows > 1 || lists.stretches() > 1;
        let continued = is_continued.then(|| {
            let made = || rays.map_or_else(|| affine_blend(true), |rays| rays.continued_blend(gpu));
            &*continued.entry((mode.window, mode.depths)).or_insert_with(made)
        });

        let [width, height] = size;
        let views = work.views;
        let items = work.capacity * u64::from(views);
        let [across, down] = tile_count(size, work.per_ray);
        let tiles = views * across * down;
        let pixels = u64::from(views) * u64::from(width) * u64::from(height);
        let touched = gpu.storage("touched", 4 * items);
        let touched_sums = gpu.storage("touched, summed", 4 * items.div_ceil(LANES.into()));
        let pairs = SortBuffers::new(gpu, "pairs", lists.capacity);
        let arguments = wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::STORAGE;
        let dispatches = gpu.buffer("pair dispatches", PairDispatches::SHADER_SIZE.get(), arguments);
        let tile_lists = gpu.storage("tile lists", TileList::SHADER_SIZE.get() * u64::from(tiles));
        let pixels = gpu.storage("pixels", if is_continued { Vec4::SHADER_SIZE.get() * pixels } else { 0 });
        let shown_before = gpu.storage("shown before", 4 * 2 * u64::from(down) * u64::from(across + 1));
        let cleared = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let large_items = gpu.buffer("large items", LARGE_ITEMS_HEAD + 4 * u64::from(LARGE_ITEMS), cleared);
        let resources = resources.with([
            ("touched", &touched),
            ("touched_sums", &touched_sums),
            ("large_items", &large_items),
            ("pair_dispatches", &dispatches),
            ("tile_lists", &tile_lists),
            ("pixels", &pixels),
            ("shown_before", &shown_before),
        ]);
        // The greatest key is the number of tiles less one.
        let bits = u32::BITS - tiles.saturating_sub(1).leading_zeros();
        let sort = pair_sort.bind(gpu, &work.totals, &pairs, bits.max(1));
        let set = |k: usize| [("pair_tiles", &pairs.keys[k]), ("pair_splats", &pairs.values[k])];
        // The order by ray reads the second set and writes the first one, the input of the sort by tile.
        let listed = resources.with(set(usize::from(rays.is_some())));
        let sorted = resources.with(set(sort.result()));
        let by_ray = rays.map(|rays| {
            let depths = SortBuffers::new(gpu, "pairs by depth", lists.capacity);
            let sort = pair_sort.bind(gpu, &work.totals, &depths, u32::BITS);
            let measured = [("pair_depths", &depths.keys[0]), ("pair_places", &depths.values[0])];
            let ordered = [
                ("pair_places", &depths.values[sort.result()]),
                ("ordered_tiles", &pairs.keys[0]),
                ("ordered_splats", &pairs.values[0]),
            ];
            RayOrder {
                measure: rays.measure.bind(gpu, &listed.with(measured)),
                order: rays.order.bind(gpu, &listed.with(ordered)),
                sort,
            }
        });
        let bind_blend = |index: u32, k: u32| {
            let stretch = gpu.uniform("stretch", &Stretch { index: index + k, first_item: k * STRETCH });
            let is_last = index + 1 == lists.windows && k + 1 == lists.stretches();
            let kernel = continued.filter(|_| !is_last).unwrap_or(blend);
            let bind = |[first, second, first_depths, second_depths]: &[wgpu::TextureView; 4]| {
                let stored = Resources::of_textures([
                    ("first_picture", first),
                    ("second_picture", second),
                    ("first_depths", first_depths),
                    ("second_depths", second_depths),
                ]);
                kernel.bind(gpu, &sorted.with([("stretch", &stretch)]).and(&stored))
            };
            stored.iter().map(bind).collect()
        };
        let windows = (0..lists.windows).map(|index| {
            let first_pair = (lists.capacity * u64::from(index)) as u32;
            let window = gpu.uniform("window", &Window { first_pair, index });
            let listed = listed.with([("window", &window)]);
            WindowBindings {
                open: self.open_window.bind(gpu, &listed),
                list: list_pairs.bind(gpu, &listed),
                list_large: list_large.bind(gpu, &listed),
                blend: (0..lists.stretches()).map(|k| bind_blend(index, k)).collect(),
            }
        });
        TileBindings {
            capacity: lists.capacity,
            mode,
            windows: windows.collect(),
            touch: touch.bind(gpu, &resources),
            sum_touched: self.sum_touched.bind(gpu, &resources),
            by_ray,
            sort,
            clear_lists: self.clear_lists.bind(gpu, &resources),
            find_ends: self.find_ends.bind(gpu, &sorted),
            longest: self.longest.bind(gpu, &resources),
            dispatches,
            large_items,
            shown_before,
            shown: None,
            grid: [across, down, views],
            clear_groups: tiles.div_ceil(LANES),
        }
    }

    /// Views of what the blending stores from the picture `first` on: two pictures, two depths.
    fn stored(&self, targets: &RenderTargets, first: usize) -> [wgpu::TextureView; 4] {
        let Self { spare_picture, spare_depths: [first_depths, second_depths], .. } = self;
        let [pictures, depths] = [&targets.pictures, &targets.depths].map(|all| all.get(first..).unwrap_or_default());
        [
            pictures.first().unwrap_or(spare_picture),
            pictures.get(1).unwrap_or(spare_picture),
            depths.first().unwrap_or(first_depths),
            depths.get(1).unwrap_or(second_depths),
        ]
        .map(|texture| texture.create_view(&wgpu::TextureViewDescriptor::default()))
    }
}

/// The bound passes over tiles.
pub(super) struct TileBindings {
    /// Number of pairs in one window.
    pub(super) capacity: u64,
    mode: TileMode,
    touch: BoundKernel,
    sum_touched: BoundKernel,
    windows: Vec<WindowBindings>,
    /// The ray-consistent mode only.
    by_ray: Option<RayOrder>,
    sort: SortBindings,
    clear_lists: BoundKernel,
    find_ends: BoundKernel,
    longest: BoundKernel,
    /// [`PairDispatches`].
    dispatches: wgpu::Buffer,
    /// The number of large items, and the items.
    large_items: wgpu::Buffer,
    /// Tiles across and down, and views.
    grid: [u32; 3],
    /// Workgroups of the passes over all tiles.
    clear_groups: u32,
    /// For each row of tiles of both eyes, the number of tiles outside the visibility mask before each column.
    shown_before: wgpu::Buffer,
    /// Number of the mask and size of the pictures that it belongs to.
    shown: Option<(u64, [u32; 2])>,
}

/// Brings pairs into the order of the rays before the sort by tile.
struct RayOrder {
    measure: BoundKernel,
    sort: SortBindings,
    order: BoundKernel,
}

/// One window of pairs.
struct WindowBindings {
    open: BoundKernel,
    list: BoundKernel,
    list_large: BoundKernel,
    /// Stretches of the lists, one after another; each from the picture of either eye on, if that differs.
    blend: Vec<Vec<BoundKernel>>,
}

impl TileBindings {
    /// Whether the passes are of this mode and the lists have room for `lists`.
    pub(super) fn fit(&self, mode: TileMode, lists: ListSizes) -> bool {
        self.mode == mode
            && self.capacity >= lists.capacity
            && self.windows.len() >= lists.windows as usize
            && self.blend_all_of(lists.longest)
    }

    /// Sets the size of the next pictures, at most that of the binding.
    pub(super) fn set_size(&mut self, size: [u32; 2]) {
        let [across, down] = tile_count(size, self.mode.window.is_some());
        self.grid = [across, down, self.grid[2]];
        self.clear_groups = (across * down * self.grid[2]).div_ceil(LANES);
    }

    /// Sets the tiles outside a visibility mask for pictures of `size` pixels.
    pub(super) fn show_outside(&mut self, gpu: &Gpu, mask: &VisibilityMask, size: [u32; 2]) {
        let wanted = Some((mask.number, size));
        if self.shown != wanted {
            let edge = if self.mode.window.is_some() { RAY_TILE } else { TILE as u32 };
            let table = shown_before(&mask.triangles, size, edge);
            gpu.write(&self.shown_before, 0, bytemuck::cast_slice(&table));
            self.shown = wanted;
        }
    }

    /// Whether the passes are of this mode, with lists of any length.
    pub(super) fn is_of(&self, mode: TileMode) -> bool {
        self.mode == mode
    }

    /// Whether a picture with this many pairs and this longest list is complete.
    pub(super) fn complete(&self, pairs: u64, longest: u32) -> bool {
        pairs <= self.capacity * self.windows.len() as u64 && self.blend_all_of(longest)
    }

    /// Whether the passes blend a list of this length to its end.
    fn blend_all_of(&self, longest: u32) -> bool {
        let stretches = self.windows.first().map_or(0, |w| w.blend.len() as u64);
        u64::from(longest) <= stretches * u64::from(STRETCH)
    }

    /// Encodes all windows, near to far: list, sort, blend. The first view is that of the eye `first_eye`.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        stats: &mut StatsReadback,
        dispatches: &wgpu::Buffer,
        first_eye: usize,
    ) {
        let of_pairs = &self.dispatches;
        let (sort, all_pairs) = (offset_of!(PairDispatches, sort), offset_of!(PairDispatches, pairs));
        let large = offset_of!(PairDispatches, large);
        recorded::clear(&self.large_items);
        encoder.clear_buffer(&self.large_items, 0, Some(LARGE_ITEMS_HEAD));
        let items = offset_of!(Dispatches, tile_lists);
        for (k, window) in self.windows.iter().enumerate() {
            {
                let mut pass = stats.compute_pass(encoder, Stage::Bin);
                if k == 0 {
                    self.touch.run_indirect(&mut pass, dispatches, items);
                    self.sum_touched.run(&mut pass, [1, 1, 1]);
                }
                window.open.run(&mut pass, [1, 1, 1]);
                window.list.run_indirect(&mut pass, dispatches, items);
                window.list_large.run_indirect(&mut pass, of_pairs, large);
                if let Some(by_ray) = &self.by_ray {
                    by_ray.measure.run_indirect(&mut pass, of_pairs, all_pairs);
                    by_ray.sort.run(&mut pass, of_pairs, sort);
                    by_ray.order.run_indirect(&mut pass, of_pairs, all_pairs);
                }
            }
            self.sort.run(&mut stats.compute_pass(encoder, Stage::PairSort), of_pairs, sort);
            {
                let mut pass = stats.compute_pass(encoder, Stage::Bin);
                self.clear_lists.run(&mut pass, [self.clear_groups, 1, 1]);
                self.find_ends.run_indirect(&mut pass, of_pairs, all_pairs);
                self.longest.run(&mut pass, [self.clear_groups, 1, 1]);
            }
            let mut pass = stats.compute_pass(encoder, Stage::Blend);
            for blend in window.blend.iter().filter_map(|firsts| firsts.get(first_eye)) {
                blend.run(&mut pass, self.grid);
            }
        }
    }
}
