//! Chooses the renderer of a scene, all CPU cores or a graphics device, and recovers from the loss of the device.

use std::sync::Arc;
use std::time::Instant;

use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::device::Gpu;
use crate::device_class::DeviceClass;
use crate::error::GpuError;
use crate::renderer::Renderer;
use crate::settings::{FrameStats, Rasterizer, Settings};
use crate::stats::PassSeconds;
use crate::trial::Trial;
use sg_raster::render::{Options, Projection, Quality, Rendered, render};
use sg_raster::report::{Report, StageSeconds};
use sg_scene::framing;

/// Choice of the renderer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Backend {
    /// A graphics card if there is one, else the CPU: it is faster than a software device.
    #[default]
    Auto,
    /// All CPU cores.
    Cpu,
    /// A graphics device of any class.
    Gpu,
}

/// Edge of a trial picture in pixels.
const TRIAL_SIZE: u32 = 768;

/// A scene and its renderer.
pub struct Engine {
    scene: Arc<Scene>,
    device: Option<DeviceRenderer>,
    /// Whether the CPU may replace the device.
    falls_back: bool,
    /// The error after which the CPU replaced the device.
    fallback_error: Option<GpuError>,
}

struct DeviceRenderer {
    class: DeviceClass,
    renderer: Renderer,
    rasterizer: Rasterizer,
}

impl Engine {
    /// Chooses the renderer of `scene`. A device uses `rasterizer`, or the fastest one in a trial of the scene's
    /// first view.
    ///
    /// # Errors
    /// [`GpuError`] without a usable device. With [`Backend::Auto`] the CPU draws instead.
    pub fn new(
        scene: impl Into<Arc<Scene>>,
        backend: Backend,
        rasterizer: Option<Rasterizer>,
    ) -> Result<Self, GpuError> {
        let scene = scene.into();
        let class = match backend {
            Backend::Cpu => return Ok(Self::on_cpu(scene)),
            Backend::Auto => DeviceClass::Hardware,
            Backend::Gpu => DeviceClass::Any,
        };
        match DeviceRenderer::open(class, &scene, rasterizer) {
            Ok(device) => {
                let falls_back = backend == Backend::Auto;
                Ok(Self { device: Some(device), falls_back, fallback_error: None, scene })
            }
            Err(GpuError::NoDevice { .. }) if backend == Backend::Auto => Ok(Self::on_cpu(scene)),
            Err(error) if backend == Backend::Auto => Ok(Self { fallback_error: Some(error), ..Self::on_cpu(scene) }),
            Err(error) => Err(error),
        }
    }

    fn on_cpu(scene: Arc<Scene>) -> Self {
        Self { scene, device: None, falls_back: true, fallback_error: None }
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Draws this scene from now on: the same Gaussians, some of them elsewhere. The scene that is drawn already costs nothing.
    ///
    /// # Errors
    /// As [`Self::draw`].
    pub fn show(&mut self, scene: &Arc<Scene>) -> Result<(), GpuError> {
        if Arc::ptr_eq(&self.scene, scene) {
            return Ok(());
        }
        self.scene = Arc::clone(scene);
        let shown = self.on_device(Options::from(Quality::Standard), |device| {
            if device.renderer.show(scene)? { Ok(()) } else { device.reopen(scene) }
        });
        shown.map(drop)
    }

    /// Name of the renderer: `cpu`, or the name of the device and the rasterizer.
    #[must_use]
    pub fn name(&self) -> String {
        self.device.as_ref().map_or_else(
            || "cpu".to_owned(),
            |d| format!("{}, {}", d.renderer.gpu().name(), format!("{:?}", d.rasterizer).to_lowercase()),
        )
    }

    /// Draws one picture. The CPU always draws [`sg_raster::render::Quality::Exact`]. The engine opens a lost
    /// device again and uploads the scene again. If this fails, or the device lacks room, the CPU draws where
    /// allowed.
    ///
    /// # Errors
    /// [`GpuError::Input`] for invalid input, other errors if the device fails and the CPU may not replace it.
    pub fn draw(
        &mut self,
        appearance: &Appearance,
        camera: &Camera,
        options: impl Into<Options>,
    ) -> Result<Rendered, GpuError> {
        let options = options.into();
        match self.on_device(options, |device| device.draw(appearance, camera, options))? {
            Some(rendered) => Ok(rendered),
            None => Ok(render(&self.scene, appearance, camera, options)?),
        }
    }

    /// Draws complete pictures of one or two cameras and returns their textures, as [`Renderer::pictures`] does;
    /// `None` if the CPU draws.
    ///
    /// # Errors
    /// As [`Self::draw`].
    pub fn leave(
        &mut self,
        appearance: &Appearance,
        cameras: &[Camera],
        options: impl Into<Options>,
    ) -> Result<Option<(&Gpu, &[wgpu::Texture])>, GpuError> {
        let options = options.into();
        let left = self.on_device(options, |device| device.leave(appearance, cameras, options))?;
        let device = self.device.as_ref().filter(|_| left.is_some());
        Ok(device.map(|d| (d.renderer.gpu(), d.renderer.pictures())))
    }

    /// Runs `work` on the device and reopens a lost one; `None` if the CPU has to draw.
    fn on_device<T>(
        &mut self,
        options: Options,
        mut work: impl FnMut(&mut DeviceRenderer) -> Result<T, GpuError>,
    ) -> Result<Option<T>, GpuError> {
        let Some(device) = self.device.as_mut().filter(|_| options.drawn_by_devices()) else { return Ok(None) };
        let outcome = match work(device) {
            Err(GpuError::Lost { .. }) => device.reopen(&self.scene).and_then(|()| work(device)),
            outcome => outcome,
        };
        match outcome {
            Ok(done) => Ok(Some(done)),
            Err(error) if self.falls_back && !matches!(error, GpuError::Input(_)) => {
                if !matches!(error, GpuError::TooMany { .. } | GpuError::TooManyNear { .. }) {
                    self.device = None;
                }
                self.fallback_error = Some(error);
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    /// Takes the error after which the CPU replaced the device, once.
    pub fn take_fallback_error(&mut self) -> Option<GpuError> {
        self.fallback_error.take()
    }

    /// The device, if one draws.
    #[must_use]
    pub fn gpu(&self) -> Option<&Gpu> {
        self.device.as_ref().map(|d| d.renderer.gpu())
    }
}

impl DeviceRenderer {
    fn open(class: DeviceClass, scene: &Scene, rasterizer: Option<Rasterizer>) -> Result<Self, GpuError> {
        let mut renderer = Renderer::new(&Gpu::open(class)?, scene)?;
        let rasterizer = match rasterizer {
            Some(given) => given,
            None => fastest(&mut renderer, scene)?,
        };
        Ok(Self { class, renderer, rasterizer })
    }

    fn reopen(&mut self, scene: &Scene) -> Result<(), GpuError> {
        *self = Self::open(self.class, scene, Some(self.rasterizer))?;
        Ok(())
    }

    fn settings(&self, Options { quality, projection, foveation }: Options) -> Settings {
        Settings { quality, projection, foveation, rasterizer: self.rasterizer, ..Settings::default() }
    }

    fn draw(&mut self, appearance: &Appearance, camera: &Camera, options: Options) -> Result<Rendered, GpuError> {
        let began = Instant::now();
        let settings = self.settings(options);
        let (mut images, stats) = self.renderer.picture(std::slice::from_ref(camera), appearance, settings)?;
        let report = self.report(&stats, began);
        self.renderer.gpu().save_pipelines_or_log();
        match images.pop() {
            Some(image) => Ok(Rendered { image, report }),
            None => Err(GpuError::Views("the device made no picture".to_owned())),
        }
    }

    fn leave(&mut self, appearance: &Appearance, cameras: &[Camera], options: Options) -> Result<(), GpuError> {
        let settings = self.settings(options);
        self.renderer.draw_complete(cameras, appearance, settings).map(drop)
    }

    fn report(&self, stats: &FrameStats, began: Instant) -> Report {
        let PassSeconds { list, project, sort, bin, pair_sort, blend, compose } = stats.seconds.unwrap_or_default();
        let gaussians = self.renderer.gaussians();
        let dropped_non_finite = self.renderer.dropped_non_finite();
        Report {
            gaussians,
            drawn: stats.listed as usize,
            dropped_non_finite,
            culled_outside: gaussians - dropped_non_finite - stats.listed as usize,
            tile_pairs: stats.tile_pairs.into(),
            seconds: StageSeconds {
                preprocess: list + project,
                sort,
                bin: bin + pair_sort,
                raster: blend + compose,
                total: began.elapsed().as_secs_f64(),
            },
            ..Report::default()
        }
    }
}

/// The fastest rasterizer for a scene's first view on this device. Ray-consistent pictures always use tiles.
fn fastest(renderer: &mut Renderer, scene: &Scene) -> Result<Rasterizer, GpuError> {
    if !renderer.blends_quads() {
        return Ok(Rasterizer::Tiles);
    }
    let camera = [framing::default_camera(scene, TRIAL_SIZE, TRIAL_SIZE)];
    let look = Appearance::of(scene);
    let mut trial = Trial::new(renderer, &[Projection::Affine], None);
    while !trial.step(renderer, &camera, &look, Settings::default())? {}
    Ok(trial.fastest(Projection::Affine).map_or(Rasterizer::Tiles, |best| best.rasterizer))
}
