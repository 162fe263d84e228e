//! A small window with the progress of a file that opens: there is no other window yet.

use std::sync::Arc;

use egui::{CentralPanel, Key, ProgressBar, Ui, ViewportId};
use winit::application::ApplicationHandler;
use winit::dpi::LogicalSize;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::platform::x11::EventLoopBuilderExtX11 as _;
use winit::window::{Window, WindowId};

use super::error::WindowError;
use super::fresh_input;
use super::surface::{PresentResult, WindowSurface};
use crate::display::Tools;
use crate::display::number_format::percent;
use crate::panels::theme;

/// Title of the window. The file's name is inside: its own window has it in the title.
const TITLE: &str = "Opening…";

/// Size of the window, points.
const SIZE: (f64, f64) = (440.0, 132.0);

/// News of the work.
#[derive(Debug, Clone, PartialEq)]
pub enum ProgressUpdate {
    /// The share that is done, 0 to 1, and what is being done.
    Step(f32, String),
    /// The work has ended; the window closes.
    End,
}

/// What the window shows.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgressUi {
    /// Name of the file.
    pub name: String,
    /// The share that is done, 0 to 1.
    pub share: f32,
    /// What is being done.
    pub step: String,
    /// Whether a person has cancelled.
    pub cancelled: bool,
}

impl ProgressUi {
    /// The beginning of the work on a file.
    #[must_use]
    pub fn new(name: &str) -> Self {
        Self { name: name.to_owned(), share: 0.0, step: "reading".to_owned(), cancelled: false }
    }

    /// Shows a frame and handles its input.
    pub fn show(&mut self, ui: &mut Ui) {
        theme::apply(ui.ctx(), &Tools::default());
        CentralPanel::default().show(ui, |ui| {
            ui.add(egui::Label::new(format!("Opening {}", self.name)).truncate());
            ui.add_space(4.0);
            let share = self.share.clamp(0.0, 1.0);
            ui.add(ProgressBar::new(share).text(percent(share.into())));
            ui.add_space(4.0);
            ui.horizontal(|ui| {
                if ui.button("Cancel").on_hover_text("stop, and leave nothing behind (Esc)").clicked() {
                    self.cancelled = true;
                }
                ui.add(egui::Label::new(&self.step).truncate());
            });
        });
        self.cancelled |= ui.input(|i| i.key_pressed(Key::Escape));
    }
}

/// Shows the window until the work has ended or a person has cancelled it. `start` gets a function that takes the news of the
/// work, from any thread. Returns whether it was cancelled.
///
/// # Errors
/// [`WindowError`].
pub fn show_progress(name: &str, start: impl FnOnce(Box<dyn Fn(ProgressUpdate) + Send>)) -> Result<bool, WindowError> {
    let display = |e: &dyn std::fmt::Display| WindowError::Display(e.to_string());
    let event_loop =
        EventLoop::<ProgressUpdate>::with_user_event().with_any_thread(true).build().map_err(|e| display(&e))?;
    let wake: EventLoopProxy<ProgressUpdate> = event_loop.create_proxy();
    start(Box::new(move |update| {
        // A loop that has ended needs no news.
        let _ = wake.send_event(update);
    }));
    let mut app = App { ui: ProgressUi::new(name), opened: None, error: None };
    event_loop.run_app(&mut app).map_err(|e| display(&e))?;
    app.error.map_or(Ok(app.ui.cancelled), Err)
}

struct App {
    ui: ProgressUi,
    opened: Option<Opened>,
    error: Option<WindowError>,
}

/// The open window.
struct Opened {
    window: Arc<Window>,
    surface: WindowSurface,
    input: egui_winit::State,
}

impl Opened {
    fn new(event_loop: &ActiveEventLoop) -> Result<Self, WindowError> {
        let attributes = Window::default_attributes()
            .with_title(TITLE)
            .with_inner_size(LogicalSize::new(SIZE.0, SIZE.1))
            .with_resizable(false);
        let window = event_loop.create_window(attributes).map_err(|e| WindowError::Display(e.to_string()))?;
        let window = Arc::new(window);
        let surface = WindowSurface::open(&window, None)?;
        let input = fresh_input(&window, Some(&surface));
        Ok(Self { window, surface, input })
    }

    fn frame(&mut self, shown: &mut ProgressUi) -> Result<(), WindowError> {
        let raw = self.input.take_egui_input(&self.window);
        let ctx = self.input.egui_ctx().clone();
        let output = ctx.run_ui(raw, |ui| shown.show(ui));
        self.input.handle_platform_output(&self.window, output.platform_output);
        let primitives = ctx.tessellate(output.shapes, output.pixels_per_point);
        let delay = output.viewport_output.get(&ViewportId::ROOT).map(|v| v.repaint_delay);
        let painted = self.surface.paint(primitives, output.textures_delta, output.pixels_per_point);
        match painted {
            PresentResult::Lost => Err(WindowError::Surface("its device was lost".to_owned())),
            // The first frame learns the size of its texts, the second one has them in place.
            _ if painted == PresentResult::Passed || delay.is_some_and(|delay| delay.is_zero()) => {
                self.window.request_redraw();
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

impl ApplicationHandler<ProgressUpdate> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        event_loop.set_control_flow(ControlFlow::Wait);
        match Opened::new(event_loop) {
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

    fn user_event(&mut self, event_loop: &ActiveEventLoop, update: ProgressUpdate) {
        match update {
            ProgressUpdate::End => event_loop.exit(),
            ProgressUpdate::Step(share, step) => {
                (self.ui.share, self.ui.step) = (share, step);
                if let Some(opened) = &self.opened {
                    opened.window.request_redraw();
                }
            }
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(opened) = &mut self.opened else { return };
        let redraws = matches!(event, WindowEvent::RedrawRequested);
        if !redraws && opened.input.on_window_event(&opened.window, &event).repaint {
            opened.window.request_redraw();
        }
        match event {
            WindowEvent::CloseRequested => self.ui.cancelled = true,
            WindowEvent::Destroyed => event_loop.exit(),
            WindowEvent::Resized(size) => opened.surface.resize(size.width, size.height),
            WindowEvent::RedrawRequested => {
                if let Err(error) = opened.frame(&mut self.ui) {
                    self.error = Some(error);
                    event_loop.exit();
                }
            }
            _ => (),
        }
        if self.ui.cancelled {
            event_loop.exit();
        }
    }
}
