//! A node: this machine runs services for a stack of another machine.
//!
//! The supervisor sends requests to start and signal processes. The node reports its processes once a second. If the
//! reports stay unanswered for the lease, the node ends all its processes, and the supervisor assumes the same. Time in
//! which this machine is suspended counts.

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::time::Duration;

use nix::sys::signal::Signal;
use sg_confinement::Support;
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::launch::{Ended, JoinReply, JoinRequest, LogLines, SignalReply, SignalRequest, StartReply, StartRequest};
use sg_runtime::actor::{Inbox, Mailbox, Reply, mailbox};
use sg_runtime::bus::{Bus, BusError, Link, ServerHandle};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::session::SessionDir;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;

use crate::boot_time::BootTime;
use crate::descendants;
use crate::error::StackError;
use crate::file::{Confinement, ExecutableSearch};
use crate::params_file;
use crate::pid_registry::PidRegistry;
use crate::reconcile::{Exit, ProcessId};
use crate::run_folder::Cleaner;
use crate::serve_arguments;
use crate::service_rights;
use crate::spawn::{self, LineSink, SpawnRequest};
use crate::terminal;

/// Time between two reports.
const REPORT_PERIOD: Duration = Duration::from_secs(1);
/// Longest time for an answer to a report.
const ANSWER: Duration = Duration::from_millis(1500);
/// Lease before the supervisor's first answer.
const LEASE: Duration = Duration::from_secs(5);
/// Pause between two attempts to connect.
const RETRY_PAUSE: Duration = Duration::from_secs(1);
/// Most requests, exits and answers that wait at a time.
const CAPACITY: usize = 64;
/// Most log lines that wait at a time. Further lines are dropped.
const LINES: usize = 4096;
/// Most lines of one message, and bytes of one line.
const LINES_AT_ONCE: usize = 200;
const LINE_BYTES: usize = 8 << 10;
/// Most processes at a time.
const PROCESSES: usize = 64;

/// How this machine joins a stack.
#[derive(Debug, Clone)]
pub struct NodeSettings {
    /// Name of the session.
    pub session: String,
    /// Name of this machine in the launch file.
    pub name: String,
    /// Endpoint of the stack, and the certificates of this machine.
    pub link: Link,
    /// How the kernel confines the services here.
    pub confinement: Confinement,
}

/// A request of the supervisor.
enum Request {
    Start(Box<StartRequest>, Reply<StartReply>),
    Signal(SignalRequest, Reply<SignalReply>),
}

/// The answer to a report.
struct ReportAnswer {
    sent: BootTime,
    /// Number of ended processes in the report.
    ended: usize,
    outcome: Result<JoinReply, Fault>,
}

/// Runs services for a stack of another machine, until a signal ends this process.
///
/// # Errors
/// [`StackError`] if the node cannot start, or the supervisor refuses it for good.
pub async fn run(settings: NodeSettings) -> Result<(), StackError> {
    let NodeSettings { session, name, link, confinement } = settings;
    let folder = SessionDir::for_node(&session, &name)?;
    folder.create()?;
    let lock = lock(&folder)?;
    params_file::remove_all(folder.path()).map_err(|e| StackError::io(folder.path(), e))?;
    descendants::adopt();
    let _reaper = descendants::start_reaper().map_err(StackError::Reaper)?;
    let registry = PidRegistry::open(folder.path()).await?;
    let blobs = folder.path().join("blobs");
    match std::fs::remove_dir_all(&blobs) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(StackError::io(&blobs, error)),
        _ => {}
    }
    let watch = |kind| signal(kind).map_err(StackError::Signals);
    let mut interrupt = watch(SignalKind::interrupt())?;
    let mut terminate = watch(SignalKind::terminate())?;
    terminal::print_status(&format!("node {name} · session {session} · {}", link.endpoint));
    match sg_confinement::support() {
        support @ Support::Version(_) if confinement.confined => {
            terminal::print_status(&format!("services are confined ({support})"));
        }
        Support::Version(_) => terminal::print_status("services are not confined: --unconfined"),
        missing => terminal::print_status(&format!("services are not confined: {missing}")),
    }
    let reached = tokio::select! {
        bus = connect(&session, &name, &link) => bus,
        _ = interrupt.recv() => return Ok(()),
        _ = terminate.recv() => return Ok(()),
    };
    let mut node = Node::new(reached, &name, (link, confinement), folder, registry).await?;
    let mut panicked = sg_runtime::process::report_panics();
    let outcome = tokio::select! {
        refused = node.run() => Err(refused),
        Ok(text) = panicked.wait_for(Option::is_some) => Err(StackError::Panicked(text.clone().unwrap_or_default())),
        _ = interrupt.recv() => Ok(()),
        _ = terminate.recv() => Ok(()),
    };
    node.shut_down().await;
    drop(lock);
    outcome
}

/// Takes the lock of this node's name. The system releases it when this process ends.
fn lock(folder: &SessionDir) -> Result<File, StackError> {
    let path = folder.path().join("node.lock");
    let fail = |e: std::io::Error| StackError::io(&path, e);
    let file = File::options().write(true).create(true).truncate(false).open(&path).map_err(fail)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(StackError::NodeRuns(path)),
        Err(TryLockError::Error(error)) => Err(fail(error)),
    }
}

/// Connects to the bus. Retries until the stack answers.
async fn connect(session: &str, name: &str, link: &Link) -> Bus {
    let instance = keys::node_instance(name);
    let mut last_problem = String::new();
    loop {
        // A node serves no role. It is addressed by its instance only.
        match Bus::connect_instance(session, role::NODE, &instance, 0, true, link.clone()).await {
            Ok(bus) => return bus,
            Err(error) => {
                let text = error.to_string();
                if text != last_problem {
                    terminal::print_status(&format!(
                        "{text}; check that the stack runs, that it listens there, and that the authority is the same; next try every {} s",
                        RETRY_PAUSE.as_secs()
                    ));
                    last_problem = text;
                }
                tokio::time::sleep(RETRY_PAUSE).await;
            }
        }
    }
}

/// A process that runs for the stack.
struct RunningProcess {
    instance: String,
    pid: u32,
    stop: Duration,
}

struct Node {
    bus: Bus,
    name: String,
    process_id: String,
    link: Link,
    confinement: Confinement,
    folder: SessionDir,
    registry: PidRegistry,
    requests: Inbox<Request>,
    exits: mpsc::Receiver<(ProcessId, Exit)>,
    exit_sender: mpsc::Sender<(ProcessId, Exit)>,
    answers: mpsc::Receiver<ReportAnswer>,
    answer_sender: mpsc::Sender<ReportAnswer>,
    lines: mpsc::Sender<(String, String)>,
    running: BTreeMap<ProcessId, RunningProcess>,
    /// Ends that the supervisor has not acknowledged.
    ended: Vec<Ended>,
    starts: u64,
    lease: Duration,
    /// Time of the last report that was answered.
    answered: Option<BootTime>,
    waits_for_answer: bool,
    /// Last reason for a missing answer, to print each reason once.
    last_problem: String,
    _serving: Vec<ServerHandle>,
}

impl Node {
    async fn new(
        bus: Bus,
        name: &str,
        (link, confinement): (Link, Confinement),
        folder: SessionDir,
        registry: PidRegistry,
    ) -> Result<Self, StackError> {
        let (mailbox, requests) = mailbox(role::NODE, CAPACITY);
        let serving = serve(&bus, &mailbox).await?;
        let (exit_sender, exits) = mpsc::channel(CAPACITY);
        let (answer_sender, answers) = mpsc::channel(CAPACITY);
        let (lines, waiting) = mpsc::channel(LINES);
        tokio::spawn(send_lines(bus.clone(), waiting));
        Ok(Self {
            process_id: Context::root().id,
            bus,
            name: name.to_owned(),
            link,
            confinement,
            folder,
            registry,
            requests,
            exits,
            exit_sender,
            answers,
            answer_sender,
            lines,
            running: BTreeMap::new(),
            ended: Vec::new(),
            starts: 0,
            lease: LEASE,
            answered: None,
            waits_for_answer: false,
            last_problem: String::new(),
            _serving: serving,
        })
    }

    /// Serves requests until the supervisor refuses this node for good.
    async fn run(&mut self) -> StackError {
        let mut report_timer = tokio::time::interval(REPORT_PERIOD);
        report_timer.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut cleaner = Cleaner::new(self.folder.path());
        loop {
            tokio::select! {
                _ = report_timer.tick() => self.send_report(),
                Some(request) = self.requests.recv() => self.handle_request(request),
                Some((id, exit)) = self.exits.recv() => {
                    self.process_ended(id, exit);
                    self.send_report();
                }
                Some(answer) = self.answers.recv() => {
                    if let Some(failure) = self.handle_answer(answer) {
                        return failure;
                    }
                }
            }
            self.check_lease();
            cleaner.clean_if_due(|| self.running.values().map(|r| r.instance.clone()).collect());
        }
    }

    /// Sends a report, unless an earlier one is still unanswered.
    fn send_report(&mut self) {
        if std::mem::replace(&mut self.waits_for_answer, true) {
            return;
        }
        let request = self.report();
        let (bus, sender, ended) = (self.bus.clone(), self.answer_sender.clone(), request.ended.len());
        tokio::spawn(async move {
            let sent = BootTime::now();
            let outcome = bus.ask(&keys::JOIN, &request, &Context::root().deadline_in(ANSWER)).await;
            // After the end of the node the answer is of no use.
            let _ = sender.send(ReportAnswer { sent, ended, outcome }).await;
        });
    }

    fn report(&self) -> JoinRequest {
        JoinRequest {
            node: self.name.clone(),
            process_id: self.process_id.clone(),
            pid: std::process::id(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            starts: self.starts,
            running: self.running.values().map(|r| r.instance.clone()).collect(),
            ended: self.ended.clone(),
        }
    }

    /// Handles the answer to a report. Returns an error if the node must stop.
    fn handle_answer(&mut self, answer: ReportAnswer) -> Option<StackError> {
        self.waits_for_answer = false;
        match answer.outcome {
            Ok(reply) => {
                if self.answered.is_none() {
                    self.last_problem.clear();
                    terminal::print_status("joined; press Ctrl-C to leave");
                }
                self.answered = Some(answer.sent);
                self.lease = Duration::from_millis(reply.lease_ms);
                self.ended.drain(..answer.ended.min(self.ended.len()));
                for (_, process) in self.running.iter().filter(|(_, r)| reply.unknown_instances.contains(&r.instance)) {
                    terminal::print_status(&format!("{}: unknown to the supervisor; ended", process.instance));
                    kill(process);
                }
                if !self.ended.is_empty() {
                    self.send_report();
                }
                None
            }
            Err(fault) if matches!(fault.code, Code::NotFound | Code::PermissionDenied | Code::InvalidArgument) => {
                Some(StackError::Refused(fault))
            }
            Err(fault) => {
                let text = fault.to_string();
                if self.answered.is_none() && text != self.last_problem {
                    terminal::print_status(&format!("{text}; retrying"));
                    self.last_problem = text;
                }
                None
            }
        }
    }

    /// Ends all processes once the lease has run out.
    fn check_lease(&mut self) {
        if self.answered.is_some_and(|at| at.elapsed() >= self.lease) {
            self.answered = None;
            let count = self.running.len();
            terminal::print_status(&format!("the stack does not answer; its {count} processes here end"));
            self.running.values().for_each(kill);
        }
    }

    fn handle_request(&mut self, request: Request) {
        // The requester may have given up. The next report says what runs.
        match request {
            Request::Start(request, reply) => {
                let _ = reply.send(self.start(&request));
            }
            Request::Signal(request, reply) => {
                let signal = if request.kill { Signal::SIGKILL } else { Signal::SIGTERM };
                if let Some(process) = self.running.values().find(|r| r.instance == request.instance) {
                    send(process, signal);
                }
                let _ = reply.send(Ok(SignalReply {}));
            }
        }
    }

    fn start(&mut self, request: &StartRequest) -> Result<StartReply, Fault> {
        if self.answered.is_none() {
            return Err(Fault::unavailable("this machine has no lease"));
        }
        if self.running.len() >= PROCESSES {
            return Err(Fault::exhausted(format!("{PROCESSES} processes run here; that is the limit")));
        }
        if request.exec.contains('/') {
            return Err(Fault::invalid(format!("executable `{}`: give a name without a path", request.exec)));
        }
        let executable = ExecutableSearch::here_then_path().find(&request.exec, std::path::Path::new(""));
        let executable = executable.map_err(|e| Fault::not_found(e.to_string()))?;
        let stop = Duration::from_millis(request.stop_ms);
        let params_file = params_file::write(self.folder.path(), &request.instance, &request.params);
        let params_file = params_file.map_err(|e| Fault::internal(format!("parameters cannot be stored: {e}")))?;
        let serving = serve_arguments::ServeArguments {
            session: self.folder.name(),
            role: &request.role,
            instance: &request.instance,
            link: &self.link,
            run_dir: self.folder.path(),
            params_file: &params_file,
            epoch: request.epoch,
            standby: request.standby,
            stop,
        };
        let id = ProcessId(self.starts + 1);
        let env: Vec<_> = request.env.iter().map(|v| (v.name.clone(), v.value.clone())).collect();
        let process = service_rights::Process {
            role: &request.role,
            instance: &request.instance,
            executable: &executable,
            params: &serde_json::from_str(&request.params).map_err(|e| Fault::invalid(format!("parameters: {e}")))?,
            params_file: &params_file,
            env: &env,
            run_dir: self.folder.path(),
            link: &self.link,
            scene: None,
            confinement: &self.confinement,
        };
        let (rights, scratch) = process.prepare().map_err(Fault::internal)?;
        let arguments = serving.arguments();
        let spawn_request = SpawnRequest { id, executable: executable.clone(), arguments, env, rights, scratch };
        let log = Log { instance: request.instance.clone(), lines: self.lines.clone() };
        let pid = spawn::start(spawn_request, log, self.exit_sender.clone())
            .map_err(|e| Fault::internal(format!("{} cannot be started: {e}", executable.display())))?;
        self.starts += 1;
        self.registry.add(pid);
        self.running.insert(id, RunningProcess { instance: request.instance.clone(), pid, stop });
        terminal::print_status(&format!("{}: {}, process {pid}", request.instance, executable.display()));
        Ok(StartReply { pid, number: self.starts, executable: executable.display().to_string() })
    }

    fn process_ended(&mut self, id: ProcessId, exit: Exit) {
        let Some(process) = self.running.remove(&id) else { return };
        self.registry.remove(process.pid);
        params_file::remove(self.folder.path(), &process.instance);
        terminal::print_status(&format!("{}: {}", process.instance, exit.reason));
        self.ended.push(Ended {
            instance: process.instance,
            exited: exit.status.is_some(),
            status: exit.status.unwrap_or(0),
            reason: exit.reason,
        });
    }

    /// Asks all processes to stop, kills the rest, and reports their ends.
    async fn shut_down(mut self) {
        let stop = self.running.values().map(|r| r.stop).max().unwrap_or_default();
        self.running.values().for_each(|r| send(r, Signal::SIGTERM));
        let deadline = tokio::time::Instant::now() + stop;
        let mut killed = false;
        while !self.running.is_empty() {
            match tokio::time::timeout_at(
                deadline + if killed { RETRY_PAUSE } else { Duration::ZERO },
                self.exits.recv(),
            )
            .await
            {
                Ok(Some((id, exit))) => self.process_ended(id, exit),
                Ok(None) => break,
                Err(_) if killed => break,
                Err(_) => {
                    killed = true;
                    self.running.values().for_each(kill);
                }
            }
        }
        // A stack that does not answer learns it from the lease.
        let _ = self.bus.ask(&keys::JOIN, &self.report(), &Context::root().deadline_in(ANSWER)).await;
        self.bus.close().await;
    }
}

fn kill(process: &RunningProcess) {
    send(process, Signal::SIGKILL);
}

fn send(process: &RunningProcess, signal: Signal) {
    if let Err(error) = spawn::signal(process.pid, signal) {
        terminal::print_status(&format!("{signal} could not be sent to {}: {error}", process.instance));
    }
}

async fn serve(bus: &Bus, mailbox: &Mailbox<Request>) -> Result<Vec<ServerHandle>, BusError> {
    let start = |request, _, reply| Request::Start(Box::new(request), reply);
    let signal = |request, _, reply| Request::Signal(request, reply);
    Ok(vec![
        bus.route(&keys::NODE_START, CAPACITY, mailbox, start).await?,
        bus.route(&keys::NODE_SIGNAL, CAPACITY, mailbox, signal).await?,
    ])
}

/// Destination of one process's lines.
#[derive(Clone)]
struct Log {
    instance: String,
    lines: mpsc::Sender<(String, String)>,
}

impl LineSink for Log {
    fn line(&self, line: &str) {
        let end = line.floor_char_boundary(LINE_BYTES);
        // A process that writes too much loses lines, not time.
        let _ = self.lines.try_send((self.instance.clone(), line.get(..end).unwrap_or_default().to_owned()));
    }
}

/// Sends lines to the supervisor, in batches.
async fn send_lines(bus: Bus, mut waiting: mpsc::Receiver<(String, String)>) {
    let mut batch = Vec::new();
    while waiting.recv_many(&mut batch, LINES_AT_ONCE).await > 0 {
        let mut by_instance: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for (instance, line) in batch.drain(..) {
            by_instance.entry(instance).or_default().push(line);
        }
        for (instance, lines) in by_instance {
            // Lost lines show in the stream's sequence numbers.
            let _ = bus.publish(&keys::NODE_LOG, &LogLines { instance, lines }, &Context::root()).await;
        }
    }
}
