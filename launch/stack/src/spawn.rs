//! Starting, observing and signalling processes.

use std::io;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::process::{CommandExt as _, ExitStatusExt};
use std::path::PathBuf;
use std::process::{ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use nix::errno::Errno;
use nix::sys::resource::{Resource, getrlimit, setrlimit};
use nix::sys::signal::{Signal, killpg};
use nix::unistd::{Pid, getppid};
use sg_confinement::{ConfinementError, Rights, confine};
use tokio::io::{AsyncBufRead, AsyncBufReadExt, BufReader};
use tokio::process::Command;
use tokio::sync::mpsc;

use crate::log_line::{Level, LogLine};
use crate::reconcile::{Exit, ProcessId};
use crate::{control_group, descendants, service_manager};

/// First argument with which this program runs as the short-lived parent of a service.
pub const BECOME_CHILD: &str = "become-child-of";

/// First argument with which this program outlives the process that started it.
pub const DETACHED: &str = "on-its-own";

/// Longest log line, bytes. The rest of a longer line is dropped.
const MAX_LINE_BYTES: usize = 64 << 10;

/// Environment variable with the rights of a service's process, as JSON. Only the short-lived parent reads it.
const RIGHTS: &str = "SUPERGAUSSIAN_RIGHTS";

/// Most files that a service has open at a time.
const MAX_OPEN_FILES: u64 = 8192;

/// How long to read the output of an ended process. Its children may keep it open.
const LAST_OUTPUT_TIME: Duration = Duration::from_millis(500);

/// A process to start.
#[derive(Debug, Clone)]
pub(crate) struct SpawnRequest {
    pub(crate) id: ProcessId,
    pub(crate) executable: PathBuf,
    pub(crate) arguments: Vec<String>,
    pub(crate) env: Vec<(String, String)>,
    /// Its rights; `None` for those of its user.
    pub(crate) rights: Option<Rights>,
    /// Its folder for temporary files, if its rights are limited.
    pub(crate) scratch: PathBuf,
}

/// A destination for the lines of a service.
pub(crate) trait LineSink: Send + 'static {
    /// Takes one line, without its line break.
    fn line(&self, line: &str);
}

/// A command for a program, such that the kernel kills the program when this process dies.
///
/// The parent-death signal is lost at a fork and kept over an exec. The new process must set it itself. So this program
/// runs first, sets the signal, checks that its parent is alive, and becomes the other program ([`become_child`]).
pub fn tied_to_parent(program: &std::path::Path) -> std::process::Command {
    // Not the path of this program: a newer build may have replaced it.
    let mut command = std::process::Command::new("/proc/self/exe");
    command.arg0("supergaussian").arg(BECOME_CHILD).arg(std::process::id().to_string()).arg(program);
    service_manager::hide_from(&mut command);
    command
}

/// This program, as a command that outlives this process. The new process calls [`close_inherited`] first.
pub fn detached() -> std::process::Command {
    let mut command = std::process::Command::new("/proc/self/exe");
    command.arg0("supergaussian").arg(DETACHED).env_remove(descendants::MARK);
    service_manager::hide_from(&mut command);
    command
}

/// A process that could not become the program of [`tied_to_parent`].
#[derive(Debug, thiserror::Error)]
pub enum BecomeChildError {
    /// The arguments are not those of [`tied_to_parent`].
    #[error("`{BECOME_CHILD}` is for internal use")]
    Arguments,
    /// The kernel refused the parent-death signal.
    #[error("the parent-death signal cannot be set: {0}")]
    DeathSignal(Errno),
    /// The kernel refused a limit of the new process.
    #[error("the limits of a service cannot be set: {0}")]
    Limits(Errno),
    /// The rights in the environment cannot be read.
    #[error("the rights of a service cannot be read: {0}")]
    Rights(serde_json::Error),
    /// The kernel refused the rights.
    #[error("a service cannot be confined: {0}; `confined = false` in its table of the launch file starts it without")]
    Confinement(#[from] ConfinementError),
    /// The parent ended before the signal was set.
    #[error("the parent has ended already")]
    ParentGone,
    /// The program cannot be started.
    #[error("{} cannot be started: {source}", .program.display())]
    Exec {
        /// The program.
        program: PathBuf,
        /// The system's error.
        source: io::Error,
    },
}

/// The new process of [`tied_to_parent`]: becomes the program in the arguments. Returns only on failure.
pub fn become_child(mut arguments: impl Iterator<Item = std::ffi::OsString>) -> BecomeChildError {
    let parent = arguments.next().and_then(|a| a.to_str()?.parse::<i32>().ok());
    let (Some(parent), Some(program)) = (parent, arguments.next()) else {
        return BecomeChildError::Arguments;
    };
    if let Err(error) = nix::sys::prctl::set_pdeathsig(Signal::SIGKILL) {
        return BecomeChildError::DeathSignal(error);
    }
    if getppid() != Pid::from_raw(parent) {
        return BecomeChildError::ParentGone;
    }
    close_inherited();
    if let Err(error) = contain() {
        return BecomeChildError::Limits(error);
    }
    // Before the rights, which leave no way to another group. Without the group the mark still finds the process.
    let _ = std::env::var_os(control_group::GROUP).map(|folder| control_group::enter(&folder));
    if let Some(rights) = std::env::var_os(RIGHTS) {
        match serde_json::from_slice::<Rights>(rights.as_bytes()) {
            // A kernel without Landlock confines nothing. The supervisor has said so.
            Ok(rights) => match confine(&rights) {
                Ok(_) => {}
                Err(error) => return error.into(),
            },
            Err(error) => return BecomeChildError::Rights(error),
        }
    }
    let mut command = std::process::Command::new(&program);
    let source = command.args(arguments).env_remove(RIGHTS).env_remove(control_group::GROUP).exec();
    BecomeChildError::Exec { program: program.into(), source }
}

/// Limits this process and its children: no privileges beyond those of the parent, no core dumps, which could hold keys and
/// take the disk's room, and a bounded number of open files.
fn contain() -> Result<(), Errno> {
    nix::sys::prctl::set_no_new_privs()?;
    setrlimit(Resource::RLIMIT_CORE, 0, 0)?;
    let (soft, hard) = getrlimit(Resource::RLIMIT_NOFILE)?;
    setrlimit(Resource::RLIMIT_NOFILE, soft.min(MAX_OPEN_FILES), hard.min(MAX_OPEN_FILES))
}

/// Closes all descriptors but the standard streams. The bus opens its socket lock without close-on-exec. A service that
/// inherited the lock would outlive the supervisor with it, and block the next supervisor.
pub fn close_inherited() {
    let entries = std::fs::read_dir("/proc/self/fd").into_iter().flatten().flatten();
    let open: Vec<i32> = entries.filter_map(|e| e.file_name().to_str()?.parse().ok()).collect();
    for descriptor in open.into_iter().filter(|d| *d > 2) {
        // The descriptor of this listing is closed already.
        let _ = nix::unistd::close(descriptor);
    }
}

/// Starts a process in its own process group, so that Ctrl-C at the terminal does not reach it. Its end goes to
/// `exits`.
///
/// Call it on a thread that lives as long as the supervisor. The kernel takes the end of that thread for the death of
/// the parent.
///
/// # Errors
/// The system's error.
pub(crate) fn start(
    request: SpawnRequest,
    lines: impl LineSink + Clone,
    exits: mpsc::Sender<(ProcessId, Exit)>,
) -> io::Result<u32> {
    let mark = format!("{}{}", descendants::own_mark(), request.id.0);
    let mut command = tied_to_parent(&request.executable);
    if let Some(rights) = &request.rights {
        command.env(RIGHTS, serde_json::to_string(rights)?).env("TMPDIR", &request.scratch);
    }
    command.args(&request.arguments).envs(request.env).env(descendants::MARK, &mark);
    if let Some(group) = control_group::create(&mark) {
        command.env(control_group::GROUP, group);
    }
    let (pid, ended) = run(command, lines).inspect_err(|_| control_group::end(&mark))?;
    tokio::spawn(async move {
        let exit = ended.await;
        // Before the end is known: a process that is left could hold the service's files.
        let _ = tokio::task::spawn_blocking(move || descendants::end_marked(&mark)).await;
        // Without a supervisor the exit is of no use.
        let _ = exits.send((request.id, exit)).await;
    });
    Ok(pid)
}

/// Starts a command in its own process group. Returns its process id, and a future for its end.
///
/// # Errors
/// The system's error.
pub(crate) fn run(
    command: std::process::Command,
    lines: impl LineSink + Clone,
) -> io::Result<(u32, impl Future<Output = Exit> + Send + 'static)> {
    let mut command = Command::from(command);
    command.process_group(0);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut own = descendants::own();
    let mut child = command.spawn()?;
    let pid = child.id().ok_or_else(|| io::Error::other("the process ended at once"))?;
    own.insert(pid);
    drop(own);
    let last = LastLines::default();
    let streams = [
        child.stdout.take().map(|s| tokio::spawn(read_lines(BufReader::new(s), lines.clone(), last.clone()))),
        child.stderr.take().map(|s| tokio::spawn(read_lines(BufReader::new(s), lines, last.clone()))),
    ];
    let ended = async move {
        let status = child.wait().await;
        descendants::own().remove(&pid);
        // Kill the whole group, with all children of the process.
        let _ = signal(pid, Signal::SIGKILL);
        for stream in streams.into_iter().flatten() {
            let _ = tokio::time::timeout(LAST_OUTPUT_TIME, stream).await;
        }
        describe_exit(status, &last)
    };
    Ok((pid, ended))
}

/// Sends a signal to a process group. A missing process is not an error.
///
/// # Errors
/// The system's error.
pub fn signal(pid: u32, signal: Signal) -> io::Result<()> {
    let pid = i32::try_from(pid).map_err(io::Error::other)?;
    match killpg(Pid::from_raw(pid), signal) {
        Ok(()) | Err(Errno::ESRCH) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// The line that best explains the end of a process: its last error, else its last line.
#[derive(Debug, Clone, Default)]
struct LastLines(Arc<Mutex<(Option<String>, Option<String>)>>);

impl LastLines {
    fn note(&self, line: &str) {
        let parsed = LogLine::parse(line);
        let mut words = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if parsed.level == Level::Error {
            words.0 = Some(parsed.text());
        } else if !parsed.message.trim().is_empty() {
            words.1 = Some(parsed.text());
        }
    }

    fn get(&self) -> Option<String> {
        let words = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        words.0.clone().or_else(|| words.1.clone())
    }
}

async fn read_lines(mut stream: impl AsyncBufRead + Unpin, lines: impl LineSink, last: LastLines) {
    let mut line = Vec::new();
    loop {
        let (taken, whole) = match stream.fill_buf().await {
            // End of the stream, or a read error.
            Ok([]) | Err(_) => break,
            Ok(buffer) => {
                let end = buffer.iter().position(|b| *b == b'\n');
                let part = buffer.get(..end.unwrap_or(buffer.len())).unwrap_or_default();
                let room = MAX_LINE_BYTES.saturating_sub(line.len());
                line.extend_from_slice(part.get(..room.min(part.len())).unwrap_or_default());
                (end.map_or(buffer.len(), |e| e + 1), end.is_some())
            }
        };
        stream.consume(taken);
        if whole {
            forward_line(&mut line, &lines, &last);
        }
    }
    if !line.is_empty() {
        forward_line(&mut line, &lines, &last);
    }
}

fn forward_line(line: &mut Vec<u8>, lines: &impl LineSink, last: &LastLines) {
    let text = String::from_utf8_lossy(line);
    let text = text.trim_end_matches('\r');
    last.note(text);
    lines.line(text);
    line.clear();
}

fn describe_exit(status: io::Result<ExitStatus>, last: &LastLines) -> Exit {
    let status = match status {
        Ok(status) => status,
        Err(error) => return Exit { status: None, reason: format!("cannot be waited for: {error}") },
    };
    let how = match (status.code(), status.signal()) {
        (Some(0), _) => return Exit { status: Some(0), reason: "ended by itself".to_owned() },
        (Some(code), _) => format!("exit status {code}"),
        (None, Some(number)) => {
            let name = Signal::try_from(number).map_or_else(|_| number.to_string(), |s| s.to_string());
            // The output is unrelated to a signal from outside.
            return Exit { status: None, reason: format!("killed by {name}") };
        }
        (None, None) => status.to_string(),
    };
    let reason = last.get().map_or_else(|| how.clone(), |words| format!("{how}: {words}"));
    Exit { status: status.code(), reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Default)]
    struct Kept(Arc<Mutex<Vec<String>>>);

    impl LineSink for Kept {
        fn line(&self, line: &str) {
            self.0.lock().unwrap().push(line.to_owned());
        }
    }

    #[tokio::test]
    async fn lines_are_split_bounded_and_remembered() {
        let (kept, last) = (Kept::default(), LastLines::default());
        let long = "x".repeat(MAX_LINE_BYTES + 10);
        let text =
            format!("one\r\n\n{long}\n{{\"level\":\"ERROR\",\"message\":\"no such file\",\"path\":\"a\"}}\nafter");
        let bytes = [text.as_bytes(), b"\xff\ntail"].concat();
        read_lines(BufReader::new(bytes.as_slice()), kept.clone(), last.clone()).await;
        let lines = kept.0.lock().unwrap();
        assert_eq!(lines.len(), 6);
        assert_eq!(
            (lines[0].as_str(), lines[1].as_str(), lines[2].len(), lines[5].as_str()),
            ("one", "", MAX_LINE_BYTES, "tail")
        );
        assert_eq!(last.get().as_deref(), Some("no such file path=a"));
    }

    #[test]
    fn exit_reason_has_the_last_line() {
        let last = LastLines::default();
        last.note("about to give up");
        let exit = |raw| describe_exit(Ok(ExitStatus::from_raw(raw)), &last);
        assert_eq!(exit(0), Exit { status: Some(0), reason: "ended by itself".into() });
        assert_eq!(exit(3 << 8), Exit { status: Some(3), reason: "exit status 3: about to give up".into() });
        assert_eq!(exit(9), Exit { status: None, reason: "killed by SIGKILL".into() });
    }
}
