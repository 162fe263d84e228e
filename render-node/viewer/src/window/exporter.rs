//! Exports pictures: a single one, or a turn around the scene as numbered files. With `ffmpeg`, a turn also becomes a
//! video. Drawing happens beside the loop at the best quality.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use glam::Vec3;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use super::navigation::Navigator;
use crate::display::LatestWorker;
use crate::video::{self, VIDEO_TIMEOUT};
use sg_raster::finish::Finish;
use sg_raster::image::Image;
use sg_raster::render::{Quality, render};

/// Pictures of one turn: 12 seconds at 30 a second.
const TURN: u32 = 360;

/// Pictures of a turn's video in a second.
const RATE: u32 = 30;

/// Longest edge of a picture of a turn, pixels.
const TURN_EDGE: f64 = 1280.0;

/// A picture or a turn to export.
#[derive(Debug, Clone)]
pub(crate) enum ExportJob {
    /// One picture with this camera and last step.
    Picture(Box<Camera>, Appearance, Finish),
    /// A turn about the target of an eye, of pictures of this shape and last step.
    Turn(Navigator, [u32; 2], Appearance, Finish),
    /// One picture into a folder of the session, on its way to a name that a person has chosen.
    NamedPicture {
        /// The camera.
        camera: Box<Camera>,
        /// What it sees.
        appearance: Appearance,
        /// The last step.
        finish: Finish,
        /// The folder of the session.
        folder: PathBuf,
        /// The chosen name.
        path: PathBuf,
        /// Whether a file of that name is replaced.
        replace: bool,
    },
}

/// A finished export.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum ExportResult {
    /// A line for a person, with the path.
    Saved(String),
    /// A picture that is drawn and has to get its name.
    Drawn {
        /// Its file in the session's folder.
        picture: PathBuf,
        /// The chosen name.
        path: PathBuf,
        /// Whether a file of that name is replaced.
        replace: bool,
    },
}

/// An export of a scene, and whether it is cancelled.
type Work = (Arc<Scene>, ExportJob, Arc<AtomicBool>);

/// Keeps pictures.
#[derive(Debug)]
pub(crate) struct Exporter {
    worker: LatestWorker<Work, Result<ExportResult, String>>,
    /// Whether a turn is queued or under way.
    is_turning: Arc<AtomicBool>,
    /// Finished pictures of the current turn.
    done: Arc<AtomicU32>,
    /// Pictures that are in its video.
    in_video_count: Arc<AtomicU32>,
    /// Of each export that is under way or queued: whether it is cancelled.
    cancelled: Mutex<Vec<Weak<AtomicBool>>>,
}

impl Drop for Exporter {
    fn drop(&mut self) {
        self.cancel();
    }
}

impl Exporter {
    /// A keeper that puts pictures into `folder`, on `pool`.
    pub(crate) fn new(
        folder: PathBuf,
        pool: Arc<rayon::ThreadPool>,
        wake: impl Fn() + Send + 'static,
    ) -> std::io::Result<Self> {
        let done = Arc::new(AtomicU32::new(0));
        let in_video_count = Arc::new(AtomicU32::new(0));
        let is_turning = Arc::new(AtomicBool::new(false));
        let (counted, in_video, turning) = (Arc::clone(&done), Arc::clone(&in_video_count), Arc::clone(&is_turning));
        let work = move |(scene, job, stop): (Arc<Scene>, ExportJob, Arc<AtomicBool>)| {
            let exported = pool.install(|| exported(&scene, &folder, job, (&counted, &stop)));
            let exported = exported.map(|exported| match exported {
                Exported::Picture(path) => ExportResult::Saved(format!("saved {}", path.display())),
                Exported::Drawn { picture, path, replace } => ExportResult::Drawn { picture, path, replace },
                Exported::Turn(turn) => ExportResult::Saved(film(&turn, &pool, (&in_video, &stop))),
                Exported::Cancelled(turn, n) => {
                    ExportResult::Saved(format!("turntable cancelled; {n} pictures are in {}", turn.display()))
                }
            });
            counted.store(0, Ordering::Relaxed);
            in_video.store(0, Ordering::Relaxed);
            turning.store(false, Ordering::Relaxed);
            exported
        };
        let worker = LatestWorker::new("keeps", work, wake)?;
        Ok(Self { worker, is_turning, done, in_video_count, cancelled: Mutex::default() })
    }

    /// Queues an export of pictures of `scene`; it replaces a queued one that has not begun.
    pub(crate) fn export(&self, scene: &Arc<Scene>, job: ExportJob) {
        let stop = Arc::new(AtomicBool::new(false));
        let mut cancelled = self.cancelled.lock().unwrap_or_else(PoisonError::into_inner);
        cancelled.retain(|one| one.strong_count() > 0);
        cancelled.push(Arc::downgrade(&stop));
        if matches!(job, ExportJob::Turn(..)) {
            self.is_turning.store(true, Ordering::Relaxed);
        }
        self.worker.submit((Arc::clone(scene), job, stop));
    }

    /// Cancels all exports. A turn that is being drawn ends with its present picture, a video at once.
    pub(crate) fn cancel(&self) {
        let cancelled = self.cancelled.lock().unwrap_or_else(PoisonError::into_inner);
        for stop in cancelled.iter().filter_map(Weak::upgrade) {
            stop.store(true, Ordering::Relaxed);
        }
    }

    /// Result of the export, or its error as a line for a person; returned once.
    pub(crate) fn take_result(&self) -> Option<Result<ExportResult, String>> {
        self.worker.take()
    }

    /// Progress of a turn or of its video, 0 to 1, and its kind; `None` while idle.
    pub(crate) fn progress(&self) -> Option<(f32, &'static str)> {
        let share = |count: &AtomicU32| (count.load(Ordering::Relaxed) as f32 / TURN as f32).min(1.0);
        match (share(&self.done), share(&self.in_video_count)) {
            (0.0, _) if !self.is_turning.load(Ordering::Relaxed) => None,
            (1.0, in_video_count) => Some((in_video_count, "video")),
            (drawn, _) => Some((drawn, "turntable")),
        }
    }
}

/// The exported files.
enum Exported {
    Picture(PathBuf),
    /// A picture on its way to its name.
    Drawn {
        picture: PathBuf,
        path: PathBuf,
        replace: bool,
    },
    /// The folder of a turn's pictures.
    Turn(PathBuf),
    /// The folder of a cancelled turn, and the number of its pictures.
    Cancelled(PathBuf, u32),
}

/// Makes a video of a turn beside its pictures. The pictures stay even if it fails. Returns a line for a person.
fn film(turn: &Path, pool: &rayon::ThreadPool, watched: (&AtomicU32, &AtomicBool)) -> String {
    let pictures = format!("saved {TURN} pictures in {}", turn.display());
    let Some(program) = video::found(std::env::var_os("PATH").as_deref()) else {
        return format!("{pictures}; no video, since ffmpeg is not installed");
    };
    let to = turn.with_extension("mp4");
    // At the lowest priority, as the threads of the pool are: their children inherit it.
    match pool.install(|| video::video(&program, (turn, &to), RATE, watched, VIDEO_TIMEOUT)) {
        Ok(()) => format!("{pictures}, and the video {}", to.display()),
        Err(why) => format!("{pictures}; no video: {why}"),
    }
}

fn exported(
    scene: &Scene,
    folder: &Path,
    job: ExportJob,
    (counted, stop): (&AtomicU32, &AtomicBool),
) -> Result<Exported, String> {
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    match job {
        ExportJob::Picture(camera, look, finish) => {
            let path = free(folder, "picture", "png");
            write(&picture(scene, &look, &camera)?, &path, look.background, &finish)?;
            Ok(Exported::Picture(path))
        }
        ExportJob::Turn(navigator, [width, height], look, finish) => {
            let turn = free(folder, "turn", "");
            std::fs::create_dir_all(&turn).map_err(|e| format!("{}: {e}", turn.display()))?;
            let scale = (TURN_EDGE / f64::from(width.max(height)).max(1.0)).min(1.0);
            // Video encoders want even edges.
            let even = |edge: u32| (((f64::from(edge) * scale) as u32) & !1).max(2);
            for k in 0..TURN {
                if stop.load(Ordering::Relaxed) {
                    return Ok(Exported::Cancelled(turn, k));
                }
                let view = navigator.view.orbited(360.0 * f64::from(k) / f64::from(TURN), 0.0);
                let camera = navigator.at(view).camera(even(width), even(height));
                let path = turn.join(format!("{k:04}.png"));
                write(&picture(scene, &look, &camera)?, &path, look.background, &finish)?;
                counted.store(k + 1, Ordering::Relaxed);
            }
            Ok(Exported::Turn(turn))
        }
        ExportJob::NamedPicture { camera, appearance, finish, folder, path, replace } => {
            let picture = free(&folder, "named", "png");
            write(&self::picture(scene, &appearance, &camera)?, &picture, appearance.background, &finish)?;
            Ok(Exported::Drawn { picture, path, replace })
        }
    }
}

fn picture(scene: &Scene, look: &Appearance, camera: &Camera) -> Result<Image, String> {
    Ok(render(scene, look, camera, Quality::Standard).map_err(|e| e.to_string())?.image)
}

fn write(image: &Image, path: &Path, background: Vec3, finish: &Finish) -> Result<(), String> {
    let said = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let mut png = Vec::new();
    image.write_finished_png(background, finish, &mut png).map_err(|e| said(&e))?;
    std::fs::write(path, png).map_err(|e| said(&e))
}

/// The first unused name of its kind.
fn free(folder: &Path, kind: &str, extension: &str) -> PathBuf {
    let dot = if extension.is_empty() { "" } else { "." };
    let name = |k: u32| folder.join(format!("supergaussian-{kind}-{k:03}{dot}{extension}"));
    (1..).map(name).find(|path| !path.exists()).unwrap_or_else(|| name(0))
}
