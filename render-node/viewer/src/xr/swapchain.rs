//! Images of the runtime that are drawn to.

use openxr as xr;

use super::device;
use super::error::XrError;
use super::watchdog::Watchdog;
use sg_gpu::Gpu;

/// Longest wait for an image that the compositor still reads.
const IMAGE_TIMEOUT_NANOSECONDS: i64 = 5_000_000_000;

/// A swapchain and its images. Fields are dropped in this order: wrappers before the wrapped objects.
pub(super) struct SwapchainTarget {
    /// For each image its layers.
    views: Vec<Vec<wgpu::TextureView>>,
    _textures: Vec<wgpu::Texture>,
    pub(super) swapchain: xr::Swapchain<xr::Vulkan>,
    pub(super) size: [u32; 2],
    /// Whether any image has been drawn; a swapchain without one cannot be shown.
    pub(super) drawn: bool,
    watchdog: Watchdog,
}

impl SwapchainTarget {
    pub(super) fn new(
        gpu: &Gpu,
        session: &xr::Session<xr::Vulkan>,
        format: Format,
        size: [u32; 2],
        layers: u32,
        watchdog: &Watchdog,
    ) -> Result<Self, XrError> {
        let [width, height] = size;
        let attachment = match format.wgpu.has_depth_aspect() {
            true => xr::SwapchainUsageFlags::DEPTH_STENCIL_ATTACHMENT,
            false => xr::SwapchainUsageFlags::COLOR_ATTACHMENT,
        };
        let swapchain = session
            .create_swapchain(&xr::SwapchainCreateInfo {
                create_flags: xr::SwapchainCreateFlags::EMPTY,
                usage_flags: attachment | xr::SwapchainUsageFlags::SAMPLED,
                format: format.raw,
                sample_count: 1,
                width,
                height,
                face_count: 1,
                array_size: layers,
                mip_count: 1,
            })
            .map_err(|e| XrError::call("swapchain", e))?;
        let textures = device::textures(gpu, &swapchain, format.wgpu, size, layers)?;
        let layer = |texture: &wgpu::Texture, layer: u32| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2),
                base_array_layer: layer,
                array_layer_count: Some(1),
                ..wgpu::TextureViewDescriptor::default()
            })
        };
        let views = textures.iter().map(|t| (0..layers).map(|k| layer(t, k)).collect()).collect();
        Ok(Self { views, _textures: textures, swapchain, size, drawn: false, watchdog: watchdog.clone() })
    }

    /// Draws the next image with `draw`. `draw` gets its layers and must submit its work before it returns.
    pub(super) fn draw<T>(&mut self, draw: impl FnOnce(&[wgpu::TextureView]) -> T) -> Result<T, XrError> {
        let call = |e| XrError::call("image", e);
        let Self { swapchain, watchdog, .. } = self;
        let index = watchdog
            .watch("an image to draw to", || {
                let index = swapchain.acquire_image()?;
                swapchain.wait_image(xr::Duration::from_nanos(IMAGE_TIMEOUT_NANOSECONDS))?;
                Ok(index)
            })
            .map_err(call)?;
        let done = draw(self.views.get(index as usize).map_or(&[], Vec::as_slice));
        watchdog.watch("taking an image back", || swapchain.release_image()).map_err(call)?;
        self.drawn = true;
        Ok(done)
    }

    /// The whole of one layer, for a composition layer.
    pub(super) fn sub_image(&self, layer: u32) -> xr::SwapchainSubImage<'_, xr::Vulkan> {
        self.part(layer, self.size)
    }

    /// The upper left part of one layer with this width and height.
    pub(super) fn part(&self, layer: u32, [width, height]: [u32; 2]) -> xr::SwapchainSubImage<'_, xr::Vulkan> {
        let within = |part: u32, whole: u32| i32::try_from(part.clamp(1, whole.max(1))).unwrap_or(i32::MAX);
        let [width, height] = [within(width, self.size[0]), within(height, self.size[1])];
        let rectangle = xr::Rect2Di { offset: xr::Offset2Di { x: 0, y: 0 }, extent: xr::Extent2Di { width, height } };
        xr::SwapchainSubImage::new().swapchain(&self.swapchain).image_array_index(layer).image_rect(rectangle)
    }
}

/// A format of images under both its names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Format {
    pub(super) wgpu: wgpu::TextureFormat,
    raw: u32,
}

/// Formats that store by the sRGB curve, as runtimes expect of 8 bits: with any other, dark colours show bands.
const FORMATS: [Format; 2] = [
    Format { wgpu: wgpu::TextureFormat::Rgba8UnormSrgb, raw: ash::vk::Format::R8G8B8A8_SRGB.as_raw() as u32 },
    Format { wgpu: wgpu::TextureFormat::Bgra8UnormSrgb, raw: ash::vk::Format::B8G8R8A8_SRGB.as_raw() as u32 },
];

/// Formats of depths.
const DEPTHS: [Format; 2] = [
    Format { wgpu: wgpu::TextureFormat::Depth32Float, raw: ash::vk::Format::D32_SFLOAT.as_raw() as u32 },
    Format { wgpu: wgpu::TextureFormat::Depth16Unorm, raw: ash::vk::Format::D16_UNORM.as_raw() as u32 },
];

impl Format {
    /// The first for colours and the first for depths that the runtime offers; `None` where it offers none.
    pub(super) fn of(session: &xr::Session<xr::Vulkan>) -> xr::Result<[Option<Self>; 2]> {
        let offered = session.enumerate_swapchain_formats()?;
        Ok([FORMATS, DEPTHS].map(|known| known.into_iter().find(|f| offered.contains(&f.raw))))
    }
}
