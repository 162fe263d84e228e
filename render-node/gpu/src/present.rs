//! Copies a picture onto a window's surface or a headset's image, its numbers unchanged.

use crate::device::Gpu;
use crate::pipeline::DrawPipeline;
use crate::resources::Resources;
use crate::shader::Shader;
use sg_raster::image::Image;

/// Copies pictures onto targets of one format.
///
/// The target stores round(255·clamp), as a PNG does; for sRGB formats the pass applies the inverse curve first.
/// The target is opaque. Pictures of another size are interpolated.
#[derive(Debug)]
pub struct Present {
    gpu: Gpu,
    pipeline: DrawPipeline,
    /// The last uploaded CPU picture.
    uploaded: Option<wgpu::Texture>,
}

impl Present {
    /// A presenter for targets of `format`, a renderable format.
    #[must_use]
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let parts = [include_str!("shaders/full_screen.wgsl"), include_str!("shaders/present.wgsl")];
        let shader = Shader::new(gpu, "present", &parts);
        let constants = [("CURVED", f64::from(u8::from(format.is_srgb())))];
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let target = wgpu::ColorTargetState::from(format);
        let pipeline = DrawPipeline::new(gpu, (&shader, ["cover", "present"]), &constants, triangles, target.into());
        Self { gpu: gpu.clone(), pipeline, uploaded: None }
    }

    /// Draws `picture` (f32 RGBA, such as one of [`crate::Renderer::pictures`]) to `area` of `target`: left, top,
    /// width and height in pixels, inside the target. `load` applies to the other pixels.
    pub fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        picture: &wgpu::Texture,
        target: &wgpu::TextureView,
        area: [u32; 4],
        load: wgpu::LoadOp<wgpu::Color>,
    ) {
        self.encode_part(encoder, (picture, [picture.width(), picture.height()]), target, area, load);
    }

    /// As [`Self::encode`], for the upper left part of `picture` with this width and height in pixels. A part of the area's
    /// size is copied pixel by pixel.
    pub fn encode_part(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (picture, part): (&wgpu::Texture, [u32; 2]),
        target: &wgpu::TextureView,
        area: [u32; 4],
        load: wgpu::LoadOp<wgpu::Color>,
    ) {
        let view = picture.create_view(&wgpu::TextureViewDescriptor::default());
        let draw = self.pipeline.bind(&self.gpu, &Resources::of_texture("picture", &view));
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("present"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
            })],
            ..wgpu::RenderPassDescriptor::default()
        });
        let [left, top, width, height] = area;
        if width > 0 && height > 0 && part.iter().all(|pixels| *pixels > 0) {
            // The viewport shows the whole texture, the scissor its part.
            let across = width as f32 * (picture.width() as f32 / part[0] as f32);
            let down = height as f32 * (picture.height() as f32 / part[1] as f32);
            pass.set_viewport(left as f32, top as f32, across, down, 0.0, 1.0);
            pass.set_scissor_rect(left, top, width, height);
            draw.draw_full_screen(&mut pass);
        }
    }

    /// Uploads a CPU picture as a texture for [`Self::encode`], valid until the next call. An invalid or empty
    /// image becomes one transparent pixel.
    pub fn upload(&mut self, image: &Image) -> wgpu::Texture {
        let whole = image.rgba.len() as u64 == 4 * u64::from(image.width) * u64::from(image.height);
        let empty = [0.0; 4];
        let (width, height, rgba) = match image {
            Image { width: 0, .. } | Image { height: 0, .. } => (1, 1, empty.as_slice()),
            _ if !whole => (1, 1, empty.as_slice()),
            _ => (image.width, image.height, image.rgba.as_slice()),
        };
        let texture = match self.uploaded.take() {
            Some(kept) if kept.width() == width && kept.height() == height => kept,
            _ => {
                let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
                let format = wgpu::TextureFormat::Rgba32Float;
                self.gpu.texture("picture from the CPU", ([width, height], 1), format, usage)
            }
        };
        self.gpu.queue.write_texture(
            texture.as_image_copy(),
            bytemuck::cast_slice(rgba),
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(16 * width), rows_per_image: None },
            texture.size(),
        );
        self.uploaded = Some(texture.clone());
        texture
    }
}
