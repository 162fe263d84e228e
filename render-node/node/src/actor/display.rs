//! An interactive view: the display's loop on a thread of its own, and its services beside it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use directories::UserDirs;
use sg_edit::Replica;
use sg_gpu::backend::Engine;
use sg_proto::keys;
use sg_proto::render::State;
#[cfg(feature = "xr")]
use sg_raster::foveation::Foveation;
use sg_raster::render::Quality;
use sg_runtime::bus::RetainedValue;
use sg_runtime::context::Context;
use sg_runtime::process::{Host, StartError};
use sg_runtime::scene_replica::SceneReplica;
use sg_scene::model::Scene;
use sg_viewer::display::{Backend, StateWriter, Tools, ViewPort, ViewState};
#[cfg(feature = "xr")]
use sg_viewer::hands::Stance;
use sg_viewer::vr::{self, VrView};
use sg_viewer::window::{self, Settings, Setup};
use sg_viewer::xr::{Headset, Options, XrError};
use tokio::sync::oneshot;

use super::params::{Display, Params};
use super::watchdog::{BlockedCall, LoopWatchdog};
use super::{request_executor, state_sync};

/// Timeout for opening a window: a software device compiles its shaders.
const OPEN_TIMEOUT: Duration = Duration::from_secs(60);

/// Timeout for closing a display.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(2);

/// Period of the display's state reports.
const REPORT_PERIOD: Duration = Duration::from_secs(1);

/// Search time for a headset that an earlier process of this stack had, before a window replaces it.
#[cfg(feature = "xr")]
const HEADSET_RETRY_TIME: Duration = Duration::from_secs(20);

/// File in the session's folder; it marks a stack that has had a headset.
#[cfg(feature = "xr")]
const HEADSET_MARKER: &str = "headset";

/// Opens a headset or a window over the scene. Serves it until it is closed; then the process ends.
///
/// # Errors
/// An error if no display opens on this machine, or if the bus fails.
pub(super) async fn open(
    host: &Host,
    scene: Arc<Scene>,
    replica: SceneReplica<Replica>,
    params: &Params,
) -> Result<(), StartError> {
    let first = ViewState::of(Arc::clone(replica.newest().replica.state()));
    let state_message =
        State { gaussians: scene.len() as u64, display: params.display.name().to_owned(), ..State::default() };
    let owned = host.bus().retain(&keys::VIEW_STATE, state_message.clone()).await?;
    let (view_port, service) = ViewPort::new(first);
    let Backend { writer, requests } = service;
    let (opened_sender, opened_receiver) = oneshot::channel();
    let run_dir = host.run_dir().to_owned();
    let scratch = host.blobs().folder().to_owned();
    let setup = DisplaySetup { scene, view_port, params: params.clone(), run_dir, scratch, opened_sender };
    let (ended, thread) = run(host.clone(), setup, &writer)?;
    let OpenDisplay { display, blocked_call } = tokio::select! {
        opened = opened_receiver => match opened {
            Ok(opened) => opened,
            Err(_) => return Err(open_error(ended.await)),
        },
        () = tokio::time::sleep(OPEN_TIMEOUT) => {
            return Err(StartError::Failed(format!("nothing was there to look at within {} s", OPEN_TIMEOUT.as_secs())));
        }
    };
    drop(ended);
    let state_message = State { display: display.name().to_owned(), ..state_message };
    state_sync::follow(host, &replica, &writer).await?;
    request_executor::run(host.bus().clone(), requests, writer.clone())
        .map_err(|e| StartError::Failed(format!("no thread for what is asked for: {e}")))?;
    let turns = writer.clone();
    host.watch_loop("display", move || turns.silent_for());
    let loop_watchdog = LoopWatchdog::new(blocked_call, Duration::from_secs_f64(params.patience));
    tokio::spawn(tell(host.clone(), owned, state_message, CloseOnDrop { writer, thread }, loop_watchdog));
    Ok(())
}

/// Input of the display's thread.
struct DisplaySetup {
    scene: Arc<Scene>,
    view_port: ViewPort,
    params: Params,
    /// Folder of the session.
    run_dir: PathBuf,
    /// Folder of this process for pictures.
    scratch: PathBuf,
    /// Receives the opened display.
    opened_sender: oneshot::Sender<OpenDisplay>,
}

/// An open display.
struct OpenDisplay {
    display: Display,
    blocked_call: BlockedCall,
}

/// Starts the display's thread. The receiver gets the error if the display did not open, as long as it listens.
fn run(
    host: Host,
    setup: DisplaySetup,
    writer: &StateWriter,
) -> Result<(oneshot::Receiver<Option<StartError>>, JoinHandle<()>), StartError> {
    let (ending, ended) = oneshot::channel();
    let writer = writer.clone();
    let body = move || {
        let _broken = PanicGuard(host.clone());
        let outcome = run_display(setup, &writer).err();
        // If opening fails, the receiver ends the process with an error. After opening there is no receiver.
        match ending.send(outcome) {
            Ok(()) => (),
            Err(None) => {
                tracing::info!("the display was closed");
                host.stop();
            }
            Err(Some(error)) => host.fail(format!("the display: {error}")),
        }
    };
    let thread = std::thread::Builder::new().name("display".to_owned()).spawn(body);
    let thread = thread.map_err(|e| StartError::Failed(format!("no thread for the display: {e}")))?;
    Ok((ended, thread))
}

/// Ends the process with an error if the display's thread panics: without it, the process has no purpose.
struct PanicGuard(Host);

impl Drop for PanicGuard {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.fail("the display broke off; what it said stands before this".to_owned());
        }
    }
}

/// Serves the headset, or a window if requested or without a headset.
fn run_display(setup: DisplaySetup, writer: &StateWriter) -> Result<(), StartError> {
    if setup.params.display == Display::Headset {
        match open_headset(&setup)? {
            Ok(headset) => return run_headset(setup, headset),
            Err(why) => {
                tracing::warn!("the window takes the headset's place: {why}");
                writer.notice(why, false);
            }
        }
    }
    run_window(setup)
}

/// The headset, if there is one; else why not. A headset that an earlier process of this stack has had is waited for.
#[cfg(feature = "xr")]
fn open_headset(setup: &DisplaySetup) -> Result<Result<Headset, String>, StartError> {
    let params = &setup.params;
    let stance = if params.seated { Stance::Seated } else { Stance::Standing };
    let blend_mode = params.blend_mode;
    let options = Options { resolution: params.resolution, stance, blend_mode, ..Options::default() };
    let stack = std::os::unix::process::parent_id().to_string();
    let marker = setup.run_dir.join(HEADSET_MARKER);
    let had_headset =
        sg_input::file::read_text(&marker, sg_input::limits::SMALL_TEXT_BYTES).is_ok_and(|said| said == stack);
    let begun = Instant::now();
    loop {
        match Headset::open(options) {
            Ok(headset) => {
                if let Err(error) = std::fs::write(&marker, &stack) {
                    tracing::warn!(
                        "{}: {error}; should this process end, the next one will not wait for the headset",
                        marker.display()
                    );
                }
                return Ok(Ok(headset));
            }
            // The runtime is still there and may recover: the next process tries again.
            Err(error @ XrError::Silent { .. }) if had_headset => return Err(StartError::Failed(error.to_string())),
            Err(error) if !had_headset || begun.elapsed() > HEADSET_RETRY_TIME => return Ok(Err(error.to_string())),
            Err(_) => std::thread::sleep(options.retry_pause),
        }
    }
}

/// Serves a person in the room with the scene until they leave.
#[cfg(feature = "xr")]
fn run_headset(setup: DisplaySetup, mut headset: Headset) -> Result<(), StartError> {
    let DisplaySetup { scene, mut view_port, params, opened_sender, .. } = setup;
    let opened = PathBuf::from(&view_port.newest().scene.geometry().path);
    let Params { seated, left_handed, mirror, rasterizer, locomotion, upright, floor, callouts, .. } = params;
    let foveation = Foveation::beyond(params.foveation);
    let tools = Tools {
        seated,
        left_handed,
        locomotion,
        upright,
        floor,
        callouts,
        foveation,
        ..tools(&params, Tools::default().highlight_mix)
    };
    let pictures = params.pictures.unwrap_or_else(pictures);
    let frame_traces = params.frame_traces;
    let setup = vr::Setup {
        scene,
        view_port,
        tools,
        near: params.near,
        settings: Settings::default_path(),
        opened,
        mirror,
        rasterizer,
        pictures,
        frame_traces,
    };
    let view = VrView::new(setup, &headset);
    let watchdog = headset.watchdog();
    // After a timeout the receiver is gone.
    let _ = opened_sender
        .send(OpenDisplay { display: Display::Headset, blocked_call: Box::new(move || watchdog.blocked_call()) });
    view.serve(&mut headset).map_err(|e| StartError::Failed(e.to_string()))
}

/// This executable was built without OpenXR.
#[cfg(not(feature = "xr"))]
fn open_headset(_: &DisplaySetup) -> Result<Result<std::convert::Infallible, String>, StartError> {
    Ok(Err("this executable was built without the feature `xr`".to_owned()))
}

#[cfg(not(feature = "xr"))]
fn run_headset(_: DisplaySetup, headset: std::convert::Infallible) -> Result<(), StartError> {
    match headset {}
}

fn run_window(setup: DisplaySetup) -> Result<(), StartError> {
    let DisplaySetup { scene, mut view_port, params, scratch, opened_sender, .. } = setup;
    // A scene file has the name of all of its kind.
    let of_file = params.file.as_deref().and_then(Path::file_name).filter(|name| *name != "scene.toml");
    let of_file = of_file.map(|name| name.to_string_lossy().into_owned());
    let named = params.title.clone().or(of_file);
    let named = named.unwrap_or_else(|| last_parts(&view_port.newest().scene.geometry().path));
    let title = format!("{named} - Super-Gaussian");
    let open = || Engine::new(Arc::clone(&scene), params.backend, params.rasterizer);
    let engine = window::at_low_priority(open)
        .map_err(|e| StartError::Failed(e.to_string()))?
        .map_err(|e| StartError::Input(e.to_string()))?;
    let window_setup = Setup {
        scene,
        engine,
        view_port,
        title,
        tools: tools(&params, window::TINT),
        quality: params.quality,
        copies: params.copies,
        settings: Settings::default_path(),
        pictures: params.pictures.unwrap_or_else(pictures),
        file: params.file,
        scratch: Some(scratch),
        opened: Box::new(move || {
            let _ = opened_sender.send(OpenDisplay { display: Display::Window, blocked_call: Box::new(|| None) });
        }),
    };
    window::run(window_setup).map_err(|e| StartError::Input(e.to_string()))
}

/// Display settings from the launch file; without one there, the highlight has the share `mix` of its colour.
fn tools(params: &Params, mix: f32) -> Tools {
    let Params { quality, projection, highlight_color, highlight_mix, .. } = *params;
    Tools {
        quality: quality.unwrap_or(Quality::Standard),
        projection,
        highlight: highlight_color.into(),
        highlight_mix: highlight_mix.unwrap_or(mix),
        ..Tools::default()
    }
}

fn open_error(ended: Result<Option<StartError>, oneshot::error::RecvError>) -> StartError {
    ended.ok().flatten().unwrap_or_else(|| StartError::Failed("the display did not open".to_owned()))
}

/// The last folder and the file of a path: the folder names most scenes, whose file is `scene.toml`.
fn last_parts(path: &str) -> String {
    let parts: Vec<_> = Path::new(path).iter().rev().take(2).collect();
    parts.into_iter().rev().collect::<PathBuf>().display().to_string()
}

/// The user's picture folder: `XDG_PICTURES_DIR`, else the desktop's own (`user-dirs.dirs`), else `Pictures` in the home.
fn pictures() -> PathBuf {
    let set = std::env::var_os("XDG_PICTURES_DIR").map(PathBuf::from).filter(|p| p.is_absolute());
    let of_user = || {
        let user = UserDirs::new()?;
        Some(user.picture_dir().map_or_else(|| user.home_dir().join("Pictures"), Path::to_path_buf))
    };
    set.or_else(of_user).unwrap_or_else(std::env::temp_dir)
}

/// Closes the display with the process: drawing during the driver's shutdown would crash.
struct CloseOnDrop {
    writer: StateWriter,
    thread: JoinHandle<()>,
}

impl Drop for CloseOnDrop {
    fn drop(&mut self) {
        self.writer.close();
        let begun = Instant::now();
        while !self.thread.is_finished() && begun.elapsed() < CLOSE_TIMEOUT {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// Reports the display's pace and blocked calls while the display is open.
async fn tell(
    host: Host,
    owned: RetainedValue<State>,
    mut state_message: State,
    ending: CloseOnDrop,
    mut loop_watchdog: LoopWatchdog,
) {
    loop {
        tokio::time::sleep(REPORT_PERIOD).await;
        if let Some(reason) = loop_watchdog.check() {
            host.fail(reason);
        }
        let now = ending.writer.frame_stats();
        state_message.revision = now.revision;
        (state_message.frames, state_message.shown, state_message.late) = (now.pictures, now.frames, now.late);
        [state_message.width, state_message.height] = now.size;
        state_message.render_ms = 1e3 * now.seconds;
        if !now.engine.is_empty() {
            state_message.engine = now.engine;
        }
        if let Err(fault) = owned.set(state_message.clone(), &Context::root()).await {
            tracing::warn!(%fault, "{} could not be published", keys::VIEW_STATE.name);
        }
    }
}
