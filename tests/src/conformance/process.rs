//! One process of a session, started as a supervisor starts it.

use std::fs::File;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, killpg};
use nix::unistd::Pid;

/// How often an end is looked for.
const GLANCE: Duration = Duration::from_millis(10);

/// A process. Drop kills it and every process that it started.
#[derive(Debug)]
pub(super) struct Process {
    child: Child,
    log: PathBuf,
    pub(super) instance: String,
}

/// How a process ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Ended {
    /// Exit status; absent after a signal.
    pub(super) status: Option<i32>,
}

impl Process {
    /// Starts a command in a process group of its own. The kernel ends it with the thread that calls.
    pub(super) fn start(mut command: Command, instance: &str, log: &Path) -> Result<Self, String> {
        let fail = |e: std::io::Error| format!("{}: {e}", command_name(log));
        let errors = File::create(log).map_err(fail)?;
        let program = command.get_program().display().to_string();
        command.process_group(0).stdin(Stdio::null()).stdout(Stdio::null()).stderr(errors);
        let child = command.spawn().map_err(|e| format!("{program}: {e}"))?;
        Ok(Self { child, log: log.to_owned(), instance: instance.to_owned() })
    }

    /// Sends a signal to the process and every process that it started. A process that is gone needs none.
    pub(super) fn signal(&self, signal: Signal) {
        if let Ok(pid) = i32::try_from(self.child.id()) {
            let _ = killpg(Pid::from_raw(pid), signal);
        }
    }

    /// Its end, awaited for at most this long.
    pub(super) async fn end(&mut self, within: Duration) -> Option<Ended> {
        let deadline = Instant::now() + within;
        loop {
            if let Ok(Some(status)) = self.child.try_wait() {
                return Some(Ended { status: status.code() });
            }
            if Instant::now() >= deadline {
                return None;
            }
            tokio::time::sleep(GLANCE).await;
        }
    }

    /// Kills it without a word and waits until it is gone.
    pub(super) fn kill(mut self) {
        self.put_down();
    }

    fn put_down(&mut self) {
        self.signal(Signal::SIGKILL);
        // The end of a killed process does not take long.
        let _ = self.child.wait();
    }

    /// Kills the process itself and spares its children.
    pub(super) async fn kill_alone(&mut self) {
        // A process that is gone already is as dead as it was to be.
        let _ = self.child.kill();
        let _ = self.end(Duration::from_secs(5)).await;
    }

    /// The last lines it has logged.
    pub(super) fn last_words(&self) -> String {
        let text = std::fs::read(&self.log).unwrap_or_default();
        let text = String::from_utf8_lossy(&text).into_owned();
        let lines: Vec<&str> = text.lines().collect();
        lines.iter().skip(lines.len().saturating_sub(3)).copied().collect::<Vec<_>>().join("\n")
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.put_down();
    }
}

fn command_name(log: &Path) -> String {
    log.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
