//! The window's surface, its device, and the renderer of its panels.

use std::sync::Arc;

use egui::{ClippedPrimitive, TextureId, TexturesDelta};
use winit::dpi::PhysicalSize;
use winit::window::Window;

use super::canvas::{Canvas, panels};
use super::error::WindowError;
use super::shared_texture::empty;
use sg_gpu::Gpu;

/// A surface with its device. The caller recreates lost devices and surfaces: [`PresentResult::Lost`].
pub(super) struct WindowSurface {
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    /// Whether recreating the surface failed; it must not be drawn to.
    surface_lost: bool,
    gpu: Gpu,
    /// Whether another renderer shares the device and handles its errors.
    shared: bool,
    renderer: egui_wgpu::Renderer,
    picture: TextureId,
    /// The last frame. `None` on a surface that takes no copies.
    canvas: Option<Canvas>,
}

/// Outcome of presenting a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PresentResult {
    /// It is on the screen.
    Shown,
    /// The window is hidden, or the screen did not take it in time; the next one may succeed.
    Passed,
    /// The device or the surface is gone: open another.
    Lost,
}

impl WindowSurface {
    /// Presents a window with the device that draws its pictures, or with another one.
    ///
    /// # Errors
    /// [`WindowError::Surface`] where that device, or no Vulkan device at all, can show anything in it.
    pub(super) fn open(window: &Arc<Window>, drawn_by: Option<&Gpu>) -> Result<Self, WindowError> {
        let failed = |e: &dyn std::fmt::Display| WindowError::Surface(e.to_string());
        let (gpu, surface) = match drawn_by {
            Some(gpu) => {
                let elsewhere = "its device was opened by somebody else";
                let (instance, _) = gpu.origin().ok_or_else(|| failed(&elsewhere))?;
                (gpu.clone(), instance.create_surface(Arc::clone(window)).map_err(|e| failed(&e))?)
            }
            None => {
                let instance = wgpu::Instance::new(Gpu::instance_descriptor());
                let surface = instance.create_surface(Arc::clone(window)).map_err(|e| failed(&e))?;
                let options = wgpu::RequestAdapterOptions { compatible_surface: Some(&surface), ..Default::default() };
                let adapter = pollster::block_on(instance.request_adapter(&options)).map_err(|e| failed(&e))?;
                (Gpu::of_adapter(instance, adapter).map_err(|e| failed(&e))?, surface)
            }
        };
        let refused = || WindowError::Surface(format!("{} cannot show pictures in this window", gpu.name()));
        let (_, adapter) = gpu.origin().ok_or_else(refused)?;
        let PhysicalSize { width, height } = window.inner_size();
        let mut config = surface.get_default_config(adapter, width.max(1), height.max(1)).ok_or_else(refused)?;
        // Values of pictures and panels are final: no transfer curve of a format may apply.
        let formats = surface.get_capabilities(adapter).formats;
        config.format = formats.into_iter().find(|f| !f.is_srgb()).unwrap_or(config.format);
        config.present_mode = wgpu::PresentMode::AutoVsync;
        config.desired_maximum_frame_latency = 1;
        config.usage |= surface.get_capabilities(adapter).usages & wgpu::TextureUsages::COPY_DST;
        gpu.configure(&surface, &config).map_err(|e| failed(&e))?;
        let options = egui_wgpu::RendererOptions { dithering: false, ..Default::default() };
        let mut renderer = egui_wgpu::Renderer::new(gpu.device(), config.format, options);
        let none = empty(&gpu, [1, 1]).create_view(&wgpu::TextureViewDescriptor::default());
        let picture = renderer.register_native_texture(gpu.device(), &none, wgpu::FilterMode::Linear);
        let shared = drawn_by.is_some();
        let takes_copies = config.usage.contains(wgpu::TextureUsages::COPY_DST);
        let canvas = takes_copies.then(|| Canvas::new(&gpu, [config.width, config.height], config.format));
        Ok(Self { surface, config, surface_lost: false, gpu, shared, renderer, picture, canvas })
    }

    /// The device that draws pictures, if it also shows the window, and the pictures' texture id in egui.
    pub(super) fn shows(&self) -> Option<(Gpu, TextureId)> {
        self.shared.then(|| (self.gpu.clone(), self.picture))
    }

    /// Shows another picture that lies on its device from the next frame on.
    pub(super) fn take(&mut self, picture: &wgpu::Texture) {
        let view = picture.create_view(&wgpu::TextureViewDescriptor::default());
        let (device, filter) = (self.gpu.device(), wgpu::FilterMode::Linear);
        self.renderer.update_egui_texture_from_wgpu_texture(device, &view, filter, self.picture);
        if let Some(canvas) = &mut self.canvas {
            canvas.replace(self.picture);
        }
    }

    /// Whether the device is lost or has reported an error. On a shared device, the picture renderer reports its own
    /// errors.
    fn is_broken(&self) -> bool {
        if self.shared {
            return self.gpu.is_lost();
        }
        match self.gpu.check() {
            Ok(()) => self.gpu.is_lost(),
            Err(error) => {
                tracing::warn!("the window is shown by a device opened anew: {error}");
                true
            }
        }
    }

    /// Longest edge of a texture.
    pub(super) fn largest(&self) -> usize {
        self.gpu.device().limits().max_texture_dimension_2d as usize
    }

    /// Takes another size, pixels.
    pub(super) fn resize(&mut self, width: u32, height: u32) {
        if width > 0 && height > 0 {
            (self.config.width, self.config.height) = (width, height);
            self.configure();
        }
    }

    fn configure(&mut self) {
        if let Err(error) = self.gpu.configure(&self.surface, &self.config) {
            tracing::warn!("the window has to be shown anew: {error}");
            self.surface_lost = true;
        }
    }

    /// Paints a frame: what differs from the one before.
    pub(super) fn paint(
        &mut self,
        primitives: Vec<ClippedPrimitive>,
        mut textures: TexturesDelta,
        pixels_per_point: f32,
    ) -> PresentResult {
        // The panel renderer treats a lost device as a programming error.
        let _ = self.gpu.device().poll(wgpu::PollType::Poll);
        if self.surface_lost || self.is_broken() {
            return PresentResult::Lost;
        }
        let size = [self.config.width, self.config.height];
        let screen = egui_wgpu::ScreenDescriptor { size_in_pixels: size, pixels_per_point };
        if let Some(canvas) = &mut self.canvas {
            canvas.fit(&self.gpu, size);
            // Where a part of a texture is new, nothing has been drawn from that part.
            let replaced = textures.set.iter().filter(|(_, deltas)| deltas.iter().any(|delta| delta.pos.is_none()));
            replaced.for_each(|(id, _)| canvas.replace(*id));
        }
        // Applied even if the frame fails: each change arrives once.
        for (id, deltas) in textures.set.drain() {
            for delta in deltas {
                self.renderer.update_texture(self.gpu.device(), self.gpu.queue(), id, &delta);
            }
        }
        let freed: Vec<_> = textures.free.drain().collect();
        let painted = self.paint_frame(primitives, &screen);
        for id in freed {
            self.renderer.free_texture(&id);
        }
        if self.is_broken() { PresentResult::Lost } else { painted }
    }

    fn paint_frame(
        &mut self,
        primitives: Vec<ClippedPrimitive>,
        screen: &egui_wgpu::ScreenDescriptor,
    ) -> PresentResult {
        let frame = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) | wgpu::CurrentSurfaceTexture::Suboptimal(frame) => frame,
            wgpu::CurrentSurfaceTexture::Timeout | wgpu::CurrentSurfaceTexture::Occluded => {
                return PresentResult::Passed;
            }
            wgpu::CurrentSurfaceTexture::Outdated => {
                self.configure();
                return PresentResult::Passed;
            }
            wgpu::CurrentSurfaceTexture::Lost | wgpu::CurrentSurfaceTexture::Validation => return PresentResult::Lost,
        };
        let mut encoder = self.gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let (device, queue) = (self.gpu.device(), self.gpu.queue());
        let mut commands = self.renderer.update_buffers(device, queue, &mut encoder, &primitives, screen);
        match &mut self.canvas {
            Some(canvas) => {
                canvas.draw(&mut encoder, &self.renderer, primitives, screen);
                let from = canvas.texture().as_image_copy();
                encoder.copy_texture_to_texture(from, frame.texture.as_image_copy(), canvas.texture().size());
            }
            None => {
                let view = frame.texture.create_view(&wgpu::TextureViewDescriptor::default());
                let mut pass = panels(&mut encoder, &view, wgpu::LoadOp::Clear(wgpu::Color::BLACK));
                self.renderer.render(&mut pass, &primitives, screen);
            }
        }
        commands.push(encoder.finish());
        self.gpu.submit(commands);
        queue.present(frame);
        PresentResult::Shown
    }
}
