//! Subcommands in other executables, found as git finds its own: beside this one, then on `PATH`.

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::LazyLock;

use serde_json::Value;
use sg_stack::file::ExecutableSearch;
use sg_stack::spawn::tied_to_parent;
use sg_stack::suggestion::suggestion;

use crate::terminal::{CommandResult, Failure};

/// The command table: name, executable, help line. A new command is one row.
const TABLE: [(&str, &str, &str); 8] = [
    ("scene", SCENE, "Show and convert Gaussian files"),
    ("render", "supergaussian-render-node", "Render one picture of a scene"),
    ("selection", "supergaussian-selection", "Cluster a scene and select by strokes"),
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

/// Runs a command with JSON output. Its standard error goes to this process's.
pub(crate) fn json_of(command: &str, arguments: &[&std::ffi::OsStr]) -> Result<Value, Failure> {
    let executable = executable(command, &[])?;
    let output = tied_to_parent(&executable)
        .args(arguments)
        .stdin(Stdio::null())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|e| Failure::Work(format!("{} cannot be started: {e}", executable.display())))?;
    match output.status.code() {
        Some(0) => serde_json::from_slice(&output.stdout)
            .map_err(|e| Failure::Work(format!("`supergaussian {command}` printed no JSON: {e}"))),
        Some(status @ 1..=2) => Err(Failure::Reported(status as u8)),
        _ => Err(Failure::Work(format!("`supergaussian {command}` failed: {}", output.status))),
    }
}
