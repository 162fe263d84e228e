//! Draws a window's pictures beside its loop, and finds the frontmost surface in them.

use std::sync::Arc;
use std::time::Instant;

use egui::{Color32, ColorImage};
use glam::{DVec2, Vec3};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::display::{LatestWorker, Level};
use sg_gpu::Gpu;
use sg_gpu::backend::Engine;
use sg_raster::finish::Finish;
use sg_raster::image::Image;
use sg_raster::outline::{OutlineStyle, draw_outlines};
use sg_raster::pick::{FrontIds, Hit, SURFACE, front_ids, hit_of};
use sg_raster::render::{Options, Projection};
use sg_scene::camera_motion::{preview, scaled};

use super::error::WindowError;
use super::shared_texture::SharedTexture;

/// Edge of the picture that ids are found in, over that of the window's.
const FRONT_SCALE: f64 = 0.5;

/// Scheduler niceness of the work beside a window's loop.
const NICE: i32 = 10;

/// A requested picture.
#[derive(Debug, Clone)]
pub(super) struct PictureJob {
    pub(super) scene: Arc<Scene>,
    /// One camera, or two with their pictures side by side.
    pub(super) cameras: Vec<Camera>,
    pub(super) appearance: Appearance,
    pub(super) level: Level,
    pub(super) projection: Projection,
    /// Whether something moves, so that it has to be there soon.
    pub(super) moving: bool,
    /// Super-Gaussian of each Gaussian, where outlines are wanted.
    pub(super) outlines: Option<Arc<[u32]>>,
    /// The device that shows the window, where pictures may stay on it.
    pub(super) shown_by: Option<Gpu>,
    /// The last step of the picture.
    pub(super) finish: Finish,
}

/// Location of a picture.
pub(super) enum Picture {
    /// In memory.
    Pixels(ColorImage),
    /// On the device that was said to show the window.
    OnDevice(Gpu, wgpu::Texture),
}

/// A finished picture.
pub(super) struct DrawnPicture {
    pub(super) picture: Result<Picture, String>,
    /// Size of the window's picture that it stands for, pixels of the screen.
    pub(super) size: [u32; 2],
    pub(super) level: Level,
    pub(super) moving: bool,
    pub(super) seconds: f64,
    /// The renderer, and whether its picture was copied through memory.
    pub(super) engine: String,
    /// The device that draws, if one does.
    pub(super) drawn_by: Option<Gpu>,
}

/// What a front surface is found for.
pub(super) type FrontJob = (Arc<Scene>, Camera, Appearance);

/// The front surface at every pixel of a picture.
#[derive(Debug, Clone)]
pub(super) struct FrontSurface {
    scene: Arc<Scene>,
    /// The window's camera, not that of the ids.
    camera: Camera,
    appearance: Appearance,
    ids: FrontIds,
}

/// Draws wishes with an engine, on `pool`; `wake` after each.
pub(super) fn pictures(
    mut engine: Engine,
    pool: Arc<rayon::ThreadPool>,
    wake: impl Fn() + Send + 'static,
) -> std::io::Result<LatestWorker<PictureJob, DrawnPicture>> {
    let mut shared_texture = None;
    let work = move |job: PictureJob| {
        let began = Instant::now();
        let picture = pool.install(|| draw(&mut engine, &mut shared_texture, &job));
        let size = whole_size(&job.cameras);
        let PictureJob { level, moving, .. } = job;
        let seconds = began.elapsed().as_secs_f64();
        let drawn_by = engine.gpu().cloned();
        let copied = drawn_by.is_some() && matches!(picture, Ok(Picture::Pixels(_)));
        let name = engine.name() + if copied { ", copied" } else { "" };
        DrawnPicture { picture, size, level, moving, seconds, engine: name, drawn_by }
    };
    LatestWorker::new("draws", work, wake)
}

/// Size of pictures beside each other.
fn whole_size(cameras: &[Camera]) -> [u32; 2] {
    let height = cameras.iter().map(|camera| camera.height).min().unwrap_or(0);
    [cameras.iter().map(|camera| camera.width).sum(), height]
}

fn draw(engine: &mut Engine, shared_texture: &mut Option<SharedTexture>, job: &PictureJob) -> Result<Picture, String> {
    engine.show(&job.scene).map_err(|e| e.to_string())?;
    let cameras: Vec<_> = job.cameras.iter().map(|camera| preview(camera, job.level.scale)).collect();
    let options = Options { projection: job.projection, ..job.level.quality.into() };
    let background = job.appearance.background;
    // Outlines are drawn by the cores.
    if let Some(shown_by) = job.shown_by.as_ref().filter(|_| job.outlines.is_none()) {
        let left = engine.leave(&job.appearance, &cameras, options).map_err(|e| e.to_string())?;
        // A reopened device does not present the window yet.
        if let Some((gpu, pictures)) = left.filter(|(gpu, _)| gpu.is(shown_by)) {
            if !shared_texture.as_ref().is_some_and(|h| h.is_on(gpu)) {
                *shared_texture = None;
            }
            let picture =
                shared_texture.get_or_insert_with(|| SharedTexture::new(gpu)).put(pictures, background, &job.finish);
            return Ok(Picture::OnDevice(shown_by.clone(), picture));
        }
    }
    let mut eyes = Vec::with_capacity(cameras.len());
    for camera in &cameras {
        let mut image = engine.draw(&job.appearance, camera, options).map_err(|e| e.to_string())?.image;
        if let Some(labels) = &job.outlines {
            let front = front_ids(engine.scene(), &job.appearance, camera, job.projection, SURFACE);
            let (ids, _) = front.map_err(|e| e.to_string())?;
            draw_outlines(&mut image, &ids, labels, OutlineStyle::default()).map_err(|e| e.to_string())?;
        }
        eyes.push(image);
    }
    Ok(Picture::Pixels(side_by_side(&eyes, background, &job.finish)))
}

/// Pictures of one height beside each other, with their last step.
fn side_by_side(images: &[Image], background: Vec3, finish: &Finish) -> ColorImage {
    let height = images.iter().map(|i| i.height).min().unwrap_or(0) as usize;
    let width: usize = images.iter().map(|i| i.width as usize).sum();
    let bytes: Vec<Vec<u8>> = images.iter().map(|image| image.finished_rgb8(background, finish)).collect();
    let mut pixels = Vec::with_capacity(width * height);
    for y in 0..height {
        for (image, bytes) in images.iter().zip(&bytes) {
            let row = 3 * image.width as usize;
            let line = bytes.get(y * row..(y + 1) * row).unwrap_or_default();
            pixels.extend(line.chunks_exact(3).map(|p| Color32::from_rgb(p[0], p[1], p[2])));
        }
    }
    ColorImage::new([width, height], pixels)
}

/// Finds the front surface for scenes, cameras and appearances on `pool`; calls `wake` after each.
pub(super) fn fronts(
    pool: Arc<rayon::ThreadPool>,
    wake: impl Fn() + Send + 'static,
) -> std::io::Result<LatestWorker<FrontJob, Option<FrontSurface>>> {
    let work = move |(scene, camera, appearance): FrontJob| {
        let small = scaled(&camera, FRONT_SCALE);
        let found = pool.install(|| front_ids(&scene, &appearance, &small, Projection::Affine, SURFACE));
        // A picture that cannot be drawn says so itself.
        found.ok().map(|(ids, _)| FrontSurface { scene, camera, appearance, ids })
    };
    LatestWorker::new("finds-front", work, wake)
}

impl FrontSurface {
    /// Whether it is that of this camera.
    pub(super) fn is_of(&self, camera: &Camera) -> bool {
        self.camera == *camera
    }

    /// The front Gaussian of each pixel of a smaller picture.
    pub(super) fn ids(&self) -> &FrontIds {
        &self.ids
    }

    /// The front surface at a pixel of the window's picture.
    pub(super) fn at(&self, at: DVec2) -> Option<Hit> {
        let scale = DVec2::new(
            f64::from(self.ids.width) / f64::from(self.camera.width),
            f64::from(self.ids.height) / f64::from(self.camera.height),
        );
        let place = at * scale;
        if place.min_element() < 0.0 {
            return None;
        }
        let id = self.ids.at(place.x as u32, place.y as u32)?;
        hit_of(&self.scene, &self.appearance, &self.camera, id, at)
    }
}

/// Lowers the priority of this thread, and of the threads that it will start.
fn lower_priority() {
    if let Err(error) = rustix::process::setpriority_process(None, NICE) {
        tracing::warn!(%error, "drawing goes at the priority of everything else");
    }
}

/// Drawing threads, one per core, at a low priority. A person's input needs only microseconds of another process, and must not wait
/// for a picture.
///
/// # Errors
/// The system's error if it cannot start threads.
pub fn threads() -> Result<Arc<rayon::ThreadPool>, rayon::ThreadPoolBuildError> {
    let lowered = |_| lower_priority();
    let builder = rayon::ThreadPoolBuilder::new().thread_name(|k| format!("draws-{k}")).start_handler(lowered);
    builder.build().map(Arc::new)
}

/// Does something on a thread of the drawing threads' priority. A driver that draws on the cores starts its own threads when a device
/// is opened, and they inherit it.
///
/// # Errors
/// [`WindowError::Threads`] if the system cannot start a thread.
pub fn at_low_priority<T: Send>(work: impl FnOnce() -> T + Send) -> Result<T, WindowError> {
    std::thread::scope(|scope| {
        let lowered = || {
            lower_priority();
            work()
        };
        let thread = std::thread::Builder::new().name("opens".to_owned()).spawn_scoped(scope, lowered);
        let thread = thread.map_err(|e| WindowError::Threads(e.to_string()))?;
        thread.join().map_or_else(|panic| std::panic::resume_unwind(panic), Ok)
    })
}
