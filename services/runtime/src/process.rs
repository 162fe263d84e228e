//! One lifecycle for every process: connect, load, ready, serve, drain, stop.

use std::future::Future;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use nix::unistd::{Pid, getppid};
use prost::{Message, Name};
use serde::de::DeserializeOwned;
use sg_proto::bus::{Health, Phase, Ready};
use sg_proto::keys::{self, Ask};
use sg_proto::limits::HEALTH_PERIOD;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::{mpsc, watch};

use crate::actor::{self, Actor, Exit, Mailbox, Observed, Running};
use crate::blobs::Blobs;
use crate::bus::{Bus, BusError, Serving};
use crate::context::Context;
use crate::fault::Fault;
use crate::{telemetry, wire};

/// Exit status of a process whose parameters or input are wrong: starting it again would not help.
pub const EXIT_INPUT: u8 = 2;
/// Exit status of a process that failed at its work.
pub const EXIT_FAILED: u8 = 1;

/// The arguments of every executable's service mode. A supervisor fills them in; by hand they need a running session.
#[derive(Debug, Clone, clap::Args)]
pub struct ServeArgs {
    /// Session whose bus is joined
    #[arg(long)]
    pub session: String,
    /// Role to serve
    #[arg(long)]
    pub role: String,
    /// Instance name, unique within the session
    #[arg(long)]
    pub instance: String,
    /// Endpoint of the session's router
    #[arg(long)]
    pub connect: String,
    /// Folder of the session (socket, logs, pictures)
    #[arg(long)]
    pub run_dir: PathBuf,
    /// Parameters from the launch file, as JSON
    #[arg(long, default_value = "{}")]
    pub params: String,
    /// Process id of the supervisor; the process ends when that one is gone
    #[arg(long)]
    pub supervisor_pid: Option<i32>,
    /// Epoch of the role, granted by the supervisor; 0 for none
    #[arg(long, default_value_t = 0)]
    pub epoch: u64,
    /// Serve only under the instance until promoted
    #[arg(long)]
    pub standby: bool,
    /// Milliseconds to finish accepted work after a request to stop
    #[arg(long, default_value_t = 3000)]
    pub grace_ms: u64,
}

/// Why a process could not begin to serve.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StartError {
    /// Parameters or input are wrong: starting again would not help.
    #[error("{0}")]
    Input(String),
    /// Something failed that may work another time.
    #[error("{0}")]
    Failed(String),
}

impl From<BusError> for StartError {
    fn from(error: BusError) -> Self {
        Self::Failed(error.to_string())
    }
}

impl From<Fault> for StartError {
    fn from(fault: Fault) -> Self {
        Self::Failed(fault.to_string())
    }
}

/// What a process has in hand while it loads and serves. Cheap to clone.
#[derive(Clone)]
pub struct Host {
    inner: Arc<Inner>,
}

struct Inner {
    args: ServeArgs,
    version: &'static str,
    started: Instant,
    bus: Bus,
    blobs: Blobs,
    phase: watch::Sender<Phase>,
    serving: Mutex<Vec<Serving>>,
    observed: Mutex<Vec<Arc<dyn Observed>>>,
    ends: mpsc::Sender<(&'static str, Exit)>,
}

impl Host {
    /// The bus.
    #[must_use]
    pub fn bus(&self) -> &Bus {
        &self.inner.bus
    }

    /// Role this process serves.
    #[must_use]
    pub fn role(&self) -> &str {
        &self.inner.args.role
    }

    /// Folder of the session.
    #[must_use]
    pub fn run_dir(&self) -> &Path {
        &self.inner.args.run_dir
    }

    /// Where pictures and other bulk data of the session go.
    #[must_use]
    pub fn blobs(&self) -> &Blobs {
        &self.inner.blobs
    }

    /// The parameters from the launch file.
    ///
    /// # Errors
    /// [`StartError::Input`] naming the parameter; give the type `#[serde(deny_unknown_fields)]`.
    pub fn params<T: DeserializeOwned>(&self) -> Result<T, StartError> {
        serde_json::from_str(&self.inner.args.params)
            .map_err(|e| StartError::Input(format!("parameters of `{}`: {e}", self.role())))
    }

    /// Starts an actor that belongs to this process: it shows in the health, and its failure ends the process.
    pub fn spawn<A: Actor>(&self, actor: A, capacity: usize) -> (Mailbox<A::Message>, watch::Receiver<A::State>) {
        let name = actor.name();
        let (mailbox, Running { state, exit, observed }) = actor::spawn(actor, capacity);
        lock(&self.inner.observed).push(observed);
        let ends = self.inner.ends.clone();
        tokio::spawn(async move {
            let exit = exit.await.unwrap_or_else(|e| Exit::Failed(format!("panicked: {e}")));
            // The receiver lives as long as the process: a closed channel means that it is over anyway.
            let _ = ends.send((name, exit)).await;
        });
        (mailbox, state)
    }

    /// Answers the requests of a row of this process's role until the process drains.
    ///
    /// # Errors
    /// [`BusError::Declare`]; a row of another role.
    pub async fn serve<Q, R, H, F>(&self, row: &Ask<Q, R>, capacity: usize, handler: H) -> Result<(), BusError>
    where
        Q: Message + Name + Default + 'static,
        R: Message + Name + 'static,
        H: FnMut(Q, Context) -> F + Send + 'static,
        F: Future<Output = Result<R, Fault>> + Send,
    {
        if row.role != keys::ANY && row.role != self.role() {
            return Err(BusError::Declare {
                key: keys::key(self.bus().session(), row.role, row.name),
                reason: format!("the row belongs to `{}`, this process serves `{}`", row.role, self.role()),
            });
        }
        let serving = self.bus().serve(row, self.role(), capacity, handler).await?;
        lock(&self.inner.serving).push(serving);
        Ok(())
    }

    /// How this process is.
    #[must_use]
    pub fn health(&self) -> Health {
        let counters = self.bus().counters();
        Health {
            role: self.role().to_owned(),
            instance: self.inner.args.instance.clone(),
            phase: (*self.inner.phase.borrow()).into(),
            pid: std::process::id(),
            uptime_ms: millis(self.inner.started.elapsed()),
            memory_bytes: resident_bytes(),
            actors: lock(&self.inner.observed).iter().map(|o| o.health()).collect(),
            refused: counters.refused.load(Ordering::Relaxed),
            dropped: counters.dropped.load(Ordering::Relaxed),
            answered: counters.answered.load(Ordering::Relaxed),
            version: self.inner.version.to_owned(),
            schema_hash: wire::SCHEMA_HASH.clone(),
        }
    }
}

/// Runs a process: joins the bus, lets `load` read what it needs and declare what it serves, announces readiness, serves
/// until it is told to stop or an actor fails, drains and stops. `load` keeps nothing: actors own the state.
///
/// The exit status is 0 after a request to stop, [`EXIT_INPUT`] when parameters or input are wrong, else [`EXIT_FAILED`].
pub fn run<F, Fut>(args: ServeArgs, version: &'static str, load: F) -> ExitCode
where
    F: FnOnce(Host) -> Fut,
    Fut: Future<Output = Result<(), StartError>>,
{
    telemetry::init_service(&args.role);
    if let Some(supervisor) = args.supervisor_pid {
        die_with(supervisor);
    }
    match block_on(live(args, version, load)) {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(error)) => {
            tracing::error!("{error}");
            ExitCode::from(match error {
                StartError::Input(_) => EXIT_INPUT,
                StartError::Failed(_) => EXIT_FAILED,
            })
        }
        Err(error) => {
            tracing::error!("the async runtime could not be started: {error}");
            ExitCode::from(EXIT_FAILED)
        }
    }
}

/// Runs a future on a fresh multi-threaded runtime, which the bus needs.
///
/// # Errors
/// The threads could not be started.
pub fn block_on<F: Future>(future: F) -> std::io::Result<F::Output> {
    // The heavy work of a service runs in rayon's pool; these threads only carry messages.
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    let output = runtime.block_on(future);
    runtime.shutdown_timeout(Duration::from_millis(500));
    Ok(output)
}

async fn live<F, Fut>(args: ServeArgs, version: &'static str, load: F) -> Result<(), StartError>
where
    F: FnOnce(Host) -> Fut,
    Fut: Future<Output = Result<(), StartError>>,
{
    let started = Instant::now();
    let signal_error = |e: std::io::Error| StartError::Failed(format!("signals cannot be watched: {e}"));
    let mut terminate = signal(SignalKind::terminate()).map_err(signal_error)?;
    let mut interrupt = signal(SignalKind::interrupt()).map_err(signal_error)?;
    let supervised = args.supervisor_pid.is_some();
    let stop = async move {
        loop {
            tokio::select! {
                _ = terminate.recv() => return,
                // Ctrl-C reaches the whole terminal group; a supervised process waits for its supervisor's word.
                _ = interrupt.recv() => if !supervised { return },
            }
        }
    };
    tokio::pin!(stop);

    let bus = Bus::connect(&args.session, &args.role, &args.connect).await?;
    let blobs = Blobs::open(&args.run_dir.join("blobs")).map_err(|e| StartError::Failed(e.to_string()))?;
    let grace = Duration::from_millis(args.grace_ms);
    let (ends, mut ended) = mpsc::channel(16);
    let inner = Inner {
        args,
        version,
        started,
        bus,
        blobs,
        phase: watch::channel(Phase::Loading).0,
        serving: Mutex::default(),
        observed: Mutex::default(),
        ends,
    };
    let host = Host { inner: Arc::new(inner) };
    tokio::spawn(beat(host.clone()));
    let status = host.clone();
    host.serve(&keys::STATUS, 16, move |_, _| std::future::ready(Ok(status.health()))).await?;

    tokio::select! {
        outcome = load(host.clone()) => outcome?,
        () = &mut stop => return Ok(()),
    }

    let alive = host.bus().declare_alive(&host.inner.args.instance).await?;
    host.inner.phase.send_replace(Phase::Ready);
    let ready = Ready {
        role: host.role().to_owned(),
        instance: host.inner.args.instance.clone(),
        version: version.to_owned(),
        schema_hash: wire::SCHEMA_HASH.clone(),
        pid: std::process::id(),
        start_ms: millis(started.elapsed()),
    };
    host.bus().publish(&keys::READY, &ready, &Context::root()).await?;
    tracing::info!(start_ms = ready.start_ms, "ready");

    let failure = tokio::select! {
        () = &mut stop => None,
        Some((name, exit)) = ended.recv() => Some(match exit {
            Exit::Failed(reason) => format!("actor `{name}` failed: {reason}"),
            Exit::Finished => format!("actor `{name}` ended by itself"),
        }),
    };

    host.inner.phase.send_replace(Phase::Draining);
    drop(alive);
    let deadline = Instant::now() + grace;
    let serving = std::mem::take(&mut *lock(&host.inner.serving));
    let draining = serving.into_iter().map(|s| tokio::spawn(s.drain(grace)));
    for drained in draining.collect::<Vec<_>>() {
        let _ = drained.await;
    }
    let actors = lock(&host.inner.observed).clone();
    for actor in &actors {
        // What `load` spawned beside the actors may hold their mailboxes for ever; it ends with the runtime.
        actor.close();
    }
    for _ in usize::from(failure.is_some())..actors.len() {
        if tokio::time::timeout_at(deadline.into(), ended.recv()).await.is_err() {
            break;
        }
    }
    host.inner.phase.send_replace(Phase::Stopped);
    host.bus().close().await;
    failure.map_or(Ok(()), |reason| Err(StartError::Failed(reason)))
}

/// Publishes the health of the process every period, from the loop that serves: a hung loop falls silent.
async fn beat(host: Host) {
    let mut period = tokio::time::interval(HEALTH_PERIOD);
    period.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
    loop {
        period.tick().await;
        if let Err(fault) = host.bus().publish(&keys::HEALTH, &host.health(), &Context::root()).await {
            tracing::debug!(%fault, "health could not be published");
            return;
        }
    }
}

/// Ties the life of this process to its supervisor's: a signal from the kernel when the parent dies, and a watch for the
/// gap before that is armed and for work that ignores the signal.
fn die_with(supervisor: i32) {
    if let Err(error) = nix::sys::prctl::set_pdeathsig(Signal::SIGTERM) {
        tracing::warn!(%error, "the kernel will not tell of the supervisor's death; watching it instead");
    }
    let parent = Pid::from_raw(supervisor);
    let watch = std::thread::Builder::new().name("supervisor-watch".into()).spawn(move || {
        while getppid() == parent {
            std::thread::sleep(Duration::from_millis(100));
        }
        tracing::error!("the supervisor is gone; stopping");
        let _ = nix::sys::signal::raise(Signal::SIGTERM);
        std::thread::sleep(Duration::from_millis(1000));
        std::process::exit(i32::from(EXIT_FAILED));
    });
    if let Err(error) = watch {
        tracing::warn!(%error, "the supervisor cannot be watched");
    }
}

/// Resident memory of this process in bytes; 0 where the system does not tell.
#[must_use]
pub fn resident_bytes() -> u64 {
    let Ok(text) = std::fs::read_to_string("/proc/self/statm") else { return 0 };
    let pages: u64 = text.split_whitespace().nth(1).and_then(|p| p.parse().ok()).unwrap_or(0);
    let page = nix::unistd::sysconf(nix::unistd::SysconfVar::PAGE_SIZE).ok().flatten().unwrap_or(4096);
    pages * u64::try_from(page).unwrap_or(4096)
}

fn millis(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}

/// A list is whole after a panic in another thread: every change to one is a single push or take.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
