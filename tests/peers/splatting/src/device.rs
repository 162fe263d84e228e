//! The graphics device, and what is drawn into.

use wgpu::{DeviceType, TextureFormat, TextureUsages};

/// Why the device does not serve.
#[derive(Debug, thiserror::Error)]
pub(crate) enum DeviceError {
    #[error("no Vulkan device, neither hardware nor lavapipe")]
    None,
    #[error("the device cannot be opened: {0}")]
    Open(#[from] wgpu::RequestDeviceError),
    #[error("the device does not finish: {0}")]
    Wait(#[from] wgpu::PollError),
    #[error("a picture cannot be read back: {0}")]
    Map(String),
}

/// A device, chosen as our own renderer chooses it: hardware first.
#[derive(Debug)]
pub(crate) struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    name: String,
}

impl Gpu {
    pub(crate) fn open() -> Result<Self, DeviceError> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::VULKAN;
        let adapters = pollster::block_on(wgpu::Instance::new(descriptor).enumerate_adapters(wgpu::Backends::VULKAN));
        let adapter = adapters
            .into_iter()
            .min_by_key(|a| match a.get_info().device_type {
                DeviceType::DiscreteGpu => 0,
                DeviceType::VirtualGpu => 1,
                DeviceType::IntegratedGpu => 2,
                DeviceType::Other => 3,
                DeviceType::Cpu => 4,
            })
            .ok_or(DeviceError::None)?;
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            required_limits: adapter.limits(),
            ..wgpu::DeviceDescriptor::default()
        }))?;
        Ok(Self { device, queue, name: adapter.get_info().name })
    }

    /// The device's own name.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Waits until all work that was handed in is done.
    pub(crate) fn wait(&self) -> Result<(), DeviceError> {
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        Ok(())
    }
}

/// How a row of the table calls what is drawn into.
pub(crate) fn bits(format: TextureFormat) -> &'static str {
    if format == TextureFormat::Rgba16Float { "16-bit float" } else { "8 bits" }
}

/// A picture on the device: RGB over transparent black and opacity, premultiplied.
#[derive(Debug)]
pub(crate) struct Target {
    texture: wgpu::Texture,
    view: wgpu::TextureView,
}

impl Target {
    /// A picture of `size` (width, height) in pixels; `format` is `Rgba8Unorm` or `Rgba16Float`.
    pub(crate) fn new(gpu: &Gpu, (width, height): (u32, u32), format: TextureFormat) -> Self {
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Self { texture, view }
    }

    /// Begins a pass that draws into an empty picture.
    pub(crate) fn pass<'a>(&self, encoder: &'a mut wgpu::CommandEncoder) -> wgpu::RenderPass<'a> {
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.view,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
                depth_slice: None,
            })],
            ..wgpu::RenderPassDescriptor::default()
        })
    }

    /// The picture, rows from the top, RGBA.
    pub(crate) fn read(&self, gpu: &Gpu) -> Result<Vec<f32>, DeviceError> {
        let size = self.texture.size();
        let float = self.texture.format() == TextureFormat::Rgba16Float;
        let row = size.width * if float { 8 } else { 4 };
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size: u64::from(padded) * u64::from(size.height),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: None };
        let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(self.texture.as_image_copy(), to, size);
        gpu.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |_| ());
        gpu.wait()?;
        let bytes = buffer.get_mapped_range(..).map_err(|e| DeviceError::Map(e.to_string()))?;
        let values = |line: &[u8]| -> Vec<f32> {
            match float {
                true => line.chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32()).collect(),
                false => line.iter().map(|&b| f32::from(b) / 255.0).collect(),
            }
        };
        Ok(bytes.chunks_exact(padded as usize).flat_map(|line| values(&line[..row as usize])).collect())
    }
}
