//! Copies a picture onto a window's surface or a headset's image, its numbers unchanged or with a last step.

use glam::Vec3;

use crate::device::Gpu;
use crate::kept_bindings::KeptBindings;
use crate::pipeline::{BoundDraw, DrawPipeline};
use crate::recorded;
use crate::resources::Resources;
use crate::shader::Shader;
use crate::shader_layout::LastStep;
use sg_raster::finish::Finish;
use sg_raster::image::Image;

/// Copies pictures onto targets of one format.
///
/// The target stores round(255·clamp), as a PNG does; for sRGB formats the pass applies the inverse curve first.
/// [`Self::set_finish`] adds a gradient as background, and dithering. The target is opaque. Pictures of another size are interpolated.
#[derive(Debug)]
pub struct Present {
    gpu: Gpu,
    pipeline: DrawPipeline,
    bindings: KeptBindings<1, BoundDraw>,
    /// A [`LastStep`], and its value.
    last_step: (wgpu::Buffer, LastStep),
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
        let none = LastStep::default();
        let last_step = (gpu.uniform("last step", &none), none);
        Self { gpu: gpu.clone(), pipeline, bindings: KeptBindings::default(), last_step, uploaded: None }
    }

    /// As [`Self::new`], with dithered colors: for pictures that people look at.
    #[must_use]
    pub fn dithered(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let mut present = Self::new(gpu, format);
        present.set_finish(Vec3::ZERO, &Finish { dither: true, ..Finish::default() });
        present
    }

    /// Sets the last step of pictures that are submitted from now on; `plain` is the background over which they are drawn. A
    /// transparent backdrop stays plain. The same as [`Image::finished_rgb8`] on 8-bit targets.
    pub fn set_finish(&mut self, plain: Vec3, finish: &Finish) {
        let gradient = finish.gradient();
        let (top, bottom) = gradient.map_or((plain, plain), |g| (g.top, g.bottom));
        let step =
            LastStep { top, gradient: u32::from(gradient.is_some()), bottom, dither: u32::from(finish.dither), plain };
        let (buffer, value) = &mut self.last_step;
        if *value != step {
            *value = step;
            self.gpu.write_uniform(buffer, value);
        }
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
        let draw = self.bindings.get([picture], |[view]| {
            let resources = Resources::of_texture("picture", &view);
            self.pipeline.bind(&self.gpu, &resources.with([("last_step", &self.last_step.0)]))
        });
        recorded::open_pass();
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
        draw.draw_part(&mut pass, (picture, part), area);
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
