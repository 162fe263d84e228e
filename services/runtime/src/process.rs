//! One lifecycle for every process: connect, load, ready, serve, drain, stop.

use std::future::Future;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use nix::unistd::{Pid, getppid};
use prost::{Message, Name};
use serde::de::DeserializeOwned;
use sg_proto::bus::{
    CancelReply, CancelRequest, Code, ContentReply, ContentRequest, Health, MetricsReply, Phase, PromoteReply,
    PromoteRequest, Ready,
};
use sg_proto::keys::{self, Ask};
use sg_proto::limits::HEALTH_PERIOD;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::{mpsc, oneshot, watch};

use crate::actor::{self, Actor, Exit, Mailbox, Observed, Reply, Running};
use crate::blobs::Blobs;
use crate::bus::{Alive, Bus, BusError, Certificates, Link, Serving};
use crate::context::Context;
use crate::fault::Fault;
use crate::scene_replica::SceneReplicaError;
use crate::{metrics, scene_files, telemetry, wire};

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
    /// Certificate of the authority, where the router is on another machine (PEM)
    #[arg(long, requires_all = ["certificate", "key"])]
    pub authority: Option<PathBuf>,
    /// Certificate of this machine (PEM)
    #[arg(long, requires = "authority")]
    pub certificate: Option<PathBuf>,
    /// Private key of this machine (PEM)
    #[arg(long, requires = "authority")]
    pub key: Option<PathBuf>,
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

impl ServeArgs {
    /// The way to the session's router.
    #[must_use]
    pub fn link(&self) -> Link {
        let Self { authority, certificate, key, .. } = self;
        let certificates = authority.clone().zip(certificate.clone()).zip(key.clone());
        let certificates =
            certificates.map(|((authority, certificate), key)| Certificates { authority, certificate, key });
        Link { endpoint: self.connect.clone(), certificates }
    }
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

impl From<SceneReplicaError> for StartError {
    fn from(error: SceneReplicaError) -> Self {
        Self::Failed(error.to_string())
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
    before_promotion: Mutex<Vec<Hook>>,
    promotions: mpsc::Sender<Promotion>,
    stop: tokio::sync::Notify,
    failures: mpsc::Sender<String>,
}

/// What a process does before it takes its role.
type Hook = Box<dyn FnOnce() -> Pin<Box<dyn Future<Output = Result<(), StartError>> + Send>> + Send>;

/// A role that was granted, and where to say that it was taken.
type Promotion = (PromoteRequest, oneshot::Sender<Result<PromoteReply, Fault>>);

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

    /// Whether this process has not been granted its role yet. What belongs to the role alone, such as a journal, is then
    /// taken by [`Host::before_promotion`]; until that, a process that stands by works on scratch state.
    #[must_use]
    pub fn stands_by(&self) -> bool {
        self.bus().stands_by()
    }

    /// Has something done after the role is granted and before its keys are taken: whoever had the role is gone then, and
    /// nobody asks yet. An error ends the process. Of no effect where the role was there from the start.
    pub fn before_promotion<F, Fut>(&self, hook: F)
    where
        F: FnOnce() -> Fut + Send + 'static,
        Fut: Future<Output = Result<(), StartError>> + Send + 'static,
    {
        lock(&self.inner.before_promotion).push(Box::new(move || Box::pin(hook())));
    }

    /// Ends this process as if it had been asked to: it finishes what it has accepted. For a display that a person closes.
    pub fn stop(&self) {
        self.inner.stop.notify_one();
    }

    /// Ends this process as one that failed at its work, so that its supervisor starts it again. For what works beside the
    /// actors, such as a display's loop. Of several reasons the first counts.
    pub fn fail(&self, reason: String) {
        // One that waits already is as good.
        let _ = self.inner.failures.try_send(reason);
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

    /// Where a file of the scene's geometry can be read on this machine: the path that its owner reads it from, or, where
    /// the owner is on another machine, a copy that is fetched once and kept in this process's folder.
    ///
    /// # Errors
    /// The scene's refusal; a file that could not be fetched whole or kept.
    pub async fn scene_path(&self, path: &str, geometry_hash: &str) -> Result<PathBuf, StartError> {
        if !self.inner.args.link().is_remote() {
            return Ok(PathBuf::from(path));
        }
        scene_files::fetch(self.bus(), self.run_dir(), geometry_hash).await.map_err(|fault| match fault.code {
            // The scene as it lies there cannot be had here: trying again would not help.
            Code::FailedPrecondition | Code::InvalidArgument => StartError::Input(fault.message),
            _ => fault.into(),
        })
    }

    /// Answers a row by which other machines read what this process has put into its [`Host::blobs`] or offers there.
    ///
    /// # Errors
    /// As [`Bus::serve`].
    pub async fn serve_content(&self, row: &Ask<ContentRequest, ContentReply>) -> Result<(), BusError> {
        let blobs = self.blobs().clone();
        let part =
            move |request: ContentRequest, _| std::future::ready(tokio::task::block_in_place(|| blobs.part(&request)));
        self.serve(row, 8, part).await
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
    /// As [`Bus::serve`].
    pub async fn serve<Q, R, H, F>(&self, row: &Ask<Q, R>, capacity: usize, handler: H) -> Result<(), BusError>
    where
        Q: Message + Name + Default + 'static,
        R: Message + Name + 'static,
        H: FnMut(Q, Context) -> F + Send + 'static,
        F: Future<Output = Result<R, Fault>> + Send,
    {
        let serving = self.bus().serve(row, capacity, handler).await?;
        lock(&self.inner.serving).push(serving);
        Ok(())
    }

    /// Answers the requests of a row of this process's role through an actor's mailbox, until the process drains.
    ///
    /// The actor's message is made from the request, its context and the sender of the reply, as in this example.
    ///
    /// ```
    /// use sg_proto::keys;
    /// use sg_proto::scene::{Command, CommandResult};
    /// use sg_runtime::actor::{Actor, Reply};
    /// use sg_runtime::bus::BusError;
    /// use sg_runtime::context::Context;
    /// use sg_runtime::process::Host;
    ///
    /// struct Scene {
    ///     revision: u64,
    /// }
    ///
    /// enum Message {
    ///     Apply { command: Command, context: Context, reply: Reply<CommandResult> },
    /// }
    ///
    /// impl Actor for Scene {
    ///     type Message = Message;
    ///     type State = u64;
    ///
    ///     fn name(&self) -> &'static str {
    ///         "scene"
    ///     }
    ///
    ///     fn state(&self) -> u64 {
    ///         self.revision
    ///     }
    ///
    ///     async fn handle(&mut self, message: Message) -> Result<(), String> {
    ///         let Message::Apply { command, context, reply } = message;
    ///         self.revision += 1;
    ///         tracing::debug!(conversation = context.conversation, "applied");
    ///         // A caller that has gone away misses only the reply.
    ///         let _ = reply.send(Ok(CommandResult { id: command.id, ..CommandResult::default() }));
    ///         Ok(())
    ///     }
    /// }
    ///
    /// async fn load(host: Host) -> Result<(), BusError> {
    ///     let (mailbox, _) = host.spawn(Scene { revision: 0 }, 8);
    ///     host.route(&keys::SCENE_APPLY, 8, &mailbox, |command, context, reply| Message::Apply { command, context, reply })
    ///         .await
    /// }
    /// ```
    ///
    /// # Errors
    /// As in [`Host::serve`].
    pub async fn route<Q, R, M, F>(
        &self,
        row: &Ask<Q, R>,
        capacity: usize,
        mailbox: &Mailbox<M>,
        message: F,
    ) -> Result<(), BusError>
    where
        Q: Message + Name + Default + 'static,
        R: Message + Name + 'static,
        M: Send + 'static,
        F: FnOnce(Q, Context, Reply<R>) -> M + Clone + Send + 'static,
    {
        let serving = self.bus().route(row, capacity, mailbox, message).await?;
        lock(&self.inner.serving).push(serving);
        Ok(())
    }

    /// The rows that every process answers.
    async fn serve_what_all_serve(&self) -> Result<(), BusError> {
        let host = self.clone();
        self.serve(&keys::STATUS, 16, move |_, _| std::future::ready(Ok(host.health()))).await?;
        let bus = self.bus().clone();
        let withdraw =
            move |request: CancelRequest, _| std::future::ready(Ok(CancelReply { found: bus.withdraw(&request.id) }));
        self.serve(&keys::CANCEL, 16, withdraw).await?;
        let host = self.clone();
        let counted = move |_, _| {
            metrics::health(&host.health());
            std::future::ready(Ok(MetricsReply { text: metrics::render() }))
        };
        self.serve(&keys::METRICS, 4, counted).await?;
        let host = self.clone();
        let promote = move |request: PromoteRequest, context: Context| {
            let host = host.clone();
            async move {
                if !host.stands_by() {
                    let message = format!("`{}` has its role already", host.inner.args.instance);
                    return Err(Fault::new(Code::FailedPrecondition, message));
                }
                let (reply, answer) = oneshot::channel();
                let loading = || Fault::unavailable("the process has not loaded yet");
                host.inner.promotions.try_send((request, reply)).map_err(|_| loading())?;
                match tokio::time::timeout_at(context.deadline.into(), answer).await {
                    Ok(Ok(outcome)) => outcome,
                    Ok(Err(_)) => Err(Fault::unavailable("the process ended before it took its role")),
                    Err(_) => Err(Fault::deadline("the role was not taken in time")),
                }
            }
        };
        self.serve(&keys::PROMOTE, 1, promote).await
    }

    /// Takes the role; how long that took, milliseconds.
    async fn take_role(&self, request: &PromoteRequest) -> Result<(Alive, f64), StartError> {
        let begun = Instant::now();
        let hooks = std::mem::take(&mut *lock(&self.inner.before_promotion));
        for hook in hooks {
            hook().await?;
        }
        self.bus().promote(request.epoch).await?;
        let alive = self.bus().declare_alive(&self.inner.args.instance).await?;
        self.announce().await?;
        Ok((alive, begun.elapsed().as_secs_f64() * 1e3))
    }

    /// Says that this process serves its role, or stands by.
    async fn announce(&self) -> Result<(), Fault> {
        let standby = self.stands_by();
        let phase = if standby { Phase::Standby } else { Phase::Ready };
        self.inner.phase.send_replace(phase);
        let ready = Ready {
            role: self.role().to_owned(),
            instance: self.inner.args.instance.clone(),
            version: self.inner.version.to_owned(),
            schema_hash: wire::SCHEMA_HASH.clone(),
            pid: std::process::id(),
            start_ms: millis(self.inner.started.elapsed()),
            epoch: self.bus().epoch(),
            standby,
            declares: self.bus().declares().into_iter().map(str::to_owned).collect(),
        };
        self.bus().publish(&keys::READY, &ready, &Context::root()).await?;
        tracing::info!(
            start_ms = ready.start_ms,
            epoch = ready.epoch,
            "{}",
            if standby { "standing by" } else { "ready" }
        );
        Ok(())
    }

    /// How this process is.
    #[must_use]
    pub fn health(&self) -> Health {
        let counters = self.bus().counters();
        let (answer_ms, answer_ms_p99) = counters.answer_ms();
        Health {
            role: self.role().to_owned(),
            instance: self.inner.args.instance.clone(),
            phase: (*self.inner.phase.borrow()).into(),
            pid: std::process::id(),
            uptime_ms: millis(self.inner.started.elapsed()),
            memory_bytes: resident_bytes(),
            actors: lock(&self.inner.observed).iter().map(|o| o.health()).collect(),
            refused: counters.refused(),
            dropped: counters.dropped(),
            answered: counters.answered(),
            version: self.inner.version.to_owned(),
            schema_hash: wire::SCHEMA_HASH.clone(),
            epoch: self.bus().epoch(),
            answer_ms,
            answer_ms_p99,
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
    metrics::install(&args.role, &args.instance);
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

    let ServeArgs { session, role, instance, epoch, standby, .. } = &args;
    let bus = Bus::connect_instance(session, role, instance, *epoch, *standby, args.link()).await?;
    let blobs = Blobs::open(&args.run_dir.join("blobs")).map_err(|e| StartError::Failed(e.to_string()))?;
    let grace = Duration::from_millis(args.grace_ms);
    let (ends, mut ended) = mpsc::channel(16);
    let (promotions, mut granted) = mpsc::channel(1);
    let (failures, mut beside) = mpsc::channel(1);
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
        before_promotion: Mutex::default(),
        promotions,
        stop: tokio::sync::Notify::new(),
        failures,
    };
    let host = Host { inner: Arc::new(inner) };
    let asked = host.clone();
    let stop = async move {
        tokio::select! {
            () = stop => (),
            () = asked.inner.stop.notified() => (),
        }
    };
    tokio::pin!(stop);
    tokio::spawn(beat(host.clone()));
    host.serve_what_all_serve().await?;

    tokio::select! {
        outcome = load(host.clone()) => outcome?,
        () = &mut stop => return Ok(()),
    }

    let mut ended_actors = 0;
    let mut failed = |(name, exit): (&str, Exit)| {
        ended_actors = 1;
        match exit {
            Exit::Failed(reason) => format!("actor `{name}` failed: {reason}"),
            Exit::Finished => format!("actor `{name}` ended by itself"),
        }
    };
    let mut alive = None;
    let failure = if host.stands_by() {
        host.announce().await?;
        tokio::select! {
            () = &mut stop => return Ok(()),
            Some(end) = ended.recv() => Some(failed(end)),
            Some(reason) = beside.recv() => Some(reason),
            Some((request, reply)) = granted.recv() => {
                let outcome = host.take_role(&request).await;
                let told = match &outcome {
                    Ok((_, elapsed_ms)) => Ok(PromoteReply { elapsed_ms: *elapsed_ms }),
                    Err(error) => Err(Fault::internal(error.to_string())),
                };
                // The supervisor waits with a deadline; that it gave up shows in what it does next.
                let _ = reply.send(told);
                alive = Some(outcome?.0);
                None
            }
        }
    } else {
        alive = Some(host.bus().declare_alive(&host.inner.args.instance).await?);
        host.announce().await?;
        None
    };
    let failure = match failure {
        Some(reason) => Some(reason),
        None => tokio::select! {
            () = &mut stop => None,
            Some(end) = ended.recv() => Some(failed(end)),
            Some(reason) = beside.recv() => Some(reason),
        },
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
    for _ in ended_actors..actors.len() {
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
        metrics::upkeep();
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
