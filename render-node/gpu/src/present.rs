//! Onto a window's surface or a headset's image: a picture's numbers stored as they are.

use crate::device::Gpu;
use crate::pipeline::render_pipeline;
use sg_raster::image::Image;

/// Puts pictures onto targets of one format.
///
/// A picture is stored as round(255·clamp), as its PNG is: a target of an sRGB format gets the inverse curve first. The
/// target is opaque. Where picture and area differ in size, pixels are interpolated.
#[derive(Debug)]
pub struct Present {
    gpu: Gpu,
    pipeline: wgpu::RenderPipeline,
    /// What the newest picture from the CPU was uploaded to.
    uploaded: Option<wgpu::Texture>,
}

impl Present {
    /// For targets of `format`, one that can be drawn to.
    #[must_use]
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("present"),
            source: wgpu::ShaderSource::Wgsl(
                concat!(include_str!("shaders/full_screen.wgsl"), include_str!("shaders/present.wgsl")).into(),
            ),
        });
        let constants = [("CURVED", f64::from(u8::from(format.is_srgb())))];
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let pipeline = render_pipeline(
            gpu,
            (&module, ["cover", "present"]),
            &constants,
            triangles,
            format.into(),
            Default::default(),
        );
        Self { gpu: gpu.clone(), pipeline, uploaded: None }
    }

    /// Has `picture` (f32 RGBA, such as one of [`super::Renderer::pictures`]) drawn to `area` of `target`: left, top, width
    /// and height in pixels, which must lie within it. `load` says what becomes of the rest.
    pub fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        picture: &wgpu::Texture,
        target: &wgpu::TextureView,
        area: [u32; 4],
        load: wgpu::LoadOp<wgpu::Color>,
    ) {
        let view = picture.create_view(&wgpu::TextureViewDescriptor::default());
        let group = self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("present"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) }],
        });
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
        let [left, top, width, height] = area.map(|n| n as f32);
        if width > 0.0 && height > 0.0 {
            pass.set_viewport(left, top, width, height, 0.0, 1.0);
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.draw(0..3, 0..1);
        }
    }

    /// Uploads a picture that was drawn on the CPU and gives it as a texture for [`Self::encode`], which holds it until the
    /// next call. An image without pixels, or with fewer than its size says, is one transparent pixel.
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
