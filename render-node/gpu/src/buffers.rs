//! Buffers that the passes share, and the target textures of a picture.

use crate::device::Gpu;
use crate::radix_sort::{SortBindings, SortBuffers};
use crate::scene_buffers::SceneBuffers;
use crate::shader_layout::dispatch;
use crate::textures::picture_texture;
use sg_raster::TILE;

use crate::ray_tiles::RAY_TILE;

/// Bytes of a vector of four f32.
const VECTOR: u64 = 16;

/// Vectors of a splat's tint in the ray-consistent mode: a color, and the coefficients of its rays.
const RAY_TINT: u64 = 3;

/// Projected splats, all views of one list after another.
pub(super) struct SplatBuffers {
    pub(super) ellipses: wgpu::Buffer,
    pub(super) levels: wgpu::Buffer,
    pub(super) tints: wgpu::Buffer,
}

/// Buffers whose size depends on the scene and the number of views.
pub(super) struct WorkBuffers {
    /// Limit of the number of listed Gaussians.
    pub(super) capacity: u64,
    /// Number of views that are drawn together.
    pub(super) views: u32,
    /// Whether tints hold ray coefficients.
    pub(super) per_ray: bool,
    /// A bit for each Gaussian that may be visible.
    pub(super) marked: wgpu::Buffer,
    /// Number of marked Gaussians in each block, then the sums before each block.
    pub(super) block_counts: wgpu::Buffer,
    /// First place and length of each part in the list.
    pub(super) part_ranges: wgpu::Buffer,
    /// Words of [`crate::shader_layout::Total`].
    pub(super) totals: wgpu::Buffer,
    /// Length of the longest list of a tile.
    pub(super) longest: wgpu::Buffer,
    /// Words of [`dispatch`].
    pub(super) dispatches: wgpu::Buffer,
    /// Scene-wide indices of the listed Gaussians.
    pub(super) listed: wgpu::Buffer,
    pub(super) splats: SplatBuffers,
    /// Depths of the listed Gaussians as keys, places in the list as values.
    pub(super) depth_keys: SortBuffers,
}

impl WorkBuffers {
    /// Buffers for `views` views. The capacity is the whole scene unless a binding's limit is smaller.
    pub(super) fn new(gpu: &Gpu, scene: &SceneBuffers, views: u32, per_ray: bool) -> Self {
        let tint = if per_ray { RAY_TINT } else { 1 };
        let capacity = (scene.len as u64).min(gpu.largest_binding() / (tint * VECTOR * u64::from(views))).max(1);
        let blocks = u64::from(scene.blocks);
        let parts = scene.parts.len() as u64;
        let splats = |label, vectors| gpu.storage(label, vectors * VECTOR * capacity * u64::from(views));
        Self {
            capacity,
            views,
            per_ray,
            marked: gpu.storage("marked", 128 * blocks),
            block_counts: gpu.storage("block counts", 4 * blocks),
            part_ranges: gpu.storage("part ranges", 8 * parts),
            totals: gpu.storage("totals", 16),
            longest: gpu.storage("longest list", 4),
            dispatches: gpu.buffer(
                "dispatches",
                4 * (dispatch::PARTS + 3 * parts),
                wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::STORAGE,
            ),
            listed: gpu.storage("listed", 4 * capacity),
            splats: SplatBuffers {
                ellipses: splats("ellipses", 1),
                levels: splats("levels", 1),
                tints: splats("tints", tint),
            },
            depth_keys: SortBuffers::new(gpu, "depths", capacity),
        }
    }

    /// Whether the buffers are for this number of views in this mode.
    pub(super) fn fit(&self, views: u32, per_ray: bool) -> bool {
        (self.views, self.per_ray) == (views, per_ray)
    }

    /// The list of splats in the order of depth.
    pub(super) fn ordered(&self, order: &SortBindings) -> &wgpu::Buffer {
        &self.depth_keys.values[order.result()]
    }

    /// Bindings of quads.wgsl.
    pub(super) fn quad_resources<'a>(
        &'a self,
        frame: &'a wgpu::Buffer,
        order: &SortBindings,
    ) -> [(u32, wgpu::BindingResource<'a>); 5] {
        let SplatBuffers { ellipses, levels, tints } = &self.splats;
        [(0, frame), (1, ellipses), (2, self.ordered(order)), (3, levels), (4, tints)]
            .map(|(at, b)| (at, b.as_entire_binding()))
    }
}

/// Target textures of a picture.
pub(super) struct RenderTargets {
    pub(super) size: [u32; 2],
    /// One picture for each camera.
    pub(super) pictures: Vec<wgpu::Texture>,
    /// Their depths, if requested.
    pub(super) depths: Vec<wgpu::Texture>,
}

impl RenderTargets {
    pub(super) fn new(gpu: &Gpu, size: [u32; 2], views: usize) -> Self {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC;
        Self { size, pictures: (0..views).map(|_| picture_texture(gpu, size, 1, usage)).collect(), depths: Vec::new() }
    }
}

/// Number of tiles across and down.
pub(super) fn tile_count([width, height]: [u32; 2], per_ray: bool) -> [u32; 2] {
    let edge = if per_ray { RAY_TILE } else { TILE as u32 };
    [width.div_ceil(edge), height.div_ceil(edge)]
}
