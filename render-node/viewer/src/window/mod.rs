//! A window: the scene with its panels, a mouse and a keyboard.
//!
//! The loop draws what is newest and never waits: pictures are made beside it ([`crate::display::Beside`]), and what a person
//! asks for is handed to a [`Seat`].

mod around;
mod bars;
mod bookmarks;
mod desk;
mod drawing;
mod dropped;
mod error;
mod ffmpeg;
mod glass;
mod handover;
mod keep;
mod marks;
mod memory;
mod navigation;
mod shortcuts;
mod viewport;

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

use crate::display::{Seat, Tools};
use sg_gpu::Gpu;
use sg_gpu::backend::Engine;
use sg_raster::render::Quality;

pub use desk::Desk;
pub use drawing::threads;
pub use error::WindowError;
pub use memory::Memory;
pub use navigation::{Manner, Navigator};
pub use shortcuts::{MOUSE, SHORTCUTS, Shortcut};
pub use viewport::Pointer;

use glass::{Glass, Painted};

/// How often news from elsewhere is looked for while nothing is drawn.
const GLANCE: Duration = Duration::from_millis(16);

/// Frames in a row whose device or surface may be lost, each opened anew.
const MOST_LOSSES: u32 = 5;

/// What a window shows.
pub struct Setup {
    /// The geometry.
    pub scene: Arc<Scene>,
    /// What draws it.
    pub engine: Engine,
    /// Where the newest comes from and requests go.
    pub seat: Seat,
    /// What stands at its top.
    pub title: String,
    /// The settings of tools at first; what is remembered of an earlier time comes before them.
    pub tools: Tools,
    /// The best quality of pictures where it is given for this time: it comes before what is remembered.
    pub quality: Option<Quality>,
    /// Whether pictures are copied from the device that draws them to another one that shows the window. Without it only where
    /// the former is made of cores: it does one thing after the other, and the loop would wait for its pictures.
    pub copies: Option<bool>,
    /// Where its layout is remembered; `None`: nowhere.
    pub memory: Option<PathBuf>,
    /// Where kept pictures go.
    pub pictures: PathBuf,
    /// Called when it is there.
    pub opened: Box<dyn FnOnce() + Send>,
}

/// Opens a window and serves it on this thread until a person closes it or its seat is over.
///
/// # Errors
/// [`WindowError`].
pub fn run(setup: Setup) -> Result<(), WindowError> {
    // What went wrong stands last, after the place in somebody else's source.
    let display = |e: &dyn std::fmt::Display| {
        let said = e.to_string();
        WindowError::Display(said.rsplit(": ").next().unwrap_or(&said).to_owned())
    };
    // Not the process's first thread, which serves the bus.
    let event_loop = EventLoop::<()>::with_user_event().with_any_thread(true).build().map_err(|e| display(&e))?;
    let wake = event_loop.create_proxy();
    let mut app = App { setup: Some(setup), wake, opened: None, trouble: None };
    event_loop.run_app(&mut app).map_err(|e| display(&e))?;
    match app.trouble {
        Some(trouble) => Err(trouble),
        None => Ok(()),
    }
}

/// The application as the event loop sees it.
struct App {
    setup: Option<Setup>,
    wake: EventLoopProxy<()>,
    opened: Option<Opened>,
    trouble: Option<WindowError>,
}

/// The open window.
struct Opened {
    window: Arc<Window>,
    /// Taken away before another is opened: a window has one at a time.
    glass: Option<Glass>,
    input: egui_winit::State,
    desk: Desk,
    copies: Option<bool>,
    /// The newest device that draws which was tried for showing as well.
    tried: Option<Gpu>,
    /// Frames since one was shown whose device or surface was lost.
    losses: u32,
    memory: Option<PathBuf>,
    /// What was remembered when it opened, and the quality that was given for this time.
    before: (Memory, Option<Quality>),
    /// When the next frame is due, if one is.
    due: Option<Instant>,
}

impl Opened {
    fn new(event_loop: &ActiveEventLoop, setup: Setup, wake: &EventLoopProxy<()>) -> Result<Self, WindowError> {
        let Setup { scene, engine, seat, title, tools, quality, copies, memory, pictures, opened } = setup;
        let read = memory.as_deref().map_or(Ok(None), Memory::read).unwrap_or_else(|why| {
            tracing::warn!("the window's layout is as it is at first: {why}");
            None
        });
        let mut tools = tools;
        if let Some(remembered) = &read {
            remembered.apply(&mut tools, quality);
        }
        let remembered = read.unwrap_or_default();
        let attributes = Window::default_attributes()
            .with_title(title)
            .with_maximized(remembered.maximized)
            .with_inner_size(LogicalSize::new(remembered.width, remembered.height));
        let window = event_loop.create_window(attributes).map_err(|e| WindowError::Display(e.to_string()))?;
        let window = Arc::new(window);
        let wake = wake.clone();
        let told = move || {
            // A loop that has ended needs no waking.
            let _ = wake.send_event(());
        };
        let desk = Desk::new(scene, engine, (seat, tools), pictures, &remembered, told)?;
        let input = fresh_input(&window, None);
        let (before, due) = ((remembered, quality), Some(Instant::now()));
        let mut this = Self { window, glass: None, input, desk, copies, tried: None, losses: 0, memory, before, due };
        this.open_glass()?;
        opened();
        Ok(this)
    }

    /// The device that draws pictures, where they are to stay on it and that has not been tried.
    fn untried(&self) -> Option<Gpu> {
        let tried = |gpu: &Gpu| self.tried.as_ref().is_some_and(|tried| tried.is(gpu));
        let stays = |gpu: &&Gpu| !self.copies.unwrap_or(gpu.is_software()) && !gpu.is_lost() && !tried(gpu);
        self.desk.drawn_by().filter(stays).cloned()
    }

    /// Has the window shown anew: by the device that draws its pictures if they are to stay on it and it can show them, else by
    /// one of its own.
    fn open_glass(&mut self) -> Result<(), WindowError> {
        self.glass = None;
        let drawn_by = self.untried();
        let opened = drawn_by.as_ref().and_then(|gpu| match Glass::open(&self.window, Some(gpu)) {
            Ok(glass) => {
                tracing::info!("pictures stay on {}, which draws them and shows the window", gpu.name());
                Some(glass)
            }
            Err(error) => {
                tracing::info!("pictures are copied from {}, which draws them: {error}", gpu.name());
                None
            }
        });
        if drawn_by.is_some() {
            self.tried = drawn_by;
        }
        let glass = match opened {
            Some(glass) => glass,
            None => Glass::open(&self.window, None)?,
        };
        // What another device held, fonts among it, is told again by a new context alone.
        self.input = fresh_input(&self.window, Some(&glass));
        self.desk.show_by(glass.shows());
        self.glass = Some(glass);
        self.due = Some(Instant::now());
        Ok(())
    }

    /// Paints a frame and finds out when the next one is due.
    fn frame(&mut self) -> Result<(), WindowError> {
        // Whoever draws has opened a lost device anew.
        if self.untried().is_some() {
            self.open_glass()?;
        }
        let raw = self.input.take_egui_input(&self.window);
        let ctx = self.input.egui_ctx().clone();
        let output = ctx.run_ui(raw, |ui| self.desk.show(ui));
        self.input.handle_platform_output(&self.window, output.platform_output);
        let primitives = ctx.tessellate(output.shapes, output.pixels_per_point);
        let delay = output.viewport_output.get(&ViewportId::ROOT).map_or(Duration::MAX, |v| v.repaint_delay);
        self.due = Instant::now().checked_add(delay);
        let Some(glass) = &mut self.glass else { return Ok(()) };
        if let Some(picture) = self.desk.take_picture() {
            glass.take(&picture);
        }
        match glass.paint(&primitives, output.textures_delta, output.pixels_per_point) {
            Painted::Shown => self.losses = 0,
            Painted::Passed => (),
            Painted::Lost if self.losses >= MOST_LOSSES => {
                return Err(WindowError::Surface(format!("its device was lost {MOST_LOSSES} times in a row")));
            }
            Painted::Lost => {
                self.losses += 1;
                // Not by the same device again: the loss of a surface may be the first that is heard of a lost device.
                self.open_glass()?;
            }
        }
        Ok(())
    }

    /// Keeps the layout for the next time; that it could not be kept is told and does no harm.
    fn remember(&self) {
        let Some(path) = &self.memory else { return };
        let size: LogicalSize<f64> = self.window.inner_size().to_logical(self.window.scale_factor());
        let memory = Memory {
            width: size.width,
            height: size.height,
            maximized: self.window.is_maximized(),
            ..self.desk.remembers()
        };
        let memory = memory.after(&self.before.0, self.before.1);
        if let Err(error) = memory.keep(path) {
            tracing::warn!("the window's layout is not kept: {error}");
        }
    }
}

fn fresh_input(window: &Window, glass: Option<&Glass>) -> egui_winit::State {
    let scale = Some(window.scale_factor() as f32);
    egui_winit::State::new(
        egui::Context::default(),
        ViewportId::ROOT,
        window,
        scale,
        window.theme(),
        glass.map(Glass::largest),
    )
}

impl ApplicationHandler<()> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        let Some(setup) = self.setup.take() else { return };
        match Opened::new(event_loop, setup, &self.wake) {
            Ok(opened) => {
                opened.window.request_redraw();
                self.opened = Some(opened);
            }
            Err(error) => {
                self.trouble = Some(error);
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
            && opened.desk.is_over()
        {
            opened.remember();
            event_loop.exit();
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(opened) = &mut self.opened else { return };
        let response = opened.input.on_window_event(&opened.window, &event);
        if response.repaint {
            opened.window.request_redraw();
        }
        match event {
            WindowEvent::CloseRequested => {
                opened.remember();
                event_loop.exit();
            }
            // Somebody else took it away; there is nothing left to ask how large it was.
            WindowEvent::Destroyed => event_loop.exit(),
            WindowEvent::Resized(PhysicalSize { width, height }) => {
                if let Some(glass) = &mut opened.glass {
                    glass.resize(width, height);
                }
                opened.window.request_redraw();
            }
            WindowEvent::RedrawRequested => {
                if let Err(error) = opened.frame() {
                    self.trouble = Some(error);
                    event_loop.exit();
                }
            }
            _ => (),
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let Some(opened) = &mut self.opened else { return };
        let now = Instant::now();
        if opened.desk.has_news() || opened.due.is_some_and(|due| due <= now) {
            opened.due = None;
            opened.window.request_redraw();
        }
        let next = now + GLANCE;
        event_loop.set_control_flow(ControlFlow::WaitUntil(opened.due.map_or(next, |due| due.min(next))));
    }
}
