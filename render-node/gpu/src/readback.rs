//! Synchronous readback of textures.

use crate::created::count_created;
use crate::device::Gpu;
use crate::error::GpuError;

/// The bytes of the upper left part of a texture with `pixel` bytes a pixel, rows from the top without padding. Waits for the
/// device.
pub(super) fn texture_bytes(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    [width, height]: [u32; 2],
    pixel: u32,
) -> Result<Vec<u8>, GpuError> {
    count_created(|created| created.buffers += 1);
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
