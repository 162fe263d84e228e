//! Buffers that the passes share, and the target textures of a picture.

use std::num::NonZeroU64;

use encase::ShaderSize;
use sg_raster::TILE;

use crate::device::Gpu;
use crate::radix_sort::SortBuffers;
use crate::ray_tiles::RAY_TILE;
use crate::resources::Resources;
use crate::scene_buffers::SceneBuffers;
use crate::shader_layout::{
    DispatchArguments, Dispatches, Ellipse, Level, MARK_WORDS, NearRay, PartRange, RayCoefficients, SORT_BLOCK, Tint,
    Totals,
};
use crate::textures::PicturePrecision;

/// Limit of the Gaussians that rays evaluate in the affine mode. Those are large in the picture, so that few are in view. More
/// are an error.
const NEAR_RAYS: u64 = 1 << 20;

/// Workgroups of a dispatch along one axis that every device can run. Nobody validates our indirect dispatches.
pub(super) const MAX_WORKGROUPS: u64 = 65_535;

/// Bytes before the first [`NearRay`]: their number, aligned.
pub(super) const NEAR_RAYS_HEAD: u64 = 16;

/// Projected splats, all views of one list after another.
struct SplatBuffers {
    /// [`Ellipse`]s.
    ellipses: wgpu::Buffer,
    /// [`Level`]s.
    levels: wgpu::Buffer,
    /// [`Tint`]s.
    tints: wgpu::Buffer,
    /// [`RayCoefficients`]; empty in the affine mode.
    rays: wgpu::Buffer,
    /// The number of [`NearRay`]s, then those; of one in the ray-consistent mode.
    near_rays: wgpu::Buffer,
}

/// Buffers whose size depends on the scene and the number of views.
pub(super) struct WorkBuffers {
    /// Limit of the number of listed Gaussians.
    pub(super) capacity: u64,
    /// Limit of the number of Gaussians that rays evaluate in the affine mode, over all views.
    pub(super) near_capacity: u64,
    /// Number of views that are drawn together.
    pub(super) views: u32,
    /// Whether the splats have ray coefficients.
    pub(super) per_ray: bool,
    /// A bit for each Gaussian that may be visible.
    marked: wgpu::Buffer,
    /// Number of marked Gaussians in each block, then the sums before each block.
    block_counts: wgpu::Buffer,
    /// A [`PartRange`] for each part.
    part_ranges: wgpu::Buffer,
    /// [`Totals`].
    pub(super) totals: wgpu::Buffer,
    /// Length of the longest list of a tile.
    pub(super) longest_list: wgpu::Buffer,
    /// [`Dispatches`].
    pub(super) dispatches: wgpu::Buffer,
    /// [`DispatchArguments`] of the projection of each part.
    pub(super) part_dispatches: wgpu::Buffer,
    /// Scene-wide indices of the listed Gaussians.
    listed: wgpu::Buffer,
    splats: SplatBuffers,
    /// Depths of the listed Gaussians as keys, places in the list as values.
    pub(super) depth_keys: SortBuffers,
}

impl WorkBuffers {
    /// Buffers for `views` views. The capacity is the whole scene unless a binding's limit is smaller.
    pub(super) fn new(gpu: &Gpu, scene: &SceneBuffers, views: u32, per_ray: bool) -> Self {
        let widest = if per_ray { RayCoefficients::SHADER_SIZE } else { Ellipse::SHADER_SIZE };
        let capacity = (scene.len as u64)
            .min(gpu.largest_binding() / (widest.get() * u64::from(views)))
            .clamp(1, MAX_WORKGROUPS * u64::from(SORT_BLOCK));
        let near_capacity = if per_ray { 1 } else { NEAR_RAYS.min(capacity * u64::from(views)) };
        let blocks = u64::from(scene.blocks);
        let parts = scene.parts.len() as u64;
        let splats = |label, bytes: NonZeroU64| gpu.storage(label, bytes.get() * capacity * u64::from(views));
        let arguments =
            |label, bytes| gpu.buffer(label, bytes, wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::STORAGE);
        Self {
            capacity,
            near_capacity,
            views,
            per_ray,
            marked: gpu.storage("marked", 4 * u64::from(MARK_WORDS) * blocks),
            block_counts: gpu.storage("block counts", 4 * blocks),
            part_ranges: gpu.storage("part ranges", PartRange::SHADER_SIZE.get() * parts),
            totals: gpu.storage("totals", Totals::SHADER_SIZE.get()),
            longest_list: gpu.storage("longest list", 4),
            dispatches: arguments("dispatches", Dispatches::SHADER_SIZE.get()),
            part_dispatches: arguments("part dispatches", DispatchArguments::SHADER_SIZE.get() * parts),
            listed: gpu.storage("listed", 4 * capacity),
            splats: SplatBuffers {
                ellipses: splats("ellipses", Ellipse::SHADER_SIZE),
                levels: splats("levels", Level::SHADER_SIZE),
                tints: splats("tints", Tint::SHADER_SIZE),
                near_rays: gpu.storage("near rays", NEAR_RAYS_HEAD + NearRay::SHADER_SIZE.get() * near_capacity),
                rays: if per_ray { splats("rays", RayCoefficients::SHADER_SIZE) } else { gpu.storage("rays", 0) },
            },
            depth_keys: SortBuffers::new(gpu, "depths", capacity),
        }
    }

    /// Whether the buffers are for this number of views in this mode.
    pub(super) fn fit(&self, views: u32, per_ray: bool) -> bool {
        (self.views, self.per_ray) == (views, per_ray)
    }

    /// The number of Gaussians that rays evaluate in the affine mode, in the first bytes.
    pub(super) fn near_rays(&self) -> &wgpu::Buffer {
        &self.splats.near_rays
    }

    /// The buffers by name.
    pub(super) fn resources(&self) -> Resources<'_> {
        let SplatBuffers { ellipses, levels, tints, rays, near_rays } = &self.splats;
        Resources::of([
            ("marked", &self.marked),
            ("block_counts", &self.block_counts),
            ("part_ranges", &self.part_ranges),
            ("totals", &self.totals),
            ("longest_list", &self.longest_list),
            ("dispatches", &self.dispatches),
            ("part_dispatches", &self.part_dispatches),
            ("listed", &self.listed),
            ("ellipses", ellipses),
            ("levels", levels),
            ("tints", tints),
            ("rays", rays),
            ("near_rays", near_rays),
            ("depth_keys", &self.depth_keys.keys[0]),
            ("depth_places", &self.depth_keys.values[0]),
        ])
    }
}

/// Target textures of a picture.
pub(super) struct RenderTargets {
    /// Width and height of the pictures, the upper left part of the textures.
    pub(super) size: [u32; 2],
    /// Width and height of the textures.
    pub(super) capacity: [u32; 2],
    /// One picture for each camera.
    pub(super) pictures: Vec<wgpu::Texture>,
    /// Their depths, if requested.
    pub(super) depths: Vec<wgpu::Texture>,
}

impl RenderTargets {
    pub(super) fn new(gpu: &Gpu, capacity: [u32; 2], views: usize, precision: PicturePrecision) -> Self {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC;
        let pictures = (0..views).map(|_| gpu.texture("picture", (capacity, 1), precision.format(), usage)).collect();
        Self { size: capacity, capacity, pictures, depths: Vec::new() }
    }
}

/// Number of tiles across and down.
pub(super) fn tile_count([width, height]: [u32; 2], per_ray: bool) -> [u32; 2] {
    let edge = if per_ray { RAY_TILE } else { TILE as u32 };
    [width.div_ceil(edge), height.div_ceil(edge)]
}
