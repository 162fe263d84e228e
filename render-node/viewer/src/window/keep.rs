//! Pictures that a person keeps: one, or a turn around the scene as numbered files, and a video of these where `ffmpeg` is
//! there. Drawn beside the loop at the best quality.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;
use sg_scene::view::View;

use super::ffmpeg::{self, PATIENCE, video};
use crate::display::Beside;
use sg_raster::image::Image;
use sg_raster::render::{Quality, render};

/// Pictures of one turn: 12 seconds at 30 a second.
const TURN: u32 = 360;

/// Longest edge of a picture of a turn, pixels.
const TURN_EDGE: f64 = 1280.0;

/// What is to be kept.
#[derive(Debug, Clone)]
pub(super) enum Keep {
    /// One picture with this camera.
    Picture(Box<Camera>, Appearance),
    /// A turn about a view's target, of pictures of this shape.
    Turn(View, [u32; 2], Appearance),
}

/// Keeps pictures.
#[derive(Debug)]
pub(super) struct Keeper {
    keeps: Beside<Keep, Result<String, String>>,
    /// Pictures of the turn that is being drawn that are there, and how many there will be.
    done: Arc<AtomicU32>,
    /// Pictures that are in its video.
    filmed: Arc<AtomicU32>,
    /// Whether nobody waits for pictures any more.
    over: Arc<AtomicBool>,
}

impl Drop for Keeper {
    fn drop(&mut self) {
        // A turn that is being drawn ends with its present picture, a video at once.
        self.over.store(true, Ordering::Relaxed);
    }
}

impl Keeper {
    /// A keeper that puts pictures of `scene` into `folder`, on `pool`.
    pub(super) fn new(
        scene: Arc<Scene>,
        folder: PathBuf,
        pool: Arc<rayon::ThreadPool>,
        told: impl Fn() + Send + 'static,
    ) -> std::io::Result<Self> {
        let done = Arc::new(AtomicU32::new(0));
        let over = Arc::new(AtomicBool::new(false));
        let filmed = Arc::new(AtomicU32::new(0));
        let (counted, in_video, stop) = (Arc::clone(&done), Arc::clone(&filmed), Arc::clone(&over));
        let work = move |keep| {
            let kept = pool.install(|| kept(&scene, &folder, keep, (&counted, &stop)));
            let kept = kept.map(|kept| match kept {
                Kept::Picture(path) => format!("kept {}", path.display()),
                Kept::Turn(turn) => film(&turn, &pool, (&in_video, &stop)),
            });
            counted.store(0, Ordering::Relaxed);
            in_video.store(0, Ordering::Relaxed);
            kept
        };
        Ok(Self { keeps: Beside::new("keeps", work, told)?, done, filmed, over })
    }

    /// Has something kept, in place of what has been asked for and not been begun.
    pub(super) fn keep(&self, keep: Keep) {
        self.keeps.want(keep);
    }

    /// What was kept and where, or why not: a line for a person, once.
    pub(super) fn news(&self) -> Option<Result<String, String>> {
        self.keeps.take()
    }

    /// How much of a turn, or of its video, is there, 0 to 1, and which of them; `None` while none is made.
    pub(super) fn progress(&self) -> Option<(f32, &'static str)> {
        let share = |count: &AtomicU32| (count.load(Ordering::Relaxed) as f32 / TURN as f32).min(1.0);
        match (share(&self.done), share(&self.filmed)) {
            (0.0, _) => None,
            (1.0, filmed) => Some((filmed, "video")),
            (drawn, _) => Some((drawn, "turntable")),
        }
    }
}

/// What is there.
enum Kept {
    Picture(PathBuf),
    /// The folder of a turn's pictures.
    Turn(PathBuf),
}

/// Makes a video of a turn beside its pictures, which stay whatever comes of it. A line for a person.
fn film(turn: &Path, pool: &rayon::ThreadPool, watched: (&AtomicU32, &AtomicBool)) -> String {
    let pictures = format!("kept {TURN} pictures in {}", turn.display());
    let Some(program) = ffmpeg::found(std::env::var_os("PATH").as_deref()) else {
        return format!("{pictures}; no video, since ffmpeg is not installed");
    };
    let to = turn.with_extension("mp4");
    // Behind everything else, as the threads of the pool are: what they start takes after them.
    match pool.install(|| video(&program, (turn, &to), watched, PATIENCE)) {
        Ok(()) => format!("{pictures}, and the video {}", to.display()),
        Err(why) => format!("{pictures}; no video: {why}"),
    }
}

fn kept(scene: &Scene, folder: &Path, keep: Keep, (counted, stop): (&AtomicU32, &AtomicBool)) -> Result<Kept, String> {
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    match keep {
        Keep::Picture(camera, look) => {
            let path = free(folder, "picture", "png");
            write(&picture(scene, &look, &camera)?, &path)?;
            Ok(Kept::Picture(path))
        }
        Keep::Turn(view, [width, height], look) => {
            let turn = free(folder, "turn", "");
            std::fs::create_dir_all(&turn).map_err(|e| format!("{}: {e}", turn.display()))?;
            let scale = (TURN_EDGE / f64::from(width.max(height)).max(1.0)).min(1.0);
            // Video encoders want even edges.
            let even = |edge: u32| (((f64::from(edge) * scale) as u32) & !1).max(2);
            for k in 0..TURN {
                if stop.load(Ordering::Relaxed) {
                    return Err(format!("the window was closed after {k} pictures in {}", turn.display()));
                }
                let camera =
                    view.orbited(360.0 * f64::from(k) / f64::from(TURN), 0.0).camera(even(width), even(height));
                write(&picture(scene, &look, &camera)?, &turn.join(format!("{k:04}.png")))?;
                counted.store(k + 1, Ordering::Relaxed);
            }
            Ok(Kept::Turn(turn))
        }
    }
}

fn picture(scene: &Scene, look: &Appearance, camera: &Camera) -> Result<Image, String> {
    Ok(render(scene, look, camera, Quality::Standard).map_err(|e| e.to_string())?.image)
}

fn write(image: &Image, path: &Path) -> Result<(), String> {
    let said = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let mut png = Vec::new();
    image.write_png(&mut png).map_err(|e| said(&e))?;
    std::fs::write(path, png).map_err(|e| said(&e))
}

/// The first name of its kind that nothing has.
fn free(folder: &Path, kind: &str, extension: &str) -> PathBuf {
    let dot = if extension.is_empty() { "" } else { "." };
    let name = |k: u32| folder.join(format!("supergaussian-{kind}-{k:03}{dot}{extension}"));
    (1..).map(name).find(|path| !path.exists()).unwrap_or_else(|| name(0))
}
