//! What draws a scene: all cores of this machine, or a graphics device, chosen once and kept through the device's loss.

use std::time::Instant;

use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::{Drawn, Gpu, GpuError, PassSeconds, Rasterizer, Renderer, Settings, Wanted};
use sg_raster::render::{Options, Rendered, render};
use sg_raster::report::{Report, StageSeconds};
use sg_scene::framing;

/// What is to draw.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Backend {
    /// A graphics card where there is one, else the cores: a device that is made of cores is slower than they are.
    #[default]
    Auto,
    /// All cores of this machine.
    Cpu,
    /// A graphics device of any kind.
    Gpu,
}

/// Pictures that each rasterizer draws when one is chosen; the last is timed, after shaders were compiled and lists grew.
const TRIALS: usize = 3;

/// Edge of those pictures in pixels.
const TRIAL_SIZE: u32 = 768;

/// A scene and what draws it.
pub struct Engine {
    scene: Scene,
    device: Option<OnDevice>,
    /// Whether the cores draw where the device cannot.
    falls_back: bool,
    /// Why the cores draw although a device was there.
    trouble: Option<GpuError>,
}

struct OnDevice {
    wanted: Wanted,
    renderer: Renderer,
    rasterizer: Rasterizer,
}

impl Engine {
    /// Chooses what draws `scene`. With a device, `rasterizer` or the fastest in a trial of the scene's first view.
    ///
    /// # Errors
    /// [`GpuError`] where a device was asked for and none will do. With [`Backend::Auto`] the cores draw then.
    pub fn new(scene: Scene, backend: Backend, rasterizer: Option<Rasterizer>) -> Result<Self, GpuError> {
        let wanted = match backend {
            Backend::Cpu => return Ok(Self::on_cores(scene)),
            Backend::Auto => Wanted::Hardware,
            Backend::Gpu => Wanted::Any,
        };
        match OnDevice::open(wanted, &scene, rasterizer) {
            Ok(device) => {
                let falls_back = backend == Backend::Auto;
                Ok(Self { device: Some(device), falls_back, trouble: None, scene })
            }
            Err(GpuError::NoDevice { .. }) if backend == Backend::Auto => Ok(Self::on_cores(scene)),
            Err(error) if backend == Backend::Auto => Ok(Self { trouble: Some(error), ..Self::on_cores(scene) }),
            Err(error) => Err(error),
        }
    }

    fn on_cores(scene: Scene) -> Self {
        Self { scene, device: None, falls_back: true, trouble: None }
    }

    /// What is drawn.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What draws: `cpu`, or the device's name and the rasterizer.
    #[must_use]
    pub fn name(&self) -> String {
        self.device.as_ref().map_or_else(
            || "cpu".to_owned(),
            |d| format!("{}, {}", d.renderer.gpu().name(), format!("{:?}", d.rasterizer).to_lowercase()),
        )
    }

    /// Draws one picture. References are drawn by the cores, whatever draws the rest.
    /// A lost device is opened again and the scene uploaded anew; where that fails, or the device has not enough room, the
    /// cores take over if they may.
    ///
    /// # Errors
    /// [`GpuError::Input`] for what makes no picture, the rest for a device that fails where the cores may not take over.
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

    /// Draws pictures of one or two cameras, complete when this returns, and leaves them on the device, as
    /// [`Renderer::pictures`] has them; `None` where the cores draw.
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

    /// Lets the device do something, opened anew where it was lost; `None` where the cores have to.
    fn on_device<T>(
        &mut self,
        options: Options,
        mut work: impl FnMut(&mut OnDevice) -> Result<T, GpuError>,
    ) -> Result<Option<T>, GpuError> {
        let Some(device) = self.device.as_mut().filter(|_| options.drawn_by_devices()) else { return Ok(None) };
        let outcome = match work(device) {
            Err(GpuError::Lost { .. }) => device.reopen(&self.scene).and_then(|()| work(device)),
            outcome => outcome,
        };
        match outcome {
            Ok(done) => Ok(Some(done)),
            Err(error) if self.falls_back && !matches!(error, GpuError::Input(_)) => {
                if !matches!(error, GpuError::TooMany { .. }) {
                    self.device = None;
                }
                self.trouble = Some(error);
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    /// Why the cores have drawn in place of a device, if that is news.
    pub fn take_trouble(&mut self) -> Option<GpuError> {
        self.trouble.take()
    }

    /// The device that draws, if one does.
    #[must_use]
    pub fn gpu(&self) -> Option<&Gpu> {
        self.device.as_ref().map(|d| d.renderer.gpu())
    }
}

impl OnDevice {
    fn open(wanted: Wanted, scene: &Scene, rasterizer: Option<Rasterizer>) -> Result<Self, GpuError> {
        let mut renderer = Renderer::new(&Gpu::open(wanted)?, scene)?;
        let rasterizer = match rasterizer {
            Some(given) => given,
            None => fastest(&mut renderer, scene)?,
        };
        Ok(Self { wanted, renderer, rasterizer })
    }

    fn reopen(&mut self, scene: &Scene) -> Result<(), GpuError> {
        *self = Self::open(self.wanted, scene, Some(self.rasterizer))?;
        Ok(())
    }

    fn settings(&self, Options { quality, projection }: Options) -> Settings {
        Settings { quality, projection, rasterizer: self.rasterizer, ..Settings::default() }
    }

    fn draw(&mut self, appearance: &Appearance, camera: &Camera, options: Options) -> Result<Rendered, GpuError> {
        let began = Instant::now();
        let settings = self.settings(options);
        let (mut images, drawn) = self.renderer.picture(std::slice::from_ref(camera), appearance, settings)?;
        let report = self.report(&drawn, began);
        match images.pop() {
            Some(image) => Ok(Rendered { image, report }),
            None => Err(GpuError::Views("the device made no picture".to_owned())),
        }
    }

    fn leave(&mut self, appearance: &Appearance, cameras: &[Camera], options: Options) -> Result<(), GpuError> {
        let settings = self.settings(options);
        self.renderer.whole(cameras, appearance, settings).map(drop)
    }

    fn report(&self, drawn: &Drawn, began: Instant) -> Report {
        let PassSeconds { list, project, sort, bin, blend, compose } = drawn.seconds.unwrap_or_default();
        let gaussians = self.renderer.gaussians();
        let dropped_non_finite = self.renderer.dropped_non_finite();
        Report {
            gaussians,
            drawn: drawn.listed as usize,
            dropped_non_finite,
            culled_outside: gaussians - dropped_non_finite - drawn.listed as usize,
            tile_pairs: drawn.tile_pairs.into(),
            seconds: StageSeconds {
                preprocess: list + project,
                sort,
                bin,
                raster: blend + compose,
                total: began.elapsed().as_secs_f64(),
            },
            ..Report::default()
        }
    }
}

/// The rasterizer that draws a scene's first view fastest on this device.
///
/// # Errors
/// [`GpuError`].
pub fn fastest(renderer: &mut Renderer, scene: &Scene) -> Result<Rasterizer, GpuError> {
    if !renderer.blends_quads() {
        return Ok(Rasterizer::Tiles);
    }
    let camera = [framing::default_view(scene, TRIAL_SIZE, TRIAL_SIZE)];
    let look = Appearance::of(scene);
    let mut seconds = |rasterizer| -> Result<f64, GpuError> {
        let settings = Settings { rasterizer, ..Settings::default() };
        let mut newest = f64::INFINITY;
        for _ in 0..TRIALS {
            let began = Instant::now();
            renderer.draw(&camera, &look, settings)?;
            renderer.finish()?;
            newest = began.elapsed().as_secs_f64();
        }
        Ok(newest)
    };
    let mut best = (f64::INFINITY, Rasterizer::Tiles);
    for rasterizer in Rasterizer::ALL {
        let taken = seconds(rasterizer)?;
        if taken < best.0 {
            best = (taken, rasterizer);
        }
    }
    Ok(best.1)
}
