//! `open`: a scene or volume in its own window and session.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use sg_proto::keys::role;
use sg_runtime::bus::Bus;
use sg_runtime::session::SessionDir;
use sg_stack::console::Verbosity;
use sg_stack::file::ExecutableSearch;
use sg_stack::reconcile::Outcome;
use sg_stack::supervisor::{Stack, Supervisor};

use crate::display::has_display;
use crate::input::{Input, Scene, VolumeOptions};
use crate::opener::CommandOpener;
use crate::opening_window::OpeningWindow;
use crate::session_name::session_of;
use crate::shipped::{self, DESKTOP};
use crate::terminal::{self, CommandResult, Failure};
use crate::up::outcome;

#[derive(Debug, clap::Args)]
pub(crate) struct OpenArgs {
    /// Volume, scene or project
    #[arg(value_name = "VOLUME|SCENE|PROJECT")]
    path: PathBuf,
    #[command(flatten)]
    volume: VolumeOptions,
}

pub(crate) async fn open(arguments: &OpenArgs, session_name: Option<&str>) -> CommandResult {
    open_path(&arguments.path, None, &arguments.volume, session_name).await
}

/// Opens a scene or a volume with one of its projects, by default its own one.
pub(crate) async fn open_path(
    path: &Path,
    project: Option<&Path>,
    options: &VolumeOptions,
    session_name: Option<&str>,
) -> CommandResult {
    let input = Input::of(Some(path))?;
    let project = if let Input::Project(own) = &input { Some(own.as_path()) } else { project };
    if !has_display() {
        return Err(Failure::Work("no window can be opened: DISPLAY is not set".to_owned()));
    }
    // Check all inputs before slow work.
    let search = ExecutableSearch::here_then_path();
    shipped::launch_file(DESKTOP, &[], &search)?;
    let name = session_name.map_or_else(|| session_of(path), |session_name| Ok(session_name.to_owned()))?;
    let session = SessionDir::named(&name)?;
    let is_new = !session.path().exists();
    session.create()?;
    let lock = Lock::take(&session)?;
    // The fit and the services take seconds, and a person who has opened a file by a click sees no terminal.
    let mut window = OpeningWindow::open(path);
    let scene = match scene_of(&input, options, &mut window) {
        Ok(Some(scene)) => scene,
        Ok(None) => {
            lock.remove(is_new);
            return cancelled();
        }
        Err(refused) => {
            lock.remove(is_new);
            return Err(refused);
        }
    };
    let param = |service: &str, name: &str, path: &Path| {
        format!("service.{service}.params.{name}={}", toml::Value::String(path.display().to_string()))
    };
    let mut overrides = vec![param("scene", "scene", &scene.path)];
    overrides.extend(project.map(|project| param("scene", "project", project)));
    // A volume's scene lies in a folder of the program's own, so the window gets the user's file too. Of a project that folder's
    // file would be the name.
    let is_kept = project.is_some() && path.file_name().is_some_and(|name| name == "scene.toml");
    overrides
        .extend(std::path::absolute(path).iter().filter(|_| !is_kept).map(|file| param("render-view", "file", file)));
    let file = shipped::launch_file(DESKTOP, &overrides, &search)?;
    let (folder, endpoint) = (session.path().to_owned(), session.endpoint());
    let stack = Stack {
        file,
        path: PathBuf::from(DESKTOP.0),
        session,
        verbosity: Verbosity::Quiet,
        opener: Box::new(CommandOpener),
    };
    terminal::print_status(&format!("session {name}: a window shows the scene; close it to end"));
    let supervisor = Supervisor::open(stack).await?;
    let handle = supervisor.handle();
    let opening = tokio::spawn(async move {
        let Ok(bus) = Bus::connect(&name, role::CLI, &endpoint).await else { return false };
        let is_cancelled = window.until_shown(&bus).await;
        if is_cancelled {
            handle.down();
        }
        is_cancelled
    });
    let ended = supervisor.run().await?;
    if opening.is_finished() && opening.await.unwrap_or(false) {
        if is_new {
            let _ = std::fs::remove_dir_all(folder);
        }
        return cancelled();
    }
    if is_new && is_of_wrong_input(&ended) {
        // The error says all that its logs do. Left over, they only take disk space.
        let _ = std::fs::remove_dir_all(folder);
    }
    outcome(ended)
}

/// Whether a service could not use its input, by its exit status: such a session never showed anything.
fn is_of_wrong_input(ended: &Outcome) -> bool {
    matches!(ended, Outcome::Failed { reason, .. } if reason.starts_with("exit status 2"))
}

/// The result after a person has cancelled.
fn cancelled() -> CommandResult {
    terminal::print_status("cancelled; nothing was opened");
    Ok(())
}

fn scene_of(input: &Input, options: &VolumeOptions, window: &mut OpeningWindow) -> Result<Option<Scene>, Failure> {
    let shipped = tempfile::tempdir().map_err(|e| Failure::Work(format!("no temporary folder: {e}; set TMPDIR")))?;
    let function = shipped::unpack(shipped.path(), input.shipped_name())?.transfer_function;
    input.kept_scene(function.as_deref(), options, window)
}

/// The lock on a session while Gaussians are made, before a supervisor exists. The system frees it at the end of the
/// process.
struct Lock {
    _file: File,
    path: PathBuf,
}

impl Lock {
    fn take(session: &SessionDir) -> Result<Self, Failure> {
        let path = session.path().join("open.lock");
        let fail = |e: std::io::Error| Failure::Work(format!("{}: {e}", path.display()));
        let file = File::options().write(true).create(true).truncate(false).open(&path).map_err(fail)?;
        match file.try_lock() {
            Ok(()) => Ok(Self { _file: file, path }),
            Err(TryLockError::WouldBlock) => {
                Err(Failure::Work(format!("it is open already, in session `{}`", session.name())))
            }
            Err(TryLockError::Error(error)) => Err(fail(error)),
        }
    }

    /// Removes what a refused command has made: the lock's file, and the session's folder if that is new and empty.
    fn remove(self, folder_too: bool) {
        // Left over, they only take disk space.
        let _ = std::fs::remove_file(&self.path);
        if let Some(folder) = self.path.parent().filter(|_| folder_too) {
            let _ = std::fs::remove_dir(folder);
        }
    }
}
