//! Tile passes of the ray-consistent mode. Tiles list splats in the order of the rays through them; each ray sorts its layers
//! again in a [`SortWindow`].

use crate::device::Gpu;
use crate::pipeline::Kernel;
use crate::shader::Shader;
use crate::sort_window::SortWindow;
use crate::textures::PicturePrecision;
use crate::tile_shader::source;

/// Edge of a tile in pixels. In tiles of 16 pixels the orders of two rays differ too much for a window of 64 layers on
/// trained scenes, and lists are longer.
pub(super) const RAY_TILE: u32 = 8;

/// Compute passes that replace four passes of the affine mode, and two more.
pub(super) struct RayPasses {
    shader: Shader,
    depths: bool,
    pub(super) touch: Kernel,
    pub(super) list: Kernel,
    pub(super) list_large: Kernel,
    pub(super) measure: Kernel,
    pub(super) order: Kernel,
    pub(super) blend: Kernel,
}

impl RayPasses {
    /// Kernels for one sort window; `depths` adds the depth of each pixel's front.
    pub(super) fn new(gpu: &Gpu, window: SortWindow, depths: bool, pictures: PicturePrecision) -> Self {
        let parts = [&window.source(), &source(RAY_TILE, pictures), include_str!("shaders/ray_tiles.wgsl")];
        let shader = Shader::new(gpu, "tiles, by ray", &parts);
        let kernel = |entry| Kernel::new(gpu, &shader, entry, &[]);
        Self {
            touch: kernel("touch"),
            list: kernel("list_pairs"),
            list_large: kernel("list_large"),
            measure: kernel("measure_rays"),
            order: kernel("order_rays"),
            blend: blend_kernel(gpu, &shader, depths, false),
            depths,
            shader,
        }
    }

    /// The blending of all dispatches but the last one.
    pub(super) fn continued_blend(&self, gpu: &Gpu) -> Kernel {
        blend_kernel(gpu, &self.shader, self.depths, true)
    }
}

fn blend_kernel(gpu: &Gpu, shader: &Shader, depths: bool, is_continued: bool) -> Kernel {
    let flag = |on: bool| f64::from(u8::from(on));
    Kernel::new(gpu, shader, "blend_rays", &[("DEPTHS", flag(depths)), ("CONTINUED", flag(is_continued))])
}
