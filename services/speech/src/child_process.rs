//! Programs of others as child processes, the one file of this crate that starts any.
//!
//! A child has a deadline, can be cancelled, writes a bounded output, and is killed with its parent. `setpriv` of util-linux asks
//! the kernel for the last one (`PR_SET_PDEATHSIG`). Code between fork and exec would be unsafe Rust.

use std::ffi::{OsStr, OsString};
use std::io::{Read, Write as _};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, killpg};
use nix::unistd::Pid;

use crate::error::SpeechError;

/// Period of checks for a child's end.
const POLL_PERIOD: Duration = Duration::from_millis(2);

/// Most bytes that are read of a child's error output.
const ERROR_BYTES: u64 = 1 << 20;

/// What bounds a piece of work.
#[derive(Debug, Clone)]
pub struct Limits {
    /// When it is given up.
    pub deadline: Instant,
    /// Set by anybody to cancel it.
    pub cancel: Arc<AtomicBool>,
}

impl Limits {
    /// Work of at most this time from now that nobody cancels.
    #[must_use]
    pub fn within(time: Duration) -> Self {
        Self { deadline: Instant::now() + time, cancel: Arc::default() }
    }

    /// Whether it was cancelled.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }
}

/// An installed program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Program {
    name: &'static str,
    path: PathBuf,
    setpriv: PathBuf,
}

impl Program {
    /// Looks for a program in the folders of a search path such as `PATH`.
    ///
    /// # Errors
    /// [`SpeechError::Missing`] with Debian's package.
    pub fn find(name: &'static str, package: &'static str, path: Option<&OsStr>) -> Result<Self, SpeechError> {
        let find = |name| found(name, path);
        let program = find(name).ok_or(SpeechError::Missing { program: name, package })?;
        let setpriv = find("setpriv").ok_or(SpeechError::Missing { program: "setpriv", package: "util-linux" })?;
        Ok(Self { name, path: program, setpriv })
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Runs it to its end with these bytes as its input, and returns at most `most` bytes of its output.
    ///
    /// # Errors
    /// [`SpeechError`]: it does not start, fails, writes more, is late or cancelled. Then it and its children are killed.
    pub fn run(
        &self,
        arguments: &[OsString],
        input: &[u8],
        most: usize,
        limits: &Limits,
    ) -> Result<Vec<u8>, SpeechError> {
        let start =
            |error: std::io::Error| SpeechError::Start { program: self.name.into(), problem: error.to_string() };
        let mut command = Command::new(&self.setpriv);
        command.args(["--pdeathsig", "KILL", "--"]).arg(&self.path).args(arguments);
        // A process group of its own, so that its children end with it. Its words do not depend on the user's language.
        command.process_group(0).env("LC_ALL", "C.UTF-8");
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let began = Instant::now();
        let mut child = command.spawn().map_err(start)?;
        let (to, output, errors) = (child.stdin.take(), child.stdout.take(), child.stderr.take());
        std::thread::scope(|scope| {
            scope.spawn(move || {
                // A child that ends early reads no more; its exit status tells why.
                let _ = to.map(|mut to| to.write_all(input));
            });
            let output = scope.spawn(move || bytes_of(output, most as u64 + 1));
            let errors = scope.spawn(move || bytes_of(errors, ERROR_BYTES));
            let ended = wait(&mut child, limits);
            if !matches!(ended, Ended::Itself(_)) {
                end(&mut child);
            }
            let (output, errors) = (output.join().unwrap_or_default(), errors.join().unwrap_or_default());
            let failed = |problem: String| SpeechError::Failed { program: self.name.into(), problem };
            match ended {
                Ended::Itself(status) if status.success() && output.len() > most => {
                    Err(failed(format!("it wrote more than {most} bytes")))
                }
                Ended::Itself(status) if status.success() => Ok(output),
                Ended::Itself(status) => {
                    let said = String::from_utf8_lossy(&errors).into_owned();
                    let line = said.lines().rfind(|line| !line.trim().is_empty()).unwrap_or_default().trim();
                    let line: String = sg_input::printable(line).chars().take(200).collect();
                    Err(failed(if line.is_empty() { status.to_string() } else { line }))
                }
                Ended::Cancelled => Err(SpeechError::Cancelled),
                Ended::Late => Err(SpeechError::Late { program: self.name.into(), after: began.elapsed() }),
                Ended::Unknown(error) => Err(start(error)),
            }
        })
    }
}

/// A program's path in the folders of a search path.
fn found(name: &str, path: Option<&OsStr>) -> Option<PathBuf> {
    let folders = std::env::split_paths(path?).filter(|folder| folder.is_absolute());
    folders.map(|folder| folder.join(name)).find(|file: &PathBuf| Path::is_file(file))
}

fn bytes_of(from: Option<impl Read>, most: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    if let Some(from) = from {
        let mut from = from.take(most);
        // What was read until an error is what there is.
        let _ = from.read_to_end(&mut bytes);
        // Read on, so that a talkative child does not wait for a reader until its deadline.
        let _ = std::io::copy(&mut from.into_inner(), &mut std::io::sink());
    }
    bytes
}

enum Ended {
    Itself(ExitStatus),
    Late,
    Cancelled,
    Unknown(std::io::Error),
}

fn wait(child: &mut Child, limits: &Limits) -> Ended {
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return Ended::Itself(status),
            Ok(None) if limits.is_cancelled() => return Ended::Cancelled,
            Ok(None) if Instant::now() >= limits.deadline => return Ended::Late,
            Ok(None) => std::thread::sleep(POLL_PERIOD),
            Err(error) => return Ended::Unknown(error),
        }
    }
}

fn end(child: &mut Child) {
    // A process that has just exited needs no kill.
    let _ = killpg(Pid::from_raw(child.id().cast_signed()), Signal::SIGKILL);
    let _ = child.wait();
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    fn shell(script: &str, input: &str, most: usize, limits: &Limits) -> Result<String, String> {
        let shell = Program::find("sh", "dash", std::env::var_os("PATH").as_deref()).unwrap();
        let arguments = ["-c", script].map(OsString::from);
        let output = shell.run(&arguments, input.as_bytes(), most, limits).map_err(|e| e.to_string())?;
        Ok(String::from_utf8(output).unwrap())
    }

    #[test]
    fn a_program_takes_its_input_and_gives_its_output() {
        let limits = Limits::within(LONG);
        assert_eq!(shell("cat", "--version\n$(date)", 100, &limits).unwrap(), "--version\n$(date)");
        assert_eq!(shell("exit 0", &"x".repeat(1 << 20), 0, &limits).unwrap(), "", "it reads nothing");
        assert_eq!(shell("echo no voice >&2; exit 3", "", 9, &limits).unwrap_err(), "sh failed: no voice");
        assert!(shell("exit 3", "", 9, &limits).unwrap_err().contains("exit status: 3"));
        assert_eq!(
            shell("yes | head -c 5000000", "", 99, &limits).unwrap_err(),
            "sh failed: it wrote more than 99 bytes"
        );
    }

    #[test]
    fn a_late_or_cancelled_program_ends_with_its_children() {
        let begun = Instant::now();
        let late = shell("sleep 50 & sleep 50", "", 9, &Limits::within(Duration::from_millis(100))).unwrap_err();
        assert!(late.starts_with("sh was ended at its deadline, after 0."), "{late}");
        let limits = Limits::within(LONG);
        let cancel = Arc::clone(&limits.cancel);
        let canceller = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(100));
            cancel.store(true, Ordering::Relaxed);
        });
        assert_eq!(shell("yes", "", 9, &limits).unwrap_err(), "the work was cancelled");
        canceller.join().unwrap();
        assert!(begun.elapsed() < Duration::from_secs(20));
    }

    #[test]
    fn a_program_is_killed_with_the_thread_that_waits_for_it() {
        // The kernel keeps the request over an exec, so the program can tell it.
        let asks = shell("exec setpriv --dump", "", 1 << 16, &Limits::within(LONG)).unwrap();
        assert!(asks.contains("Parent death signal: KILL"), "{asks}");
    }

    #[test]
    fn a_missing_program_names_its_package() {
        let missing = Program::find("espeak-ng", "espeak-ng", Some(OsStr::new("/no/such/folder"))).unwrap_err();
        assert_eq!(missing.to_string(), "espeak-ng is not installed; on Debian install espeak-ng");
        assert!(Program::find("sh", "dash", None).is_err());
    }
}
