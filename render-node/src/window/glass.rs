//! What a window's frames are put on: its surface, the device behind it, and what paints panels there.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use egui::{ClippedPrimitive, TexturesDelta};
use winit::dpi::PhysicalSize;
use winit::window::Window;

use super::WindowError;

/// A surface with its device. Lost devices and surfaces are made anew by whoever paints: [`Painted::Lost`].
pub(super) struct Glass {
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    device: wgpu::Device,
    queue: wgpu::Queue,
    renderer: egui_wgpu::Renderer,
    lost: Arc<AtomicBool>,
}

/// What came of painting a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Painted {
    /// It is on the screen.
    Shown,
    /// Nobody can see it, or the screen did not take it in time; the next one may do.
    Passed,
    /// The device or the surface is gone: open another.
    Lost,
}

impl Glass {
    /// Opens a device for a window.
    ///
    /// # Errors
    /// [`WindowError::Surface`] where no Vulkan device can show anything in it.
    pub(super) fn open(window: &Arc<Window>) -> Result<Self, WindowError> {
        let failed = |e: &dyn std::fmt::Display| WindowError::Surface(e.to_string());
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::VULKAN;
        let instance = wgpu::Instance::new(descriptor);
        let surface = instance.create_surface(Arc::clone(window)).map_err(|e| failed(&e))?;
        let options = wgpu::RequestAdapterOptions { compatible_surface: Some(&surface), ..Default::default() };
        let adapter = pollster::block_on(instance.request_adapter(&options)).map_err(|e| failed(&e))?;
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("window"),
            required_limits: adapter.limits(),
            ..wgpu::DeviceDescriptor::default()
        }))
        .map_err(|e| failed(&e))?;
        let lost = Arc::new(AtomicBool::new(false));
        let gone = Arc::clone(&lost);
        device.set_device_lost_callback(move |_, reason| {
            tracing::warn!("the window's device was lost: {reason}");
            gone.store(true, Ordering::Relaxed);
        });
        let broken = Arc::clone(&lost);
        device.on_uncaptured_error(Arc::new(move |error| {
            tracing::warn!("the window's device: {error}");
            broken.store(true, Ordering::Relaxed);
        }));
        let PhysicalSize { width, height } = window.inner_size();
        let mut config = surface
            .get_default_config(&adapter, width.max(1), height.max(1))
            .ok_or_else(|| failed(&"the device cannot show pictures in this window"))?;
        // Pictures and panels are numbers as they are to be seen: no curve of a format is to be put on them.
        let formats = surface.get_capabilities(&adapter).formats;
        config.format = formats.into_iter().find(|f| !f.is_srgb()).unwrap_or(config.format);
        config.present_mode = wgpu::PresentMode::AutoVsync;
        config.desired_maximum_frame_latency = 1;
        surface.configure(&device, &config);
        let options = egui_wgpu::RendererOptions { dithering: false, ..Default::default() };
        let renderer = egui_wgpu::Renderer::new(&device, config.format, options);
        Ok(Self { surface, config, device, queue, renderer, lost })
    }

    /// Longest edge of a texture.
    pub(super) fn largest(&self) -> usize {
        self.device.limits().max_texture_dimension_2d as usize
    }

    /// Takes another size, pixels.
    pub(super) fn resize(&mut self, width: u32, height: u32) {
        if width > 0 && height > 0 {
            (self.config.width, self.config.height) = (width, height);
            self.surface.configure(&self.device, &self.config);
        }
    }

    /// Paints a frame.
    pub(super) fn paint(
        &mut self,
        primitives: &[ClippedPrimitive],
        mut textures: TexturesDelta,
        pixels_per_point: f32,
    ) -> Painted {
        // Taken in whatever comes of the frame: each change is told once.
        for (id, deltas) in textures.set.drain() {
            for delta in deltas {
                self.renderer.update_texture(&self.device, &self.queue, id, &delta);
            }
        }
        let freed: Vec<_> = textures.free.drain().collect();
        let painted = self.paint_frame(primitives, pixels_per_point);
        for id in freed {
            self.renderer.free_texture(&id);
        }
        if self.lost.load(Ordering::Relaxed) { Painted::Lost } else { painted }
    }

    fn paint_frame(&mut self, primitives: &[ClippedPrimitive], pixels_per_point: f32) -> Painted {
        let frame = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) | wgpu::CurrentSurfaceTexture::Suboptimal(frame) => frame,
            wgpu::CurrentSurfaceTexture::Timeout | wgpu::CurrentSurfaceTexture::Occluded => return Painted::Passed,
            wgpu::CurrentSurfaceTexture::Outdated => {
                self.surface.configure(&self.device, &self.config);
                return Painted::Passed;
            }
            wgpu::CurrentSurfaceTexture::Lost | wgpu::CurrentSurfaceTexture::Validation => return Painted::Lost,
        };
        let size_in_pixels = [self.config.width, self.config.height];
        let screen = egui_wgpu::ScreenDescriptor { size_in_pixels, pixels_per_point };
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut commands = self.renderer.update_buffers(&self.device, &self.queue, &mut encoder, primitives, &screen);
        {
            let view = frame.texture.create_view(&wgpu::TextureViewDescriptor::default());
            let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("panels"),
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
            });
            self.renderer.render(&mut pass.forget_lifetime(), primitives, &screen);
        }
        commands.push(encoder.finish());
        self.queue.submit(commands);
        self.queue.present(frame);
        Painted::Shown
    }
}
