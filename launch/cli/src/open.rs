//! `open`: a scene or volume in its own window and session.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use sg_runtime::session::SessionDir;
use sg_stack::console::Verbosity;
use sg_stack::file::ExecutableSearch;
use sg_stack::supervisor::{Stack, Supervisor};

use crate::display::has_display;
use crate::input::{GAUSSIANS, Input};
use crate::opener::CommandOpener;
use crate::session_name::session_of;
use crate::shipped::{self, DESKTOP};
use crate::terminal::{self, CommandResult, Failure};
use crate::up::outcome;

#[derive(Debug, clap::Args)]
pub(crate) struct OpenArgs {
    /// Volume or scene
    #[arg(value_name = "VOLUME|SCENE")]
    path: PathBuf,
}

pub(crate) async fn open(arguments: &OpenArgs, session_name: Option<&str>) -> CommandResult {
    open_path(&arguments.path, None, session_name).await
}

/// Opens a scene with one of its projects.
pub(crate) async fn open_project(scene: &Path, project: &Path, session_name: Option<&str>) -> CommandResult {
    open_path(scene, Some(project), session_name).await
}

async fn open_path(path: &Path, project: Option<&Path>, session_name: Option<&str>) -> CommandResult {
    let input = Input::of(Some(path))?;
    if !has_display() {
        return Err(Failure::Work("no window can be opened: DISPLAY is not set".to_owned()));
    }
    // Check all inputs before slow work.
    let search = ExecutableSearch::here_then_path();
    shipped::launch_file(DESKTOP, &[], &search)?;
    let name = session_name.map_or_else(|| session_of(path), |session_name| Ok(session_name.to_owned()))?;
    let session = SessionDir::named(&name)?;
    session.create()?;
    let _lock = lock(&session)?;
    let function = shipped::unpack(session.path(), input.shipped_name())?.transfer_function;
    // The Gaussians must be the same each time, so that earlier edits fit.
    let scene = input.scene(session.path(), function.as_deref(), GAUSSIANS, 0)?;
    let param = |name: &str, path: &Path| {
        format!("service.scene.params.{name}={}", toml::Value::String(path.display().to_string()))
    };
    let mut overrides = vec![param("scene", &scene.path)];
    overrides.extend(project.map(|project| param("project", project)));
    let file = shipped::launch_file(DESKTOP, &overrides, &search)?;
    let stack = Stack {
        file,
        path: PathBuf::from(DESKTOP.0),
        session,
        verbosity: Verbosity::Quiet,
        opener: Box::new(CommandOpener),
    };
    terminal::print_status(&format!("session {name}: a window shows the scene; close it to end"));
    outcome(Supervisor::open(stack).await?.run().await?)
}

/// Locks the session while Gaussians are made, before a supervisor exists.
fn lock(session: &SessionDir) -> Result<File, Failure> {
    let path = session.path().join("open.lock");
    let fail = |e: std::io::Error| Failure::Work(format!("{}: {e}", path.display()));
    let file = File::options().write(true).create(true).truncate(false).open(&path).map_err(fail)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            Err(Failure::Work(format!("it is open already, in session `{}`", session.name())))
        }
        Err(TryLockError::Error(error)) => Err(fail(error)),
    }
}
