//! A view that a person sits before: the display's loop on a thread of its own, and everything that answers it beside.

use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use sg_gpu::backend::Engine;
use sg_proto::keys;
use sg_proto::render::State;
use sg_raster::render::Quality;
use sg_runtime::bus::Owned;
use sg_runtime::context::Context;
use sg_runtime::process::{Host, StartError};
use sg_scene::model::Scene;
use sg_viewer::display::{News, Seat, Service, Shown, Tools};
#[cfg(feature = "xr")]
use sg_viewer::hands::Stance;
use sg_viewer::room::{self, Room};
use sg_viewer::window::{self, Memory, Setup};
use sg_viewer::xr::{Headset, Options, XrError};
use tokio::sync::{oneshot, watch};

use super::following::Followed;
use super::params::{Display, Params};
use super::patience::{Holds, Watch};
use super::{errands, news};

/// How long a window may take to open: a software device compiles its shaders.
const OPENS: Duration = Duration::from_secs(60);

/// How long a display may take to close.
const CLOSES: Duration = Duration::from_secs(2);

/// How often the state of the display is told.
const TELLS: Duration = Duration::from_secs(1);

/// How long a headset is looked for that an earlier process of this stack had, before a window takes its place.
#[cfg(feature = "xr")]
const COMES_BACK: Duration = Duration::from_secs(20);

/// File of the session's folder that says which stack has had a headset.
#[cfg(feature = "xr")]
const STOOD: &str = "headset";

/// Opens a headset or a window over the scene and serves it until it is closed, which ends the process.
///
/// # Errors
/// Where nothing can be opened on this machine, or the bus cannot be used.
pub(super) async fn open(
    host: &Host,
    scene: Scene,
    state: watch::Receiver<Followed>,
    params: &Params,
) -> Result<(), StartError> {
    let first = Shown::of(Arc::clone(&state.borrow().state));
    let told = State { gaussians: scene.len() as u64, display: params.display.name().to_owned(), ..State::default() };
    let owned = host.bus().own(&keys::VIEW_STATE, told.clone()).await?;
    let (seat, service) = Seat::new(first);
    let Service { news, requests } = service;
    let (there, is_there) = oneshot::channel();
    let run_dir = host.run_dir().to_owned();
    let before = Before { scene: Arc::new(scene), seat, params: params.clone(), run_dir, there };
    let (ended, thread) = run(host.clone(), before, &news)?;
    let Opened { display, holds } = tokio::select! {
        opened = is_there => match opened {
            Ok(opened) => opened,
            Err(_) => return Err(why(ended.await)),
        },
        () = tokio::time::sleep(OPENS) => {
            return Err(StartError::Failed(format!("nothing was there to look at within {} s", OPENS.as_secs())));
        }
    };
    drop(ended);
    let told = State { display: display.name().to_owned(), ..told };
    news::follow(host, state, &news).await?;
    errands::run(host.bus().clone(), requests, news.clone())
        .map_err(|e| StartError::Failed(format!("no thread for what is asked for: {e}")))?;
    let watch = Watch::new(holds, Duration::from_secs_f64(params.patience));
    tokio::spawn(tell(host.clone(), owned, told, Ending { news, thread }, watch));
    Ok(())
}

/// What a display's thread begins with.
struct Before {
    scene: Arc<Scene>,
    seat: Seat,
    params: Params,
    /// Folder of the session.
    run_dir: PathBuf,
    /// Who waits for what was opened.
    there: oneshot::Sender<Opened>,
}

/// A display that is there.
struct Opened {
    display: Display,
    holds: Holds,
}

/// Starts the display's thread; why it did not open, while somebody waits for that.
fn run(
    host: Host,
    before: Before,
    news: &News,
) -> Result<(oneshot::Receiver<Option<StartError>>, JoinHandle<()>), StartError> {
    let (ending, ended) = oneshot::channel();
    let news = news.clone();
    let body = move || {
        let _broken = Broken(host.clone());
        let outcome = see(before, &news).err();
        // Who waits for it to open ends the process as a failure if it did not; nobody waits once it has opened.
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

/// Ends the process as failed where the display's thread breaks off: what it was there for is gone.
struct Broken(Host);

impl Drop for Broken {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.fail("the display broke off; what it said stands before this".to_owned());
        }
    }
}

/// Serves the headset, or the window where that was asked for or there is none.
fn see(before: Before, news: &News) -> Result<(), StartError> {
    if before.params.display == Display::Headset {
        match find(&before)? {
            Ok(headset) => return stand(before, headset),
            Err(why) => {
                tracing::warn!("the window takes the headset's place: {why}");
                news.notice(why, false);
            }
        }
    }
    window(before)
}

/// The headset, if there is one; else why not. A headset that an earlier process of this stack has had is waited for.
#[cfg(feature = "xr")]
fn find(before: &Before) -> Result<Result<Headset, String>, StartError> {
    let params = &before.params;
    let stance = if params.seated { Stance::Seated } else { Stance::Standing };
    let options = Options { resolution: params.resolution, stance, ..Options::default() };
    let stack = std::os::unix::process::parent_id().to_string();
    let marker = before.run_dir.join(STOOD);
    let stood = std::fs::read_to_string(&marker).is_ok_and(|said| said == stack);
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
            // It is still there and may go on: the next process asks it anew.
            Err(error @ XrError::Silent { .. }) if stood => return Err(StartError::Failed(error.to_string())),
            Err(error) if !stood || begun.elapsed() > COMES_BACK => return Ok(Err(error.to_string())),
            Err(_) => std::thread::sleep(options.retry_pause),
        }
    }
}

/// Lets a person stand in the room with the scene until they leave.
#[cfg(feature = "xr")]
fn stand(before: Before, mut headset: Headset) -> Result<(), StartError> {
    let Before { scene, mut seat, params, there, .. } = before;
    let opened = PathBuf::from(&seat.newest().scene.geometry().path);
    let Params { seated, left_handed, mirror, .. } = params;
    let tools = Tools { seated, left_handed, ..tools(&params) };
    let room = Room::new(room::Setup { scene, seat, tools, opened, mirror }, &headset);
    let held = headset.held();
    // Nobody waits any more once that was given up.
    let _ = there.send(Opened { display: Display::Headset, holds: Box::new(move || held.now()) });
    room.serve(&mut headset).map_err(|e| StartError::Failed(e.to_string()))
}

/// This executable was built without OpenXR.
#[cfg(not(feature = "xr"))]
fn find(_: &Before) -> Result<Result<std::convert::Infallible, String>, StartError> {
    Ok(Err("this executable was built without the feature `xr`".to_owned()))
}

#[cfg(not(feature = "xr"))]
fn stand(_: Before, headset: std::convert::Infallible) -> Result<(), StartError> {
    match headset {}
}

fn window(before: Before) -> Result<(), StartError> {
    let Before { scene, mut seat, params, there, .. } = before;
    let title = format!("Super-Gaussian: {}", seat.newest().scene.geometry().path);
    let engine = Engine::new(Scene::clone(&scene), params.backend, params.rasterizer)
        .map_err(|e| StartError::Input(e.to_string()))?;
    let setup = Setup {
        scene,
        engine,
        seat,
        title,
        tools: tools(&params),
        quality: params.quality,
        copies: params.copies,
        memory: Memory::place(),
        pictures: params.pictures.unwrap_or_else(pictures),
        opened: Box::new(move || {
            let _ = there.send(Opened { display: Display::Window, holds: Box::new(|| None) });
        }),
    };
    window::run(setup).map_err(|e| StartError::Input(e.to_string()))
}

/// The settings of a display as the launch file has them.
fn tools(params: &Params) -> Tools {
    let Params { quality, projection, highlight_color, highlight_mix, .. } = *params;
    Tools {
        quality: quality.unwrap_or(Quality::Standard),
        projection,
        highlight: highlight_color.into(),
        highlight_mix,
        ..Tools::default()
    }
}

fn why(ended: Result<Option<StartError>, oneshot::error::RecvError>) -> StartError {
    ended.ok().flatten().unwrap_or_else(|| StartError::Failed("the display did not open".to_owned()))
}

/// Where a user keeps pictures.
fn pictures() -> PathBuf {
    let set = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|p| p.is_absolute());
    set("XDG_PICTURES_DIR").or_else(|| Some(set("HOME")?.join("Pictures"))).unwrap_or_else(std::env::temp_dir)
}

/// Closes the display with the process: one that went on to draw while its driver is taken away would crash.
struct Ending {
    news: News,
    thread: JoinHandle<()>,
}

impl Drop for Ending {
    fn drop(&mut self) {
        self.news.end();
        let begun = Instant::now();
        while !self.thread.is_finished() && begun.elapsed() < CLOSES {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// Tells how the display keeps up and whether it goes on, for as long as it is there.
async fn tell(host: Host, owned: Owned<State>, mut told: State, ending: Ending, mut watch: Watch) {
    loop {
        tokio::time::sleep(TELLS).await;
        if let Some(reason) = watch.look() {
            host.fail(reason);
        }
        let now = ending.news.pace();
        told.revision = now.revision;
        (told.frames, told.shown, told.late) = (now.pictures, now.frames, now.late);
        told.render_ms = 1e3 * now.seconds;
        if !now.engine.is_empty() {
            told.engine = now.engine;
        }
        if let Err(fault) = owned.set(told.clone(), &Context::root()).await {
            tracing::warn!(%fault, "{} could not be published", keys::VIEW_STATE.name);
        }
    }
}
