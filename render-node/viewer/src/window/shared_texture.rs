//! Pictures that stay on the device that shows the window.

use glam::Vec3;
use sg_gpu::{Gpu, Present};
use sg_raster::finish::Finish;

/// Format of the painted panels: values are final, without a transfer curve.
pub(super) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Puts pictures where a window's loop can show them.
///
/// There are two textures: one is written while the other is shown. The loop's commands for a texture complete before the
/// next picture overwrites that texture.
pub(super) struct SharedTexture {
    gpu: Gpu,
    present: Present,
    places: [Option<wgpu::Texture>; 2],
    next: usize,
}

impl SharedTexture {
    pub(super) fn new(gpu: &Gpu) -> Self {
        Self { gpu: gpu.clone(), present: Present::new(gpu, FORMAT), places: [None, None], next: 0 }
    }

    pub(super) fn is_on(&self, gpu: &Gpu) -> bool {
        self.gpu.is(gpu)
    }

    /// Puts pictures of one height (f32 RGBA) side by side with their last step, over the background `plain`; does not wait for
    /// the device.
    pub(super) fn put(&mut self, pictures: &[wgpu::Texture], plain: Vec3, finish: &Finish) -> wgpu::Texture {
        self.present.set_finish(plain, finish);
        let width = pictures.iter().map(wgpu::Texture::width).sum::<u32>().max(1);
        let height = pictures.iter().map(wgpu::Texture::height).min().unwrap_or(1);
        let place = &mut self.places[self.next];
        self.next = 1 - self.next;
        let kept = place.take().filter(|t| [t.width(), t.height()] == [width, height]);
        let texture = place.insert(kept.unwrap_or_else(|| empty(&self.gpu, [width, height]))).clone();
        let target = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let mut encoder = self.gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let (mut left, mut load) = (0, wgpu::LoadOp::Clear(wgpu::Color::BLACK));
        for picture in pictures {
            self.present.encode(&mut encoder, picture, &target, [left, 0, picture.width(), height], load);
            (left, load) = (left + picture.width(), wgpu::LoadOp::Load);
        }
        self.gpu.submit([encoder.finish()]);
        texture
    }
}

/// An empty texture of this many pixels for a picture.
pub(super) fn empty(gpu: &Gpu, size: [u32; 2]) -> wgpu::Texture {
    let usage =
        wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC;
    gpu.texture("picture of the window", (size, 1), FORMAT, usage)
}
