//! Pictures read back from the device, for single pictures and tests: it is waited for.

use super::GpuError;
use super::device::Gpu;

/// The bytes of a texture of so many bytes a pixel, rows from the top without gaps.
pub(super) fn bytes_of(gpu: &Gpu, texture: &wgpu::Texture, pixel: u32) -> Result<Vec<u8>, GpuError> {
    let [width, height] = [texture.width(), texture.height()];
    let row = (pixel * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let staging = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("picture"),
        size: u64::from(row) * u64::from(height),
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &staging,
            layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None },
        },
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
    gpu.submit([encoder.finish()]);
    let bytes = gpu.mapped(&staging)?;
    let lines = bytes.chunks_exact(row as usize);
    Ok(lines.flat_map(|line| line.get(..(pixel * width) as usize).unwrap_or_default()).copied().collect())
}
