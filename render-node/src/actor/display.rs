//! A view that a person sits before: the display's loop on a thread of its own, and everything that answers it beside.

use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use sg_proto::keys;
use sg_proto::render::State;
use sg_render_node::backend::Engine;
use sg_render_node::display::{News, Seat, Service, Shown, Tools};
use sg_render_node::window::{self, Memory, Setup};
#[cfg(feature = "xr")]
use sg_render_node::{
    hands::Stance,
    room::{self, Room},
    xr::{Headset, Options},
};
use sg_runtime::bus::Owned;
use sg_runtime::context::Context;
use sg_runtime::process::{Host, StartError};
use sg_scene::model::Scene;
use tokio::sync::{oneshot, watch};

use super::following::Followed;
use super::params::{Display, Params};
use super::{errands, news};

/// How long a window may take to open: a software device compiles its shaders.
const OPENS: Duration = Duration::from_secs(60);

/// How long a display may take to close.
const CLOSES: Duration = Duration::from_secs(2);

/// How often the state of the display is told.
const TELLS: Duration = Duration::from_secs(1);

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
    let (ended, thread) =
        run(host.clone(), Before { scene: Arc::new(scene), seat, params: params.clone(), there }, &news)?;
    let display = tokio::select! {
        opened = is_there => match opened {
            Ok(display) => display,
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
    tokio::spawn(tell(owned, told, Ending { news, thread }));
    Ok(())
}

/// What a display's thread begins with.
struct Before {
    scene: Arc<Scene>,
    seat: Seat,
    params: Params,
    /// Who waits for what was opened.
    there: oneshot::Sender<Display>,
}

/// Starts the display's thread; what it said at its end.
fn run(
    host: Host,
    before: Before,
    news: &News,
) -> Result<(oneshot::Receiver<Option<String>>, JoinHandle<()>), StartError> {
    let (ending, ended) = oneshot::channel();
    let news = news.clone();
    let body = move || {
        let outcome = see(before, &news).err();
        match &outcome {
            Some(error) => tracing::error!("{error}"),
            None => tracing::info!("the display was closed"),
        }
        // Who waits for it to open says why it did not, and ends the process as a failure; nobody waits once it has opened.
        if ending.send(outcome).is_err() {
            host.stop();
        }
    };
    let thread = std::thread::Builder::new().name("display".to_owned()).spawn(body);
    let thread = thread.map_err(|e| StartError::Failed(format!("no thread for the display: {e}")))?;
    Ok((ended, thread))
}

/// Serves the headset, or the window where that was asked for or there is none.
fn see(before: Before, news: &News) -> Result<(), String> {
    if before.params.display == Display::Headset {
        match find(&before.params) {
            Ok(headset) => return stand(before, headset),
            Err(why) => {
                tracing::warn!("the window takes the headset's place: {why}");
                news.notice(why, false);
            }
        }
    }
    window(before)
}

/// The headset, if there is one.
#[cfg(feature = "xr")]
fn find(params: &Params) -> Result<Headset, String> {
    let stance = if params.seated { Stance::Seated } else { Stance::Standing };
    let options = Options { resolution: params.resolution, stance, ..Options::default() };
    Headset::open(options).map_err(|e| e.to_string())
}

/// Lets a person stand in the room with the scene until they leave.
#[cfg(feature = "xr")]
fn stand(before: Before, mut headset: Headset) -> Result<(), String> {
    let Before { scene, mut seat, params, there } = before;
    let opened = PathBuf::from(&seat.newest().scene.geometry().path);
    let Params { seated, left_handed, .. } = params;
    let tools = Tools { seated, left_handed, ..tools(&params) };
    let room = Room::new(room::Setup { scene, seat, tools, opened }, &headset);
    // Nobody waits any more once that was given up.
    let _ = there.send(Display::Headset);
    room.serve(&mut headset).map_err(|e| e.to_string())
}

/// This executable was built without OpenXR.
#[cfg(not(feature = "xr"))]
fn find(_: &Params) -> Result<std::convert::Infallible, String> {
    Err("this executable was built without the feature `xr`".to_owned())
}

#[cfg(not(feature = "xr"))]
fn stand(_: Before, headset: std::convert::Infallible) -> Result<(), String> {
    match headset {}
}

fn window(before: Before) -> Result<(), String> {
    let Before { scene, mut seat, params, there } = before;
    let title = format!("Super-Gaussian: {}", seat.newest().scene.geometry().path);
    let engine = Engine::new(Scene::clone(&scene), params.backend, params.rasterizer).map_err(|e| e.to_string())?;
    let setup = Setup {
        scene,
        engine,
        seat,
        title,
        tools: tools(&params),
        memory: Memory::place(),
        pictures: params.pictures.unwrap_or_else(pictures),
        opened: Box::new(move || {
            let _ = there.send(Display::Window);
        }),
    };
    window::run(setup).map_err(|e| e.to_string())
}

/// The settings of a display as the launch file has them.
fn tools(params: &Params) -> Tools {
    let Params { quality, highlight_color, highlight_mix, .. } = *params;
    Tools { quality, highlight: highlight_color.into(), highlight_mix, ..Tools::default() }
}

fn why(ended: Result<Option<String>, oneshot::error::RecvError>) -> StartError {
    StartError::Input(ended.ok().flatten().unwrap_or_else(|| "the display did not open".to_owned()))
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

/// Tells how the display keeps up, for as long as it is there.
async fn tell(owned: Owned<State>, mut told: State, ending: Ending) {
    loop {
        tokio::time::sleep(TELLS).await;
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
