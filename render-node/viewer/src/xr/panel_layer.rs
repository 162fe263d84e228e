//! A board: egui's output, hung in the room as a quad and pointed at with a ray.

use std::time::{Duration, Instant};

use egui::epaint::ClippedShape;
use egui::{
    Event, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2, RawInput, Rect, TouchPhase, Ui, Vec2,
};

use super::error::XrError;
use super::frame::Frame;
use super::quad::{PanelId, Quad};
use crate::hands::{HandInput, Pointed, Rectangle};
use sg_gpu::Gpu;

/// Points that a stick at its end scrolls in a second.
const SCROLL: f32 = 900.0;

/// A stick at rest is within this of its middle.
const REST: f64 = 0.15;

/// A panel of egui in the room.
///
/// It is drawn after a change and otherwise shown as it is. After the runtime's return it recreates its renderer by itself.
pub struct PanelLayer {
    /// Where it hangs.
    pub place: Rectangle,
    /// Whether it is in front of the eyes' pictures, as [`Quad::in_front`]; so it is at first.
    pub in_front: bool,
    context: egui::Context,
    size: Vec2,
    pixels_per_point: f32,
    renderer: Option<LayerRenderer>,
    /// Whether the context has sent its textures.
    used: bool,
    begun: Instant,
    /// Time of egui's next requested frame.
    due: Option<Instant>,
    /// Position of the pointer on it, and whether it presses.
    pointer: Option<(Pos2, bool)>,
    /// Shapes of the newest layout.
    shapes: Vec<ClippedShape>,
    counts: Counts,
}

/// Layout and draw counts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Times that it was laid out.
    pub laid_out: u64,
    /// Times that it was drawn.
    pub drawn: u64,
}

/// Its panel and renderer in one session.
struct LayerRenderer {
    panel: PanelId,
    renderer: egui_wgpu::Renderer,
}

impl PanelLayer {
    /// A board with this size in points and this many pixels per point, placed at `place`. The caller styles its context.
    #[must_use]
    pub fn new(size: Vec2, pixels_per_point: f32, place: Rectangle) -> Self {
        Self {
            place,
            in_front: true,
            context: egui::Context::default(),
            size,
            pixels_per_point,
            renderer: None,
            used: false,
            begun: Instant::now(),
            due: None,
            pointer: None,
            shapes: Vec::new(),
            counts: Counts::default(),
        }
    }

    /// Layout and draw counts so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// egui's context of the board. Fetch it again in every frame: the runtime's return replaces it.
    #[must_use]
    pub fn context(&self) -> &egui::Context {
        &self.context
    }

    /// Pixels across and down.
    fn pixels(&self) -> [u32; 2] {
        [self.size.x, self.size.y].map(|points| (points * self.pixels_per_point).round().max(1.0) as u32)
    }

    /// Shows the board in a frame. Its layout is redone if `changed`, if its pointer changed, or if egui asked for it. It
    /// is redrawn if its look differs.
    ///
    /// `pointed` is the pointer on *this* board, with its hand; the hand's stick scrolls. `more` are other events, such as
    /// text. `ui` is as for [`egui::Context::run_ui`].
    ///
    /// # Errors
    /// [`XrError::Call`] when the runtime fails.
    pub fn show(
        &mut self,
        frame: &mut Frame<'_>,
        pointed: Option<(&Pointed, &HandInput)>,
        more: Vec<Event>,
        changed: bool,
        ui: impl FnMut(&mut Ui),
    ) -> Result<(), XrError> {
        let mut events = more;
        self.point(pointed, frame.period, &mut events);
        let known = self.renderer.take().filter(|d| d.panel.session == frame.session);
        let (mut drawn_by, new) = match known {
            Some(drawn_by) => (drawn_by, false),
            None => (self.create_renderer(frame)?, true),
        };
        let due = self.due.is_some_and(|due| due <= Instant::now());
        let redraw = new || changed || due || !events.is_empty();
        let drawn = if redraw { self.draw(frame, (&mut drawn_by, new), events, ui) } else { Ok(()) };
        let panel = drawn_by.panel;
        self.renderer = Some(drawn_by);
        drawn?;
        frame.show(Quad { panel, place: self.place, in_front: self.in_front });
        Ok(())
    }

    /// Makes the board's renderer on this session's device. A new device knows none of egui's textures, and only a new
    /// context sends all of them again. The new context takes over the old one's memory.
    fn create_renderer(&mut self, frame: &mut Frame<'_>) -> Result<LayerRenderer, XrError> {
        let panel = frame.panel(self.pixels())?;
        let options = egui_wgpu::RendererOptions::default();
        let renderer = egui_wgpu::Renderer::new(frame.gpu().device(), frame.format(), options);
        if self.used {
            let context = egui::Context::default();
            let memory = self.context.memory(Clone::clone);
            context.memory_mut(|new| *new = memory);
            self.context = context;
        }
        self.used = true;
        Ok(LayerRenderer { panel, renderer })
    }

    /// Events of the pointer, against where it was.
    fn point(&mut self, pointed: Option<(&Pointed, &HandInput)>, period: f64, events: &mut Vec<Event>) {
        let Some((pointed, hand)) = pointed else {
            if let Some((at, pressed)) = self.pointer.take() {
                if pressed {
                    events.push(button(at, false));
                }
                events.push(Event::PointerGone);
            }
            return;
        };
        let at = Pos2::new(pointed.at.x as f32 * self.size.x, pointed.at.y as f32 * self.size.y);
        let (before, pressed) = self.pointer.map_or((None, false), |(at, pressed)| (Some(at), pressed));
        // A hand trembles: motion below half a pixel is ignored.
        let moved = before.is_none_or(|b| b.distance(at) * self.pixels_per_point > 0.5);
        if moved {
            events.push(Event::PointerMoved(at));
        }
        if pointed.pressed != pressed {
            events.push(button(at, pointed.pressed));
        }
        self.pointer = Some((if moved { at } else { before.unwrap_or(at) }, pointed.pressed));
        if hand.stick.y.abs() > REST {
            events.push(Event::MouseWheel {
                unit: MouseWheelUnit::Point,
                delta: Vec2::new(0.0, hand.stick.y as f32 * SCROLL * period.clamp(0.0, 0.1) as f32),
                phase: TouchPhase::Move,
                source: MouseWheelSource::Unknown,
                modifiers: Modifiers::NONE,
            });
        }
    }

    fn draw(
        &mut self,
        frame: &mut Frame<'_>,
        (drawn_by, new): (&mut LayerRenderer, bool),
        events: Vec<Event>,
        ui: impl FnMut(&mut Ui),
    ) -> Result<(), XrError> {
        self.counts.laid_out += 1;
        let mut input = RawInput {
            screen_rect: Some(Rect::from_min_size(Pos2::ZERO, self.size)),
            time: Some(self.begun.elapsed().as_secs_f64()),
            predicted_dt: frame.period as f32,
            events,
            focused: true,
            ..RawInput::default()
        };
        input.viewports.entry(egui::ViewportId::ROOT).or_default().native_pixels_per_point =
            Some(self.pixels_per_point);
        let mut output = self.context.run_ui(input, ui);
        let soon = output.viewport_output.values().map(|v| v.repaint_delay).min().unwrap_or(Duration::MAX);
        self.due = Instant::now().checked_add(soon).filter(|_| soon < Duration::from_secs(3600));
        let shapes = std::mem::take(&mut output.shapes);
        if !new && shapes == self.shapes && output.textures_delta.is_empty() {
            return Ok(());
        }
        let jobs = self.context.tessellate(shapes.clone(), output.pixels_per_point);
        let gpu = frame.gpu().clone();
        let LayerRenderer { panel, renderer } = drawn_by;
        for (id, deltas) in output.textures_delta.set.drain() {
            for delta in deltas {
                renderer.update_texture(gpu.device(), gpu.queue(), id, &delta);
            }
        }
        let screen =
            egui_wgpu::ScreenDescriptor { size_in_pixels: self.pixels(), pixels_per_point: output.pixels_per_point };
        let drawn = frame.draw_panel(*panel, |target| paint(&gpu, renderer, target, &jobs, &screen));
        for id in output.textures_delta.free.drain() {
            renderer.free_texture(&id);
        }
        if drawn.is_ok() {
            self.shapes = shapes;
            self.counts.drawn += 1;
        }
        drawn
    }
}

fn button(pos: Pos2, pressed: bool) -> Event {
    Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE }
}

fn paint(
    gpu: &Gpu,
    renderer: &mut egui_wgpu::Renderer,
    target: &wgpu::TextureView,
    jobs: &[egui::ClippedPrimitive],
    screen: &egui_wgpu::ScreenDescriptor,
) {
    let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut work = renderer.update_buffers(gpu.device(), gpu.queue(), &mut encoder, jobs, screen);
    {
        let mut pass = encoder
            .begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("board"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: target,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..wgpu::RenderPassDescriptor::default()
            })
            .forget_lifetime();
        renderer.render(&mut pass, jobs, screen);
    }
    work.push(encoder.finish());
    gpu.submit(work);
}
