//! The actor that owns the scene of a session: commands in, events out.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use serde::Deserialize;
use sg_edit::Geometry;
use sg_formats::LoadOptions;
use sg_formats::files::files_of;
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::scene::{
    Changes, ChangesRequest, Command, CommandResult, Event, File, Files, FilesRequest, Measure, MeasureRequest, State,
};
use sg_runtime::actor::{Actor, ActorError, Reply};
use sg_runtime::blobs::{BlobError, Blobs};
use sg_runtime::bus::{Bus, RetainedValue};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{self, Host, ServeArgs, StartError};
use sg_runtime::progress;
use sg_scene::model::Scene;
use supergaussian_scene::journal::JournalError;
use supergaussian_scene::project::{Project, ProjectError};
use tempfile::TempDir;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::OnceCell;
use tokio::task::block_in_place;

use crate::project_folder::ProjectFolder;

/// Capacity of the request queue: edits and a burst of brush strokes.
const QUEUE: usize = 64;
/// The project of a standby process, in its temporary folder.
const SCRATCH_PROJECT: &str = "standby.sgproj";
/// Time limit for the change to the role's project.
const TAKE_OVER_TIMEOUT: Duration = Duration::from_secs(10);
/// Time limit for the question which scene the session shows.
const PRESENT_SCENE_TIMEOUT: Duration = Duration::from_millis(1500);
/// Warnings of a scene file that are logged one by one.
const MAX_LOGGED_WARNINGS: usize = 20;

/// Parameters from the launch file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Params {
    /// The scene file or folder.
    scene: PathBuf,
    /// The project file. It is made if there is none. By default it is the scene's own one in the user's data folder.
    project: Option<PathBuf>,
}

/// Serves the scene of a session until shutdown.
pub(crate) fn serve(args: ServeArgs) -> ExitCode {
    process::run(args, env!("CARGO_PKG_VERSION"), load)
}

async fn load(host: Host) -> Result<(), StartError> {
    if host.role() != role::SCENE {
        return Err(StartError::Input(format!("role `{}`: this executable serves `{}`", host.role(), role::SCENE)));
    }
    turn_file_size_signal_into_error()?;
    let params: Params = host.params()?;
    let (scene, scene_path) = block_in_place(|| read(&params.scene))?;
    let path = match params.project {
        Some(path) => path,
        None => block_in_place(|| default_project(&scene, &scene_path))?,
    };
    progress::current().step();
    let files = Arc::new(FileList { scene: Arc::clone(&scene), path: scene_path.clone(), listed: OnceCell::new() });
    // A standby process works on a temporary project: the active process holds the role's project.
    let (project, scratch) = if host.is_standby() {
        let folder = host.blobs().folder();
        let scratch = tempfile::Builder::new().prefix(".standby").tempdir_in(folder);
        let scratch = scratch.map_err(|e| StartError::Failed(format!("{}: {e}", folder.display())))?;
        let file = scratch.path().join(SCRATCH_PROJECT);
        let project = block_in_place(|| open(&scene, &scene_path, &file))?;
        let geometry = project.editor().state().geometry().clone();
        must_be_the_sessions(host.bus(), &geometry).await?;
        (project, Some(scratch))
    } else {
        (block_in_place(|| open(&scene, &scene_path, &path))?, None)
    };

    let place = std::path::absolute(&path).unwrap_or_else(|_| path.clone()).display().to_string();
    let state = host.bus().retain(&keys::SCENE_STATE, outline(&project, &place)).await?;
    let mut owner = Owner { bus: host.bus().clone(), project, place, state, _scratch: scratch };
    if !host.is_standby() {
        owner.republish_last().await?;
    }
    let (mailbox, _) = host.spawn(owner, QUEUE);
    let promoted = mailbox.clone();
    host.before_promotion(move || async move {
        let project = block_in_place(|| open(&scene, &scene_path, &path))?;
        let deadline = Instant::now() + TAKE_OVER_TIMEOUT;
        Ok(promoted.ask(deadline, |reply| Message::TakeOver { project: Box::new(project), reply }).await?)
    });
    host.route(&keys::SCENE_APPLY, QUEUE, &mailbox, |command, context, reply| Message::Apply {
        command,
        context,
        reply,
    })
    .await?;
    host.route(&keys::SCENE_MEASURE, QUEUE, &mailbox, |request, context, reply| Message::Measure {
        request,
        context,
        reply,
    })
    .await?;
    host.route(&keys::SCENE_CHANGES, QUEUE, &mailbox, |request, context, reply| Message::Changes {
        request,
        context,
        reply,
    })
    .await?;
    let blobs = host.blobs().clone();
    host.serve(&keys::SCENE_FILES, QUEUE, move |_: FilesRequest, _| {
        let (files, blobs) = (Arc::clone(&files), blobs.clone());
        async move { files.offer(&blobs).await }
    })
    .await?;
    host.serve_content(&keys::SCENE_CONTENT).await?;
    Ok(())
}

/// The state without masks, with the path of the role's project.
fn outline(project: &Project, place: &str) -> State {
    State { project_path: place.to_owned(), ..project.editor().message(false) }
}

/// The files of the geometry for readers on other machines; listed at the first request.
struct FileList {
    scene: Arc<Scene>,
    path: String,
    listed: OnceCell<Files>,
}

impl FileList {
    async fn offer(&self, blobs: &Blobs) -> Result<Files, Fault> {
        let listed = self.listed.get_or_try_init(|| std::future::ready(block_in_place(|| self.list(blobs))));
        listed.await.cloned()
    }

    fn list(&self, blobs: &Blobs) -> Result<Files, Fault> {
        let found = files_of(&self.scene, Path::new(&self.path)).map_err(|e| Fault::precondition(e.to_string()))?;
        let offer = |name: String| {
            let (hash, bytes) = blobs.offer(&found.folder.join(&name))?;
            progress::current().step();
            Ok(File { name, bytes, hash })
        };
        let files = found.names.into_iter().map(offer).collect::<Result<_, BlobError>>();
        Ok(Files { open: found.open, files: files.map_err(|e| Fault::precondition(e.to_string()))? })
    }
}

/// Turns a write beyond the file-size limit into an error, as on a full disk. Without this, a signal would end the process.
fn turn_file_size_signal_into_error() -> Result<(), StartError> {
    let kind = SignalKind::from_raw(Signal::SIGXFSZ as i32);
    // Taking the signal is enough; its arrival needs no action.
    signal(kind).map(drop).map_err(|e| StartError::Failed(format!("SIGXFSZ cannot be taken: {e}")))
}

/// The scene's Gaussians and the absolute path of their file.
fn read(path: &Path) -> Result<(Arc<Scene>, String), StartError> {
    let begun = Instant::now();
    let loaded = sg_formats::load(path, &LoadOptions::default()).map_err(|e| StartError::Input(e.to_string()))?;
    for warning in loaded.warnings.iter().take(MAX_LOGGED_WARNINGS) {
        tracing::warn!("{warning}");
    }
    if let Some(more) = loaded.warnings.len().checked_sub(MAX_LOGGED_WARNINGS).filter(|n| *n > 0) {
        tracing::warn!("{more} more warnings; `supergaussian scene info` lists them all");
    }
    let absolute = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf()).display().to_string();
    tracing::info!(scene = absolute, read_ms = begun.elapsed().as_secs_f64() * 1e3, "scene read");
    Ok((Arc::new(loaded.scene), absolute))
}

/// Refuses to take the role with another scene: the other services have loaded the present one.
async fn must_be_the_sessions(bus: &Bus, geometry: &Geometry) -> Result<(), StartError> {
    let context = Context::root().deadline_in(PRESENT_SCENE_TIMEOUT);
    // Without an answer there is no present scene to keep.
    let Ok(present) = bus.newest(&keys::SCENE_STATE, &context).await else { return Ok(()) };
    if present.scene_hash == geometry.hash {
        return Ok(());
    }
    Err(StartError::Input(format!(
        "{}: the session shows another scene, {}; end it first (`supergaussian down`), or show this one beside it \
         (`supergaussian open`)",
        geometry.path, present.scene_path
    )))
}

/// The project of a scene for which the launch file names none.
fn default_project(scene: &Scene, scene_path: &str) -> Result<PathBuf, StartError> {
    let found = ProjectFolder::of_user().and_then(|folder| folder.project_of(scene, Path::new(scene_path)));
    found.map_err(|e| if e.is_input() { StartError::Input(e.to_string()) } else { StartError::Failed(e.to_string()) })
}

fn open(scene: &Arc<Scene>, scene_path: &str, project: &Path) -> Result<Project, StartError> {
    let begun = Instant::now();
    let opened = Project::open(project, Arc::clone(scene), scene_path).map_err(|e| start_error(&e))?;
    let state = opened.editor().state();
    tracing::info!(
        project = %project.display(),
        gaussians = state.count(),
        revision = state.revision(),
        project_ms = begun.elapsed().as_secs_f64() * 1e3,
        "project opened"
    );
    Ok(opened)
}

fn start_error(error: &JournalError) -> StartError {
    if error.is_input() { StartError::Input(error.to_string()) } else { StartError::Failed(error.to_string()) }
}

/// Requests to the owner.
enum Message {
    Apply {
        command: Command,
        context: Context,
        reply: Reply<CommandResult>,
    },
    Changes {
        request: ChangesRequest,
        context: Context,
        reply: Reply<Changes>,
    },
    Measure {
        request: MeasureRequest,
        context: Context,
        reply: Reply<Measure>,
    },
    /// The process was promoted and takes this project.
    TakeOver {
        project: Box<Project>,
        reply: Reply<()>,
    },
}

/// The actor that owns the scene.
struct Owner {
    bus: Bus,
    project: Project,
    /// Absolute path of the role's project.
    place: String,
    state: RetainedValue<State>,
    /// The temporary folder of the project of a standby process.
    _scratch: Option<TempDir>,
}

/// The scene's line in the health report.
#[derive(Debug, Clone)]
struct SceneHealth {
    revision: u64,
    units: usize,
    selected: usize,
}

impl fmt::Display for SceneHealth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { revision, units, selected } = self;
        write!(f, "revision {revision}, {units} editable units, {selected} Gaussians selected")
    }
}

impl Owner {
    /// Republishes the last event: the process may have crashed before publishing it. Readers ignore a repeated event.
    async fn republish_last(&mut self) -> Result<(), StartError> {
        if let Some(event) = self.project.last_event().map_err(|e| start_error(&e))? {
            self.announce(&event, &Context::root()).await;
        }
        Ok(())
    }

    async fn take_over(&mut self, project: Project) -> Result<(), Fault> {
        self.project = project;
        self.state.set(outline(&self.project, &self.place), &Context::root()).await?;
        self.republish_last().await.map_err(|e| Fault::internal(e.to_string()))
    }

    /// Publishes a durable event and the newest state.
    async fn announce(&mut self, event: &Event, context: &Context) {
        let published = self.bus.publish(&keys::SCENE_EVENT, event, &context.next()).await;
        let retained = self.state.set(outline(&self.project, &self.place), &context.next()).await;
        // Readers notice a gap by the revision. A durable change stays, even if its publication failed.
        for fault in [published, retained].into_iter().filter_map(Result::err) {
            tracing::warn!(revision = event.revision, %fault, "an accepted change could not be published");
        }
    }

    async fn apply(&mut self, command: &Command, context: &Context) -> Result<CommandResult, Fault> {
        let outcome = block_in_place(|| self.project.apply(command)).map_err(|error| {
            if let ProjectError::Journal(error) = &error {
                tracing::error!(command = command.id, %error, "a command could not be stored");
            }
            fault(&error)
        })?;
        if let Some(event) = &outcome.event {
            tracing::info!(
                revision = event.revision,
                command = command.id,
                conversation = context.conversation,
                step = context.step,
                "{}",
                event.summary
            );
            self.announce(event, context).await;
        }
        Ok(outcome.result)
    }
}

fn fault(error: &ProjectError) -> Fault {
    let code = error.code();
    let retry_after = (code == Code::Unavailable).then_some(Duration::from_secs(1));
    Fault { retry_after, ..Fault::new(code, error.to_string()) }.with_details(error.details())
}

impl Actor for Owner {
    type Message = Message;
    type State = SceneHealth;

    fn name(&self) -> &'static str {
        "scene"
    }

    fn state(&self) -> SceneHealth {
        let state = self.project.editor().state();
        SceneHealth {
            revision: state.revision(),
            units: state.units().count(),
            selected: state.selection().mask().count(),
        }
    }

    async fn handle(&mut self, message: Message) -> Result<(), ActorError> {
        // A lost reply is no failure: a repeated id finds the stored result.
        match message {
            // An expired request is dropped: its sender has given up or will repeat it.
            Message::Apply { context, .. } | Message::Changes { context, .. } | Message::Measure { context, .. }
                if context.remaining().is_zero() => {}
            Message::Apply { command, context, reply } => {
                let _ = reply.send(self.apply(&command, &context).await);
                if let Err(error) = block_in_place(|| self.project.checkpoint_if_due()) {
                    tracing::warn!(%error, "the state could not be stored; the next start replays more commands");
                }
            }
            Message::Changes { request, reply, .. } => {
                let changes = block_in_place(|| self.project.changes(&request));
                let _ = reply.send(changes.map_err(|error| fault(&ProjectError::Journal(error))));
            }
            Message::Measure { request, reply, .. } => {
                let measured = block_in_place(|| self.project.editor().measure(&request));
                let _ = reply.send(measured.map_err(|error| fault(&ProjectError::Edit(error))));
            }
            Message::TakeOver { project, reply } => {
                let _ = reply.send(self.take_over(*project).await);
            }
        }
        Ok(())
    }
}
