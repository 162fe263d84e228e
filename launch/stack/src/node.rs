//! `join`: this machine runs services for a stack of another one.
//!
//! The supervisor asks for processes to be started and signalled; this machine says every second that it is there and what
//! it runs, and ends all of that when it is not answered for its lease: what the supervisor then takes for gone is gone.

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::launch::{Ended, JoinReply, JoinRequest, LogLines, SignalReply, SignalRequest, StartReply, StartRequest};
use sg_runtime::bus::{Bus, BusError, Link, Serving};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::session::SessionDir;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;

use crate::error::StackError;
use crate::file::Search;
use crate::pid_registry::Roster;
use crate::reconcile::{Exit, Incarnation};
use crate::request_queue::{Reply, forward};
use crate::serve_arguments;
use crate::spawn::{self, Lines, Order};
use crate::terminal;

/// How often this machine speaks.
const BEAT: Duration = Duration::from_secs(1);
/// How long an answer may take.
const ANSWER: Duration = Duration::from_millis(1500);
/// Lease until the supervisor has named one.
const LEASE: Duration = Duration::from_secs(5);
/// Pause between two tries to reach a stack that is not there.
const PAUSE: Duration = Duration::from_secs(1);
/// Orders, exits and answers that may wait.
const CAPACITY: usize = 64;
/// Log lines that may wait to be sent; more are dropped, and counted.
const LINES: usize = 4096;
/// Most lines of one message, and bytes of one line.
const LINES_AT_ONCE: usize = 200;
const LINE_BYTES: usize = 8 << 10;
/// Most processes that run at once.
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
}

/// What the supervisor asks for.
enum Asked {
    Start(Box<StartRequest>, Reply<StartReply>),
    Signal(SignalRequest, Reply<SignalReply>),
}

/// An answer to what this machine said, and when it said it.
struct Answer {
    said: Instant,
    /// Ended processes that it had spoken of.
    ended: usize,
    outcome: Result<JoinReply, Fault>,
}

/// Runs services for a stack of another machine, until a signal ends this process.
///
/// # Errors
/// [`StackError`] if the node cannot start, or the supervisor refuses it for good.
pub async fn run(settings: NodeSettings) -> Result<(), StackError> {
    let NodeSettings { session, name, link } = settings;
    let folder = SessionDir::on_node(&session, &name)?;
    folder.create()?;
    let lock = lock(&folder)?;
    let roster = Roster::begin(folder.path()).await?;
    for stale in ["blobs", "scenes"] {
        let path = folder.path().join(stale);
        match std::fs::remove_dir_all(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(StackError::io(&path, error));
            }
            _ => {}
        }
    }
    let watch = |kind| signal(kind).map_err(StackError::Signals);
    let mut interrupt = watch(SignalKind::interrupt())?;
    let mut terminate = watch(SignalKind::terminate())?;
    terminal::tell(&format!("node {name} · session {session} · {}", link.endpoint));
    let reached = tokio::select! {
        bus = reach(&session, &name, &link) => bus,
        _ = interrupt.recv() => return Ok(()),
        _ = terminate.recv() => return Ok(()),
    };
    let mut node = Node::begin(reached, &name, link, folder, roster).await?;
    let outcome = tokio::select! {
        refused = node.run() => Err(refused),
        _ = interrupt.recv() => Ok(()),
        _ = terminate.recv() => Ok(()),
    };
    node.leave().await;
    drop(lock);
    outcome
}

/// One process for one machine's name: the system gives the lock back when it dies.
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

/// Tries until the stack is there.
async fn reach(session: &str, name: &str, link: &Link) -> Bus {
    let instance = keys::node_instance(name);
    let mut told = String::new();
    loop {
        // It is no service of a role that others look for: it is known by its instance alone, for good.
        match Bus::connect_instance(session, role::NODE, &instance, 0, true, link.clone()).await {
            Ok(bus) => return bus,
            Err(error) => {
                let text = error.to_string();
                if text != told {
                    terminal::tell(&format!(
                        "{text}; does the stack run, listen there, and know this machine's authority? trying again every {} s",
                        PAUSE.as_secs()
                    ));
                    told = text;
                }
                tokio::time::sleep(PAUSE).await;
            }
        }
    }
}

/// A process that runs for the stack.
struct Running {
    instance: String,
    pid: u32,
    stop: Duration,
}

struct Node {
    bus: Bus,
    name: String,
    life: String,
    link: Link,
    folder: SessionDir,
    roster: Roster,
    asked: mpsc::Receiver<Asked>,
    exits: mpsc::Receiver<(Incarnation, Exit)>,
    exit_sender: mpsc::Sender<(Incarnation, Exit)>,
    answers: mpsc::Receiver<Answer>,
    answer_sender: mpsc::Sender<Answer>,
    lines: mpsc::Sender<(String, String)>,
    running: BTreeMap<Incarnation, Running>,
    /// Not acknowledged yet.
    ended: Vec<Ended>,
    starts: u64,
    lease: Duration,
    /// When this machine last said something that was answered.
    answered: Option<Instant>,
    waits_for_answer: bool,
    /// What was told last of why it is not answered.
    told: String,
    _serving: Vec<Serving>,
}

impl Node {
    async fn begin(bus: Bus, name: &str, link: Link, folder: SessionDir, roster: Roster) -> Result<Self, StackError> {
        let (sender, asked) = mpsc::channel(CAPACITY);
        let serving = serve(&bus, &sender).await?;
        let (exit_sender, exits) = mpsc::channel(CAPACITY);
        let (answer_sender, answers) = mpsc::channel(CAPACITY);
        let (lines, waiting) = mpsc::channel(LINES);
        tokio::spawn(pass_on(bus.clone(), waiting));
        Ok(Self {
            life: Context::root().id,
            bus,
            name: name.to_owned(),
            link,
            folder,
            roster,
            asked,
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
            told: String::new(),
            _serving: serving,
        })
    }

    /// Runs what is asked for until the supervisor refuses this machine for good.
    async fn run(&mut self) -> StackError {
        let mut beat = tokio::time::interval(BEAT);
        beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                _ = beat.tick() => self.speak(),
                Some(asked) = self.asked.recv() => self.obey(asked),
                Some((incarnation, exit)) = self.exits.recv() => {
                    self.note_end(incarnation, exit);
                    self.speak();
                }
                Some(answer) = self.answers.recv() => {
                    if let Some(failure) = self.take(answer) {
                        return failure;
                    }
                }
            }
            self.keep_lease();
        }
    }

    /// Says that this machine is there and what it runs, unless that was just said and is not answered yet.
    fn speak(&mut self) {
        if std::mem::replace(&mut self.waits_for_answer, true) {
            return;
        }
        let request = self.word();
        let (bus, sender, ended) = (self.bus.clone(), self.answer_sender.clone(), request.ended.len());
        tokio::spawn(async move {
            let said = Instant::now();
            let outcome = bus.ask(&keys::JOIN, &request, &Context::root().deadline_in(ANSWER)).await;
            // Who has left does not care.
            let _ = sender.send(Answer { said, ended, outcome }).await;
        });
    }

    fn word(&self) -> JoinRequest {
        JoinRequest {
            node: self.name.clone(),
            life: self.life.clone(),
            pid: std::process::id(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            starts: self.starts,
            running: self.running.values().map(|r| r.instance.clone()).collect(),
            ended: self.ended.clone(),
        }
    }

    /// Takes an answer. What is returned is no reason to go on.
    fn take(&mut self, answer: Answer) -> Option<StackError> {
        self.waits_for_answer = false;
        match answer.outcome {
            Ok(reply) => {
                if self.answered.is_none() {
                    self.told.clear();
                    terminal::tell("joined; Ctrl-C leaves");
                }
                self.answered = Some(answer.said);
                self.lease = Duration::from_millis(reply.lease_ms);
                self.ended.drain(..answer.ended.min(self.ended.len()));
                for (_, process) in self.running.iter().filter(|(_, r)| reply.strays.contains(&r.instance)) {
                    terminal::tell(&format!("{}: not known to the supervisor; ended", process.instance));
                    kill(process);
                }
                if !self.ended.is_empty() {
                    self.speak();
                }
                None
            }
            Err(fault) if matches!(fault.code, Code::NotFound | Code::PermissionDenied | Code::InvalidArgument) => {
                Some(StackError::Refused(fault))
            }
            Err(fault) => {
                let text = fault.to_string();
                if self.answered.is_none() && text != self.told {
                    terminal::tell(&format!("{text}; trying again"));
                    self.told = text;
                }
                None
            }
        }
    }

    /// Ends what runs once this machine has not been answered for its lease.
    fn keep_lease(&mut self) {
        if self.answered.is_some_and(|at| at.elapsed() >= self.lease) {
            self.answered = None;
            let count = self.running.len();
            terminal::tell(&format!("the stack is away; {count} processes that ran for it end"));
            self.running.values().for_each(kill);
        }
    }

    fn obey(&mut self, asked: Asked) {
        // Whoever asked may have given up; then this machine's next word tells what runs.
        match asked {
            Asked::Start(request, reply) => {
                let _ = reply.send(self.start(&request));
            }
            Asked::Signal(request, reply) => {
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
            return Err(Fault::exhausted(format!("{PROCESSES} processes run here already")));
        }
        if request.exec.contains('/') {
            return Err(Fault::invalid(format!("executable `{}`: a name without a path is looked up", request.exec)));
        }
        let executable = Search::here_then_path().find(&request.exec, std::path::Path::new(""));
        let executable = executable.map_err(|e| Fault::not_found(e.to_string()))?;
        let stop = Duration::from_millis(request.stop_ms);
        let serving = serve_arguments::Serving {
            session: self.folder.name(),
            role: &request.role,
            instance: &request.instance,
            link: &self.link,
            run_dir: self.folder.path(),
            params: &request.params,
            epoch: request.epoch,
            standby: request.standby,
            stop,
        };
        let incarnation = Incarnation(self.starts + 1);
        let order = Order {
            incarnation,
            executable: executable.clone(),
            arguments: serving.arguments(),
            env: request.env.iter().map(|v| (v.name.clone(), v.value.clone())).collect(),
        };
        let log = Log { instance: request.instance.clone(), lines: self.lines.clone() };
        let pid = spawn::start(order, log, self.exit_sender.clone())
            .map_err(|e| Fault::internal(format!("{} cannot be started: {e}", executable.display())))?;
        self.starts += 1;
        self.roster.add(pid);
        self.running.insert(incarnation, Running { instance: request.instance.clone(), pid, stop });
        terminal::tell(&format!("{}: {}, process {pid}", request.instance, executable.display()));
        Ok(StartReply { pid, number: self.starts, executable: executable.display().to_string() })
    }

    fn note_end(&mut self, incarnation: Incarnation, exit: Exit) {
        let Some(process) = self.running.remove(&incarnation) else { return };
        self.roster.remove(process.pid);
        terminal::tell(&format!("{}: {}", process.instance, exit.reason));
        self.ended.push(Ended {
            instance: process.instance,
            exited: exit.status.is_some(),
            status: exit.status.unwrap_or(0),
            reason: exit.reason,
        });
    }

    /// Asks what runs to stop, ends what does not, and says so.
    async fn leave(mut self) {
        let stop = self.running.values().map(|r| r.stop).max().unwrap_or_default();
        self.running.values().for_each(|r| send(r, Signal::SIGTERM));
        let deadline = tokio::time::Instant::now() + stop;
        let mut killed = false;
        while !self.running.is_empty() {
            match tokio::time::timeout_at(deadline + if killed { PAUSE } else { Duration::ZERO }, self.exits.recv())
                .await
            {
                Ok(Some((incarnation, exit))) => self.note_end(incarnation, exit),
                Ok(None) => break,
                Err(_) if killed => break,
                Err(_) => {
                    killed = true;
                    self.running.values().for_each(kill);
                }
            }
        }
        // A stack that is away learns it from the lease.
        let _ = self.bus.ask(&keys::JOIN, &self.word(), &Context::root().deadline_in(ANSWER)).await;
        self.bus.close().await;
    }
}

fn kill(process: &Running) {
    send(process, Signal::SIGKILL);
}

fn send(process: &Running, signal: Signal) {
    if let Err(error) = spawn::signal(process.pid, signal) {
        terminal::tell(&format!("{signal} could not be sent to {}: {error}", process.instance));
    }
}

fn leaving() -> Fault {
    Fault::unavailable("this machine is leaving")
}

async fn serve(bus: &Bus, asked: &mpsc::Sender<Asked>) -> Result<Vec<Serving>, BusError> {
    Ok(vec![
        forward(bus, &keys::NODE_START, asked, |request, reply| Asked::Start(Box::new(request), reply), leaving)
            .await?,
        forward(bus, &keys::NODE_SIGNAL, asked, Asked::Signal, leaving).await?,
    ])
}

/// Where the lines of one process go.
#[derive(Clone)]
struct Log {
    instance: String,
    lines: mpsc::Sender<(String, String)>,
}

impl Lines for Log {
    fn line(&self, line: &str) {
        let end = line.floor_char_boundary(LINE_BYTES);
        // A process that says more than can be sent loses what is too much, not its time.
        let _ = self.lines.try_send((self.instance.clone(), line.get(..end).unwrap_or_default().to_owned()));
    }
}

/// Sends lines to the supervisor, many at once where they come fast.
async fn pass_on(bus: Bus, mut waiting: mpsc::Receiver<(String, String)>) {
    let mut batch = Vec::new();
    while waiting.recv_many(&mut batch, LINES_AT_ONCE).await > 0 {
        let mut by_instance: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for (instance, line) in batch.drain(..) {
            by_instance.entry(instance).or_default().push(line);
        }
        for (instance, lines) in by_instance {
            // Lost lines show in the stream's numbers.
            let _ = bus.publish(&keys::NODE_LOG, &LogLines { instance, lines }, &Context::root()).await;
        }
    }
}
