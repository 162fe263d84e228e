//! Subcommands in other executables, found as git finds its own: beside this one, then on `PATH`.

use std::ffi::OsString;
use std::io::{BufRead as _, BufReader, Read as _};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::sync::{LazyLock, mpsc};
use std::time::Duration;

use serde_json::Value;
use sg_stack::file::ExecutableSearch;
use sg_stack::spawn::tied_to_parent;
use sg_stack::suggestion::suggestion;

use crate::terminal::{CommandResult, Failure, print_status};

/// Time between two looks at the window.
pub(crate) const LOOK: Duration = Duration::from_millis(100);

/// The command table: name, executable, help line. A new command is one row.
const TABLE: [(&str, &str, &str); 10] = [
    ("scene", SCENE, "Show and convert Gaussian files"),
    ("render", "supergaussian-render-node", "Render one picture of a scene"),
    ("selection", "supergaussian-selection", "Cluster a scene and select by strokes"),
    ("labeling", "supergaussian-labeling", "Find units by text and describe their looks"),
    ("speech", "supergaussian-speech", "Recognise commands in a sound file, and speak texts"),
    ("fit", "supergaussian-fit", "Turn a volume into an editable scene"),
    ("conformance", "supergaussian-conformance", "Test whether an executable can serve a role"),
    ("eval", "supergaussian-eval", "Make evaluation tables on scenes with known truth"),
    ("backup", SCENE, "Copy a project, also while it is open"),
    ("restore", SCENE, "Make a project from a backup"),
];

/// The executable of the scene. It also knows project files.
const SCENE: &str = "supergaussian-scene";

/// Commands of the table that are subcommands of their executable.
const INNER: [&str; 2] = ["backup", "restore"];

/// Help text for the table.
pub(crate) static HELP: LazyLock<String> = LazyLock::new(|| {
    let rows: Vec<_> = TABLE.iter().map(|(name, _, doc)| format!("  {name:<11} {doc}")).collect();
    format!("Offline, on files (`supergaussian NAME --help`):\n{}\n\nExample: supergaussian demo", rows.join("\n"))
});

/// The executables of all commands.
pub(crate) fn executables() -> impl Iterator<Item = &'static str> {
    TABLE.iter().map(|(_, executable, _)| *executable)
}

/// The executable of a command. `built_in` are the other commands, for a suggestion.
fn executable(name: &str, built_in: &[String]) -> Result<PathBuf, Failure> {
    match TABLE.iter().find(|(command, ..)| *command == name) {
        Some((_, executable, _)) => {
            let found = ExecutableSearch::here_then_path().find(executable, Path::new(""));
            found.map_err(|e| Failure::Work(e.to_string()))
        }
        None => {
            let known = TABLE.iter().map(|(name, ..)| *name).chain(built_in.iter().map(String::as_str));
            Err(Failure::Input(format!("unknown command `{name}`{}", suggestion(name, known))))
        }
    }
}

/// Replaces this process by the executable of a command, with the same streams and exit status.
pub(crate) fn run(words: &[OsString], built_in: &[String]) -> CommandResult {
    let Some((name, arguments)) = words.split_first() else {
        return Err(Failure::Input("no command".to_owned()));
    };
    let name = name.to_string_lossy();
    let executable = executable(&name, built_in)?;
    if INNER.contains(&&*name) {
        return become_program(&executable, "supergaussian", words);
    }
    become_program(&executable, &format!("supergaussian {name}"), arguments)
}

/// Replaces this process by a subcommand of the scene's executable.
pub(crate) fn run_of_scene(words: &[OsString]) -> CommandResult {
    become_program(&executable("scene", &[])?, "supergaussian", words)
}

fn become_program(executable: &Path, name: &str, arguments: &[OsString]) -> CommandResult {
    let error = std::process::Command::new(executable).arg0(name).args(arguments).exec();
    Err(Failure::Work(format!("{} cannot be started: {error}", executable.display())))
}

/// The executable of a command of the table.
pub(crate) fn executable_of(name: &str) -> Result<PathBuf, Failure> {
    executable(name, &[])
}

/// As [`json_of`], with `watch` at each line of standard error that begins with `progress `, and every [`LOOK`] without one.
/// The other lines go to this process's standard error. `None`: `watch` has returned `false`, and the command was ended.
pub(crate) fn json_watched(
    command: &str,
    arguments: &[&std::ffi::OsStr],
    mut watch: impl FnMut(Option<&str>) -> bool,
) -> Result<Option<Value>, Failure> {
    let executable = executable(command, &[])?;
    let fail = |e: &dyn std::fmt::Display| Failure::Work(format!("{} cannot be started: {e}", executable.display()));
    let mut child = tied_to_parent(&executable)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| fail(&e))?;
    let (Some(mut stdout), Some(stderr)) = (child.stdout.take(), child.stderr.take()) else {
        return Err(fail(&"its output is not connected"));
    };
    let results = std::thread::spawn(move || {
        let mut text = Vec::new();
        stdout.read_to_end(&mut text).map(|_| text)
    });
    let (sender, lines) = mpsc::sync_channel(MAX_WAITING_LINES);
    std::thread::spawn(move || {
        for line in BufReader::new(stderr).lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    loop {
        let goes_on = match lines.recv_timeout(LOOK) {
            Ok(line) => match line.strip_prefix("progress ") {
                Some(news) => watch(Some(news)),
                None => {
                    print_status(&line);
                    true
                }
            },
            Err(mpsc::RecvTimeoutError::Timeout) => watch(None),
            Err(mpsc::RecvTimeoutError::Disconnected) => break,
        };
        if !goes_on {
            let _ = child.kill();
            let _ = child.wait();
            return Ok(None);
        }
    }
    let status = child.wait().map_err(|e| fail(&e))?;
    let text = results.join().ok().and_then(Result::ok).unwrap_or_default();
    json(command, status, &text).map(Some)
}

/// Most lines of a command that wait to be read.
const MAX_WAITING_LINES: usize = 64;

/// Runs a command with JSON output. Its standard error goes to this process's.
pub(crate) fn json_of(command: &str, arguments: &[&std::ffi::OsStr]) -> Result<Value, Failure> {
    let executable = executable(command, &[])?;
    let output = tied_to_parent(&executable)
        .args(arguments)
        .stdin(Stdio::null())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|e| Failure::Work(format!("{} cannot be started: {e}", executable.display())))?;
    json(command, output.status, &output.stdout)
}

/// The JSON that a command has printed.
fn json(command: &str, status: ExitStatus, stdout: &[u8]) -> Result<Value, Failure> {
    match status.code() {
        Some(0) => serde_json::from_slice(stdout)
            .map_err(|e| Failure::Work(format!("`supergaussian {command}` printed no JSON: {e}"))),
        Some(status @ 1..=2) => Err(Failure::Reported(status as u8)),
        _ => Err(Failure::Work(format!("`supergaussian {command}` failed: {status}"))),
    }
}
