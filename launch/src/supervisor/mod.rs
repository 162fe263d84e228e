//! The supervisor's body: turns what [`sg_launch::reconcile`] wants into processes, and what happens into its events.

mod act;
mod nodes;
mod opened;
mod requests;
mod session_lock;
mod told;

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use sg_launch::file::LaunchFile;
use sg_launch::reconcile::{Action, Event, Exit, Incarnation, Outcome, Reconciler, Time};
use sg_proto::bus::{Health, Ready};
use sg_proto::keys::{self, role};
use sg_proto::launch::LogLines;
use sg_runtime::bus::{Bus, Following, Liveliness, Serving};
use sg_runtime::metrics;
use sg_runtime::session::SessionDir;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::{Semaphore, mpsc};

use crate::console::{Console, ServiceLog, Verbosity, Writer};
use crate::leftovers::Roster;
use crate::terminal::Failure;
use nodes::{Nodes, Placed};
pub(crate) use requests::Handle;
use requests::{Request, serve};
use session_lock::{forget, lock};

/// Requests, exits and signs of life that may wait.
const CAPACITY: usize = 256;
/// What stands in place of a role in the keys of all that stand by.
const STANDING_BY: &str = "@instance/*";

/// What is to be supervised.
#[derive(Debug)]
pub(crate) struct Stack {
    pub(crate) file: LaunchFile,
    /// The launch file, for people.
    pub(crate) path: PathBuf,
    pub(crate) session: SessionDir,
    pub(crate) verbosity: Verbosity,
}

/// A session that is open: locked, with its router, nothing started yet.
pub(crate) struct Supervisor {
    stack: Stack,
    mind: Reconciler,
    began: Instant,
    bus: Bus,
    endpoint: String,
    requests: mpsc::Receiver<Request>,
    handle: Handle,
    ready: Following<Ready>,
    health: Following<Health>,
    newcomers_ready: Following<Ready>,
    newcomers_health: Following<Health>,
    /// What newcomers said of themselves when they stood by.
    newcomers: HashMap<String, Ready>,
    /// What became of proofs and promotions.
    outcomes: mpsc::Receiver<Event>,
    outcome_sender: mpsc::Sender<Event>,
    alive: mpsc::Receiver<Liveliness>,
    exits: mpsc::Receiver<(Incarnation, Exit)>,
    exit_sender: mpsc::Sender<(Incarnation, Exit)>,
    /// Other machines and what runs on them.
    nodes: Nodes,
    placed: mpsc::Receiver<Placed>,
    node_logs: Following<LogLines>,
    /// For sessions that are opened from this one.
    places: Arc<Semaphore>,
    /// Process id and instance of all that run on this machine.
    pids: HashMap<Incarnation, (u32, String)>,
    /// By service.
    logs: HashMap<String, ServiceLog>,
    width: usize,
    console: Console,
    writer: Writer,
    roster: Roster,
    all_ready_told: bool,
    _serving: Vec<Serving>,
    _lock: File,
}

impl Supervisor {
    /// Opens the session: its folder, its lock, its router, its logs.
    ///
    /// # Errors
    /// The session runs already; a folder or the socket cannot be made.
    pub(crate) async fn open(stack: Stack) -> Result<Self, Failure> {
        let session = stack.session.clone();
        session.create()?;
        let lock = lock(&session).await?;
        let roster = Roster::begin(session.path()).await.map_err(Failure::Work)?;
        // A supervisor that died leaves its socket, and pictures that nobody will ask for.
        forget(&session)?;
        metrics::install(role::SUPERVISOR, session.name());
        let bus = Bus::route(session.name(), role::SUPERVISOR, &session.socket(), nodes::listen(&stack.file).as_ref())
            .await?;
        let folder = session.logs();
        std::fs::create_dir_all(&folder).map_err(|e| Failure::Work(format!("{}: {e}", folder.display())))?;

        let (sender, requests) = mpsc::channel(CAPACITY);
        let serving = serve(&bus, &sender).await?;
        let ready = bus.follow(&keys::READY, keys::ANY, CAPACITY).await?;
        let health = bus.follow(&keys::HEALTH, keys::ANY, CAPACITY).await?;
        let newcomers_ready = bus.follow(&keys::READY, STANDING_BY, CAPACITY).await?;
        let newcomers_health = bus.follow(&keys::HEALTH, STANDING_BY, CAPACITY).await?;
        let node_logs = bus.follow(&keys::NODE_LOG, STANDING_BY, CAPACITY).await?;
        let (placed_sender, placed) = mpsc::channel(CAPACITY);
        let nodes = Nodes::new(&stack.file.nodes, placed_sender);
        let alive = bus.watch_alive(CAPACITY).await?;
        let (exit_sender, exits) = mpsc::channel(CAPACITY);
        let (outcome_sender, outcomes) = mpsc::channel(CAPACITY);
        let (console, writer) = Console::open(stack.verbosity);
        let width = stack.file.services.iter().map(|s| s.name.len()).max().unwrap_or(0);
        // Of the clock, so that epochs grow over the lives of supervisors too.
        let epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_millis();
        let epoch = u64::try_from(epoch).unwrap_or(u64::MAX);
        let mind = Reconciler::new(stack.file.services.clone(), u64::from(std::process::id()), epoch);
        let mut supervisor = Self {
            endpoint: session.endpoint(),
            stack,
            mind,
            began: Instant::now(),
            bus,
            requests,
            handle: Handle(sender),
            ready,
            health,
            newcomers_ready,
            newcomers_health,
            newcomers: HashMap::new(),
            outcomes,
            outcome_sender,
            alive,
            exits,
            exit_sender,
            nodes,
            placed,
            node_logs,
            places: Arc::new(Semaphore::new(opened::MOST)),
            pids: HashMap::new(),
            logs: HashMap::new(),
            width,
            console,
            writer,
            roster,
            all_ready_told: false,
            _serving: serving,
            _lock: lock,
        };
        // What an earlier run has logged is kept apart, whether or not the service is started this time.
        for index in 0..supervisor.stack.file.services.len() {
            supervisor.log(index);
        }
        Ok(supervisor)
    }

    /// A way to speak to it.
    pub(crate) fn handle(&self) -> Handle {
        self.handle.clone()
    }

    /// Starts the services and watches them until the stack is down. To be polled on a thread that lives as long as the
    /// process: see `children::start`.
    ///
    /// # Errors
    /// Signals cannot be watched.
    pub(crate) async fn run(mut self) -> Result<Outcome, Failure> {
        let watch = |kind| signal(kind).map_err(|e| Failure::Work(format!("signals cannot be watched: {e}")));
        let mut interrupt = watch(SignalKind::interrupt())?;
        let mut terminate = watch(SignalKind::terminate())?;
        let mut hang_up = watch(SignalKind::hangup())?;
        self.console.detail(format!(
            "session {} · {} · {} services · {}",
            self.stack.session.name(),
            self.stack.path.display(),
            self.stack.file.services.len(),
            self.stack.session.path().display()
        ));
        let mut happened = VecDeque::from([Event::Tick]);
        let outcome = 'watching: loop {
            while let Some(event) = happened.pop_front() {
                let now = self.now();
                for action in self.mind.step(event, now) {
                    match action {
                        Action::Finish(outcome) => break 'watching outcome,
                        action => happened.extend(self.act(action).await),
                    }
                }
            }
            // Without a deadline only an event can change anything; an hour is as good as never.
            let deadline = self.mind.next_deadline().unwrap_or(self.now() + Duration::from_secs(3600));
            let deadline = self.nodes.deadline().into_iter().chain([self.began + deadline]).min();
            let deadline = tokio::time::Instant::from_std(deadline.unwrap_or_else(Instant::now));
            let event = tokio::select! {
                Some((incarnation, exit)) = self.exits.recv() => self.gone(incarnation, exit),
                Some((ready, _)) = self.ready.next() => serves(ready),
                Some((health, _)) = self.health.next() => lives(health),
                Some((ready, _)) = self.newcomers_ready.next() => self.stands_by(ready),
                Some((health, _)) = self.newcomers_health.next() => lives(health),
                Some(event) = self.outcomes.recv() => event,
                Some(seen) = self.alive.recv() => Event::Seen { instance: seen.instance, alive: seen.alive },
                Some(placed) = self.placed.recv() => self.nodes.placed(placed),
                Some((heard, _)) = self.node_logs.next() => {
                    self.heard_lines(&heard);
                    Event::Tick
                }
                Some(request) = self.requests.recv() => {
                    happened.extend(self.answer(request));
                    continue;
                }
                _ = interrupt.recv() => self.asked_to_stop(),
                _ = terminate.recv() => self.asked_to_stop(),
                _ = hang_up.recv() => self.asked_to_stop(),
                () = tokio::time::sleep_until(deadline) => Event::Tick,
            };
            happened.push_back(event);
            happened.extend(self.leases());
        };
        self.close(outcome).await
    }

    async fn close(self, outcome: Outcome) -> Result<Outcome, Failure> {
        let Self { stack, bus, console, writer, logs, _serving: serving, _lock: lock, .. } = self;
        drop(serving);
        bus.close().await;
        forget(&stack.session)?;
        drop((console, logs));
        writer.flush();
        // Last: who waits for the end of the session waits for the lock.
        drop(lock);
        Ok(outcome)
    }

    fn now(&self) -> Time {
        self.began.elapsed()
    }

    fn asked_to_stop(&self) -> Event {
        if self.mind.is_stopping() {
            self.console.tell("stopping at once".to_owned());
            return Event::Kill;
        }
        self.console.detail("stopping; once more to stop at once".to_owned());
        Event::Down
    }

    fn stands_by(&mut self, ready: Ready) -> Event {
        // Only of those that were started here: what others say of themselves would stay for ever.
        let here = self.pids.values().any(|(_, instance)| *instance == ready.instance);
        if here || self.nodes.is_of(&ready.instance) {
            self.newcomers.insert(ready.instance.clone(), ready.clone());
        }
        serves(ready)
    }

    fn gone(&mut self, incarnation: Incarnation, exit: Exit) -> Event {
        if let Some((pid, instance)) = self.pids.remove(&incarnation) {
            self.roster.remove(pid);
            self.newcomers.remove(&instance);
        }
        Event::Exited { incarnation, exit }
    }
}

fn serves(ready: Ready) -> Event {
    Event::Ready { instance: ready.instance, start_ms: ready.start_ms, standby: ready.standby }
}

fn lives(health: Health) -> Event {
    let answer_ms = (health.answer_ms, health.answer_ms_p99);
    Event::Health { instance: health.instance, memory_bytes: health.memory_bytes, answer_ms }
}
