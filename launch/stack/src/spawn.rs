//! Processes of services: started, listened to, signalled, waited for.

use std::io;
use std::os::unix::process::{CommandExt as _, ExitStatusExt};
use std::path::PathBuf;
use std::process::{ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use nix::errno::Errno;
use nix::sys::signal::{Signal, killpg};
use nix::unistd::{Pid, getppid};
use tokio::io::{AsyncBufRead, AsyncBufReadExt, BufReader};
use tokio::process::Command;
use tokio::sync::mpsc;

use crate::log_line::{Level, LogLine};
use crate::reconcile::{Exit, ProcessId};

/// First argument by which this program knows that it stands between a supervisor and a service for a moment.
pub const BECOME_CHILD: &str = "become-child-of";

/// First argument by which this program knows that it was started to outlive who started it.
pub const DETACHED: &str = "on-its-own";

/// Longest line of a log that is kept whole, bytes.
const MAX_LINE_BYTES: usize = 64 << 10;

/// How long the output of a process that ended is read for what it still holds: a process it left behind may keep it open.
const LAST_OUTPUT_TIME: Duration = Duration::from_millis(500);

/// What is started.
#[derive(Debug, Clone)]
pub(crate) struct SpawnRequest {
    pub(crate) id: ProcessId,
    pub(crate) executable: PathBuf,
    pub(crate) arguments: Vec<String>,
    pub(crate) env: Vec<(String, String)>,
}

/// Where the lines of a service go.
pub(crate) trait LineSink: Send + 'static {
    /// Takes one line, without its end.
    fn line(&self, line: &str);
}

/// A program and its arguments, to be run so that the kernel kills it when this process dies.
///
/// The kernel forgets the pending at a fork and keeps it over an exec, so the new process has to make it itself: this program
/// is run first, makes it, looks whether its parent is still there, and becomes the other one ([`become_child`]).
pub fn tied_to_parent(program: &std::path::Path) -> std::process::Command {
    // Not the path of this program: that may have been replaced by a newer build meanwhile.
    let mut command = std::process::Command::new("/proc/self/exe");
    command.arg0("supergaussian").arg(BECOME_CHILD).arg(std::process::id().to_string()).arg(program);
    command
}

/// This program, to be run so that it outlives this process; its arguments follow. The new process calls [`close_inherited`] first.
pub fn detached() -> std::process::Command {
    let mut command = std::process::Command::new("/proc/self/exe");
    command.arg0("supergaussian").arg(DETACHED);
    command
}

/// The other end of [`tied_to_parent`]: becomes the program named in the arguments. Returns only if it cannot.
pub fn become_child(mut arguments: impl Iterator<Item = std::ffi::OsString>) -> String {
    let parent = arguments.next().and_then(|a| a.to_str()?.parse::<i32>().ok());
    let (Some(parent), Some(program)) = (parent, arguments.next()) else {
        return format!("`{BECOME_CHILD}` is for the supervisor's own use");
    };
    if let Err(error) = nix::sys::prctl::set_pdeathsig(Signal::SIGKILL) {
        return format!("the kernel does not watch the parent: {error}");
    }
    if getppid() != Pid::from_raw(parent) {
        return "the parent is gone already".to_owned();
    }
    close_inherited();
    let error = std::process::Command::new(&program).args(arguments).exec();
    format!("{} cannot be started: {error}", program.display())
}

/// Closes everything but the standard streams. The bus's lock on its socket would pass on to services (it is not opened
/// close-on-exec), outlive the supervisor in what they start, and keep the next supervisor from opening the session.
pub fn close_inherited() {
    let entries = std::fs::read_dir("/proc/self/fd").into_iter().flatten().flatten();
    let open: Vec<i32> = entries.filter_map(|e| e.file_name().to_str()?.parse().ok()).collect();
    for descriptor in open.into_iter().filter(|d| *d > 2) {
        // The descriptor of the listing itself is closed already.
        let _ = nix::unistd::close(descriptor);
    }
}

/// Starts a process in a process group of its own, so that Ctrl-C at the terminal does not reach it before its turn.
/// When it is gone, how it ended goes to `exits`.
///
/// Must be called on a thread that lives as long as the supervisor: the kernel takes the end of the thread that started a
/// process for the death of its parent.
///
/// # Errors
/// What the system said.
pub(crate) fn start(
    request: SpawnRequest,
    lines: impl LineSink + Clone,
    exits: mpsc::Sender<(ProcessId, Exit)>,
) -> io::Result<u32> {
    let mut command = tied_to_parent(&request.executable);
    command.args(&request.arguments).envs(request.env);
    let (pid, ended) = run(command, lines)?;
    tokio::spawn(async move {
        // The receiver lives as long as the supervisor; without it nobody wants to know.
        let _ = exits.send((request.id, ended.await)).await;
    });
    Ok(pid)
}

/// Starts a command in a process group of its own: its process id, and how it ended, to be waited for.
///
/// # Errors
/// What the system said.
pub(crate) fn run(
    command: std::process::Command,
    lines: impl LineSink + Clone,
) -> io::Result<(u32, impl Future<Output = Exit> + Send + 'static)> {
    let mut command = Command::from(command);
    command.process_group(0);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn()?;
    let pid = child.id().ok_or_else(|| io::Error::other("the process was gone at once"))?;
    let last = LastLines::default();
    let streams = [
        child.stdout.take().map(|s| tokio::spawn(read_lines(BufReader::new(s), lines.clone(), last.clone()))),
        child.stderr.take().map(|s| tokio::spawn(read_lines(BufReader::new(s), lines, last.clone()))),
    ];
    let ended = async move {
        let status = child.wait().await;
        // Whatever it started itself goes with it.
        let _ = signal(pid, Signal::SIGKILL);
        for stream in streams.into_iter().flatten() {
            let _ = tokio::time::timeout(LAST_OUTPUT_TIME, stream).await;
        }
        describe_exit(status, &last)
    };
    Ok((pid, ended))
}

/// Sends a signal to a process and whatever it started. A process that is gone is no error.
///
/// # Errors
/// What the system said.
pub fn signal(pid: u32, signal: Signal) -> io::Result<()> {
    let pid = i32::try_from(pid).map_err(io::Error::other)?;
    match killpg(Pid::from_raw(pid), signal) {
        Ok(()) | Err(Errno::ESRCH) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// The line that says best why a process ended: its last error, else its last line.
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
            // Nothing more comes, or nothing more can be read.
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
            // What it said before has nothing to do with a signal that others sent.
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
    fn an_end_is_described_with_the_last_words() {
        let last = LastLines::default();
        last.note("about to give up");
        let exit = |raw| describe_exit(Ok(ExitStatus::from_raw(raw)), &last);
        assert_eq!(exit(0), Exit { status: Some(0), reason: "ended by itself".into() });
        assert_eq!(exit(3 << 8), Exit { status: Some(3), reason: "exit status 3: about to give up".into() });
        assert_eq!(exit(9), Exit { status: None, reason: "killed by SIGKILL".into() });
    }
}
