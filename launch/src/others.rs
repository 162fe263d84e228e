//! Commands that other executables carry out, found as git finds its own: beside this one, else on `PATH`.

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use sg_launch::document::suggestion;
use sg_launch::file::Search;

use crate::terminal::{Done, Failure};

/// Command, executable, what it is for.
const TABLE: [(&str, &str, &str); 6] = [
    ("scene", "supergaussian-scene", "Look at and convert Gaussian files"),
    ("render", "supergaussian-render-node", "Draw one picture of a scene"),
    ("selection", "supergaussian-selection", "Cluster a scene, select by strokes"),
    ("fit", "supergaussian-fit", "Turn a volume into an editable scene"),
    ("conformance", "supergaussian-conformance", "Try whether an executable can fill a role"),
    ("eval", "supergaussian-eval", "Evaluation tables on scenes whose truth is known"),
];

/// What the help says about them.
pub(crate) static HELP: LazyLock<String> = LazyLock::new(|| {
    let rows: Vec<_> = TABLE.iter().map(|(name, _, doc)| format!("  {name:<11} {doc}")).collect();
    format!("Offline, on files (`supergaussian NAME --help`):\n{}\n\nExample: supergaussian demo", rows.join("\n"))
});

/// The executable of a command of the table.
pub(crate) fn executable(name: &str) -> Result<PathBuf, Failure> {
    match TABLE.iter().find(|(command, ..)| *command == name) {
        Some((_, executable, _)) => Search::here_then_path().find(executable, Path::new("")).map_err(Failure::Work),
        None => {
            let ours: Vec<_> = crate::cli::commands();
            let known = TABLE.iter().map(|(name, ..)| *name).chain(ours.iter().map(String::as_str));
            Err(Failure::Input(format!("unknown command `{name}`{}", suggestion(name, known))))
        }
    }
}

/// Becomes the executable of a command: its standard streams and exit status are those of this process.
pub(crate) fn run(words: &[OsString]) -> Done {
    let Some((name, arguments)) = words.split_first() else {
        return Err(Failure::Input("no command".to_owned()));
    };
    let name = name.to_string_lossy();
    let executable = executable(&name)?;
    let error = std::process::Command::new(&executable).arg0(format!("supergaussian {name}")).args(arguments).exec();
    Err(Failure::Work(format!("{} cannot be started: {error}", executable.display())))
}
