//! A window: the scene with its panels, a mouse and a keyboard.
//!
//! The loop draws the newest state and never waits. Pictures are made beside it ([`crate::display::LatestWorker`]). A
//! person's requests go to a [`ViewPort`].

mod actions;
mod bookmarks;
mod canvas;
mod contour;
mod damage;
mod docks;
mod drawing;
mod error;
pub(crate) mod exporter;
mod file_dialog;
mod file_drop;
mod file_menu;
mod file_purpose;
mod gizmo;
mod grid;
mod grid_view;
mod hints;
mod image_texture;
mod input_order;
mod lasso;
mod mouse_tool;
mod move_tool;
mod move_view;
mod native_dialog;
mod navigation;
mod orientation_cube;
mod overlay;
mod picture_request;
mod polygon;
mod polygon_view;
mod press;
mod progress_window;
mod recent_files;
mod round_length;
mod scale_bar;
mod scene_lines;
mod scene_mouse;
mod scene_view;
mod settings;
mod shape_tool;
mod shape_view;
mod shared_texture;
mod shortcuts;
mod spacing_dialog;
mod surface;
mod tool_card;
mod toolbar;
mod tour_view;
mod view_flight;
mod window_files;
mod window_ui;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::ViewportId;
use sg_scene::model::Scene;
use winit::application::ApplicationHandler;
use winit::dpi::{LogicalSize, PhysicalSize};
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::platform::x11::EventLoopBuilderExtX11 as _;
use winit::window::{Window, WindowId};

use crate::display::{Tools, ViewPort};
use sg_gpu::Gpu;
use sg_gpu::backend::Engine;
use sg_raster::render::Quality;

pub use drawing::{at_low_priority, threads};
pub use error::WindowError;
pub use hints::Hint;
pub use mouse_tool::MouseTool;
pub use navigation::{NavigationMode, Navigator};
pub use progress_window::{ProgressUi, ProgressUpdate, show_progress};
pub use settings::{Settings, SettingsError};
pub use shortcuts::{Group, MOUSE, SHORTCUTS, Shortcut};
pub use window_files::WindowFiles;
pub use window_ui::WindowUi;

use input_order::InputOrder;
use native_dialog::NativeDialogs;
use surface::{PresentResult, WindowSurface};

/// Share of the highlight's colour beside a contour: what is selected keeps its own colours.
pub const TINT: f32 = 0.25;

/// Longest sleep of the loop. Input, updates and finished pictures wake it earlier; a turn that comes as seldom as this shows the
/// watchdog of the process that the loop does not hang.
const LONGEST_SLEEP: Duration = Duration::from_millis(500);

/// Time until a frame is drawn again that the surface had no room for.
const RETRY_PERIOD: Duration = Duration::from_millis(16);

/// Most consecutive frames with a lost device or surface; each loss opens a new one.
const MOST_LOSSES: u32 = 5;

/// Configuration of a window.
pub struct Setup {
    /// The geometry.
    pub scene: Arc<Scene>,
    /// The renderer.
    pub engine: Engine,
    /// Source of the newest state, and sink of requests.
    pub view_port: ViewPort,
    /// Title of the window.
    pub title: String,
    /// The initial settings of tools; saved settings override them.
    pub tools: Tools,
    /// The best quality of pictures, if given for this run; it overrides the saved one.
    pub quality: Option<Quality>,
    /// Whether pictures are copied from the device that draws them to another one that shows the window. By default only
    /// pictures of a software device are copied. Such a device runs one task after another, and the loop would wait for its
    /// pictures.
    pub copies: Option<bool>,
    /// Path of the saved layout; `None`: not saved.
    pub settings: Option<PathBuf>,
    /// Folder of kept pictures.
    pub pictures: PathBuf,
    /// The file that the person has opened; absent for a scene that a launch file names.
    pub file: Option<PathBuf>,
    /// Folder of the session for pictures on their way to a chosen name.
    pub scratch: Option<PathBuf>,
    /// Called once the window is open.
    pub opened: Box<dyn FnOnce() + Send>,
}

/// Opens a window and serves it on this thread until a person closes it or its view port closes.
///
/// # Errors
/// [`WindowError`].
pub fn run(setup: Setup) -> Result<(), WindowError> {
    // The cause stands last, after the source location in the library.
    let display = |e: &dyn std::fmt::Display| {
        let said = e.to_string();
        WindowError::Display(said.rsplit(": ").next().unwrap_or(&said).to_owned())
    };
    // Not the process's first thread: that one serves the bus.
    let event_loop = EventLoop::<()>::with_user_event().with_any_thread(true).build().map_err(|e| display(&e))?;
    let wake = event_loop.create_proxy();
    let mut app = App { setup: Some(setup), wake, opened: None, error: None };
    event_loop.run_app(&mut app).map_err(|e| display(&e))?;
    match app.error {
        Some(error) => Err(error),
        None => Ok(()),
    }
}

/// The application as the event loop sees it.
struct App {
    setup: Option<Setup>,
    wake: EventLoopProxy<()>,
    opened: Option<OpenWindow>,
    error: Option<WindowError>,
}

/// The open window.
struct OpenWindow {
    window: Arc<Window>,
    /// Taken away before another is opened: a window has one at a time.
    surface: Option<WindowSurface>,
    input: egui_winit::State,
    input_order: InputOrder,
    window_ui: WindowUi,
    copies: Option<bool>,
    /// The newest drawing device already tried for presenting.
    tried_device: Option<Gpu>,
    /// Frames since the last shown one with a lost device or surface.
    losses: u32,
    settings: Option<PathBuf>,
    /// The saved settings at the start, and the quality given for this run.
    before: (Settings, Option<Quality>),
    /// When the next frame is due, if one is.
    due: Option<Instant>,
    /// Whether other windows cover all of it.
    occluded: bool,
    /// Whether a frame was due while it was hidden.
    missed: bool,
    /// Whether its frame was compared with the monitor.
    fitted: bool,
}

impl OpenWindow {
    fn new(event_loop: &ActiveEventLoop, setup: Setup, wake: &EventLoopProxy<()>) -> Result<Self, WindowError> {
        let Setup {
            scene,
            engine,
            view_port,
            title,
            tools,
            quality,
            copies,
            settings,
            pictures,
            file,
            scratch,
            opened,
        } = setup;
        if let (Some(settings), Some(file)) = (&settings, &file)
            && let Err(why) = recent_files::remember(settings, file)
        {
            tracing::warn!("the file is not kept among the recent ones: {why}");
        }
        let read = settings.as_deref().map_or(Ok(None), Settings::load).unwrap_or_else(|why| {
            tracing::warn!("the window's layout is as it is at first: {why}");
            None
        });
        let mut tools = tools;
        if let Some(loaded) = &read {
            loaded.apply(&mut tools, quality);
        }
        let loaded = read.unwrap_or_default();
        let attributes = Window::default_attributes()
            .with_title(title)
            .with_maximized(loaded.maximized)
            .with_inner_size(LogicalSize::new(loaded.width, loaded.height));
        let window = event_loop.create_window(attributes).map_err(|e| WindowError::Display(e.to_string()))?;
        let window = Arc::new(window);
        let wake = wake.clone();
        let waker = move || {
            // A loop that has ended needs no waking.
            let _ = wake.send_event(());
        };
        let files = WindowFiles { opened: file, scratch, settings: settings.clone() };
        let window_ui = WindowUi::new(scene, engine, (view_port, tools), pictures, &loaded, waker.clone())?;
        let mut window_ui = window_ui.with_files(files);
        if loaded.native_dialogs {
            window_ui.file_menu.dialogs.use_native(NativeDialogs::new(Arc::clone(&window), Arc::new(waker)));
        }
        let input = fresh_input(&window, None);
        let (before, due) = ((loaded, quality), Some(Instant::now()));
        let mut this = Self {
            window,
            surface: None,
            input,
            input_order: InputOrder::default(),
            window_ui,
            copies,
            tried_device: None,
            losses: 0,
            settings,
            before,
            due,
            occluded: false,
            missed: false,
            fitted: false,
        };
        this.open_surface()?;
        opened();
        Ok(this)
    }

    /// The device that draws pictures, where they are to stay on it and that has not been tried.
    fn untried(&self) -> Option<Gpu> {
        let tried_device = |gpu: &Gpu| self.tried_device.as_ref().is_some_and(|tried_device| tried_device.is(gpu));
        let stays = |gpu: &&Gpu| !self.copies.unwrap_or(gpu.is_software()) && !gpu.is_lost() && !tried_device(gpu);
        self.window_ui.drawn_by().filter(stays).cloned()
    }

    /// Opens a new surface. It prefers the device that draws the pictures, if they may stay there and it can present.
    /// Otherwise it opens another device.
    fn open_surface(&mut self) -> Result<(), WindowError> {
        self.surface = None;
        let drawn_by = self.untried();
        let opened = drawn_by.as_ref().and_then(|gpu| match WindowSurface::open(&self.window, Some(gpu)) {
            Ok(surface) => {
                tracing::info!("pictures stay on {}, which draws them and shows the window", gpu.name());
                Some(surface)
            }
            Err(error) => {
                tracing::info!("pictures are copied from {}, which draws them: {error}", gpu.name());
                None
            }
        });
        if drawn_by.is_some() {
            self.tried_device = drawn_by;
        }
        let surface = match opened {
            Some(surface) => surface,
            None => WindowSurface::open(&self.window, None)?,
        };
        // Only a new context uploads all textures, fonts among them, to the new device.
        self.input = fresh_input(&self.window, Some(&surface));
        self.window_ui.show_by(surface.shows());
        self.surface = Some(surface);
        self.due = Some(Instant::now());
        Ok(())
    }

    /// Paints a frame and computes the time of the next one.
    fn frame(&mut self) -> Result<(), WindowError> {
        // The renderer has opened a lost device again.
        if self.untried().is_some() {
            self.open_surface()?;
        }
        let mut raw = self.input.take_egui_input(&self.window);
        raw.events = self.input_order.next(raw.events);
        let ctx = self.input.egui_ctx().clone();
        let output = ctx.run_ui(raw, |ui| self.window_ui.show(ui));
        self.input.handle_platform_output(&self.window, output.platform_output);
        let primitives = ctx.tessellate(output.shapes, output.pixels_per_point);
        let delay = output.viewport_output.get(&ViewportId::ROOT).map_or(Duration::MAX, |v| v.repaint_delay);
        let delay = if self.input_order.is_waiting() { Duration::ZERO } else { delay };
        self.due = Instant::now().checked_add(delay);
        self.missed = false;
        let Some(surface) = &mut self.surface else { return Ok(()) };
        if let Some(picture) = self.window_ui.take_picture() {
            surface.take(&picture);
        }
        match surface.paint(primitives, output.textures_delta, output.pixels_per_point) {
            PresentResult::Shown => {
                self.losses = 0;
                self.fit_to_monitor();
            }
            // Nothing else may wake a window at rest, and its content has changed.
            PresentResult::Passed => self.due = Instant::now().checked_add(RETRY_PERIOD),
            PresentResult::Lost if self.losses >= MOST_LOSSES => {
                return Err(WindowError::Surface(format!("its device was lost {MOST_LOSSES} times in a row")));
            }
            PresentResult::Lost => {
                self.losses += 1;
                // Not by the same device again: the loss of a surface may be the first that is heard of a lost device.
                self.open_surface()?;
            }
        }
        Ok(())
    }

    /// Makes a window smaller whose frame is larger than its monitor, once. Only a shown window has the frame that its window
    /// manager gives it.
    fn fit_to_monitor(&mut self) {
        if std::mem::replace(&mut self.fitted, true) || self.window.is_maximized() {
            return;
        }
        let Some(monitor) = self.window.current_monitor() else { return };
        let (inner, outer, most) = (self.window.inner_size(), self.window.outer_size(), monitor.size());
        let fitting = |inner: u32, outer: u32, most: u32| inner.saturating_sub(outer.saturating_sub(most)).max(1);
        let size = PhysicalSize::new(
            fitting(inner.width, outer.width, most.width),
            fitting(inner.height, outer.height, most.height),
        );
        if size != inner {
            // The window's event of a new size follows, at once or later.
            let _ = self.window.request_inner_size(size);
        }
    }

    /// Whether nothing of the window is on the screen: it is covered or minimised.
    fn is_hidden(&self) -> bool {
        self.occluded || self.window.is_minimized() == Some(true)
    }

    /// Requests the frame that is due, unless nobody can see it. A hidden window commits its pending change all the same.
    fn request_frame_if_due(&mut self, now: Instant) {
        if !(self.missed || self.window_ui.has_update() || self.due.is_some_and(|due| due <= now)) {
            return;
        }
        self.due = None;
        if self.is_hidden() && !self.window_ui.holds_change() {
            self.missed = true;
        } else {
            self.window.request_redraw();
        }
    }

    /// Saves the layout; an error is logged and has no other effect.
    fn save_settings(&self) {
        let Some(path) = &self.settings else { return };
        let size: LogicalSize<f64> = self.window.inner_size().to_logical(self.window.scale_factor());
        let settings = Settings {
            width: size.width,
            height: size.height,
            maximized: self.window.is_maximized(),
            // Other windows may have opened files meanwhile.
            recent: recent_files::stored(path),
            native_dialogs: self.before.0.native_dialogs,
            ..self.window_ui.settings()
        };
        let settings = settings.without_override(&self.before.0, self.before.1);
        if let Err(error) = settings.save(path) {
            tracing::warn!("the window's layout is not kept: {error}");
        }
    }
}

fn fresh_input(window: &Window, surface: Option<&WindowSurface>) -> egui_winit::State {
    let scale = Some(window.scale_factor() as f32);
    egui_winit::State::new(
        egui::Context::default(),
        ViewportId::ROOT,
        window,
        scale,
        window.theme(),
        surface.map(WindowSurface::largest),
    )
}

impl ApplicationHandler<()> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        let Some(setup) = self.setup.take() else { return };
        match OpenWindow::new(event_loop, setup, &self.wake) {
            Ok(opened) => {
                opened.window.request_redraw();
                self.opened = Some(opened);
            }
            Err(error) => {
                self.error = Some(error);
                event_loop.exit();
            }
        }
    }

    fn user_event(&mut self, _: &ActiveEventLoop, (): ()) {
        if let Some(opened) = &mut self.opened {
            opened.due = Some(Instant::now());
        }
    }

    fn new_events(&mut self, event_loop: &ActiveEventLoop, _: StartCause) {
        if let Some(opened) = &mut self.opened
            && opened.window_ui.is_closed()
        {
            opened.save_settings();
            event_loop.exit();
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(opened) = &mut self.opened else { return };
        // egui answers a redraw with the wish for another one, and a window that grants it never rests.
        let redraws = matches!(event, WindowEvent::RedrawRequested);
        if !redraws && opened.input.on_window_event(&opened.window, &event).repaint {
            opened.window.request_redraw();
        }
        match event {
            WindowEvent::CloseRequested => {
                opened.save_settings();
                event_loop.exit();
            }
            // The window is destroyed: its size cannot be read.
            WindowEvent::Destroyed => event_loop.exit(),
            WindowEvent::Resized(PhysicalSize { width, height }) => {
                if let Some(surface) = &mut opened.surface {
                    surface.resize(width, height);
                }
                opened.window.request_redraw();
            }
            WindowEvent::Occluded(occluded) => opened.occluded = occluded,
            WindowEvent::RedrawRequested => {
                if let Err(error) = opened.frame() {
                    self.error = Some(error);
                    event_loop.exit();
                }
            }
            _ => (),
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let Some(opened) = &mut self.opened else { return };
        let now = Instant::now();
        opened.request_frame_if_due(now);
        let next = now + LONGEST_SLEEP;
        event_loop.set_control_flow(ControlFlow::WaitUntil(opened.due.map_or(next, |due| due.min(next))));
    }
}
