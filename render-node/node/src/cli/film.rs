//! Films: numbered pictures of a turn around a scene and of a camera path, and a video of them.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use sg_input::print;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::camera_path::{CameraPath, framed_turn};
use sg_scene::framing;
use sg_scene::model::Scene;
use sg_scene::view::{FIELD_OF_VIEW, View};
use sg_viewer::video::{self, VIDEO_TIMEOUT};
use sg_volume::Marcher;
use tokio::signal::unix::{SignalKind, signal};

use super::Picture;
use super::failure::Failure;
use super::look::{self, Look, Painter};
use super::print_json;
use super::values::Background;
use super::volume::{self, SeenVolume};

mod film_folder;

use film_folder::{FilmFolder, Frame, picture_name};

/// Width and height of the pictures where no size is given.
const DEFAULT_SIZE: [u32; 2] = [1280, 720];

/// Pictures of each part where no number is given: eight seconds.
const DEFAULT_FRAMES: u32 = 240;

/// Pictures in a second where no rate is given.
const DEFAULT_RATE: u32 = 30;

/// Time for a picture of a video, beyond [`VIDEO_TIMEOUT`] for all.
const PICTURE_TIMEOUT: Duration = Duration::from_secs(1);

/// Period in which the progress of a video is shown.
const PROGRESS_PERIOD: Duration = Duration::from_millis(100);

/// The JSON report.
#[derive(Debug, Serialize)]
struct FilmReport<'a> {
    out: &'a Path,
    pictures: usize,
    width: u32,
    height: u32,
    pictures_per_second: u32,
    /// The video's file; null without one.
    video: Option<PathBuf>,
    backend: String,
    /// Seconds of each picture.
    seconds: Vec<f64>,
}

/// What the pictures show.
enum Source<'a> {
    Gaussians(Box<Painter<'a>>),
    Volume(&'a SeenVolume, Box<Marcher<'a>>),
}

/// Makes the film; a stopped one keeps its finished pictures.
pub(super) fn make(picture: &Picture) -> Result<(), Failure> {
    let Some(out) = &picture.out else { return Err(Failure::input("name the folder of the film with --out")) };
    let folder = FilmFolder::check(out)?;
    let path = picture.camera_path.as_deref().map(CameraPath::read).transpose().map_err(Failure::input)?;
    if path.as_ref().is_some_and(|path| path.poses.len() < 2) && !picture.turntable {
        return Err(Failure::input("a camera path of one pose leads nowhere; add a pose, or --turntable for a turn"));
    }
    let volume = SeenVolume::read(picture)?;
    let marched = volume.as_ref().map(|volume| volume.marcher(&look::clips(picture))).transpose()?;
    let (marcher, scene) = match marched {
        Some((marcher, place)) => (Some(marcher), place),
        None => (None, look::read_scene(picture)?),
    };
    let appearance = look::clipped(picture, &scene);
    let cameras = cameras(picture, path.as_ref(), &scene, &appearance);
    let cameras: Vec<Camera> = cameras.into_iter().map(|camera| look::lit(picture, &scene, camera)).collect();
    cameras.iter().try_for_each(|camera| camera.check("a picture of the film")).map_err(Failure::input)?;
    let Some(first) = cameras.first() else { return Err(Failure::work("the film has no picture")) };
    // The light of a preset is that of the first picture, and stays in the scene.
    let look = Look::new(picture, &scene, first, appearance)?;
    let stopped = watch_interrupts().map_err(Failure::work)?;
    let mut source = match volume.as_ref().zip(marcher) {
        Some((volume, marcher)) => Source::Volume(volume, Box::new(marcher)),
        None => Source::Gaussians(Box::new(Painter::new(picture, scene, &look)?)),
    };
    let (plain, finish) = look.finish(picture);
    let rate = picture.fps.unwrap_or(DEFAULT_RATE);
    let frame = |(k, camera): (u32, &Camera)| Frame { file: picture_name(k), camera: camera.clone() };
    folder.prepare(rate, (0..).zip(&cameras).map(frame).collect())?;
    let began = Instant::now();
    let bar = progress_bar(cameras.len());
    let mut seconds = Vec::with_capacity(cameras.len());
    let mut dropped = 0;
    for (k, camera) in (0..).zip(&cameras) {
        if stopped.load(Ordering::Relaxed) {
            bar.finish_and_clear();
            return Err(Failure::work(format!("stopped: {k} of {} pictures in {}", cameras.len(), out.display())));
        }
        let clock = Instant::now();
        let image = match &mut source {
            Source::Volume(volume, marcher) => volume.draw(marcher, camera),
            Source::Gaussians(painter) => {
                let drawn = painter.draw(camera)?;
                dropped = drawn.report.dropped_non_finite;
                drawn.image
            }
        };
        image.save_finished(&out.join(picture_name(k)), plain, &finish).map_err(Failure::work)?;
        seconds.push(clock.elapsed().as_secs_f64());
        bar.inc(1);
    }
    bar.finish_and_clear();
    look::warn_of_dropped(dropped);
    print::status(&format!(
        "{}: {} pictures of {} x {} pixels, {:.3} s",
        out.display(),
        cameras.len(),
        first.width,
        first.height,
        began.elapsed().as_secs_f64()
    ));
    let video = film(picture, folder.video(), cameras.len(), rate, &stopped);
    if picture.json {
        print_json(&FilmReport {
            out,
            pictures: cameras.len(),
            width: first.width,
            height: first.height,
            pictures_per_second: rate,
            video,
            backend: match &source {
                Source::Volume(..) => volume::BACKEND.to_owned(),
                Source::Gaussians(painter) => painter.engine().name(),
            },
            seconds,
        })?;
    }
    Ok(())
}

/// The cameras of all pictures: a turn, then the path.
fn cameras(picture: &Picture, path: Option<&CameraPath>, scene: &Scene, appearance: &Appearance) -> Vec<Camera> {
    let size @ [width, height] = [picture.width.unwrap_or(DEFAULT_SIZE[0]), picture.height.unwrap_or(DEFAULT_SIZE[1])];
    let count = picture.frames.unwrap_or(DEFAULT_FRAMES);
    let mut cameras = Vec::new();
    if picture.turntable {
        let near = path.and_then(|path| path.near).unwrap_or(0.0);
        let start = path.and_then(|path| path.views().next()).map_or_else(
            || {
                let aspect = f64::from(width) / f64::from(height);
                framed_turn(scene, appearance, framing::default_sight(scene), FIELD_OF_VIEW, aspect)
            },
            |first| about_the_middle(first, scene),
        );
        let turned = |k: u32| start.orbited(360.0 * f64::from(k) / f64::from(count), 0.0);
        cameras.extend((0..count).map(|k| Camera { near, ..turned(k).camera(width, height) }));
    }
    // A single pose is the turn's only.
    if let Some(path) = path.filter(|path| path.poses.len() > 1) {
        cameras.extend(path.frames(size, count));
    }
    cameras
}

/// The same picture with the target of a turn: the point on the view's axis nearest to the scene's middle, if that lies ahead.
fn about_the_middle(view: View, scene: &Scene) -> View {
    let bounds = framing::framed_box(scene);
    let forward = (view.target - view.eye).normalize_or_zero();
    let ahead = (0.5 * (bounds.min + bounds.max) - view.eye).dot(forward);
    if ahead > 0.0 { View { target: view.eye + ahead * forward, ..view } } else { view }
}

/// Makes the video, where it is wanted and can be made; says so if it is not. The pictures stay in any case.
fn film(picture: &Picture, to: PathBuf, pictures: usize, rate: u32, stopped: &AtomicBool) -> Option<PathBuf> {
    if picture.no_video {
        return None;
    }
    if matches!(picture.background, Some(Background::Transparent)) {
        print::status("no video: its pictures would not be transparent");
        return None;
    }
    let Some(program) = video::found(std::env::var_os("PATH").as_deref()) else {
        print::status("no video: ffmpeg is not installed");
        return None;
    };
    let timeout = VIDEO_TIMEOUT + PICTURE_TIMEOUT * u32::try_from(pictures).unwrap_or(u32::MAX);
    let (done, over) = (AtomicU32::new(0), AtomicBool::new(false));
    let bar = progress_bar(pictures);
    bar.set_message("video");
    let from = to.parent().unwrap_or(Path::new("."));
    let made = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !over.load(Ordering::Relaxed) {
                bar.set_position(done.load(Ordering::Relaxed).into());
                std::thread::sleep(PROGRESS_PERIOD);
            }
        });
        let made = video::video(&program, (from, &to), rate, (&done, stopped), timeout);
        over.store(true, Ordering::Relaxed);
        made
    });
    bar.finish_and_clear();
    match made {
        Ok(()) => {
            print::status(&format!("{}: {rate} pictures a second", to.display()));
            Some(to)
        }
        Err(why) => {
            print::status(&format!("warning: no video: {why}"));
            None
        }
    }
}

/// Notes the first interrupt, so that a picture in work is finished. The second one ends the process.
fn watch_interrupts() -> io::Result<Arc<AtomicBool>> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
    let mut interrupts = {
        let _entered = runtime.enter();
        signal(SignalKind::interrupt())?
    };
    let stopped = Arc::new(AtomicBool::new(false));
    let note = Arc::clone(&stopped);
    let watch = move || {
        runtime.block_on(async {
            if interrupts.recv().await.is_some() {
                note.store(true, Ordering::Relaxed);
            }
            if interrupts.recv().await.is_some() {
                std::process::exit(1);
            }
        });
    };
    std::thread::Builder::new().name("interrupts".to_owned()).spawn(watch)?;
    Ok(stopped)
}

/// A progress bar on standard error; it draws only to a terminal.
fn progress_bar(length: usize) -> ProgressBar {
    let bar = ProgressBar::new(length as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg} {eta}") {
        bar.set_style(style);
    }
    bar
}
