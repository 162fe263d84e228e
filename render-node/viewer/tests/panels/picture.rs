//! Panels drawn by a graphics device into a picture.

use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

use egui::TexturesDelta;
use egui_kittest::{Harness, TestRenderer};
use egui_wgpu::wgpu;
use egui_wgpu::{Renderer, RendererOptions, ScreenDescriptor};

use crate::stage::Stage;

/// The textures that a context has requested so far.
#[derive(Clone, Default)]
pub(crate) struct Textures(Rc<RefCell<TexturesDelta>>);

impl TestRenderer for Textures {
    fn handle_delta(&mut self, delta: &mut TexturesDelta) {
        self.0.borrow_mut().append(std::mem::take(delta));
    }
}

/// RGBA bytes, row by row from the top.
pub(crate) struct Picture {
    pub(crate) size: [u32; 2],
    pub(crate) rgba: Vec<u8>,
    pub(crate) pixels_per_point: f32,
}

impl Picture {
    /// Colours of the pixels.
    pub(crate) fn pixels(&self) -> impl Iterator<Item = [u8; 3]> + '_ {
        self.rgba.chunks_exact(4).map(|p| [p[0], p[1], p[2]])
    }

    /// The colour that most pixels of a rectangle have.
    pub(crate) fn ground(&self, rect: egui::Rect) -> egui::Color32 {
        let mut found = std::collections::BTreeMap::<[u8; 3], usize>::new();
        for y in rect.top() as usize..(rect.bottom() as usize).min(self.size[1] as usize) {
            for x in rect.left() as usize..(rect.right() as usize).min(self.size[0] as usize) {
                let at = 4 * (y * self.size[0] as usize + x);
                *found.entry([self.rgba[at], self.rgba[at + 1], self.rgba[at + 2]]).or_default() += 1;
            }
        }
        let [r, g, b] = found.into_iter().max_by_key(|(_, n)| *n).unwrap().0;
        egui::Color32::from_rgb(r, g, b)
    }

    pub(crate) fn write(&self, path: &Path) {
        let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), self.size[0], self.size[1]);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        encoder.write_header().unwrap().write_image_data(&self.rgba).unwrap();
    }
}

/// A device for pictures of panels.
pub(crate) struct Canvas {
    device: wgpu::Device,
    queue: wgpu::Queue,
}

impl Canvas {
    /// The software device, else any. On a machine without one: `None` and a message, unless it is required.
    pub(crate) fn open() -> Option<Self> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::VULKAN;
        let instance = wgpu::Instance::new(descriptor);
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
        let adapter = adapters.into_iter().min_by_key(|a| a.get_info().device_type != wgpu::DeviceType::Cpu);
        let Some(adapter) = adapter else {
            assert!(std::env::var_os("SUPERGAUSSIAN_REQUIRE_GPU").is_none_or(|v| v != "1"), "no Vulkan device");
            println!("SKIPPED: no Vulkan device");
            return None;
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).unwrap();
        Some(Self { device, queue })
    }

    /// Draws the current content of a harness.
    pub(crate) fn draw(&self, harness: &Harness<'_, Stage>) -> Picture {
        self.draw_with(harness, &harness.state().textures)
    }

    /// Draws the current content of a harness whose textures these are.
    pub(crate) fn draw_with<S>(&self, harness: &Harness<'_, S>, textures: &Textures) -> Picture {
        let format = wgpu::TextureFormat::Rgba8Unorm;
        let mut renderer = Renderer::new(&self.device, format, RendererOptions::PREDICTABLE);
        for (id, deltas) in &textures.0.borrow().set {
            for delta in deltas {
                renderer.update_texture(&self.device, &self.queue, *id, delta);
            }
        }
        let output = harness.output();
        let (size, pixels_per_point) = (harness.ctx.content_rect().size(), output.pixels_per_point);
        let jobs = harness.ctx.tessellate(output.shapes.clone(), pixels_per_point);
        let pixels = (size * pixels_per_point).round();
        let size_in_pixels = [pixels.x as u32, pixels.y as u32];
        let screen = ScreenDescriptor { size_in_pixels, pixels_per_point };
        let extent = wgpu::Extent3d { width: size_in_pixels[0], height: size_in_pixels[1], depth_or_array_layers: 1 };
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: extent,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let own = renderer.update_buffers(&self.device, &self.queue, &mut encoder, &jobs, &screen);
        {
            let mut pass = encoder
                .begin_render_pass(&wgpu::RenderPassDescriptor {
                    color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                        view: &view,
                        depth_slice: None,
                        resolve_target: None,
                        ops: wgpu::Operations {
                            load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                            store: wgpu::StoreOp::Store,
                        },
                    })],
                    ..wgpu::RenderPassDescriptor::default()
                })
                .forget_lifetime();
            renderer.render(&mut pass, &jobs, &screen);
        }
        let row = (4 * size_in_pixels[0]).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(row) * u64::from(size_in_pixels[1]),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &staging,
                layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None },
            },
            extent,
        );
        self.queue.submit(own.into_iter().chain([encoder.finish()]));
        staging.map_async(wgpu::MapMode::Read, .., |_| ());
        self.device.poll(wgpu::PollType::Wait { submission_index: None, timeout: None }).unwrap();
        let bytes = staging.get_mapped_range(..).unwrap().to_vec();
        let wide = 4 * size_in_pixels[0] as usize;
        let rgba = bytes.chunks_exact(row as usize).flat_map(|r| r[..wide].iter().copied()).collect();
        Picture { size: size_in_pixels, rgba, pixels_per_point }
    }
}
