//! The window's last frame on its device. Frames draw what has changed into it, and each is copied to the screen whole.

use std::collections::HashSet;

use egui::{ClippedPrimitive, Pos2, Rect, TextureId};
use sg_gpu::Gpu;

use super::damage::Damage;

/// Paints an area black, as the begin of a frame does. Panels blend over it.
const BLANK: &str = "
@vertex
fn cover(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2(f32(vertex & 1u), f32(vertex >> 1u));
    return vec4(4.0 * corner.x - 1.0, 1.0 - 4.0 * corner.y, 0.0, 1.0);
}

@fragment
fn blank() -> @location(0) vec4<f32> {
    return vec4(0.0, 0.0, 0.0, 1.0);
}
";

/// A texture of the window's size and format.
pub(super) struct Canvas {
    texture: wgpu::Texture,
    view: wgpu::TextureView,
    /// The pipeline of [`BLANK`].
    blank: wgpu::RenderPipeline,
    damage: Damage,
    /// Pixels a point in the last frame.
    pixels_per_point: f32,
    /// Textures whose pixels are others than in the last frame.
    replaced: HashSet<TextureId>,
}

impl Canvas {
    /// A canvas for a window of `size` pixels.
    pub(super) fn new(gpu: &Gpu, size: [u32; 2], format: wgpu::TextureFormat) -> Self {
        let (texture, view) = target(gpu, size, format);
        let source = wgpu::ShaderSource::Wgsl(BLANK.into());
        let module = gpu.device().create_shader_module(wgpu::ShaderModuleDescriptor { label: Some("blank"), source });
        let blank = gpu.device().create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("blank"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("cover"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("blank"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let (damage, replaced) = (Damage::default(), HashSet::new());
        Self { texture, view, blank, damage, pixels_per_point: 0.0, replaced }
    }

    /// Takes another size; then it has no last frame.
    pub(super) fn fit(&mut self, gpu: &Gpu, size: [u32; 2]) {
        if [self.texture.width(), self.texture.height()] != size {
            (self.texture, self.view) = target(gpu, size, self.texture.format());
            self.damage = Damage::default();
        }
    }

    /// The last frame.
    pub(super) fn texture(&self) -> &wgpu::Texture {
        &self.texture
    }

    /// The next frame has other pixels of a texture.
    pub(super) fn replace(&mut self, texture: TextureId) {
        self.replaced.insert(texture);
    }

    /// Draws what `primitives` change. `renderer` has their buffers already.
    pub(super) fn draw(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        renderer: &egui_wgpu::Renderer,
        mut primitives: Vec<ClippedPrimitive>,
        screen: &egui_wgpu::ScreenDescriptor,
    ) {
        // The same points are other pixels.
        if self.pixels_per_point != screen.pixels_per_point {
            (self.damage, self.pixels_per_point) = (Damage::default(), screen.pixels_per_point);
        }
        let [width, height] = screen.size_in_pixels;
        let end = Pos2::new(width as f32, height as f32) / screen.pixels_per_point;
        let replaced = std::mem::take(&mut self.replaced);
        let whole = Rect::from_min_max(Pos2::ZERO, end);
        let areas = self.damage.areas(&primitives, |id| replaced.contains(&id), whole);
        if !areas.is_empty() {
            let mut pass = panels(encoder, &self.view, wgpu::LoadOp::Load);
            let clips: Vec<Rect> = primitives.iter().map(|primitive| primitive.clip_rect).collect();
            for area in areas {
                let [x, y, width, height] = pixels(area, screen);
                pass.set_pipeline(&self.blank);
                pass.set_scissor_rect(x, y, width, height);
                pass.draw(0..3, 0..1);
                for (primitive, clip) in primitives.iter_mut().zip(&clips) {
                    primitive.clip_rect = whole_pixels(area, screen.pixels_per_point).intersect(*clip);
                }
                renderer.render(&mut pass, &primitives, screen);
            }
            for (primitive, clip) in primitives.iter_mut().zip(clips) {
                primitive.clip_rect = clip;
            }
        }
        self.damage.keep(primitives);
    }
}

/// A texture for frames of `size` pixels.
fn target(gpu: &Gpu, size: [u32; 2], format: wgpu::TextureFormat) -> (wgpu::Texture, wgpu::TextureView) {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
    let texture = gpu.texture("last frame of the window", (size, 1), format, usage);
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    (texture, view)
}

/// A pass that draws panels.
pub(super) fn panels(
    encoder: &mut wgpu::CommandEncoder,
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<wgpu::Color>,
) -> wgpu::RenderPass<'static> {
    let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("panels"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
        })],
        ..wgpu::RenderPassDescriptor::default()
    });
    pass.forget_lifetime()
}

/// An area with its edges on those of pixels, in points.
fn whole_pixels(area: Rect, pixels_per_point: f32) -> Rect {
    let Rect { min, max } = area * pixels_per_point;
    Rect::from_min_max(min.floor(), max.ceil()) / pixels_per_point
}

/// The pixels of an area: left, top, width, height.
fn pixels(area: Rect, screen: &egui_wgpu::ScreenDescriptor) -> [u32; 4] {
    let Rect { min, max } = area * screen.pixels_per_point;
    let [width, height] = screen.size_in_pixels;
    let edge = |x: f32, limit: u32| (x.max(0.0) as u32).min(limit);
    let [left, top] = [edge(min.x.floor(), width), edge(min.y.floor(), height)];
    let [right, bottom] = [edge(max.x.ceil(), width), edge(max.y.ceil(), height)];
    [left, top, right.saturating_sub(left), bottom.saturating_sub(top)]
}

#[cfg(test)]
mod tests {
    use egui::{CentralPanel, Color32, Context, Event, Panel, RawInput, Ui, Vec2};
    use sg_gpu::DeviceClass;

    use super::*;

    const SIZE: [u32; 2] = [320, 200];
    const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

    /// Panels of which a frame changes some.
    fn show(ui: &mut Ui, frame: usize, texture: TextureId) {
        Panel::left("tools").show(ui, |ui| {
            ui.heading("Structures");
            for name in ["vessel", "sac", "bone"] {
                let _ = ui.button(name);
            }
        });
        Panel::bottom("status").show(ui, |ui| ui.label(format!("{} pictures", [0, 7, 7, 128, 129][frame])));
        CentralPanel::default().show(ui, |ui| {
            let rect = ui.max_rect();
            let all = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            ui.painter().image(texture, rect.shrink(7.3), all, Color32::WHITE);
            if frame > 2 {
                ui.painter().circle_filled(rect.center() + Vec2::new(3.0 * frame as f32, 0.0), 20.0, Color32::RED);
            }
        });
    }

    /// A device; none where a bare machine lacks one.
    #[allow(clippy::print_stderr, reason = "a skipped test says so")]
    fn device() -> Option<Gpu> {
        let opened = Gpu::open(DeviceClass::Any).inspect_err(|error| {
            assert!(std::env::var_os("SUPERGAUSSIAN_REQUIRE_GPU").is_none_or(|v| v != "1"), "{error}");
            eprintln!("SKIPPED on the device: {error}");
        });
        opened.ok()
    }

    fn bytes(gpu: &Gpu, texture: &wgpu::Texture) -> Vec<u8> {
        let row = 4 * SIZE[0];
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
        let size = u64::from(row * SIZE[1]);
        let descriptor = wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false };
        let read = gpu.device().create_buffer(&descriptor);
        let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
        let to = wgpu::TexelCopyBufferInfo { buffer: &read, layout };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), to, texture.size());
        gpu.submit([encoder.finish()]);
        read.map_async(wgpu::MapMode::Read, .., Result::unwrap);
        gpu.device().poll(wgpu::PollType::wait_indefinitely()).unwrap();
        read.get_mapped_range(..).unwrap().to_vec()
    }

    /// Frames on one canvas, each beside the same one on a new canvas. A mouse moves over the buttons, a picture changes, and the last
    /// frame comes at another scale.
    fn compare(gpu: &Gpu, pixels_per_point: f32) {
        let ctx = Context::default();
        ctx.set_pixels_per_point(pixels_per_point);
        let mut renderer = egui_wgpu::Renderer::new(gpu.device(), FORMAT, egui_wgpu::RendererOptions::PREDICTABLE);
        let mut kept = Canvas::new(gpu, SIZE, FORMAT);
        let picture = |shade: u8| egui::ColorImage::filled([8, 8], Color32::from_gray(shade));
        let mut handle = ctx.load_texture("picture", picture(50), egui::TextureOptions::LINEAR);
        for frame in 0..5 {
            if frame == 2 {
                handle.set(picture(200), egui::TextureOptions::LINEAR);
            }
            let mouse = Pos2::new(20.0, 30.0 + 12.0 * frame as f32);
            let points = Vec2::new(SIZE[0] as f32, SIZE[1] as f32) / pixels_per_point;
            let input = RawInput {
                screen_rect: Some(Rect::from_min_size(Pos2::ZERO, points)),
                time: Some(frame as f64),
                events: vec![Event::PointerMoved(mouse)],
                ..RawInput::default()
            };
            let output = ctx.run_ui(input, |ui| show(ui, frame, handle.id()));
            let primitives = ctx.tessellate(output.shapes, output.pixels_per_point);
            let mut textures = output.textures_delta;
            for (id, deltas) in textures.set.drain() {
                for delta in deltas {
                    renderer.update_texture(gpu.device(), gpu.queue(), id, &delta);
                    if delta.pos.is_none() {
                        kept.replace(id);
                    }
                }
            }
            textures.free.clear();
            draw_both(gpu, &mut renderer, &mut kept, &primitives, pixels_per_point);
            if frame == 4 {
                // The same points at another scale.
                draw_both(gpu, &mut renderer, &mut kept, &primitives, 0.8 * pixels_per_point);
            }
        }
    }

    /// Draws a frame on the kept canvas and on a new one, and compares all pixels.
    fn draw_both(
        gpu: &Gpu,
        renderer: &mut egui_wgpu::Renderer,
        kept: &mut Canvas,
        primitives: &[ClippedPrimitive],
        pixels_per_point: f32,
    ) {
        let screen = egui_wgpu::ScreenDescriptor { size_in_pixels: SIZE, pixels_per_point };
        let mut whole = Canvas::new(gpu, SIZE, FORMAT);
        for canvas in [&mut *kept, &mut whole] {
            let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            renderer.update_buffers(gpu.device(), gpu.queue(), &mut encoder, primitives, &screen);
            canvas.draw(&mut encoder, renderer, primitives.to_vec(), &screen);
            gpu.submit([encoder.finish()]);
        }
        let [kept, whole] = [&*kept, &whole].map(|canvas| bytes(gpu, canvas.texture()));
        let other = kept.iter().zip(&whole).filter(|(a, b)| a != b).count();
        assert_eq!(other, 0, "at {pixels_per_point} pixels a point");
        let shades = whole.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect::<HashSet<_>>().len();
        assert!(shades > 20 && whole.chunks_exact(4).all(|p| p[3] == 255), "{shades} colours");
    }

    #[test]
    fn a_frame_of_changes_is_that_of_a_whole_window() {
        let Some(gpu) = device() else { return };
        for pixels_per_point in [1.0, 1.25, 2.0] {
            compare(&gpu, pixels_per_point);
        }
        gpu.check().unwrap();
    }
}
