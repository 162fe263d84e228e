//! The supervisor's event loop: turns the reconciler's actions into processes, and observations into its events.

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use sg_proto::bus::{Health, Ready};
use sg_proto::keys::{self, role};
use sg_proto::launch::LogLines;
use sg_runtime::actor::{Inbox, mailbox};
use sg_runtime::bus::{Bus, LivelinessChange, ServerHandle, Subscription};
use sg_runtime::metrics;
use sg_runtime::session::SessionDir;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::{Semaphore, mpsc};

use super::nodes::{self, Nodes, StartResult};
use super::opener::{MAX_OPEN, SessionOpener};
use super::requests::{CAPACITY, Handle, Request, serve};
use super::session_lock::{forget, lock};
use crate::console::{Console, ServiceLog, Verbosity, Writer};
use crate::error::StackError;
use crate::file::LaunchFile;
use crate::pid_registry::PidRegistry;
use crate::reconcile::{Action, Event, Exit, Outcome, ProcessId, Reconciler, Time};

/// Key part that matches every candidate in standby, in place of a role.
const STANDING_BY: &str = "@instance/*";

/// The stack to supervise.
pub struct Stack {
    /// The launch file.
    pub file: LaunchFile,
    /// Path of the launch file, for people.
    pub path: PathBuf,
    /// The session.
    pub session: SessionDir,
    /// How much the supervisor writes to its terminal.
    pub verbosity: Verbosity,
    /// Prepares commands for requests to open another scene or volume.
    pub opener: Box<dyn SessionOpener>,
}

/// An open session: locked, with its router, without processes.
pub struct Supervisor {
    pub(super) stack: Stack,
    pub(super) reconciler: Reconciler,
    began: Instant,
    pub(super) bus: Bus,
    pub(super) endpoint: String,
    requests: Inbox<Request>,
    handle: Handle,
    ready: Subscription<Ready>,
    health: Subscription<Health>,
    candidates_ready: Subscription<Ready>,
    candidates_health: Subscription<Health>,
    /// Announcements of candidates, by instance.
    pub(super) candidates: HashMap<String, Ready>,
    /// Results of probes and promotions.
    outcomes: mpsc::Receiver<Event>,
    pub(super) outcome_sender: mpsc::Sender<Event>,
    alive: mpsc::Receiver<LivelinessChange>,
    exits: mpsc::Receiver<(ProcessId, Exit)>,
    pub(super) exit_sender: mpsc::Sender<(ProcessId, Exit)>,
    /// Nodes and their processes.
    pub(super) nodes: Nodes,
    placed: mpsc::Receiver<StartResult>,
    node_logs: Subscription<LogLines>,
    /// Limits the sessions that are opened from this one.
    pub(super) open_slots: Arc<Semaphore>,
    /// Process id and instance of all processes on this machine.
    pub(super) pids: HashMap<ProcessId, (u32, String)>,
    /// By service.
    pub(super) logs: HashMap<String, ServiceLog>,
    pub(super) width: usize,
    pub(super) console: Console,
    writer: Writer,
    pub(super) registry: PidRegistry,
    pub(super) all_ready_printed: bool,
    _serving: Vec<ServerHandle>,
    _lock: File,
}

impl Supervisor {
    /// Opens the session: its folder, its lock, its router, its logs.
    ///
    /// # Errors
    /// The session runs already, or a folder or the socket cannot be created.
    pub async fn open(stack: Stack) -> Result<Self, StackError> {
        let session = stack.session.clone();
        session.create()?;
        let lock = lock(&session).await?;
        let registry = PidRegistry::open(session.path()).await?;
        // A supervisor that died leaves its socket and unused pictures.
        forget(&session)?;
        metrics::install(role::SUPERVISOR, session.name());
        let bus =
            Bus::open_router(session.name(), role::SUPERVISOR, &session.socket(), nodes::listen(&stack.file).as_ref())
                .await?;
        let folder = session.logs();
        std::fs::create_dir_all(&folder).map_err(|e| StackError::io(&folder, e))?;

        let (mailbox, requests) = mailbox(role::SUPERVISOR, CAPACITY);
        let handle = Handle::default();
        let serving = serve(&bus, &mailbox, &handle).await?;
        let ready = bus.subscribe(&keys::READY, keys::ANY, CAPACITY).await?;
        let health = bus.subscribe(&keys::HEALTH, keys::ANY, CAPACITY).await?;
        let candidates_ready = bus.subscribe(&keys::READY, STANDING_BY, CAPACITY).await?;
        let candidates_health = bus.subscribe(&keys::HEALTH, STANDING_BY, CAPACITY).await?;
        let node_logs = bus.subscribe(&keys::NODE_LOG, STANDING_BY, CAPACITY).await?;
        let (placed_sender, placed) = mpsc::channel(CAPACITY);
        let nodes = Nodes::new(&stack.file.nodes, placed_sender);
        let alive = bus.watch_liveliness(CAPACITY).await?;
        let (exit_sender, exits) = mpsc::channel(CAPACITY);
        let (outcome_sender, outcomes) = mpsc::channel(CAPACITY);
        let (console, writer) = Console::open(stack.verbosity);
        let width = stack.file.services.iter().map(|s| s.name.len()).max().unwrap_or(0);
        // From the clock, so that epochs also grow across supervisors.
        let epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_millis();
        let epoch = u64::try_from(epoch).unwrap_or(u64::MAX);
        let reconciler = Reconciler::new(stack.file.services.clone(), u64::from(std::process::id()), epoch);
        let mut supervisor = Self {
            endpoint: session.endpoint(),
            stack,
            reconciler,
            began: Instant::now(),
            bus,
            requests,
            handle,
            ready,
            health,
            candidates_ready,
            candidates_health,
            candidates: HashMap::new(),
            outcomes,
            outcome_sender,
            alive,
            exits,
            exit_sender,
            nodes,
            placed,
            node_logs,
            open_slots: Arc::new(Semaphore::new(MAX_OPEN)),
            pids: HashMap::new(),
            logs: HashMap::new(),
            width,
            console,
            writer,
            registry,
            all_ready_printed: false,
            _serving: serving,
            _lock: lock,
        };
        // Rotate the logs of all services, started or not.
        for index in 0..supervisor.stack.file.services.len() {
            supervisor.log(index);
        }
        Ok(supervisor)
    }

    /// A handle for requests from the same process.
    pub fn handle(&self) -> Handle {
        self.handle.clone()
    }

    /// Starts the services and supervises them until the stack is down. Poll it on a thread that lives as long as the
    /// process: see [`crate::spawn::tied_to_parent`].
    ///
    /// # Errors
    /// The system's signals cannot be received.
    pub async fn run(mut self) -> Result<Outcome, StackError> {
        let watch = |kind| signal(kind).map_err(StackError::Signals);
        let mut interrupt = watch(SignalKind::interrupt())?;
        let mut terminate = watch(SignalKind::terminate())?;
        let mut hang_up = watch(SignalKind::hangup())?;
        self.console.print_detail(format!(
            "session {} · {} · {} services · {}",
            self.stack.session.name(),
            self.stack.path.display(),
            self.stack.file.services.len(),
            self.stack.session.path().display()
        ));
        let mut events = VecDeque::from([Event::Tick]);
        let outcome = 'watching: loop {
            while let Some(event) = events.pop_front() {
                let now = self.now();
                for action in self.reconciler.step(event, now) {
                    match action {
                        Action::Finish(outcome) => break 'watching outcome,
                        action => events.extend(self.perform(action).await),
                    }
                }
            }
            // Without a deadline only an event changes the state. An hour stands for never.
            let deadline = self.reconciler.next_deadline().unwrap_or(self.now() + Duration::from_secs(3600));
            let deadline = self.nodes.deadline().into_iter().chain([self.began + deadline]).min();
            let deadline = tokio::time::Instant::from_std(deadline.unwrap_or_else(Instant::now));
            let event = tokio::select! {
                Some((id, exit)) = self.exits.recv() => self.process_exited(id, exit),
                Some((ready, context)) = self.ready.next() => self.ready_event(ready, &context),
                Some((health, context)) = self.health.next() => self.health_event(health, &context),
                Some((ready, context)) = self.candidates_ready.next() => self.candidate_ready(ready, &context),
                Some((health, context)) = self.candidates_health.next() => self.health_event(health, &context),
                Some(event) = self.outcomes.recv() => event,
                Some(seen) = self.alive.recv() => self.presence_event(seen),
                Some(placed) = self.placed.recv() => self.nodes.start_finished(placed),
                Some((message, context)) = self.node_logs.next() => {
                    self.log_remote_lines(&message, &context);
                    Event::Tick
                }
                Some(request) = self.requests.recv() => {
                    events.extend(self.answer(request));
                    continue;
                }
                () = self.handle.stop_requested() => Event::Down,
                _ = interrupt.recv() => self.stop_event(),
                _ = terminate.recv() => self.stop_event(),
                _ = hang_up.recv() => self.stop_event(),
                () = tokio::time::sleep_until(deadline) => Event::Tick,
            };
            events.push_back(event);
            events.extend(self.expired_leases());
        };
        self.close(outcome).await
    }

    async fn close(self, outcome: Outcome) -> Result<Outcome, StackError> {
        let Self { stack, bus, console, writer, logs, _serving: serving, _lock: lock, .. } = self;
        drop(serving);
        bus.close().await;
        forget(&stack.session)?;
        drop((console, logs));
        writer.flush();
        // Last, because other commands wait for the lock.
        drop(lock);
        Ok(outcome)
    }

    pub(super) fn now(&self) -> Time {
        self.began.elapsed()
    }

    fn stop_event(&self) -> Event {
        if self.reconciler.is_stopping() {
            self.console.print("stopping at once".to_owned());
            return Event::Kill;
        }
        self.console.print_detail("stopping; press Ctrl-C again to stop at once".to_owned());
        Event::Down
    }

    fn process_exited(&mut self, id: ProcessId, exit: Exit) -> Event {
        if let Some((pid, instance)) = self.pids.remove(&id) {
            self.registry.remove(pid);
            self.candidates.remove(&instance);
        }
        Event::Exited { id, exit }
    }

    /// Events for nodes whose lease has run out.
    fn expired_leases(&mut self) -> VecDeque<Event> {
        let away = self.nodes.expired(Instant::now());
        for name in &away {
            self.console.print(format!("  node {name} does not answer; its services start again when it returns"));
        }
        away.into_iter().map(|name| Event::Node { name, present: false }).collect()
    }
}
