//! A desktop window that mirrors the left eye's picture, for bystanders.
//!
//! It lives in the headset's loop and must not block it: it skips frames instead of waiting.

use std::sync::Arc;
use std::time::{Duration, Instant};

use winit::application::ApplicationHandler;
use winit::dpi::LogicalSize;
use winit::event::{ElementState, WindowEvent};
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::keyboard::{Key, ModifiersState};
use winit::platform::pump_events::EventLoopExtPumpEvents as _;
use winit::platform::x11::EventLoopBuilderExtX11 as _;
use winit::window::{Window, WindowId};

use crate::xr::Headset;
use sg_gpu::{Gpu, Present};

/// Title of the window.
const TITLE: &str = "Super-Gaussian: what the headset shows";

/// Its first width and height, points.
const SIZE: LogicalSize<u32> = LogicalSize::new(640, 640);

/// Least time between two pictures in it: people beside need no headset's rate.
const PERIOD: Duration = Duration::from_millis(33);

/// Present modes that do not block.
const NON_BLOCKING: [wgpu::PresentMode; 2] = [wgpu::PresentMode::Mailbox, wgpu::PresentMode::Immediate];

/// The window. Fields are dropped in this order: dependent objects first.
pub(super) struct Mirror {
    /// Its surface on the headset's present device.
    surface_state: Option<MirrorSurface>,
    events_target: MirrorWindow,
    events: EventLoop<()>,
    shown: Option<Instant>,
}

impl Drop for Mirror {
    fn drop(&mut self) {
        self.surface_state = None;
        self.events_target.closed = true;
        self.events_target.window = None;
        // The display server learns of it with the next messages.
        self.events.pump_app_events(Some(Duration::ZERO), &mut self.events_target);
    }
}

/// The window as its events see it.
#[derive(Default)]
struct MirrorWindow {
    window: Option<Arc<Window>>,
    error: Option<String>,
    keys: ModifiersState,
    closed: bool,
    resized: bool,
}

struct MirrorSurface {
    gpu: Gpu,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    present: Present,
}

impl Mirror {
    /// Opens it; in words, why it cannot be.
    pub(super) fn open() -> Result<Self, String> {
        let words = |e: winit::error::EventLoopError| {
            let said = e.to_string();
            said.rsplit(": ").next().unwrap_or(&said).to_owned()
        };
        // Not the process's first thread: that one serves the bus.
        let events = EventLoop::builder().with_any_thread(true).build().map_err(words)?;
        let mut mirror = Self { surface_state: None, events_target: MirrorWindow::default(), events, shown: None };
        mirror.attend();
        match mirror.events_target.error.take() {
            None => Ok(mirror),
            Some(error) => Err(error),
        }
    }

    /// Handles its events; returns whether it is still open.
    pub(super) fn attend(&mut self) -> bool {
        self.events.pump_app_events(Some(Duration::ZERO), &mut self.events_target);
        !self.events_target.closed
    }

    /// Drops the surface of a lost device.
    pub(super) fn put_away(&mut self) {
        self.surface_state = None;
    }

    /// Shows the left eye's picture if it is due and needs no wait. The error explains a permanent failure.
    pub(super) fn show(
        &mut self,
        headset: &Headset,
        (picture, part): (&wgpu::Texture, [u32; 2]),
    ) -> Result<(), String> {
        if self.shown.is_some_and(|shown| shown.elapsed() < PERIOD) {
            return Ok(());
        }
        let Some(window) = &self.events_target.window else { return Ok(()) };
        let size = window.inner_size();
        if size.width == 0 || size.height == 0 {
            return Ok(());
        }
        if self.surface_state.is_none() {
            self.surface_state = Some(MirrorSurface::new(headset, window, [size.width, size.height])?);
        }
        if let (Some(surface_state), Some(shape)) = (&mut self.surface_state, headset.size()) {
            if std::mem::take(&mut self.events_target.resized) {
                surface_state.resize([size.width, size.height])?;
            }
            surface_state.show((picture, part), shape)?;
            self.shown = Some(Instant::now());
        }
        Ok(())
    }
}

impl MirrorSurface {
    fn new(headset: &Headset, window: &Arc<Window>, [width, height]: [u32; 2]) -> Result<Self, String> {
        let away = || "the headset is away".to_owned();
        let (instance, adapter) = headset.instance_and_adapter().ok_or_else(away)?;
        let gpu = headset.gpu().ok_or_else(away)?.clone();
        let surface = instance.create_surface(Arc::clone(window)).map_err(|e| e.to_string())?;
        let modes = surface.get_capabilities(adapter).present_modes;
        let mode = NON_BLOCKING.into_iter().find(|mode| modes.contains(mode));
        let present_mode = mode.ok_or_else(|| format!("{} shows nothing without being waited for", gpu.name()))?;
        let config = surface.get_default_config(adapter, width, height);
        let config = config.ok_or_else(|| format!("{} cannot show anything on this screen", gpu.name()))?;
        let config = wgpu::SurfaceConfiguration { present_mode, ..config };
        gpu.configure(&surface, &config).map_err(|e| e.to_string())?;
        let present = Present::new(&gpu, config.format);
        Ok(Self { gpu, surface, config, present })
    }

    fn resize(&mut self, [width, height]: [u32; 2]) -> Result<(), String> {
        (self.config.width, self.config.height) = (width, height);
        self.configure()
    }

    fn configure(&self) -> Result<(), String> {
        self.gpu.configure(&self.surface, &self.config).map_err(|e| e.to_string())
    }

    /// Shows the drawn part of a picture in this shape, at any resolution.
    fn show(&mut self, (picture, part): (&wgpu::Texture, [u32; 2]), shape: [u32; 2]) -> Result<(), String> {
        let frame = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) | wgpu::CurrentSurfaceTexture::Suboptimal(frame) => frame,
            wgpu::CurrentSurfaceTexture::Outdated | wgpu::CurrentSurfaceTexture::Lost => {
                return self.configure();
            }
            // The next one will do.
            _ => return Ok(()),
        };
        let view = frame.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let mut encoder = self.gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let area = fitted(shape, [self.config.width, self.config.height]);
        let load = wgpu::LoadOp::Clear(wgpu::Color::BLACK);
        self.present.encode_part(&mut encoder, (picture, part), &view, area, load);
        self.gpu.submit([encoder.finish()]);
        self.gpu.queue().present(frame);
        Ok(())
    }
}

/// Position of a picture in a window, scaled to fit: left, top, width, height.
fn fitted(picture: [u32; 2], window: [u32; 2]) -> [u32; 4] {
    let [w, h] = picture.map(|p| u64::from(p.max(1)));
    let [across, down] = window.map(u64::from);
    let (width, height) = if across * h <= down * w { (across, across * h / w) } else { (down * w / h, down) };
    [(across - width) / 2, (down - height) / 2, width, height].map(|n| n as u32)
}

impl ApplicationHandler for MirrorWindow {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.window.is_some() || self.closed {
            return;
        }
        let attributes = Window::default_attributes().with_title(TITLE).with_inner_size(SIZE);
        match event_loop.create_window(attributes) {
            Ok(window) => self.window = Some(Arc::new(window)),
            Err(error) => self.error = Some(error.to_string()),
        }
    }

    fn window_event(&mut self, _: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested | WindowEvent::Destroyed => self.closed = true,
            WindowEvent::Resized(_) => self.resized = true,
            WindowEvent::ModifiersChanged(keys) => self.keys = keys.state(),
            WindowEvent::KeyboardInput { event, .. } => {
                let q = matches!(&event.logical_key, Key::Character(c) if c.eq_ignore_ascii_case("q"));
                self.closed |= q && self.keys.control_key() && event.state == ElementState::Pressed;
            }
            _ => (),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_shown_whole_and_in_its_own_shape() {
        assert_eq!(fitted([320, 240], [640, 640]), [0, 80, 640, 480]);
        assert_eq!(fitted([240, 320], [640, 640]), [80, 0, 480, 640]);
        assert_eq!(fitted([100, 100], [300, 200]), [50, 0, 200, 200]);
        for window in [[1, 1], [1, 900], [3, 2]] {
            let [left, top, width, height] = fitted([1600, 1440], window);
            assert!(left + width <= window[0] && top + height <= window[1]);
        }
        assert_eq!(fitted([0, 0], [7, 7]), [0, 0, 7, 7]);
    }
}
