//! A stack with its supervisor in a process of its own, which can be killed.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::sys::signal::{Signal, kill, killpg};
use nix::unistd::Pid;
use sg_proto::keys;
use sg_proto::launch::{DownRequest, PsReply, PsRequest};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::process::{ProcessStat, start_time};
use sg_runtime::session::SessionDir;
use tokio::process::{Child, Command};

use crate::terminal::Failure;
use sg_stack::spawn::tied_to_parent;

/// Pause between two checks.
pub(super) const POLL_PERIOD: Duration = Duration::from_millis(10);
/// Longest time for the supervisor's answer before the next attempt.
const ANSWER: Duration = Duration::from_secs(1);
/// Longest time for the stop of a stack.
const STOP_TIME: Duration = Duration::from_secs(60);
/// Longest time that a process may outlive its supervisor. Two seconds are normal; a busy machine takes longer.
const FOLLOW_TIME: Duration = Duration::from_secs(8);

/// A launch file with overrides, and its present supervisor.
pub(super) struct Stack {
    file: PathBuf,
    overrides: Vec<String>,
    session: SessionDir,
    log: PathBuf,
    supervisor: Option<Child>,
}

impl Stack {
    pub(super) fn new(file: PathBuf, overrides: Vec<String>, session: SessionDir, log: PathBuf) -> Self {
        Self { file, overrides, session, log, supervisor: None }
    }

    pub(super) fn session(&self) -> &SessionDir {
        &self.session
    }

    /// Starts the supervisor. Call it on a thread that lives as long as this process.
    pub(super) fn up(&mut self) -> Result<(), Failure> {
        let fail = |e: std::io::Error| Failure::Work(format!("{}: {e}", self.log.display()));
        let log = File::options().create(true).append(true).open(&self.log).map_err(fail)?;
        // Not the path of this program: a newer build may have replaced it.
        let mut command = Command::from(tied_to_parent(Path::new("/proc/self/exe")));
        command.arg("up").arg(&self.file).args(["--session", self.session.name()]);
        for value in &self.overrides {
            command.args(["--set", value]);
        }
        command.process_group(0).stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
        let child = command.spawn().map_err(|e| Failure::Work(format!("the supervisor cannot be started: {e}")))?;
        self.supervisor = Some(child);
        Ok(())
    }

    pub(super) fn supervisor(&self) -> Option<u32> {
        self.supervisor.as_ref().and_then(Child::id)
    }

    /// Returns an error if the supervisor has ended by itself.
    pub(super) fn check(&mut self) -> Result<(), Failure> {
        let ended = match &mut self.supervisor {
            Some(child) => child.try_wait().ok().flatten(),
            None => None,
        };
        match ended {
            None => Ok(()),
            Some(status) => Err(Failure::Work(format!("the supervisor ended ({status}): {}", self.last_log_line()))),
        }
    }

    fn last_log_line(&self) -> String {
        let text = std::fs::read_to_string(&self.log).unwrap_or_default();
        text.lines().last().unwrap_or("it said nothing").trim().to_owned()
    }

    /// Kills the supervisor and waits for its end.
    pub(super) async fn kill_supervisor(&mut self) -> Result<(), Failure> {
        let Some(mut child) = self.supervisor.take() else { return Ok(()) };
        let fail = |e: std::io::Error| Failure::Work(format!("the supervisor cannot be killed: {e}"));
        child.start_kill().map_err(fail)?;
        child.wait().await.map_err(fail)?;
        Ok(())
    }

    /// Stops the stack and waits for the end of its supervisor.
    pub(super) async fn down(&mut self, bus: &Bus) -> Result<(), Failure> {
        let Some(mut child) = self.supervisor.take() else { return Ok(()) };
        bus.ask(&keys::DOWN, &DownRequest {}, &Context::root().deadline_in(STOP_TIME)).await?;
        let status: ExitStatus = tokio::time::timeout(STOP_TIME, child.wait())
            .await
            .map_err(|_| Failure::Work(format!("the stack did not stop within {} s", STOP_TIME.as_secs())))?
            .map_err(|e| Failure::Work(format!("the supervisor cannot be waited for: {e}")))?;
        if status.success() {
            return Ok(());
        }
        Err(Failure::Work(format!("the supervisor ended with {status}: {}", self.last_log_line())))
    }

    /// Kills all remaining processes after a failure.
    pub(super) async fn kill_all(&mut self) {
        // The first failure is the one to report.
        let _ = self.kill_supervisor().await;
        for process in self.processes() {
            let _ = signal(process.pid, Signal::SIGKILL);
        }
    }

    /// All processes of this session, by their arguments.
    pub(super) fn processes(&self) -> Vec<Process> {
        let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
        let pids = entries.filter_map(|e| e.file_name().to_str()?.parse::<u32>().ok());
        pids.filter_map(Process::of).filter(|p| p.serves(self.session.name())).collect()
    }

    /// Waits until these processes are gone. Returns the time, and the processes that stay.
    pub(super) async fn wait_gone(&self, processes: &[Process]) -> (Duration, Vec<Process>) {
        let began = Instant::now();
        loop {
            let left: Vec<_> = processes.iter().filter(|p| p.runs()).cloned().collect();
            if left.is_empty() || began.elapsed() > FOLLOW_TIME {
                return (began.elapsed(), left);
            }
            tokio::time::sleep(POLL_PERIOD).await;
        }
    }
}

/// The services; `None` without an answer of the supervisor.
pub(super) async fn ps(bus: &Bus) -> Option<PsReply> {
    bus.ask(&keys::PS, &PsRequest {}, &Context::root().deadline_in(ANSWER)).await.ok()
}

/// Sends a signal to one process. A missing process is not an error.
pub(super) fn signal(pid: u32, signal: Signal) -> Result<(), Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure::Work(format!("{signal} cannot be sent to process {pid}: {e}"));
    let pid = i32::try_from(pid).map_err(|e| failed(&e))?;
    match kill(Pid::from_raw(pid), signal) {
        Ok(()) | Err(Errno::ESRCH) => Ok(()),
        Err(error) => Err(failed(&error)),
    }
}

/// Sends a signal to a process group, as a terminal does.
pub(super) fn signal_group(leader: u32, signal: Signal) -> Result<(), Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure::Work(format!("{signal} cannot be sent to group {leader}: {e}"));
    let leader = i32::try_from(leader).map_err(|e| failed(&e))?;
    killpg(Pid::from_raw(leader), signal).map_err(|e| failed(&e))
}

/// Whether a signal has stopped a process.
pub(super) fn is_stopped(pid: u32) -> bool {
    ProcessStat::of(pid).is_some_and(|stat| stat.stopped)
}

/// A process, identified by its id and start time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Process {
    pub(super) pid: u32,
    start_time: u64,
    arguments: Vec<String>,
}

impl Process {
    /// `None` for a missing process or a zombie.
    fn of(pid: u32) -> Option<Self> {
        let start_time = start_time(pid)?;
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).ok()?;
        let arguments = line.split(|b| *b == 0).map(|a| String::from_utf8_lossy(a).into_owned()).collect();
        Some(Self { pid, start_time, arguments })
    }

    fn serves(&self, session: &str) -> bool {
        let pairs = self.arguments.windows(2);
        self.arguments.iter().any(|a| a == "serve")
            && pairs.into_iter().any(|pair| matches!(pair, [a, b] if a == "--session" && b == session))
    }

    fn runs(&self) -> bool {
        start_time(self.pid) == Some(self.start_time)
    }
}
