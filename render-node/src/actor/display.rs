//! A view that a person sits before: the display's loop on a thread of its own, and everything that answers it beside.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use sg_proto::keys;
use sg_proto::render::State;
use sg_render_node::backend::Engine;
use sg_render_node::display::{Seat, Service, Shown};
use sg_render_node::window::{self, Memory, Setup};
use sg_runtime::bus::Owned;
use sg_runtime::context::Context;
use sg_runtime::process::{Host, StartError};
use tokio::sync::{oneshot, watch};

use super::following::Followed;
use super::params::Params;
use super::{errands, news};

/// How long a window may take to open: a software device compiles its shaders.
const OPENS: Duration = Duration::from_secs(60);

/// How often the state of the display is told.
const TELLS: Duration = Duration::from_secs(1);

/// Opens a window over the scene and serves it until it is closed, which ends the process.
///
/// # Errors
/// Where no window can be opened on this machine, or the bus cannot be used.
pub(super) async fn open(
    host: &Host,
    engine: Engine,
    state: watch::Receiver<Followed>,
    (owned, told): (Owned<State>, State),
    params: &Params,
) -> Result<(), StartError> {
    let scene = Arc::new(engine.scene().clone());
    let first = Shown::of(Arc::clone(&state.borrow().state));
    let title = format!("Super-Gaussian: {}", first.scene.geometry().path);
    let (seat, service) = Seat::new(first);
    let (there, is_there) = oneshot::channel();
    let setup = Setup {
        scene,
        engine,
        seat,
        title,
        memory: Memory::place(),
        pictures: params.pictures.clone().unwrap_or_else(pictures),
        opened: Box::new(move || {
            // Nobody waits any more once that was given up.
            let _ = there.send(());
        }),
    };
    let ended = run(host.clone(), setup)?;
    tokio::select! {
        opened = is_there => if opened.is_err() {
            return Err(why(ended.await));
        },
        () = tokio::time::sleep(OPENS) => {
            return Err(StartError::Failed(format!("no window was there within {} s", OPENS.as_secs())));
        }
    }
    let Service { shown, requests, pace } = service;
    let shown = Arc::new(Mutex::new(shown));
    news::follow(host, state, &shown).await?;
    tokio::spawn(errands::run(host.bus().clone(), requests, shown));
    tokio::spawn(tell(owned, told, pace));
    Ok(())
}

/// Starts the display's thread; what it said at its end.
fn run(host: Host, setup: Setup) -> Result<oneshot::Receiver<Option<String>>, StartError> {
    let (ending, ended) = oneshot::channel();
    let body = move || {
        let outcome = window::run(setup).err().map(|e| e.to_string());
        match &outcome {
            Some(error) => tracing::error!("{error}"),
            None => tracing::info!("the window was closed"),
        }
        // Nobody listens once the window has opened.
        let _ = ending.send(outcome);
        host.stop();
    };
    let thread = std::thread::Builder::new().name("window".to_owned()).spawn(body);
    thread.map_err(|e| StartError::Failed(format!("no thread for the window: {e}")))?;
    Ok(ended)
}

fn why(ended: Result<Option<String>, oneshot::error::RecvError>) -> StartError {
    StartError::Input(ended.ok().flatten().unwrap_or_else(|| "the window did not open".to_owned()))
}

/// Where a user keeps pictures.
fn pictures() -> PathBuf {
    let set = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|p| p.is_absolute());
    set("XDG_PICTURES_DIR").or_else(|| Some(set("HOME")?.join("Pictures"))).unwrap_or_else(std::env::temp_dir)
}

/// Tells how the display keeps up, for as long as it is there.
async fn tell(owned: Owned<State>, mut told: State, pace: watch::Receiver<sg_render_node::display::Pace>) {
    loop {
        tokio::time::sleep(TELLS).await;
        let now = pace.borrow().clone();
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
