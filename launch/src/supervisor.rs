//! The supervisor's body: turns what [`sg_launch::reconcile`] wants into processes, and what happens into its events.

use std::collections::{HashMap, VecDeque};
use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use sg_launch::document::suggestion;
use sg_launch::file::{LaunchFile, Service};
use sg_launch::reconcile::{Action, Desired, Event, Exit, Incarnation, Outcome, Reconciler, Time};
use sg_proto::bus::{Health, Ready};
use sg_proto::keys::{self, role};
use sg_proto::launch::{DownReply, PsReply, RestartReply, Service as ServiceMessage, ServiceEvent, ServiceState};
use sg_runtime::bus::{Bus, Following, Liveliness, Serving};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::session::SessionDir;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::{mpsc, oneshot};

use crate::children::{self, Order};
use crate::console::{self, Console, ServiceLog, Verbosity, Writer};
use crate::leftovers::Roster;
use crate::logs::{self, LogFile};
use crate::terminal::{Failure, Ink, paint, time};

/// Requests, exits and signs of life that may wait.
const CAPACITY: usize = 256;
/// How long the lock of a session is tried for: who only looks whether it is held holds it for a moment too.
const LOCK_TIME: Duration = Duration::from_millis(300);

/// What is to be supervised.
#[derive(Debug)]
pub(crate) struct Stack {
    pub(crate) file: LaunchFile,
    /// The launch file, for people.
    pub(crate) path: PathBuf,
    pub(crate) session: SessionDir,
    pub(crate) verbosity: Verbosity,
}

enum Request {
    Ps(oneshot::Sender<PsReply>),
    Restart(String, oneshot::Sender<Result<RestartReply, Fault>>),
    Down,
}

/// A way to speak to a supervisor in the same process.
#[derive(Debug, Clone)]
pub(crate) struct Handle(mpsc::Sender<Request>);

impl Handle {
    /// Begins an orderly stop.
    pub(crate) async fn down(&self) {
        // A supervisor that no longer listens is stopping.
        let _ = self.0.send(Request::Down).await;
    }
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
    alive: mpsc::Receiver<Liveliness>,
    exits: mpsc::Receiver<(Incarnation, Exit)>,
    exit_sender: mpsc::Sender<(Incarnation, Exit)>,
    pids: HashMap<Incarnation, u32>,
    logs: Vec<ServiceLog>,
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
        let bus = Bus::route(session.name(), role::SUPERVISOR, &session.socket()).await?;
        let folder = session.logs();
        std::fs::create_dir_all(&folder).map_err(|e| Failure::Work(format!("{}: {e}", folder.display())))?;

        let (sender, requests) = mpsc::channel(CAPACITY);
        let serving = serve(&bus, &sender).await?;
        let ready = bus.follow(&keys::READY, keys::ANY, CAPACITY).await?;
        let health = bus.follow(&keys::HEALTH, keys::ANY, CAPACITY).await?;
        let alive = bus.watch_alive(CAPACITY).await?;
        let (exit_sender, exits) = mpsc::channel(CAPACITY);
        let (console, writer) = Console::open(stack.verbosity);
        let logs = service_logs(&stack.file.services, &folder, &console);
        let mind = Reconciler::new(desired(&stack.file.services), u64::from(std::process::id()));
        Ok(Self {
            endpoint: session.endpoint(),
            stack,
            mind,
            began: Instant::now(),
            bus,
            requests,
            handle: Handle(sender),
            ready,
            health,
            alive,
            exits,
            exit_sender,
            pids: HashMap::new(),
            logs,
            console,
            writer,
            roster,
            all_ready_told: false,
            _serving: serving,
            _lock: lock,
        })
    }

    /// A way to speak to it.
    pub(crate) fn handle(&self) -> Handle {
        self.handle.clone()
    }

    /// Starts the services and watches them until the stack is down. To be polled on a thread that lives as long as the
    /// process: see [`children::start`].
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
            let deadline = tokio::time::Instant::from_std(self.began + deadline);
            let event = tokio::select! {
                Some((incarnation, exit)) = self.exits.recv() => self.gone(incarnation, exit),
                Some((ready, _)) = self.ready.next() => Event::Ready { instance: ready.instance, start_ms: ready.start_ms },
                Some((health, _)) = self.health.next() => {
                    Event::Health { instance: health.instance, memory_bytes: health.memory_bytes }
                }
                Some(seen) = self.alive.recv() => Event::Seen { instance: seen.instance, alive: seen.alive },
                Some(request) = self.requests.recv() => self.answer(request),
                _ = interrupt.recv() => self.asked_to_stop(),
                _ = terminate.recv() => self.asked_to_stop(),
                _ = hang_up.recv() => self.asked_to_stop(),
                () = tokio::time::sleep_until(deadline) => Event::Tick,
            };
            happened.push_back(event);
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

    fn answer(&self, request: Request) -> Event {
        match request {
            Request::Ps(reply) => {
                let ps = PsReply {
                    session: self.stack.session.name().to_owned(),
                    launch_file: self.stack.path.display().to_string(),
                    pid: std::process::id(),
                    services: self.mind.services(self.now()),
                };
                // Whoever asked may have given up.
                let _ = reply.send(ps);
                Event::Tick
            }
            Request::Restart(name, reply) => {
                let known = self.mind.position(&name);
                let outcome = match known.and_then(|s| self.mind.service(s, self.now())) {
                    _ if self.mind.is_stopping() => Err(Fault::precondition("the stack is stopping")),
                    Some(service) => Ok(RestartReply { old_pid: service.pid }),
                    None => {
                        let names: Vec<_> = self.stack.file.services.iter().map(|s| s.name.as_str()).collect();
                        let hint = suggestion(&name, names.iter().copied());
                        Err(Fault::not_found(format!("no service `{name}`{hint}")))
                    }
                };
                let _ = reply.send(outcome);
                known.map_or(Event::Tick, |service| Event::Restart { service })
            }
            Request::Down => Event::Down,
        }
    }

    fn gone(&mut self, incarnation: Incarnation, exit: Exit) -> Event {
        if let Some(pid) = self.pids.remove(&incarnation) {
            self.roster.remove(pid);
        }
        Event::Exited { incarnation, exit }
    }

    /// Does what is wanted; what comes of it at once is returned.
    async fn act(&mut self, action: Action) -> Option<Event> {
        match action {
            Action::Spawn { service, incarnation, instance } => Some(self.spawn(service, incarnation, &instance)),
            Action::Terminate(incarnation) => self.signal(incarnation, Signal::SIGTERM),
            Action::Kill(incarnation) => self.signal(incarnation, Signal::SIGKILL),
            Action::Announce { service } => {
                self.announce(service).await;
                None
            }
            // What ended has been told by the state that its service entered.
            Action::Ended { .. } | Action::Finish(_) => None,
        }
    }

    fn spawn(&mut self, index: usize, incarnation: Incarnation, instance: &str) -> Event {
        let (Some(service), Some(log)) = (self.stack.file.services.get(index), self.logs.get(index)) else {
            let reason = "no such service".to_owned();
            return Event::Exited { incarnation, exit: Exit { status: None, reason } };
        };
        let order = Order {
            incarnation,
            executable: service.executable.clone(),
            arguments: arguments(service, instance, &self.stack.session, &self.endpoint),
            env: service.policy.env.clone(),
        };
        match children::start(order, log.clone(), self.exit_sender.clone()) {
            Ok(pid) => {
                self.pids.insert(incarnation, pid);
                self.roster.add(pid);
                Event::Started { incarnation, pid }
            }
            Err(error) => {
                let reason = format!("{} cannot be started: {error}", service.executable.display());
                Event::Exited { incarnation, exit: Exit { status: None, reason } }
            }
        }
    }

    fn signal(&self, incarnation: Incarnation, signal: Signal) -> Option<Event> {
        let pid = *self.pids.get(&incarnation)?;
        if let Err(error) = children::signal(pid, signal) {
            self.console.tell(format!("{signal} could not be sent to process {pid}: {error}"));
        }
        None
    }

    async fn announce(&mut self, index: usize) {
        let Some(service) = self.mind.service(index, self.now()) else { return };
        self.tell(&service);
        let event = ServiceEvent { service: Some(service) };
        // Nobody need listen, and the state can be asked for.
        let _ = self.bus.publish(&keys::SERVICE, &event, &Context::root()).await;
        if !self.all_ready_told {
            let services = self.mind.services(self.now());
            if services.iter().all(|s| s.state() == ServiceState::Ready) {
                self.all_ready_told = true;
                let after = time(self.now().as_secs_f64() * 1000.0);
                let name = self.stack.session.name();
                self.console.detail(format!(
                    "all {} services ready after {after}; `supergaussian say \"help\" --session {name}` talks to them, Ctrl-C stops them",
                    services.len()
                ));
            }
        }
    }

    fn tell(&self, service: &ServiceMessage) {
        let colored = self.console.colored();
        let width = self.logs.first().map_or(0, |l| l.width);
        let name = format!("{:<width$}", service.name);
        let reason = &service.reason;
        let line = match service.state() {
            ServiceState::Ready => {
                let mark = paint(Ink::Green, "ready", colored);
                let again =
                    if service.restarts > 0 { format!("  restart {}", service.restarts) } else { String::new() };
                let row =
                    format!("  {name}  {mark} after {:>8}  pid {}{again}", time(service.start_ms as f64), service.pid);
                return if service.restarts > 0 { self.console.tell(row) } else { self.console.detail(row) };
            }
            ServiceState::Failed => format!("  {name}  {}: {reason}", paint(Ink::Red, "FAILED", colored)),
            ServiceState::Backoff => format!("  {name}  {}: {reason}; restarting", paint(Ink::Yellow, "down", colored)),
            ServiceState::Stopping if !reason.starts_with("asked") => {
                format!("  {name}  {}: {reason}", paint(Ink::Yellow, "stopping", colored))
            }
            ServiceState::Stopping => return self.console.detail(format!("  {name}  stopping")),
            ServiceState::Stopped => return self.console.detail(format!("  {name}  {reason}")),
            ServiceState::Waiting | ServiceState::Starting | ServiceState::Unspecified => return,
        };
        self.console.tell(line);
    }
}

/// The arguments of a service's process (`sg_runtime::process::ServeArgs`).
fn arguments(service: &Service, instance: &str, session: &SessionDir, endpoint: &str) -> Vec<String> {
    let params = serde_json::Value::Object(service.params.clone()).to_string();
    let run_dir = session.path().display().to_string();
    let supervisor = std::process::id().to_string();
    // A little less than the time until the kill: what is left is for leaving.
    let grace = service.policy.stop.mul_f64(0.8).as_millis().to_string();
    [
        ("--session", session.name()),
        ("--role", &service.role),
        ("--instance", instance),
        ("--connect", endpoint),
        ("--run-dir", &run_dir),
        ("--params", &params),
        ("--supervisor-pid", &supervisor),
        ("--grace-ms", &grace),
    ]
    .into_iter()
    .fold(vec!["serve".to_owned()], |mut arguments, (name, value)| {
        arguments.extend([name.to_owned(), value.to_owned()]);
        arguments
    })
}

fn desired(services: &[Service]) -> Vec<Desired> {
    let position = |name: &String| services.iter().position(|s| s.name == *name);
    services
        .iter()
        .map(|s| Desired {
            name: s.name.clone(),
            role: s.role.clone(),
            after: s.after.iter().filter_map(position).collect(),
            policy: s.policy.clone(),
        })
        .collect()
}

fn service_logs(services: &[Service], folder: &Path, console: &Console) -> Vec<ServiceLog> {
    let width = services.iter().map(|s| s.name.len()).max().unwrap_or(0);
    services
        .iter()
        .enumerate()
        .map(|(i, service)| ServiceLog {
            service: service.name.clone(),
            width,
            ink: console::ink_of(i),
            file: Arc::new(Mutex::new(LogFile::begin(logs::path_of(folder, &service.name)))),
            console: console.clone(),
        })
        .collect()
}

async fn serve(bus: &Bus, requests: &mpsc::Sender<Request>) -> Result<Vec<Serving>, Failure> {
    let stopping = || Fault::unavailable("the supervisor is stopping");
    let sender = requests.clone();
    let ps = bus.serve(&keys::PS, CAPACITY, move |_, _| {
        let sender = sender.clone();
        async move {
            let (reply, answer) = oneshot::channel();
            sender.send(Request::Ps(reply)).await.map_err(|_| stopping())?;
            answer.await.map_err(|_| stopping())
        }
    });
    let sender = requests.clone();
    let restart = bus.serve(&keys::RESTART, CAPACITY, move |request, _| {
        let sender = sender.clone();
        async move {
            let (reply, answer) = oneshot::channel();
            sender.send(Request::Restart(request.service, reply)).await.map_err(|_| stopping())?;
            answer.await.map_err(|_| stopping())?
        }
    });
    let sender = requests.clone();
    let down = bus.serve(&keys::DOWN, CAPACITY, move |_, _| {
        let sender = sender.clone();
        async move {
            sender.send(Request::Down).await.map_err(|_| stopping())?;
            Ok(DownReply {})
        }
    });
    Ok(vec![ps.await?, restart.await?, down.await?])
}

/// Takes the session's lock and writes this process's id into it. The system gives it back when this process dies.
async fn lock(session: &SessionDir) -> Result<File, Failure> {
    let path = session.lock_file();
    let fail = |e: io::Error| Failure::Work(format!("{}: {e}", path.display()));
    let mut file = File::options().read(true).write(true).create(true).truncate(false).open(&path).map_err(fail)?;
    let began = Instant::now();
    loop {
        match file.try_lock() {
            Ok(()) => break,
            Err(TryLockError::WouldBlock) if began.elapsed() < LOCK_TIME => {
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
            Err(TryLockError::WouldBlock) => {
                let name = session.name();
                let pid = std::fs::read_to_string(&path).unwrap_or_default();
                return Err(Failure::Work(format!(
                    "session `{name}` runs already (supervisor {}); stop it with `supergaussian down --session {name}` or name this one with --session",
                    pid.trim()
                )));
            }
            Err(TryLockError::Error(error)) => return Err(fail(error)),
        }
    }
    file.set_len(0).and_then(|()| writeln!(file, "{}", std::process::id())).map_err(fail)?;
    Ok(file)
}

/// Removes what only makes sense while a session runs: its socket and its pictures.
fn forget(session: &SessionDir) -> Result<(), Failure> {
    let absent = |e: &io::Error| e.kind() == io::ErrorKind::NotFound;
    let socket = session.socket();
    let blobs = session.path().join("blobs");
    for (path, removed) in [(&socket, std::fs::remove_file(&socket)), (&blobs, std::fs::remove_dir_all(&blobs))] {
        if let Err(error) = removed
            && !absent(&error)
        {
            return Err(Failure::Work(format!("{}: {error}", path.display())));
        }
    }
    Ok(())
}
