//! `up`, `check` and `graph`: commands on a launch file.

use std::path::{Path, PathBuf};

use sg_proto::launch::ReloadRequest;
use sg_runtime::session::SessionDir;
use sg_stack::file::{self, LaunchFile, Restart, Service};
use sg_stack::reconcile::Outcome;

use crate::certificate_expiry::check_expiry;
use crate::opener::CommandOpener;
use crate::reload;
use crate::terminal::{self, CommandResult, Failure, columns};
use sg_stack::console::Verbosity;
use sg_stack::supervisor::{Stack, Supervisor};

/// A launch file with overrides.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct FileArgs {
    /// Launch file
    #[arg(value_name = "FILE")]
    path: PathBuf,
    /// Override a value of the file, such as service.scene.stop=2; repeatable
    #[arg(long = "set", value_name = "A.B=C")]
    overrides: Vec<String>,
}

impl FileArgs {
    /// A launch file as it is.
    pub(crate) fn of(path: &Path) -> Self {
        Self { path: path.to_owned(), overrides: Vec::new() }
    }

    /// Reads the launch file.
    pub(crate) fn load(&self) -> Result<LaunchFile, Failure> {
        launch_file(&self.path, &self.overrides, &[])
    }
}

#[derive(Debug, clap::Args)]
pub(crate) struct UpArgs {
    #[command(flatten)]
    file: FileArgs,
    /// Start only these services
    #[arg(long, value_delimiter = ',', value_name = "A,B")]
    only: Vec<String>,
    /// Print warnings and failures only
    #[arg(long)]
    quiet: bool,
}

/// Reads a launch file.
fn launch_file(path: &Path, overrides: &[String], only: &[String]) -> Result<LaunchFile, Failure> {
    file::load(path, overrides, only).map_err(|e| Failure::Mistakes(e.report()))
}

/// The session of a launch file: from the command line, from the file, or after the file's name.
fn session(session_name: Option<&str>, file: &LaunchFile, path: &Path) -> Result<SessionDir, Failure> {
    let stem = || {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        stem.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' }).collect::<String>()
    };
    let name = session_name.map(str::to_owned).or_else(|| file.name.clone()).unwrap_or_else(stem);
    Ok(SessionDir::named(&name)?)
}

pub(crate) async fn up(arguments: &UpArgs, session_name: Option<&str>) -> CommandResult {
    let FileArgs { path, overrides } = &arguments.file;
    let file = launch_file(path, overrides, &arguments.only)?;
    let session = session(session_name, &file, path)?;
    if let Some(listen) = &file.listen {
        check_expiry([listen.authority.as_path(), listen.certificate.as_path()])?;
    }
    let path = std::path::absolute(path).unwrap_or_else(|_| path.clone());
    if session.is_running() {
        let request = ReloadRequest {
            launch_file: path.display().to_string(),
            overrides: overrides.clone(),
            only: arguments.only.clone(),
        };
        return reload::reload(&session, request, file.name.as_deref()).await;
    }
    let verbosity = if arguments.quiet { Verbosity::Quiet } else { Verbosity::Full };
    outcome(
        Supervisor::open(Stack { file, path, session, verbosity, opener: Box::new(CommandOpener) })
            .await?
            .run()
            .await?,
    )
}

/// Result of the command at the end of its stack.
pub(crate) fn outcome(outcome: Outcome) -> CommandResult {
    match outcome {
        Outcome::Down | Outcome::Finished => Ok(()),
        Outcome::Failed { service, reason } => Err(Failure::Work(format!("service `{service}` failed: {reason}"))),
    }
}

pub(crate) fn check(arguments: &FileArgs) -> CommandResult {
    let file = arguments.load()?;
    let session = session(None, &file, &arguments.path)?;
    let names: Vec<_> = file.services.iter().map(|s| s.name.as_str()).collect();
    terminal::print_line(&format!(
        "{}: valid; session {}, {} services, start order: {}",
        arguments.path.display(),
        session.name(),
        names.len(),
        names.join(", ")
    ));
    Ok(())
}

pub(crate) fn graph(arguments: &FileArgs, dot: bool) -> CommandResult {
    let file = arguments.load()?;
    let lines = if dot { graphviz(&file) } else { table(&file) };
    for line in lines {
        terminal::print_line(&line);
    }
    Ok(())
}

fn graphviz(file: &LaunchFile) -> Vec<String> {
    let mut lines = vec!["digraph stack {".to_owned(), "  rankdir = LR; node [shape = box];".to_owned()];
    for service in &file.services {
        let bold = if service.policy.critical { ", style = bold" } else { "" };
        let role = if service.role == service.name { String::new() } else { format!("\\n({})", service.role) };
        lines.push(format!("  \"{0}\" [label = \"{0}{role}\"{bold}];", service.name));
        for on in &service.after {
            lines.push(format!("  \"{on}\" -> \"{}\" [label = \"ready\"];", service.name));
        }
    }
    lines.push("}".to_owned());
    lines
}

fn table(file: &LaunchFile) -> Vec<String> {
    let mut rows =
        vec![["SERVICE", "ROLE", "EXECUTABLE", "ON", "AFTER", "RESTART", "CRITICAL"].map(str::to_owned).to_vec()];
    rows.extend(file.services.iter().map(row));
    columns(&rows)
}

fn row(service: &Service) -> Vec<String> {
    let dash = |text: String| if text.is_empty() { "-".to_owned() } else { text };
    let restart = match service.policy.restart {
        Restart::Always => "always",
        Restart::OnFailure => "on-failure",
        Restart::Never => "never",
    };
    let critical = if service.policy.critical { "yes" } else { "-" };
    vec![
        service.name.clone(),
        service.role.clone(),
        service.start.exec.clone(),
        dash(service.start.node.clone().unwrap_or_default()),
        dash(service.after.join(", ")),
        restart.to_owned(),
        critical.to_owned(),
    ]
}
