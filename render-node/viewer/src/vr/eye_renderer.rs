//! Both eyes' pictures of the scene.

use std::collections::VecDeque;
use std::time::Instant;

use glam::{DVec3, Vec2};
use sg_scene::appearance::Appearance;
use sg_scene::camera::{Camera, Light};
use sg_scene::camera_motion::previewing;
use sg_scene::model::Scene;

use super::meshes;
use crate::display::quality_control::{LEVELS, drawn_at};
use crate::display::{Level, PictureCost, QualityControl, Tools};
use crate::hands::{Eye, Fov, Placement, Pose};
use crate::xr::{Frame, Headset, XrError};
use sg_gpu::{
    Candidate, DepthLayer, FrameStats, Gpu, GpuError, MeshEye, MeshLayer, Options, PlacedMesh, Present, Rasterizer,
    Renderer, Settings, Trial, Vignette, WorkTimer,
};
use sg_raster::render::{Projection, Quality};

/// Most pictures that wait for their measurement.
const MEASURED: usize = 16;

/// What a person sees of a scene: the two eyes of a frame, and the place of the scene.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight {
    pub(super) eyes: [Eye; 2],
    /// Between them.
    pub(super) head: Pose,
    pub(super) placement: Placement,
    /// Seconds from one frame to the next.
    pub(super) period: f64,
}

impl Sight {
    /// Cameras of both eyes for pictures of `size` pixels. Gaussians fade within `near` metres of the room.
    fn cameras(&self, size: [u32; 2], near: f64, background: [f32; 3], light: Light) -> [Camera; 2] {
        self.eyes.map(|eye| eye.camera(size, &self.placement, near, background, light))
    }
}

/// The room around the scene, in a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Around<'a> {
    pub(super) meshes: &'a [PlacedMesh],
    /// The scene's middle in the room.
    pub(super) middle: DVec3,
}

/// A submitted picture.
#[derive(Debug, Clone, Copy)]
struct Submitted {
    number: u64,
    time: f64,
    level: usize,
}

/// Renderer of both eyes on the device of one session.
pub(super) struct EyeRenderer {
    renderer: Renderer,
    present: Present,
    vignette: Vignette,
    meshes: MeshLayer,
    /// Depth layer, if the runtime takes depths.
    depths: Option<DepthLayer>,
    size: [u32; 2],
    trial: Trial,
    /// Whether the renderer's buffers and textures are made.
    is_prepared: bool,
    /// Whether pictures with ambient occlusion need nothing new.
    can_occlude: bool,
    /// Whether the newest picture has ambient occlusion.
    pub(super) is_occluded: bool,
    /// Rasterizer of the affine projection.
    rasterizer: Rasterizer,
    control: QualityControl,
    /// On a device without timestamps.
    timer: Option<WorkTimer>,
    begun: Instant,
    submitted: VecDeque<Submitted>,
    /// Newest measured picture.
    measured: u64,
    /// Pictures with their device seconds, and those that grow with pixels, since [`Self::new_costs`]. At most [`MEASURED`].
    costs: Vec<(u64, f64, Option<f64>)>,
    /// Level of the newest picture.
    drawn_at: usize,
    /// How the newest one was drawn.
    pub(super) level: Level,
    /// Width and height of the newest one.
    part: [u32; 2],
    pub(super) pictures: u64,
    /// Version of the newest hidden mesh, and the fields of view it belongs to.
    hides: Option<(u64, [Fov; 2])>,
    /// The newest hidden mesh in the pictures, until the renderer has it.
    hidden: Option<[Vec<[Vec2; 3]>; 2]>,
}

impl EyeRenderer {
    /// Draws the same Gaussians from now on, some of them elsewhere. The upload waits for the device: a frame or two are late.
    pub(super) fn show(&mut self, scene: &Scene) -> Result<bool, GpuError> {
        self.renderer.show(scene)
    }

    /// Uploads a scene to the headset's device; `None` while the runtime is away. A trial follows, see [`Self::prepare`].
    ///
    /// `given` is the rasterizer of the launch file. A software device has no trial: it would take minutes, and
    /// quadrilaterals are the fastest there.
    pub(super) fn new(headset: &Headset, scene: &Scene, given: Option<Rasterizer>) -> Result<Option<Self>, GpuError> {
        let (Some(gpu), Some(format), Some(size)) = (headset.gpu(), headset.format(), headset.size()) else {
            return Ok(None);
        };
        // The display has eight bits.
        let options = Options { half_pictures: true, ..Options::default() };
        let renderer = Renderer::with_options(gpu, scene, options)?;
        if let Some(rasterizer) = given.filter(|r| *r != Rasterizer::Tiles && !renderer.blends_quads()) {
            tracing::warn!("{} cannot blend in f32, so tiles draw instead of {rasterizer:?}", gpu.name());
        }
        let fixed = given.or_else(|| gpu.is_software().then_some(Rasterizer::Quads));
        let projections: &[Projection] =
            if gpu.is_software() { &[] } else { &[Projection::Affine, Projection::PerRay] };
        let trial = Trial::new(&renderer, projections, fixed);
        let usable = |r: &Rasterizer| *r == Rasterizer::Tiles || renderer.blends_quads();
        let timer = if renderer.has_timestamps() {
            None
        } else {
            let timer = WorkTimer::new(gpu);
            timer.inspect_err(|e| tracing::warn!("no thread to time pictures, so the quality stays: {e}")).ok()
        };
        Ok(Some(Self {
            present: Present::dithered(gpu, format),
            vignette: Vignette::new(gpu, format),
            meshes: MeshLayer::new(gpu, format, headset.depth_format(), size, &meshes::all()),
            depths: headset.depth_format().map(|format| DepthLayer::new(gpu, format)),
            size,
            trial,
            is_prepared: false,
            can_occlude: false,
            is_occluded: false,
            rasterizer: fixed.filter(usable).unwrap_or_default(),
            control: QualityControl::default(),
            timer,
            begun: Instant::now(),
            submitted: VecDeque::with_capacity(MEASURED),
            measured: 0,
            costs: Vec::with_capacity(MEASURED),
            drawn_at: 0,
            level: drawn_at(0, Quality::Standard),
            part: size,
            pictures: 0,
            hides: None,
            hidden: None,
            renderer,
        }))
    }

    /// Whether pictures can be drawn: the trial is over.
    pub(super) fn is_ready(&self) -> bool {
        self.trial.is_over() && self.is_prepared
    }

    /// Whether pictures with ambient occlusion create nothing in a frame: everything they need was made between frames.
    pub(super) fn can_occlude(&self) -> bool {
        self.can_occlude
    }

    fn settings(&self, tools: &Tools) -> Settings {
        Settings {
            quality: tools.quality,
            rasterizer: self.rasterizer,
            projection: tools.projection,
            foveation: tools.foveation,
            // Hands, panels and the floor are compared with them.
            depths: true,
            ..Settings::default()
        }
    }

    /// Between two frames: makes what the next pictures need, see [`Renderer::prepare`]. Before that, it makes one step of the
    /// trial: it draws one picture of a `look` at what the person sees, of both eyes at the whole size, and waits for it.
    /// Its caller holds the [`Headset`], which no frame does.
    pub(super) fn prepare(
        &mut self,
        sight: &Sight,
        tools: &Tools,
        look: impl FnOnce() -> Appearance,
    ) -> Result<(), GpuError> {
        let settings = self.settings(tools);
        if let Some([left, right]) = self.hidden.take() {
            self.renderer.hide([&left, &right]);
        }
        if self.trial.is_over() {
            let cameras = sight.cameras(self.size, tools.room_near, [0.0; 3], Light::default());
            // By ray, the buffers depend on the quality.
            let quality = if self.pictures > 0 { self.level.quality } else { settings.quality };
            if tools.occlusion {
                self.renderer.expect_occlusion();
            }
            let is_complete = self.renderer.prepare(&cameras, Settings { quality, ..settings })?;
            self.can_occlude |= is_complete && tools.occlusion;
            self.is_prepared = true;
            return Ok(());
        }
        let look = look();
        let cameras = sight.cameras(self.size, tools.room_near, look.background.to_array(), look.light);
        if !self.trial.step(&mut self.renderer, &cameras, &look, settings)? {
            return Ok(());
        }
        for Candidate { projection, rasterizer, seconds, .. } in self.trial.candidates() {
            tracing::info!("trial: {projection:?} with {rasterizer:?} takes {:.2} ms for both eyes", 1e3 * seconds);
        }
        if let Some(best) = self.trial.preferred(Projection::Affine) {
            self.rasterizer = best.rasterizer;
        }
        if let Some(Candidate { seconds, pixel_seconds, .. }) = self.trial.preferred(tools.projection) {
            let period = sight.period;
            self.control =
                QualityControl::starting_from(PictureCost { time: 0.0, level: 0, seconds, pixel_seconds, period });
        }
        Ok(())
    }

    /// Skips drawing behind the lenses' hidden areas, from the next [`Self::prepare`] on. On a software device the test of
    /// quadrilaterals costs more than most lenses save.
    fn hide(&mut self, frame: &Frame<'_>) {
        if frame.gpu().is_software() && self.rasterizer != Rasterizer::Tiles {
            return;
        }
        let fovs = frame.eyes.map(|eye| eye.fov);
        let (version, eyes) = frame.hidden();
        if self.hides.replace((version, fovs)) == Some((version, fovs)) {
            return;
        }
        self.hidden = Some([0, 1].map(|k| {
            let in_picture = |corner| fovs[k].in_picture(corner).as_vec2();
            eyes[k].iter().map(|triangle| triangle.map(in_picture)).collect()
        }));
    }

    /// The left eye's newest picture, and the width and height of its drawn part.
    pub(super) fn left(&self) -> Option<(&wgpu::Texture, [u32; 2])> {
        self.renderer.pictures().first().map(|picture| (picture, self.part))
    }

    pub(super) fn late(&self) -> u64 {
        self.control.late()
    }

    /// Number of the present level.
    pub(super) fn level_number(&self) -> usize {
        self.control.level()
    }

    /// Number and level of the newest picture.
    pub(super) fn newest(&self) -> (u64, usize) {
        (self.renderer.drawn(), self.drawn_at)
    }

    /// Pictures with their device seconds, and those that grow with pixels, measured since the last call.
    pub(super) fn new_costs(&mut self) -> impl Iterator<Item = (u64, f64, Option<f64>)> {
        self.costs.drain(..)
    }

    /// The session was hidden or paused: what was measured says nothing any more.
    pub(super) fn interrupt(&mut self) {
        self.control.interrupt();
        self.submitted.clear();
    }

    /// Takes in the costs of finished pictures.
    fn take_costs(&mut self, period: f64) -> Result<(), GpuError> {
        let FrameStats { picture, device_seconds, seconds, .. } = self.renderer.measured()?;
        if picture > self.measured
            && let Some(spent) = device_seconds
        {
            self.measured = picture;
            let share = seconds.and_then(|s| s.pixel_share());
            self.take_cost(picture, spent, share, period);
        }
        while let Some((picture, spent)) = self.timer.as_ref().and_then(WorkTimer::take) {
            self.take_cost(picture, spent, None, period);
        }
        Ok(())
    }

    fn take_cost(&mut self, picture: u64, seconds: f64, share: Option<f64>, period: f64) {
        while self.submitted.front().is_some_and(|s| s.number < picture) {
            self.submitted.pop_front();
        }
        let Some(Submitted { time, level, .. }) = self.submitted.front().filter(|s| s.number == picture).copied()
        else {
            return;
        };
        let pixel_seconds = share.map(|share| share * seconds);
        if self.costs.len() < MEASURED {
            self.costs.push((picture, seconds, pixel_seconds));
        }
        self.control.measure(PictureCost { time, level, seconds, pixel_seconds, period });
    }

    /// Draws a look of the placed scene, with the edges of the view `darkened` by 0 to 1, at the `held` level if there is
    /// one. A view that moves is drawn with the cut-offs of motion, unless a level is held.
    pub(super) fn draw(
        &mut self,
        frame: &mut Frame<'_>,
        placement: &Placement,
        look: &Appearance,
        (tools, darkened, in_motion): (&Tools, f64, bool),
        around: Around<'_>,
        held: Option<usize>,
    ) -> Result<Result<(), GpuError>, XrError> {
        if let Err(error) = self.take_costs(frame.period) {
            return Ok(Err(error));
        }
        if !frame.is_focused() {
            // The runtime's own menu draws beside the scene.
            self.interrupt();
        }
        let number = held.map_or(self.control.level(), |level| level.min(LEVELS - 1));
        self.level = drawn_at(number, tools.quality);
        self.drawn_at = number;
        self.hide(frame);
        let edge = |pixels: u32| ((f64::from(pixels) * self.level.scale).round() as u32).clamp(16.min(pixels), pixels);
        let part = frame.size().map(edge);
        let sight = Sight { eyes: frame.eyes, head: frame.head, placement: *placement, period: frame.period };
        // Where the surroundings are seen, they are the background.
        let reveals = frame.blend_mode().shows_surroundings();
        let background = if reveals { [0.0; 3] } else { look.background.to_array() };
        let whole = frame.size();
        let cameras = sight.cameras(part, tools.room_near, background, look.light);
        let cameras = cameras.map(|camera| previewing(whole, &camera));
        let in_motion = in_motion && held.is_none();
        let settings = Settings { quality: self.level.quality, in_motion, ..self.settings(tools) };
        let time = self.begun.elapsed().as_secs_f64();
        if let Err(error) = self.renderer.draw(&cameras, look, settings) {
            return Ok(Err(error));
        }
        let picture = self.renderer.drawn();
        if self.submitted.len() == MEASURED {
            self.submitted.pop_front();
        }
        self.submitted.push_back(Submitted { number: picture, time, level: number });
        self.part = part;
        self.pictures += 1;
        self.is_occluded = look.occlusion.is_some();
        let depth_part = self.renderer.depth_size(part, settings);
        let gpu: Gpu = frame.gpu().clone();
        let room = Sight { placement: Placement::IDENTITY, ..sight };
        let room_cameras = room.cameras(part, tools.room_near, background, Light::default());
        let Self { renderer, present, vignette, depths, meshes, .. } = self;
        frame.draw_eyes_and_depths(part, |targets, depth_targets| {
            let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            for (eye, (picture, target)) in renderer.pictures().iter().zip(targets).enumerate() {
                let load = wgpu::LoadOp::Clear(wgpu::Color::BLACK);
                present.encode_part(&mut encoder, (picture, part), target, [0, 0, part[0], part[1]], load);
                let seen = mesh_eye(renderer, &room_cameras, eye, (depth_part, placement.scale, around, reveals));
                if let Some(seen) = &seen {
                    meshes.encode(&mut encoder, target, seen, around.meshes);
                }
                if let Some(camera) = cameras.get(eye) {
                    vignette.encode(&mut encoder, target, camera, eye == 1, darkened);
                }
            }
            if let Some(layer) = depths {
                for (eye, (picture, target)) in renderer.depths().iter().zip(depth_targets).enumerate() {
                    layer.encode(&mut encoder, (picture, depth_part), (target, part), placement.scale);
                    let seen = mesh_eye(renderer, &room_cameras, eye, (depth_part, placement.scale, around, reveals));
                    if let Some(seen) = &seen {
                        meshes.encode_depths(&mut encoder, target, seen, around.meshes);
                    }
                }
            }
            gpu.submit([encoder.finish()]);
        })?;
        if let Some(timer) = &self.timer {
            timer.begin(picture);
        }
        Ok(Ok(()))
    }
}

/// What the meshes of an eye (0 left, 1 right) are drawn over.
fn mesh_eye<'a>(
    renderer: &'a Renderer,
    cameras: &'a [Camera; 2],
    eye: usize,
    (depth_part, scale, around, reveals): ([u32; 2], f64, Around<'_>, bool),
) -> Option<MeshEye<'a>> {
    Some(MeshEye {
        camera: cameras.get(eye)?,
        right: eye == 1,
        picture: renderer.pictures().get(eye)?,
        depths: (renderer.depths().get(eye)?, depth_part),
        scale,
        middle: around.middle,
        reveals,
    })
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    #[test]
    fn both_eyes_fade_gaussians_within_the_set_metres_of_the_room() {
        let fov = Fov { left: -0.8, right: 0.8, up: 0.7, down: -0.7 };
        let eye = |x: f64| Eye { pose: Pose { position: DVec3::new(x, 1.6, 0.0), ..Pose::IDENTITY }, fov };
        let placement = Placement { scale: 0.25, rotation: DQuat::IDENTITY, translation: DVec3::new(0.0, 1.2, -0.8) };
        let sight = Sight { eyes: [eye(-0.03), eye(0.03)], head: Pose::IDENTITY, placement, period: 1.0 / 90.0 };
        for near in [0.01, Tools::default().room_near, 0.5] {
            let cameras = sight.cameras([64, 48], near, [0.0; 3], Light::default());
            // Four units of the scene are a metre of the room.
            assert!(cameras.iter().all(|camera| (camera.near - 4.0 * near).abs() < 1e-12), "{near}: {cameras:?}");
        }
    }
}
