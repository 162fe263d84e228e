//! Limits of a device on the cameras that it draws.

use sg_scene::camera::Camera;

use crate::buffers::tile_count;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::settings::{Rasterizer, Settings};

/// Limit of the tiles of a picture on a software device: it leaves a loop over the tiles of one Gaussian after 65,535
/// iterations.
const SOFTWARE_TILES: u32 = 60_000;

/// Width and height of the pictures of one or two cameras.
///
/// # Errors
/// [`GpuError::Views`] for other numbers of cameras, different sizes, or sizes beyond the limits of the device.
pub(super) fn picture_size(gpu: &Gpu, cameras: &[Camera], settings: Settings) -> Result<[u32; 2], GpuError> {
    let first = cameras.first().ok_or_else(|| GpuError::Views("no camera was given".to_owned()))?;
    let size = [first.width, first.height];
    let [width, height] = size;
    if cameras.len() > 2 || cameras.iter().any(|c| [c.width, c.height] != size) {
        return Err(GpuError::Views("one camera or two of one size are drawn together".to_owned()));
    }
    let largest = gpu.device.limits().max_texture_dimension_2d;
    if width > largest || height > largest {
        return Err(GpuError::Views(format!(
            "{} draws pictures of at most {largest} pixels each way, not {width} x {height}",
            gpu.name()
        )));
    }
    if settings.rasterizer() != Rasterizer::Tiles {
        return Ok(size);
    }
    let tiles: u32 = tile_count(size, settings.sort_window().is_some()).iter().product();
    if gpu.is_software() && tiles > SOFTWARE_TILES {
        return Err(GpuError::Views(format!(
            "{} can list at most {SOFTWARE_TILES} tiles for one Gaussian, not the {tiles} of this picture; draw it with \
             quadrilaterals, in the affine projection",
            gpu.name()
        )));
    }
    if !pixels_fit(gpu, size, 1, settings) {
        return Err(GpuError::Views(format!(
            "{} cannot hold {width} x {height} pixels in one buffer; draw the picture with quadrilaterals, in the affine \
             projection",
            gpu.name()
        )));
    }
    Ok(size)
}

/// Whether one buffer holds the pixels of `views` views. Only tiles need such a buffer.
pub(super) fn pixels_fit(gpu: &Gpu, [width, height]: [u32; 2], views: u64, settings: Settings) -> bool {
    let bytes = 16 * views * u64::from(width) * u64::from(height);
    settings.rasterizer() != Rasterizer::Tiles || bytes <= gpu.largest_binding()
}
