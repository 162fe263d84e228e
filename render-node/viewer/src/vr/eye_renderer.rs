//! Both eyes' pictures of the scene.

use std::time::Instant;

use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::display::{AdaptiveQuality, Level, Tools};
use crate::hands::{Fov, Placement};
use crate::xr::{Frame, XrError};
use sg_gpu::backend::fastest;
use sg_gpu::{DepthLayer, GpuError, Present, Rasterizer, Renderer, Settings, Vignette};
use sg_raster::render::Quality;

/// Share of a frame's time that the scene may take.
const SHARE: f64 = 0.8;

/// Renderer of both eyes on the device of one session.
pub(super) struct EyeRenderer {
    renderer: Renderer,
    present: Present,
    vignette: Vignette,
    /// Depth layer, if the runtime takes depths.
    depths: Option<DepthLayer>,
    rasterizer: Rasterizer,
    adaptive_quality: AdaptiveQuality,
    /// Submission time of the picture before.
    before: Option<Instant>,
    /// How the newest one was drawn.
    pub(super) level: Level,
    pub(super) pictures: u64,
    /// Version of the hidden mesh in the renderer, and the fields of view it belongs to.
    hides: Option<(u64, [Fov; 2])>,
}

impl EyeRenderer {
    /// Uploads a scene to the headset's device; there is a picture every `period` seconds.
    pub(super) fn new(frame: &Frame<'_>, scene: &Scene, period: f64) -> Result<Self, GpuError> {
        let (gpu, format) = (frame.gpu(), frame.format());
        let mut renderer = Renderer::new(gpu, scene)?;
        let rasterizer = match renderer.blends_quads() {
            // A trial on a software device takes seconds without a picture.
            true if gpu.is_software() => Rasterizer::Quads,
            _ => fastest(&mut renderer, scene)?,
        };
        let adaptive_quality = AdaptiveQuality::new(SHARE * period);
        let level = adaptive_quality.level(Quality::Standard, true);
        Ok(Self {
            present: Present::new(gpu, format),
            vignette: Vignette::new(gpu, format),
            depths: frame.depth_format().map(|format| DepthLayer::new(gpu, format)),
            renderer,
            rasterizer,
            adaptive_quality,
            before: None,
            level,
            pictures: 0,
            hides: None,
        })
    }

    /// Skips drawing behind the lenses' hidden areas. On a software device the test costs more than most lenses save.
    fn hide(&mut self, frame: &Frame<'_>) {
        if frame.gpu().is_software() {
            return;
        }
        let fovs = frame.eyes.map(|eye| eye.fov);
        let (version, eyes) = frame.hidden();
        if self.hides.replace((version, fovs)) == Some((version, fovs)) {
            return;
        }
        let [left, right] = [0, 1].map(|k| {
            let in_picture = |corner| fovs[k].in_picture(corner).as_vec2();
            eyes[k].iter().map(|triangle| triangle.map(in_picture)).collect::<Vec<_>>()
        });
        self.renderer.hide([&left, &right]);
    }

    /// The left eye's newest picture.
    pub(super) fn left(&self) -> Option<&wgpu::Texture> {
        self.renderer.pictures().first()
    }

    pub(super) fn late(&self) -> u64 {
        self.adaptive_quality.late()
    }

    /// Draws a look of the placed scene, with the edges of the view `darkened` by 0 to 1.
    pub(super) fn draw(
        &mut self,
        frame: &mut Frame<'_>,
        placement: &Placement,
        look: &Appearance,
        (tools, darkened): (&Tools, f64),
    ) -> Result<Result<(), GpuError>, XrError> {
        // A frame's cost is the time to the next frame, if that exceeds the headset's own time. Less means spare time.
        let now = Instant::now();
        if let Some(before) = self.before.replace(now) {
            let between = now.duration_since(before).as_secs_f64();
            let cost = if between > 1.5 * frame.period { between } else { 0.5 * SHARE * frame.period };
            self.adaptive_quality.record(cost, true);
        }
        self.level = self.adaptive_quality.level(tools.quality, true);
        self.hide(frame);
        let [width, height] = frame.size();
        let edge = |pixels: u32| ((f64::from(pixels) * self.level.scale) as u32).max(16);
        let size = [edge(width), edge(height)];
        let background = look.background.to_array();
        let cameras: Vec<Camera> =
            frame.eyes.iter().map(|eye| eye.camera(size, placement, background, look.light)).collect();
        let whole: Vec<Camera> =
            frame.eyes.iter().map(|eye| eye.camera([width, height], placement, background, look.light)).collect();
        let settings = Settings {
            quality: self.level.quality,
            rasterizer: self.rasterizer,
            projection: tools.projection,
            depths: self.depths.is_some(),
            ..Settings::default()
        };
        if let Err(error) = self.renderer.draw(&cameras, look, settings) {
            return Ok(Err(error));
        }
        self.pictures += 1;
        let gpu = frame.gpu().clone();
        let Self { renderer, present, vignette, depths, .. } = self;
        frame.draw_eyes_and_depths(|targets, depth_targets| {
            let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            for (eye, (picture, target)) in renderer.pictures().iter().zip(targets).enumerate() {
                let load = wgpu::LoadOp::Clear(wgpu::Color::BLACK);
                present.encode(&mut encoder, picture, target, [0, 0, width, height], load);
                if let Some(camera) = whole.get(eye) {
                    vignette.encode(&mut encoder, target, camera, eye == 1, darkened);
                }
            }
            if let Some(layer) = depths {
                for (picture, target) in renderer.depths().iter().zip(depth_targets) {
                    layer.encode(&mut encoder, picture, target, placement.scale);
                }
            }
            gpu.submit([encoder.finish()]);
        })?;
        Ok(Ok(()))
    }
}
