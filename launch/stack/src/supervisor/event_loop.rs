//! The supervisor's event loop: turns the reconciler's actions into processes, and observations into its events.

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::path::PathBuf;
use std::process::Child;
use std::sync::Arc;
use std::task::{self, Poll, Waker};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use sg_proto::bus::{Health, Ready};
use sg_proto::keys::{self, role};
use sg_proto::launch::LogLines;
use sg_runtime::actor::{Inbox, mailbox};
use sg_runtime::bus::{Bus, LivelinessChange, ServerHandle, Subscription};
use sg_runtime::context::Context;
use sg_runtime::metrics;
use sg_runtime::session::SessionDir;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::{Semaphore, mpsc, watch};

use super::attempt::Attempt;
use super::awake_clock::{AwakeClock, TURN};
use super::nodes::{self, Nodes, StartResult};
use super::opener::{MAX_OPEN, SessionOpener};
use super::requests::{CAPACITY, Handle, MAX_SAVES, Request, serve};
use super::session_lock::{forget, lock};
use crate::console::{Console, ServiceLog, Verbosity, Writer};
use crate::descendants;
use crate::error::StackError;
use crate::file::LaunchFile;
use crate::log_file::{self, LogFile};
use crate::params_file;
use crate::pid_registry::PidRegistry;
use crate::reconcile::{Action, Event, Exit, Outcome, ProcessId, Reconciler, Time};
use crate::run_folder::Cleaner;
use crate::service_manager::ServiceManager;
use crate::service_rights;

/// Key part that matches every candidate in standby, in place of a role.
const STANDING_BY: &str = "@instance/*";

/// Most observations of one turn. Beyond that, deadlines are judged before the next one.
const MOST_AT_ONCE: usize = 1024;

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
    pub(super) clock: AwakeClock,
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
    outcomes: mpsc::Receiver<Attempt>,
    pub(super) outcome_sender: mpsc::Sender<Attempt>,
    alive: mpsc::Receiver<LivelinessChange>,
    exits: mpsc::Receiver<(ProcessId, Exit)>,
    pub(super) exit_sender: mpsc::Sender<(ProcessId, Exit)>,
    /// Nodes and their processes.
    pub(super) nodes: Nodes,
    placed: mpsc::Receiver<StartResult>,
    node_logs: Subscription<LogLines>,
    /// Limits the sessions that are opened from this one.
    pub(super) open_slots: Arc<Semaphore>,
    /// Limits the files that are written at a time.
    pub(super) save_slots: Arc<Semaphore>,
    /// Process id and instance of all processes on this machine.
    pub(super) pids: HashMap<ProcessId, (u32, String)>,
    /// By service.
    pub(super) logs: HashMap<String, ServiceLog>,
    pub(super) width: usize,
    pub(super) console: Console,
    writer: Writer,
    pub(super) registry: PidRegistry,
    pub(super) all_ready_printed: bool,
    /// The first panic of this process.
    panicked: watch::Receiver<Option<String>>,
    /// The session's scene, which services may read.
    pub(super) scene: Option<PathBuf>,
    /// The service manager that started this process.
    pub(super) manager: ServiceManager,
    /// Clears what dead processes leave in the session's folder.
    cleaner: Cleaner,
    /// The panic that ends this process.
    panic: Option<String>,
    /// Kills the children of services if this process is killed.
    _reaper: Child,
    _serving: Vec<ServerHandle>,
    _lock: File,
}

/// One thing that the event loop has received.
enum Observation {
    Exit(ProcessId, Exit),
    Ready(Ready, Context),
    CandidateReady(Ready, Context),
    Health(Health, Context),
    Outcome(Attempt),
    Presence(LivelinessChange),
    Placed(StartResult),
    NodeLog(LogLines, Context),
    Request(Request),
    Stop,
    StopSignal,
    Panic(String),
}

/// Signals that stop a stack.
struct StopSignals([Signal; 3]);

impl StopSignals {
    fn watch() -> Result<Self, StackError> {
        let watch = |kind| signal(kind).map_err(StackError::Signals);
        Ok(Self([watch(SignalKind::interrupt())?, watch(SignalKind::terminate())?, watch(SignalKind::hangup())?]))
    }

    async fn recv(&mut self) {
        let [interrupt, terminate, hang_up] = &mut self.0;
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
            _ = hang_up.recv() => {}
        }
    }
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
        let nodes = Nodes::new(&stack.file.nodes, nodes::revoked(&stack.file), placed_sender);
        let alive = bus.watch_liveliness(CAPACITY).await?;
        let (exit_sender, exits) = mpsc::channel(CAPACITY);
        let (outcome_sender, outcomes) = mpsc::channel(CAPACITY);
        let cleaner = Cleaner::new(session.path());
        let reaper = descendants::start_reaper().map_err(StackError::Reaper)?;
        let (console, writer) =
            Console::open(stack.verbosity, LogFile::create(log_file::path_of(&folder, role::SUPERVISOR)));
        let width = stack.file.services.iter().map(|s| s.name.len()).max().unwrap_or(0);
        // From the time of day and the last run, so that epochs also grow across supervisors.
        let epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_millis();
        let epoch = u64::try_from(epoch).unwrap_or(u64::MAX).max(registry.epoch());
        let reconciler = Reconciler::new(stack.file.services.clone(), u64::from(std::process::id()), epoch);
        let mut supervisor = Self {
            endpoint: session.endpoint(),
            scene: service_rights::scene_of(&stack.file.services),
            manager: ServiceManager::of_environment(),
            stack,
            reconciler,
            clock: AwakeClock::new(),
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
            save_slots: Arc::new(Semaphore::new(MAX_SAVES)),
            pids: HashMap::new(),
            logs: HashMap::new(),
            width,
            console,
            writer,
            registry,
            all_ready_printed: false,
            panicked: sg_runtime::process::report_panics(),
            cleaner,
            panic: None,
            _reaper: reaper,
            _serving: serving,
            _lock: lock,
        };
        descendants::adopt();
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
        let mut signals = StopSignals::watch()?;
        self.console.print_detail(format!(
            "session {} · {} · {} services · {}",
            self.stack.session.name(),
            self.stack.path.display(),
            self.stack.file.services.len(),
            self.stack.session.path().display()
        ));
        self.print_confinement();
        self.print_revoked();
        let mut received = None;
        let outcome = 'watching: loop {
            let mut events = VecDeque::from_iter(self.begin_turn());
            // Take in everything that waits before a deadline is judged: a sign of life may be among it.
            for _ in 0..MOST_AT_ONCE {
                while let Some(event) = events.pop_front() {
                    let actions = self.reconciler.observe(event, self.now());
                    if let Some(outcome) = self.perform_all(actions, &mut events).await {
                        break 'watching outcome;
                    }
                }
                let Some(observation) = received.take().or_else(|| self.waiting(&mut signals)) else { break };
                events.extend(self.take_in(observation));
            }
            events.extend(self.expired_leases());
            self.cleaner.clean_if_due(|| self.pids.values().map(|(_, instance)| instance.clone()).collect());
            events.push_back(Event::Tick);
            while let Some(event) = events.pop_front() {
                let actions = self.reconciler.step(event, self.now());
                if let Some(outcome) = self.perform_all(actions, &mut events).await {
                    break 'watching outcome;
                }
            }
            self.tell_service_manager();
            let pause = self.pause();
            received = tokio::time::timeout(pause, self.next_observation(&mut signals)).await.ok();
        };
        self.close(outcome).await
    }

    /// Begins a turn of the event loop. Tells of a gap in which this supervisor did not run.
    fn begin_turn(&mut self) -> Option<Event> {
        let gap = self.clock.turn()?;
        self.console.print_detail(format!(
            "the supervisor did not run for {:.1} s: it was stopped, or the machine is overloaded; the services get that time too",
            gap.as_secs_f64()
        ));
        Some(Event::Awoke(gap))
    }

    /// Time until the next turn. Turns are frequent, so that the clock notices a gap.
    fn pause(&self) -> Duration {
        let deadline = self.reconciler.next_deadline().map(|deadline| deadline.saturating_sub(self.now()));
        let lease = self.nodes.deadline().map(|deadline| self.clock.until(deadline));
        deadline.into_iter().chain(lease).min().map_or(TURN, |pause| pause.min(TURN))
    }

    /// An observation that waits already.
    fn waiting(&mut self, signals: &mut StopSignals) -> Option<Observation> {
        // Unconstrained: the budget of a task would end before a long queue does.
        let mut next = std::pin::pin!(tokio::task::unconstrained(self.next_observation(signals)));
        match next.as_mut().poll(&mut task::Context::from_waker(Waker::noop())) {
            Poll::Ready(observation) => Some(observation),
            Poll::Pending => None,
        }
    }

    /// Waits for an observation. Safe to cancel: none is lost.
    async fn next_observation(&mut self, signals: &mut StopSignals) -> Observation {
        let (panicked, known) = (&mut self.panicked, self.panic.is_some());
        let panic = async move {
            match panicked.wait_for(Option::is_some).await {
                Ok(text) if !known => text.clone().unwrap_or_default(),
                // Only the first one counts.
                _ => std::future::pending().await,
            }
        };
        tokio::select! {
            Some((id, exit)) = self.exits.recv() => Observation::Exit(id, exit),
            Some((ready, context)) = self.ready.next() => Observation::Ready(ready, context),
            Some((health, context)) = self.health.next() => Observation::Health(health, context),
            Some((ready, context)) = self.candidates_ready.next() => Observation::CandidateReady(ready, context),
            Some((health, context)) = self.candidates_health.next() => Observation::Health(health, context),
            Some(attempt) = self.outcomes.recv() => Observation::Outcome(attempt),
            Some(seen) = self.alive.recv() => Observation::Presence(seen),
            Some(placed) = self.placed.recv() => Observation::Placed(placed),
            Some((message, context)) = self.node_logs.next() => Observation::NodeLog(message, context),
            Some(request) = self.requests.recv() => Observation::Request(request),
            () = self.handle.stop_requested() => Observation::Stop,
            () = signals.recv() => Observation::StopSignal,
            text = panic => Observation::Panic(text),
        }
    }

    /// Turns an observation into events.
    fn take_in(&mut self, observation: Observation) -> Vec<Event> {
        let event = match observation {
            Observation::Exit(id, exit) => self.process_exited(id, exit),
            Observation::Ready(ready, context) => self.ready_event(ready, &context),
            Observation::CandidateReady(ready, context) => self.candidate_ready(ready, &context),
            Observation::Health(health, context) => self.health_event(health, &context),
            Observation::Outcome(attempt) => return self.conclude(attempt).into_iter().collect(),
            Observation::Presence(seen) => self.presence_event(seen),
            Observation::Placed(placed) => self.nodes.start_finished(placed),
            Observation::NodeLog(message, context) => {
                self.log_remote_lines(&message, &context);
                return Vec::new();
            }
            Observation::Request(request) => return self.answer(request),
            Observation::Stop => Event::Down,
            Observation::StopSignal => self.stop_event(),
            Observation::Panic(text) => {
                // A worker of this process is gone. Without it the stack cannot be served.
                self.console.print(text.clone());
                self.panic = Some(text);
                Event::Down
            }
        };
        vec![event]
    }

    /// Performs actions. Returns the outcome once the stack has ended.
    async fn perform_all(&mut self, actions: Vec<Action>, events: &mut VecDeque<Event>) -> Option<Outcome> {
        for action in actions {
            match action {
                Action::Finish(outcome) => return Some(outcome),
                action => events.extend(self.perform(action).await),
            }
        }
        None
    }

    async fn close(self, outcome: Outcome) -> Result<Outcome, StackError> {
        let Self { stack, bus, console, writer, logs, panic, _serving: serving, _lock: lock, .. } = self;
        drop(serving);
        bus.close().await;
        forget(&stack.session)?;
        drop((console, logs));
        writer.flush();
        // Last, because other commands wait for the lock.
        drop(lock);
        panic.map_or(Ok(outcome), |text| Err(StackError::Panicked(text)))
    }

    pub(super) fn now(&self) -> Time {
        self.clock.now()
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
            params_file::remove(self.stack.session.path(), &instance);
        }
        Event::Exited { id, exit }
    }

    /// Events for nodes whose lease has run out, and for processes that a node does not end.
    fn expired_leases(&mut self) -> VecDeque<Event> {
        let away = self.nodes.expired(self.clock.instant());
        for name in &away {
            self.console.print(format!("  node {name} does not answer; its services start again when it returns"));
        }
        let overdue = self.nodes.overdue(self.clock.instant());
        away.into_iter().map(|name| Event::Node { name, present: false }).chain(overdue).collect()
    }
}
